"""From robot file and logs to a diagnosis, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hdagen.diagnosis.checked_verdict import CheckedVerdict, check_on_holdout
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.models import Models, load_models
from hdagen.diagnosis.data.prepared_data import PreparedData, prepare_data
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence, find_direct_evidence
from hdagen.diagnosis.decision.posterior import score_hypotheses
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.diagnosis_content import describe_diagnosis
from hdagen.diagnosis.explanation import explain_verdict
from hdagen.diagnosis.holdout.long_window_prediction import predict_long_windows
from hdagen.diagnosis.holdout.small_effects import is_gap_alike
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion, measure_without_effects
from hdagen.diagnosis.holdout.verdict_withdrawal import is_at_bound
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.search.effect_search import search_effects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.null_model import fit_null_model
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage, StageListener, ignore_stage
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.data_table import LogError
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
    judge = partial(_judge_search, models, data, direct, unseen.result(), budget, on_stage)
    attempts = Attempts(budget)
    search_numbers = partial(_search_wrong_numbers, models, data, judge, attempts, on_stage)
    found = _judge_with_numbers(judge, search, search_numbers)
    search, checked = found.search, found.checked
    explained = explain_verdict(models, data, checked, budget, on_stage)

    failures = (*found.failures, *attempts.failures, *explained.failures)
    statement = checked.settled.statement
    result = DiagnosisResult(
        search=search,
        decision=statement.decision,
        content=describe_diagnosis(models, data, search, checked, explained, failures),
        holdout=checked.motion,
        after=statement.confirmed.after,
        residual_torque=explained.residual_torque,
        failures=failures,
    )
    return Diagnosis(result, robot, _list_sources(data.logs), _list_sources(data.holdout))


@dataclass(frozen=True, eq=False)
class _JudgedSearch:
    """A search with its check on held-out motion; ``numbers`` are the candidates that are numbers of the robot file."""

    search: SearchResult
    checked: CheckedVerdict
    failures: tuple[str, ...]
    numbers: frozenset[str]

    @property
    def is_file_in_doubt(self) -> bool:
        """Whether many times the noise is left although the file is taken as right, by no contradiction of the logs."""
        return self.checked.contradiction is None and self.leaves_much

    @property
    def leaves_much(self) -> bool:
        """Whether its verdict leaves many times the noise of the motion that decides."""
        return bool(self.checked.settled.deciding_gap["after"] > DATA.significant_noise_multiple)

    def corrects(self, other: _JudgedSearch) -> bool:
        """Tell whether its verdict has wrong numbers of the file, none at an end of its range, and clearly leaves less
        of the motion that decides than another verdict, or about as little with fewer effects."""
        if self.numbers.isdisjoint(self.verdict) or is_at_bound(
            self.verdict, self.checked.settled.statement.stated.causes
        ):
            return False
        gap, theirs = self.checked.settled.deciding_gap, other.checked.settled.deciding_gap
        if not is_gap_alike(gap, theirs):
            return bool(gap["after"] < theirs["after"])
        return is_gap_alike(theirs, gap) and 0 < len(self.verdict) < len(other.verdict)

    @property
    def verdict(self) -> tuple[str, ...]:
        """The effects that stand."""
        return self.checked.settled.statement.confirmed.effects


def _judge_search(
    models: Models,
    data: PreparedData,
    direct: Sequence[DirectEvidence],
    unseen: HoldoutMotion,
    budget: TimeBudget,
    on_stage: StageListener,
    search: SearchResult,
) -> _JudgedSearch:
    """Decide by a search, and check the decision on held-out motion."""
    on_stage(Stage.LONG_WINDOWS)
    prediction = predict_long_windows(search, data, budget)
    scores = score_hypotheses(search, prediction.log_odds)
    checked = check_on_holdout(models, data, search, scores, direct, unseen, budget, on_stage)
    keys = {number["name"] for number in models.full.manifest["numbers"]}
    numbers = (one.name for one in search.candidates.members if one.is_number or one.traits.name in keys)
    failures = (*search.failures, *prediction.failures, *checked.failures)
    return _JudgedSearch(search, checked, failures, frozenset(numbers))


def _judge_with_numbers(
    judge: Callable[[SearchResult], _JudgedSearch],
    search: SearchResult,
    search_numbers: Callable[[Sequence[str] | None], _JudgedSearch | None],
) -> _JudgedSearch:
    """Judge a search that takes the robot file as right, and another with the file's numbers among the causes where the
    first leaves much: what clearly leaves less of unseen motion stands. Where the file seems to be another machine's,
    the other one stands if it leaves about the noise."""
    try:
        found = judge(search)
    except LogError:
        again = search_numbers(None)
        if again is None or again.leaves_much:
            raise
        return again
    if not found.is_file_in_doubt:
        return found
    again = search_numbers(found.verdict)
    return again if again and again.corrects(found) else found


def _search_wrong_numbers(
    models: Models,
    data: PreparedData,
    judge: Callable[[SearchResult], _JudgedSearch],
    attempts: Attempts,
    on_stage: StageListener,
    verdict: Sequence[str] | None,
) -> _JudgedSearch | None:
    """Search with the robot file's numbers among the causes; None where that fails, or takes too long. Springs in rigid
    joints, which take most of the time, are searched again only where they stand in the first verdict, or where there
    was none."""
    budget, stage = attempts.budget, "the search for wrong numbers of the robot file"
    springs = models.full.effects.series_springs
    may_have_springs = verdict is None or any(name.partition("@")[0] in springs for name in verdict)

    def search_again() -> _JudgedSearch | None:
        null = fit_null_model(models.full, data.record, budget, with_numbers=True)
        search = search_effects(models, data, null, on_stage, may_have_springs)
        return None if budget.is_left_out(stage) else judge(search)

    return attempts.attempt_in_time(stage, search_again, None)


def _list_sources(logs: Sequence[Log]) -> tuple[str, ...]:
    """The paths of logs."""
    return tuple(log.source for log in logs)
