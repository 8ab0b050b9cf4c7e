"""A diagnosis decided again from its stored searches: the same verdict to the bit, and no set of effects fitted again.

Replays of models run again, and so does the search over long windows. Both are kept, so that several decisions of one
diagnosis share them: a replay by its model, a search over long windows by the settings that it reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.checked_verdict import LastingFinder
from hdagen.diagnosis.data.models import load_models
from hdagen.diagnosis.data.prepared_data import PreparedData, prepare_data
from hdagen.diagnosis.decision.direct_evidence import find_direct_evidence
from hdagen.diagnosis.decision.verdict_content import describe_choice
from hdagen.diagnosis.explanation import conclude_diagnosis
from hdagen.diagnosis.holdout.unseen_motion import measure_without_effects
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.judged_search import JudgedSearch, SearchJudge, judge_numbers_first, judge_with_numbers
from hdagen.diagnosis.long_horizon import LastingEffects, find_lasting_effects, list_settings_read
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.rigid_or_flexible import load_with_springs, make_spring_simulator
from hdagen.diagnosis.search.stored_searches import RIGID, SPRINGS, Searches, needs_springs, read_searches
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import ignore_stage
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class RememberedData(PreparedData):
    """Prepared logs that keep each replay.

    Attributes:
        replays: by portion, model and parameters.
        lock: of the replays.

    """

    replays: dict[tuple[str, Path, bytes], Replay] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    @classmethod
    def remember(cls, data: PreparedData) -> RememberedData:
        """Make prepared logs keep their replays.

        Args:
            data: the logs.

        Returns:
            The same logs.

        """
        return cls(**{one.name: getattr(data, one.name) for one in fields(PreparedData)})

    def replay_fitted(self, arm: Arm) -> Replay:
        """Replay the fitted logs on an arm, or return that replay if it was made before.

        Args:
            arm: the model.

        Returns:
            The replay.

        Raises:
            PlantError: the model cannot be simulated.

        """
        return self._remember_replay("fitted", arm, super().replay_fitted)

    def replay_held_out(self, arm: Arm) -> Replay:
        """Replay the held-out logs on an arm, or return that replay if it was made before.

        Args:
            arm: the model.

        Returns:
            The replay.

        Raises:
            PlantError: the model cannot be simulated.

        """
        return self._remember_replay("held out", arm, super().replay_held_out)

    def _remember_replay(self, portion: str, arm: Arm, replay: Callable[[Arm], Replay]) -> Replay:
        """The replay that was made before of the same model and parameters, or a new one."""
        key = portion, arm.folder, arm.p.tobytes()
        with self.lock:
            known = self.replays.get(key)
        if known is not None:
            return known
        found = replay(arm)
        with self.lock:
            return self.replays.setdefault(key, found)


def remember_lasting_effects() -> LastingFinder:
    """Make a `find_lasting_effects` that keeps what it finds in one diagnosis, by the search in short windows and the
    settings."""
    known: dict[tuple[Any, ...], LastingEffects | None] = {}

    def find(found: SearchResult, *data: Any) -> LastingEffects | None:
        key = (found, *list_settings_read())
        if key not in known:
            known[key] = find_lasting_effects(found, *data)
        return known[key]

    return find


@dataclass(frozen=True, eq=False)
class StoredDiagnosis:
    """A diagnosis whose searches are done.

    Attributes:
        judge: judges them.
        searches: all that was fitted.

    """

    judge: SearchJudge
    searches: Searches

    def decide_again(self) -> dict[str, Any]:
        """Decide by the stored searches.

        Returns:
            The parts of diagnosis.json that say what was decided, and ``lacks_search``: whether the decision asked for
            a search that the diagnosis had not needed, and went on without it.

        Raises:
            LogError: the log says that the robot file is another machine's.
            PlantError: a model cannot be simulated.

        """
        attempts, searches, lacking = Attempts(), self.searches, []

        def recall(search: SearchResult | None, name: str) -> SearchResult | None:
            if search is None:
                lacking.append(name)
            return search

        def recall_numbers(_: Sequence[str] | None = None) -> JudgedSearch | None:
            search = recall(searches.with_numbers, "with numbers")
            if search is None:
                return None
            return attempts.attempt("the stored search with numbers", lambda: self.judge.judge_search(search), None)

        if searches.begins_with_numbers or searches.as_stated is None:
            as_stated = partial(recall, searches.as_stated, "as stated")
            found = judge_numbers_first(recall_numbers(), as_stated, self.judge.judge_search)
        else:
            found = judge_with_numbers(self.judge.judge_search, searches.as_stated, recall_numbers)
        final = conclude_diagnosis(self.judge.data, found.checked, attempts)
        decision = found.checked.settled.statement.decision
        return {
            **describe_choice(found.search, decision),
            "verdict": list(final.effects),
            "sure": final.is_sure,
            "gap": final.alternatives.gap,
            "lacks_search": bool(lacking),
        }


def read_diagnosis(robot: str | Path, logs: Sequence[Log], searches: Path) -> StoredDiagnosis:
    """Read a diagnosis whose searches are done.

    Args:
        robot: the preset or robot.toml that was diagnosed.
        logs: the logs that were diagnosed, without a hold-out.
        searches: the file that `hdagen diagnose --keep-searches` wrote.

    Returns:
        The diagnosis, ready to be decided.

    Raises:
        InputFileError: the file of searches cannot be used.
        LogError: a log cannot carry a diagnosis.
        PlantError: a model cannot be loaded or simulated.

    """
    models = load_models(robot)
    data = RememberedData.remember(prepare_data(models, logs, ()))
    simulators: Mapping[str, MultipleShooting] = {RIGID: MultipleShooting(models.full, data.record)}
    if needs_springs(searches):
        flexible = load_with_springs(robot, models.full)
        simulators = {**simulators, SPRINGS: make_spring_simulator(flexible, data.record, data.window)}
    found = read_searches(searches, models.full.effects, simulators)
    unseen = measure_without_effects(models, data, found.null)
    direct = find_direct_evidence(models.full, data.record)
    find_lasting = remember_lasting_effects()
    return StoredDiagnosis(SearchJudge(models, data, direct, unseen, TimeBudget(), ignore_stage, find_lasting), found)
