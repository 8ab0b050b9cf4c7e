"""A search whose decision is checked on held-out motion, and the choice between two of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hdagen.diagnosis.checked_verdict import CheckedVerdict, LastingFinder, check_on_holdout
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence
from hdagen.diagnosis.decision.file_trust import has_exact_number, measure_number_gain
from hdagen.diagnosis.decision.posterior import score_hypotheses
from hdagen.diagnosis.holdout.long_window_prediction import predict_long_windows
from hdagen.diagnosis.holdout.small_effects import is_gap_alike
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import is_at_bound
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.long_horizon import find_lasting_effects
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.data_table import LogError


@dataclass(frozen=True, eq=False)
class JudgedSearch:
    """A search with its check on held-out motion.

    Attributes:
        search: the result of the search.
        checked: its verdict after the check.
        failures: a sentence for each stage that failed.
        numbers: the candidates that are numbers of the robot file, name@joint.

    """

    search: SearchResult
    checked: CheckedVerdict
    failures: tuple[str, ...]
    numbers: frozenset[str]

    @property
    def is_file_in_doubt(self) -> bool:
        """Whether wrong numbers of the file may be behind what the verdict names or leaves. A verdict that leaves much
        may lack any of them: beside much unexplained torque the linear model shows none. Of a number that the file
        claims to know exactly it never does."""
        if self.checked.contradiction is not None:
            return False
        shows = self.may_stand_for_numbers or self.may_lack_numbers
        return shows or self.leaves_much or (self.names_unsurely and self.has_exact_number)

    @property
    def may_stand_for_numbers(self) -> bool:
        """Whether wrong numbers of the file alone would gain much of the log evidence that the verdict gains."""
        if not self.verdict:
            return False
        gained = self.best.evidence_here - self.without_effects.evidence_here
        least = max(DECISION.least_number_gain, DECISION.look_alike_share * gained)
        return measure_number_gain(self.without_effects) >= least

    @property
    def may_lack_numbers(self) -> bool:
        """Whether wrong numbers of the file would gain log evidence beside the verdict."""
        return measure_number_gain(self.best) >= DECISION.least_number_gain

    @property
    def has_exact_number(self) -> bool:
        """Whether the file claims to know a number exactly."""
        return has_exact_number(self.best)

    @property
    def best(self) -> Fit:
        """The fit of the verdict."""
        return self.checked.settled.statement.decision.best

    @property
    def without_effects(self) -> Fit:
        """The fit without effects."""
        return next(fit for fit in self.search.fits if not fit.effects)

    @property
    def leaves_much(self) -> bool:
        """Whether its verdict leaves many times the noise of the motion that decides."""
        return bool(self.checked.settled.deciding_gap["after"] > DATA.significant_noise_multiple)

    @property
    def describes_machine(self) -> bool:
        """Whether the robot file with its verdict describes the machine: it leaves about the noise of the motion that
        decides, or it is sure and leaves a small part of the gap."""
        gap, is_sure = self.checked.settled.deciding_gap, self.checked.settled.statement.decision.is_sure
        return not self.leaves_much or (is_sure and gap["after"] < DECISION.largest_share_left * gap["before"])

    @property
    def names_unsurely(self) -> bool:
        """Whether its verdict names effects or something unknown, and is not sure."""
        return bool(self.verdict) and not self.checked.settled.statement.decision.is_sure

    def corrects(self, other: JudgedSearch) -> bool:
        """Tell whether its verdict corrects that of another search.

        Args:
            other: the other search.

        Returns:
            Whether the verdict has wrong numbers of the file, none at an end of its range, and clearly leaves less of
            the motion that decides than the other verdict, or about as little with fewer effects, or little more with
            fewer effects and clearly more log evidence. Logs that contradict each other correct nothing.

        """
        if other.checked.contradiction is not None:
            return False
        if self.numbers.isdisjoint(self.verdict) or is_at_bound(
            self.verdict, self.checked.settled.statement.stated.causes
        ):
            return False
        gap, theirs = self.checked.settled.deciding_gap, other.checked.settled.deciding_gap
        is_simpler = 0 < len(self.verdict) < len(other.verdict)
        if is_simpler and self._is_clearly_likelier(other):
            return bool(gap["after"] < DECISION.largest_gap_of_likelier * theirs["after"])
        if not is_gap_alike(gap, theirs):
            return bool(gap["after"] < theirs["after"])
        return is_simpler and is_gap_alike(theirs, gap)

    def _is_clearly_likelier(self, other: JudgedSearch) -> bool:
        """Whether its verdict has clearly more log evidence than that of another search."""
        lead = self.best.evidence_here - other.best.evidence_here
        return lead > SEARCH.close_call_margin * other.best.misfit_temperature

    @property
    def verdict(self) -> tuple[str, ...]:
        """The effects that stand."""
        return self.checked.settled.statement.confirmed.effects


@dataclass(frozen=True, eq=False)
class SearchJudge:
    """Judges searches by what no fit saw.

    Attributes:
        models: of the robot.
        data: of the diagnosis.
        direct_evidence: effects with direct evidence.
        unseen: the held-out motion without any effect.
        budget: the time of the diagnosis.
        on_stage: receives each stage as it begins.
        find_lasting: finds effects over long windows.

    """

    models: Models
    data: PreparedData
    direct_evidence: Sequence[DirectEvidence]
    unseen: HoldoutMotion
    budget: TimeBudget
    on_stage: StageListener
    find_lasting: LastingFinder = find_lasting_effects

    def judge_search(self, search: SearchResult) -> JudgedSearch:
        """Decide by a search, and check the decision on held-out motion.

        Args:
            search: its result.

        Returns:
            The search with the verdict that the motion confirms.

        Raises:
            LogError: the log says that the robot file is another machine's.
            PlantError: a model cannot be simulated.

        """
        self.on_stage(Stage.LONG_WINDOWS)
        prediction = predict_long_windows(search, self.data, self.budget)
        scores = score_hypotheses(search, prediction.log_odds)
        checked = check_on_holdout(
            self.models,
            self.data,
            search,
            scores,
            self.direct_evidence,
            self.unseen,
            self.budget,
            self.on_stage,
            self.find_lasting,
        )
        keys = {number["name"] for number in self.models.full.manifest["numbers"]}
        numbers = (one.name for one in search.candidates.members if one.is_number or one.traits.name in keys)
        failures = (*search.failures, *prediction.failures, *checked.failures)
        return JudgedSearch(search, checked, failures, frozenset(numbers))


def judge_with_numbers(
    judge: Callable[[SearchResult], JudgedSearch],
    search: SearchResult,
    search_numbers: Callable[[Sequence[str] | None], JudgedSearch | None],
) -> JudgedSearch:
    """Judge a search that takes the robot file as right, and one with its numbers among the causes where these may be
    behind what the first one names or leaves.

    What clearly leaves less of unseen motion stands. Where the file seems to be another machine's, the second one
    stands if it describes this one.

    Args:
        judge: judges a search.
        search: the first search.
        search_numbers: the second search, judged, for the verdict of the first; None where there is none.

    Returns:
        The search that stands.

    Raises:
        LogError: the log says that the robot file is another machine's, whatever its numbers are.

    """
    try:
        found = judge(search)
    except LogError:
        again = search_numbers(None)
        if again is not None and again.describes_machine:
            return again
        return judge(search)  # refuses once more, but where the time is up: what it found until then is stated
    if not found.is_file_in_doubt:
        return found
    return _choose_search(found, search_numbers(found.verdict))


def _choose_search(as_stated: JudgedSearch, with_numbers: JudgedSearch | None) -> JudgedSearch:
    """The search with numbers where its verdict corrects that of the other one, which takes the file as right."""
    return with_numbers if with_numbers and with_numbers.corrects(as_stated) else as_stated


def judge_numbers_first(
    numbers: JudgedSearch | None,
    search_as_stated: Callable[[], SearchResult | None],
    judge: Callable[[SearchResult], JudgedSearch],
) -> JudgedSearch:
    """Judge a search with the robot file's numbers among the causes, and one that takes the file as right where that
    leaves much.

    Args:
        numbers: the search with the numbers, judged; None where it failed.
        search_as_stated: searches with the file taken as right; None where there is no time for it.
        judge: judges a search.

    Returns:
        The search that stands.

    Raises:
        LogError: the log says that the robot file is another machine's, whatever its numbers are.

    """
    if numbers is not None and not numbers.leaves_much:
        return numbers
    search = search_as_stated()
    if search is not None:
        return _choose_search(judge(search), numbers)
    if numbers is None:
        raise LogError(["neither search for the cause could be made; give more time, or a shorter log."])
    return numbers
