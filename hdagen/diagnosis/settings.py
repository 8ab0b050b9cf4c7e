"""The settings of every stage of a diagnosis, as diagnosis.json and the documents have them."""

from __future__ import annotations

from typing import Any

from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.input_check_settings import INPUT_CHECK
from hdagen.data_quality.log_repair_settings import LOG_REPAIR
from hdagen.data_quality.ripple_line_settings import RIPPLE_LINE
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.direct_evidence_settings import DIRECT_EVIDENCE
from hdagen.diagnosis.holdout.baseline_settings import BASELINE
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.fit_settings import FIT
from hdagen.diagnosis.inference.likelihood_settings import LIKELIHOOD
from hdagen.diagnosis.initialization.encoder_regression_settings import ENCODER_REGRESSION
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.long_horizon_settings import LONG_HORIZON
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.residuals.controller_impact_settings import CONTROLLER_IMPACT
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.diagnosis.search.null_model_settings import NULL_MODEL
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.prediction.prediction_settings import PREDICTION
from hdagen.support.setting_declaration import read_values

STAGE_SETTINGS: dict[str, Any] = {
    "channel_checks": CHANNEL_CHECK,
    "input_checks": INPUT_CHECK,
    "log_repair": LOG_REPAIR,
    "ripple_lines": RIPPLE_LINE,
    "prediction": PREDICTION,
    "data_and_holdout": DATA,
    "candidate_models": CANDIDATES,
    "likelihood": LIKELIHOOD,
    "initialization": INITIALIZATION,
    "encoder_regression": ENCODER_REGRESSION,
    "direct_evidence": DIRECT_EVIDENCE,
    "null_model": NULL_MODEL,
    "fit": FIT,
    "search": SEARCH,
    "scores": DECISION,
    "holdout_check": HOLDOUT_CHECK,
    "nonparametric_baseline": BASELINE,
    "long_horizon": LONG_HORIZON,
    "explanation": EXPLANATION,
    "controller_impact": CONTROLLER_IMPACT,
    "report": REPORT,
}


def record_settings() -> dict[str, dict[str, Any]]:
    """Record every setting of a diagnosis.

    Returns:
        Each value by its name, in its stage; `settings` of diagnosis.json.

    """
    return {stage: read_values(settings) for stage, settings in STAGE_SETTINGS.items()}
