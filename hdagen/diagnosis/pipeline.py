"""From robot file and logs to a diagnosis, stage by stage."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from hdagen.diagnosis.data.models import Models, load_models
from hdagen.diagnosis.data.prepared_data import PreparedData, prepare_data
from hdagen.diagnosis.decision.direct_evidence import find_direct_evidence
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.diagnosis_content import describe_diagnosis
from hdagen.diagnosis.explanation import explain_verdict
from hdagen.diagnosis.holdout.unseen_motion import measure_without_effects
from hdagen.diagnosis.judged_search import JudgedSearch, SearchJudge, judge_numbers_first, judge_with_numbers
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.search.effect_search import search_effects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.null_model import NullModel, fit_null_model
from hdagen.diagnosis.search.stored_searches import Searches
from hdagen.diagnosis.search.whole_drives import are_rotors_missing
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage, StageListener, ignore_stage
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.measured_log import Log

NUMBER_SEARCH = "the search for wrong numbers of the robot file"


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
    attempts = Attempts(budget)
    runs = _SearchRuns(models, data, null, attempts, on_stage)
    with ThreadPoolExecutor(1) as beside:  # the search leaves half a core idle
        unseen = beside.submit(measure_without_effects, models, data, null.fit)
        runs.run_first_search()
    found = _judge_searches(SearchJudge(models, data, direct, unseen.result(), budget, on_stage), runs)
    searches = Searches(null.fit, runs.as_stated, runs.with_numbers, runs.begins_with_numbers)
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
class _SearchRuns:
    """The searches of a diagnosis, and their results once they have run: ``as_stated`` takes the robot file as right,
    ``with_numbers`` has its numbers among the causes."""

    models: Models
    data: PreparedData
    null: NullModel
    attempts: Attempts
    on_stage: StageListener
    begins_with_numbers: bool = False
    as_stated: SearchResult | None = None
    with_numbers: SearchResult | None = None

    def run_first_search(self) -> None:
        """Run the search with numbers where the file leaves out rotors that the log shows, and the other elsewhere."""
        self.begins_with_numbers = are_rotors_missing(self.models.full, self.data.record)
        if self.begins_with_numbers:
            self.with_numbers = self.attempts.attempt(NUMBER_SEARCH, self.search_with_numbers, None)
        else:
            self.search_as_stated()

    def search_as_stated(self) -> SearchResult:
        """Search with the file taken as right."""
        self.as_stated = search_effects(self.models, self.data, self.null, self.on_stage)
        return self.as_stated

    def search_with_numbers(self, may_have_springs: bool = True, named: Sequence[str] = ()) -> SearchResult:
        """Search with the file's numbers among the causes, beside what the first search ``named``."""
        null = fit_null_model(self.models.full, self.data.record, self.attempts.budget, with_numbers=True)
        return search_effects(self.models, self.data, null, self.on_stage, may_have_springs, named)

    def search_again(self, verdict: Sequence[str] | None) -> SearchResult | None:
        """Search with numbers after the other search; None where it takes too long. Springs in rigid joints, which take
        most of the time, are searched again only where they stand in the first ``verdict``, or where there was none."""
        springs = self.models.full.effects.series_springs
        has_springs = verdict is None or any(name.partition("@")[0] in springs for name in verdict)
        found = self.search_with_numbers(has_springs, verdict or ())
        if not self.attempts.budget.is_left_out(NUMBER_SEARCH):
            self.with_numbers = found
        return self.with_numbers


def _judge_searches(judge: SearchJudge, runs: _SearchRuns) -> JudgedSearch:
    """Judge the first search, and the other one where that leaves much."""
    attempts = runs.attempts

    def judge_numbers(search: SearchResult | None) -> JudgedSearch | None:
        return judge.judge_search(search) if search else None

    def search_again(verdict: Sequence[str] | None) -> JudgedSearch | None:
        return attempts.attempt_in_time(NUMBER_SEARCH, lambda: judge_numbers(runs.search_again(verdict)), None)

    def search_as_stated() -> SearchResult | None:
        if runs.with_numbers and judge.budget.is_left_out("the search that takes the robot file as right"):
            return None
        return runs.search_as_stated()

    if runs.begins_with_numbers:
        numbers = attempts.attempt(NUMBER_SEARCH, lambda: judge_numbers(runs.with_numbers), None)
        return judge_numbers_first(numbers, search_as_stated, judge.judge_search)
    return judge_with_numbers(judge.judge_search, runs.as_stated or runs.search_as_stated(), search_again)


def _list_sources(logs: Sequence[Log]) -> tuple[str, ...]:
    """The paths of logs."""
    return tuple(log.source for log in logs)
