"""From robot file and logs to a diagnosis, stage by stage."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from hdagen.diagnosis.data.models import load_models
from hdagen.diagnosis.data.prepared_data import prepare_data
from hdagen.diagnosis.decision.direct_evidence import find_direct_evidence
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.diagnosis_content import describe_diagnosis
from hdagen.diagnosis.explanation import explain_verdict
from hdagen.diagnosis.holdout.unseen_motion import measure_without_effects
from hdagen.diagnosis.judged_search import JudgedSearch, SearchJudge, judge_with_numbers
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.search.effect_search import search_effects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.null_model import fit_null_model
from hdagen.diagnosis.search.stored_searches import Searches
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage, StageListener, ignore_stage
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.measured_log import Log


def diagnose(
    robot: str | Path,
    logs: Sequence[Log],
    holdout: Sequence[Log] = (),
    *,
    on_stage: StageListener | None = None,
    budget: TimeBudget | None = None,
) -> Diagnosis:
    """Diagnose logs of one machine together.

    Args:
        robot: a preset or a robot.toml.
        logs: logs of the machine.
        holdout: other motions of the machine. Every other second of them decides which effects stand, and the gap is
            measured on the rest. Without them both happen on blocks that the fit does not use, a fifth of each log.
        on_stage: receives each stage as it begins, from any thread.
        budget: the time that it may take; where that is up, the best until then is stated, and is not sure.

    Returns:
        The diagnosis.

    Raises:
        LogError: a log cannot carry a diagnosis.
        TimeUpError: the time was up before the null model was fitted.
        PlantError: a model cannot be loaded or simulated.

    """
    from threadpoolctl import threadpool_limits  # changes the environment when it is imported

    with threadpool_limits(1):  # small matrices by the hundred, beside threads of our own; and the same bits everywhere
        return _run_stages(robot, logs, holdout, budget or TimeBudget(), on_stage or ignore_stage)


def _run_stages(
    robot: str | Path, logs: Sequence[Log], holdout: Sequence[Log], budget: TimeBudget, on_stage: StageListener
) -> Diagnosis:
    on_stage(Stage.MODELS)
    models = load_models(robot)
    on_stage(Stage.DATA)
    begun = budget.passed
    data = prepare_data(models, logs, holdout)
    on_stage(Stage.DIRECT_EVIDENCE)
    direct = find_direct_evidence(models.full, data.record)
    on_stage(Stage.NULL_MODEL)
    null = fit_null_model(models.full, data.record, budget)
    budget.require_time("the fit without effects")
    budget.keep_for_statement(budget.passed - begun)  # replays and the page take about as long
    with ThreadPoolExecutor(1) as beside:  # the search leaves half a core idle
        unseen = beside.submit(measure_without_effects, models, data, null.fit)
        search = search_effects(models, data, null, on_stage)
    judge = SearchJudge(models, data, direct, unseen.result(), budget, on_stage)
    attempts = Attempts(budget)
    numbers = _NumberSearch(judge, attempts)
    found = judge_with_numbers(judge.judge_search, search, numbers.search_again)
    searches = Searches(null.fit, search, numbers.found)
    search, checked = found.search, found.checked
    explained = explain_verdict(models, data, checked, budget, on_stage)

    failures = (*found.failures, *attempts.failures, *explained.failures)
    statement = checked.settled.statement
    result = DiagnosisResult(
        search=search,
        searches=searches,
        decision=statement.decision,
        content=describe_diagnosis(models, data, search, checked, explained, failures),
        holdout=checked.motion,
        after=statement.confirmed.after,
        residual_torque=explained.residual_torque,
        failures=failures,
    )
    return Diagnosis(result, robot, _list_sources(data.logs), _list_sources(data.holdout))


@dataclass(eq=False)
class _NumberSearch:
    """The search with the robot file's numbers among the causes; ``found`` is its result, once it has run."""

    judge: SearchJudge
    attempts: Attempts
    found: SearchResult | None = None

    def search_again(self, verdict: Sequence[str] | None) -> JudgedSearch | None:
        """Search, and judge; None where that fails, or takes too long. Springs in rigid joints, which take most of the
        time, are searched again only where they stand in the first ``verdict``, or where there was none."""
        models, data, on_stage = self.judge.models, self.judge.data, self.judge.on_stage
        budget, stage = self.attempts.budget, "the search for wrong numbers of the robot file"
        springs = models.full.effects.series_springs
        may_have_springs = verdict is None or any(name.partition("@")[0] in springs for name in verdict)

        def search_and_judge() -> JudgedSearch | None:
            null = fit_null_model(models.full, data.record, budget, with_numbers=True)
            search = search_effects(models, data, null, on_stage, may_have_springs)
            if budget.is_left_out(stage):
                return None
            self.found = search
            return self.judge.judge_search(search)

        return self.attempts.attempt_in_time(stage, search_and_judge, None)


def _list_sources(logs: Sequence[Log]) -> tuple[str, ...]:
    """The paths of logs."""
    return tuple(log.source for log in logs)
