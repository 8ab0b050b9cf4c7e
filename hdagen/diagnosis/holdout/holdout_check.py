"""The steps of checking a decision on motion that no fit saw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

from hdagen.adoption.verdict import Verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence, add_direct_evidence
from hdagen.diagnosis.decision.parameter_estimates import estimate_base_parameters
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.decision.verdict_content import StatedEffects, state_effects
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.leading_set import (
    lead_on_unseen_motion,
    lead_with_effects,
    lead_with_long_windows,
    may_replace,
)
from hdagen.diagnosis.holdout.small_effects import drop_small_effects, is_gap_alike
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import (
    ConfirmedVerdict,
    doubt_on_holdout,
    is_at_bound,
    remove_unknown,
    reweigh_unknown,
    withdraw_harmful,
)
from hdagen.diagnosis.search.fit_ranking import choose_stated_fits
from hdagen.diagnosis.search.hypothesis_search import SearchResult

LongWindowSearch = Callable[[Decision], Decision | None]


@dataclass(frozen=True, eq=False)
class Statement:
    """A statement of a decision.

    Attributes:
        decision: the decision.
        stated: its effects with their parameters.
        confirmed: the part of it that the motion confirms.

    """

    decision: Decision
    stated: StatedEffects
    confirmed: ConfirmedVerdict


@dataclass(frozen=True, eq=False)
class SettledStatement:
    """A statement after every check on held-out motion.

    Attributes:
        statement: the statement that stays.
        doubts: of diagnosis.json: the verdict that was doubted, the joint, and the share of its error that was left;
            None if nothing was.
        small_effects: `small` of diagnosis.json: effects that were dropped as small.
        deciding_gap: `gap` of diagnosis.json on the motion that decided, which is not that of the report.

    """

    statement: Statement
    doubts: Mapping[str, Any] | None
    small_effects: tuple[Mapping[str, Any], ...]
    deciding_gap: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class HoldoutJudge:
    """Judges the result of a search on a motion that it did not see.

    Attributes:
        nominal_arm: the robot file's model.
        arm: the model with every effect.
        search_result: the result of the search.
        direct_evidence: effects with direct evidence.
        motion: the motion.

    """

    nominal_arm: Arm
    arm: Arm
    search_result: SearchResult
    direct_evidence: Sequence[DirectEvidence]
    motion: HoldoutMotion

    def state_decision(self, decision: Decision, *further: HoldoutMotion) -> Statement:
        """State a decision as far as it closes the gap on the motion, and on further ones.

        Args:
            decision: to be stated.
            further: other motions that no fit saw.

        Returns:
            The statement, with the gap on the last motion.

        Raises:
            PlantError: a model cannot be simulated.

        """
        motions = list(dict.fromkeys((self.motion, *further)))
        stated, fitted = state_effects(decision), estimate_base_parameters(decision.best)
        model = choose_model(self.arm, decision, stated.build_verdict(fitted))
        confirmed = withdraw_harmful(self.nominal_arm, model, stated, motions, fitted, self._null_parameters)
        return Statement(decision, stated, confirmed)

    def try_known_effects(self, strange: Decision) -> Decision | None:
        """Name known effects in place of something unknown, where the motion confirms them and the base parameters
        alone leave clearly more.

        Args:
            strange: a decision whose verdict is something unknown.

        Returns:
            The decision for known effects, or None.

        Raises:
            PlantError: a model cannot be simulated.

        """
        without_it = leading = remove_unknown(strange)
        if not without_it.verdict:
            leading = lead_with_effects(without_it, lambda one: self.state_decision(one).confirmed.gap)
        if not leading.verdict:
            return None
        known_statement = self._state_leading_set(leading)
        if known_statement.decision.best is not without_it.best and not known_statement.decision.direct_evidence:
            strange = replace(
                strange, hypotheses=known_statement.decision.hypotheses, best=known_statement.decision.best
            )
        tried = reweigh_unknown(
            strange, known_statement.confirmed.effects, self.motion, known_statement.confirmed.after
        )
        if tried.is_unknown or is_at_bound(known_statement.confirmed.effects, known_statement.stated.causes):
            return None
        without_effects = self.motion.measure_gap(self.motion.refitted_base)
        return None if is_gap_alike(known_statement.confirmed.gap, without_effects) else tried

    def try_long_windows(self, decision: Decision, search_long_windows: LongWindowSearch) -> Decision:
        """Name effects of long windows in place of a verdict that leaves much of the motion.

        Args:
            decision: a decision whose verdict is nothing unknown.
            search_long_windows: searches long windows for effects that act all the time.

        Returns:
            The decision for the effects of long windows where these leave several times less; else as it is.

        Raises:
            PlantError: a model cannot be simulated.

        """
        stated = self._state_leading_set(decision)
        left = float(stated.confirmed.gap["after"])
        if left <= DATA.significant_noise_multiple or stated.decision.direct_evidence:
            return decision
        lasting = search_long_windows(stated.decision)
        if lasting is None or lasting.hypotheses[0].names == stated.decision.verdict:
            return decision
        tried = self.state_decision(lead_with_long_windows(stated.decision, lasting))
        leads = tried.confirmed.gap["after"] * HOLDOUT_CHECK.leading_gap_ratio < left
        return tried.decision if leads and may_replace(stated.decision, tried.decision.best) else decision

    def settle_decision(self, decision: Decision, last: HoldoutMotion) -> SettledStatement:
        """Check a decision on the motion, and state it.

        Args:
            decision: to be stated.
            last: the motion on which the gap is measured.

        Returns:
            The statement.

        Raises:
            PlantError: a model cannot be simulated.

        """
        settled = self.check_decision(decision)
        if last is self.motion:
            return settled
        return replace(settled, statement=self.state_decision(settled.statement.decision, last))

    def withhold_verdict(self, decision: Decision, last: HoldoutMotion) -> SettledStatement:
        """State that there is no verdict, as the hold-out contradicts the log.

        Args:
            decision: of the log.
            last: the motion on which the gap is measured.

        Returns:
            The statement.

        """
        gap = last.measure_gap(last.before)
        confirmed = ConfirmedVerdict((), {}, True, gap, self.nominal_arm, last.before)
        return SettledStatement(Statement(decision, StatedEffects((), ()), confirmed), None, (), gap)

    def check_decision(self, decision: Decision) -> SettledStatement:
        """Check a decision on the motion: add direct evidence, doubt, and drop small effects.

        Args:
            decision: to be checked.

        Returns:
            The statement, with the gap on the motion.

        Raises:
            PlantError: a model cannot be simulated.

        """
        stated = self._state_leading_set(decision)
        fitted, confirmed = choose_stated_fits(self.search_result.fits), stated.confirmed
        checked, doubts = doubt_on_holdout(stated.decision, fitted, confirmed.effects, self.motion, confirmed.after)
        if doubts:
            stated = self._state_with_direct_evidence(checked)
        direct = [one.name for one in self.direct_evidence]
        measure = partial(self._measure, stated)
        checked, small = drop_small_effects(stated.decision, fitted, measure, direct)
        if small:
            stated = self.state_decision(checked)
        return SettledStatement(stated, doubts, tuple(small), stated.confirmed.gap)

    @cached_property
    def _null_parameters(self) -> dict[str, Any]:
        """The base parameters of the null model's best fit."""
        return estimate_base_parameters(choose_stated_fits(self.search_result.fits)[()])

    def _state_leading_set(self, decision: Decision) -> Statement:
        """The statement with direct evidence, of the set of effects that leads on the motion."""
        stated = self._state_with_direct_evidence(decision)
        leading = lead_on_unseen_motion(stated.decision, partial(self._measure, stated))
        return stated if leading is stated.decision else self._state_with_direct_evidence(leading)

    def _measure(self, stated: Statement, decision: Decision) -> Mapping[str, Any]:
        """The gap with a decision; that of the ``stated`` one is known."""
        measured = stated if decision is stated.decision else self.state_decision(decision)
        return measured.confirmed.gap

    def _state_with_direct_evidence(self, decision: Decision) -> Statement:
        """The statement with direct evidence, or without it where the motion does not confirm it."""
        if (more := add_direct_evidence(decision, self.direct_evidence)) is not decision:
            stated = self.state_decision(more)
            if stated.confirmed.effects == more.verdict:
                return stated
        return self.state_decision(decision)


def choose_model(arm: Arm, decision: Decision, said: Verdict) -> Arm:
    """Choose the model that a verdict is replayed on.

    Args:
        arm: with every effect; drives that the robot file calls rigid are rigid.
        decision: whose fits may be of the model with springs, that of the verdict or those of other hypotheses.
        said: the verdict.

    Returns:
        The first of these models that has all parameters of the verdict; the arm where none has them.

    """
    needed = {*said.effect_parameters, *said.base_parameters}
    fits = (decision.best, *(one.fit for one in decision.hypotheses if one.fit is not None))
    models = (arm, *(fit.sensitivities.shooting.arm for fit in fits))
    return next((model for model in models if needed <= model.parameters.described.keys()), arm)


def choose_decision(decision: Decision, judge: HoldoutJudge, search_long_windows: LongWindowSearch) -> Decision:
    """Choose the decision where something unknown may be present, or where the verdict leaves much.

    Args:
        decision: of the short windows.
        judge: on motion that they did not see.
        search_long_windows: searches for effects that act all the time, if something unknown or a large gap remains.

    Returns:
        The decision, which names known effects wherever the motion confirms them.

    Raises:
        PlantError: a model cannot be simulated.

    """
    if not decision.is_unknown:
        return judge.try_long_windows(decision, search_long_windows)
    if (better := judge.try_known_effects(decision)) is not None:
        return better
    lasting = search_long_windows(decision)
    better = judge.try_known_effects(lasting) if lasting else None
    return better or decision
