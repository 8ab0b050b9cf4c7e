"""The check of a decision on held-out motion: withdrawn, doubted, or searched again over long windows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.decision.wrong_robot import refuse_wrong_robot
from hdagen.diagnosis.holdout.contradicting_holdout import find_contradiction
from hdagen.diagnosis.holdout.holdout_check import HoldoutJudge, SettledStatement, choose_decision
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.long_horizon import LastingEffects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.data_table import LogError

LastingFinder = Callable[[SearchResult, Arm, LogPortion, float, Sequence[DirectEvidence]], LastingEffects | None]


@dataclass(frozen=True, eq=False)
class CheckedVerdict:
    """A verdict after its check on held-out motion.

    Attributes:
        settled: the statement that stays, with its doubts.
        direct_evidence: the effects with direct evidence, whether the verdict names them or not.
        contradiction: of diagnosis.json: how the hold-out contradicts the log; None where it does not.
        motion: the held-out motion on which the gap is measured.
        failures: a sentence for each stage that was left out.

    """

    settled: SettledStatement
    direct_evidence: tuple[DirectEvidence, ...]
    contradiction: Mapping[str, Any] | None
    motion: HoldoutMotion
    failures: tuple[str, ...]


def check_on_holdout(
    models: Models,
    data: PreparedData,
    search: SearchResult,
    scores: Decision,
    direct: Sequence[DirectEvidence],
    unseen: HoldoutMotion,
    budget: TimeBudget,
    on_stage: StageListener,
    find_lasting: LastingFinder,
) -> CheckedVerdict:
    """Check a decision on held-out motion.

    Hold-out logs are split in halves: one decides which effects stand, the gap is measured on the other.

    Args:
        models: of the robot.
        data: of the diagnosis.
        search: the result of the search.
        scores: the decision by the fitted motion.
        direct: effects with direct evidence.
        unseen: the held-out motion.
        budget: the time of the diagnosis.
        on_stage: receives each stage as it begins.
        find_lasting: finds effects over long windows, as `find_lasting_effects` does.

    Returns:
        The verdict that the motion confirms.

    Raises:
        LogError: the log says that the robot file is another machine's.
        PlantError: a model cannot be simulated.

    """
    attempts = Attempts(budget)
    scores = _check_robot(scores, data, budget)
    contradiction, judged, measured = None, unseen, unseen
    if data.holdout:
        judged, measured = unseen.split_in_halves()
        compare = partial(find_contradiction, models.nominal, scores, data.fitted, data.replay_fitted, unseen)
        contradiction = attempts.attempt("whether the hold-out is of this machine", compare, None)
    judge = HoldoutJudge(models.nominal, models.full, search, direct, judged)
    on_stage(Stage.HOLDOUT)
    if contradiction:
        settled = judge.withhold_verdict(scores, measured)
    else:
        find = partial(find_lasting, search, models.full, data.fitted, data.window, direct)
        search_long = partial(_search_long_windows, find, attempts, on_stage)
        settled = judge.settle_decision(
            _check_robot(choose_decision(scores, judge, search_long), data, budget), measured
        )
    return CheckedVerdict(settled, tuple(direct), contradiction, measured, tuple(attempts.failures))


def _check_robot(decision: Decision, data: PreparedData, budget: TimeBudget) -> Decision:
    """Return the decision. Raise LogError where it surely says that the robot file is another machine's; not where the
    time is up, as what was not tried may explain the log."""
    if decision.is_unknown or budget.is_up:
        return decision
    if (refused := refuse_wrong_robot(decision.best)) and not _may_be_right_file(decision):
        raise LogError([f"{data.logs[0].source}: {refused}"])
    return decision


def _may_be_right_file(decision: Decision) -> bool:
    """Whether other hypotheses, with which the robot file can be right, hold too much probability for a refusal to be
    sure. Beside something unknown it can always be right."""
    fits = [h for h in decision.hypotheses if h.fit is not None and refuse_wrong_robot(h.fit) is None]
    unknown = [h for h in decision.hypotheses if h.is_unknown]
    return sum(h.probability for h in (*fits, *unknown)) > DECISION.sure_below


def _search_long_windows(
    find: Callable[[], LastingEffects | None], attempts: Attempts, on_stage: StageListener, decision: Decision
) -> Decision | None:
    """The decision with the effects of long windows; None where these show none."""
    on_stage(Stage.LONG_HORIZON)
    lasting = attempts.attempt_in_time("the search over long windows", find, None)
    return lasting.reweigh_decision(decision) if lasting else None
