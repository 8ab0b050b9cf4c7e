"""The steps of checking a decision on motion that no fit saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence, add_direct_evidence
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.decision.verdict_content import describe_decision, estimate_base_parameters
from hdagen.diagnosis.holdout.leading_set import lead_on_unseen_motion
from hdagen.diagnosis.holdout.small_effects import drop_small_effects
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import (
    doubt_on_holdout,
    is_at_bound,
    remove_unknown,
    reweigh_unknown,
    withdraw_harmful,
)
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.search.effect_search import SearchResult
from hdagen.diagnosis.search.fit_order import sort_by_evidence
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class Statement:
    """A statement of a ``decision``: ``content`` of diagnosis.json so far, the ``arm`` with the verdict that the motion
    confirms, and its replay ``after``."""

    decision: Decision
    content: dict[str, Any]
    arm: Arm
    after: Replay


@dataclass(frozen=True, eq=False)
class HoldoutJudge:
    """Judges the result ``search_result`` of a search on a ``motion`` that it did not see.

    ``nominal_arm`` is the robot file's model, ``arm`` the one with every effect; ``direct`` are effects with direct
    evidence.
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
        content = describe_decision(self.search_result, decision)
        none = next(fit for fit in sort_by_evidence(self.search_result.fits) if not fit.names)
        model = choose_model(self.arm, decision, content)
        arm, after = withdraw_harmful(self.nominal_arm, model, content, motions, estimate_base_parameters(none))
        return Statement(decision, content, arm, after)

    def try_known_effects(self, strange: Decision) -> Decision | None:
        """Name known effects in place of something unknown, where the motion confirms them.

        Args:
            strange: a decision whose verdict is something unknown.

        Returns:
            The decision for known effects, or None.

        Raises:
            PlantError: a model cannot be simulated.

        """
        if not (without_it := remove_unknown(strange)).verdict:
            return None
        alone = self._state_leading_set(without_it)
        if alone.decision.best is not without_it.best and not alone.decision.direct_evidence:
            strange = replace(strange, hypotheses=alone.decision.hypotheses, best=alone.decision.best)
        tried = reweigh_unknown(strange, alone.content["verdict"], self.motion, alone.after)
        return None if tried.is_unknown or is_at_bound(alone.content) else tried

    def settle_decision(self, decision: Decision, last: HoldoutMotion) -> Statement:
        """Check a decision on the motion, and state it.

        Args:
            decision: to be stated.
            last: the motion on which the gap is measured.

        Returns:
            The statement.

        Raises:
            PlantError: a model cannot be simulated.

        """
        told, judged_so = self.check_decision(decision)
        if last is not self.motion:
            told = self.state_decision(told.decision, last)
        told.content.update(judged_so | {"contradicted": None})
        return told

    def withhold_verdict(self, decision: Decision, last: HoldoutMotion, contradicted: dict[str, Any]) -> Statement:
        """State that there is no verdict, as the hold-out contradicts the log.

        Args:
            decision: of the log.
            last: the motion on which the gap is measured.
            contradicted: of diagnosis.json.

        Returns:
            The statement.

        """
        content = describe_decision(self.search_result, replace(decision, verdict=()))
        content |= {"sure": False, "parameters": {}, "gap": last.measure_gap(last.before)}
        content |= {"doubted": None, "alone": self._list_direct(), "small": [], "contradicted": contradicted}
        return Statement(decision, content, self.nominal_arm, last.before)

    def check_decision(self, decision: Decision) -> tuple[Statement, dict[str, Any]]:
        """Check a decision on the motion: add direct evidence, doubt, and drop small effects.

        Args:
            decision: to be checked.

        Returns:
            The statement, and ``doubt_on_holdout``, ``alone`` and ``small`` of diagnosis.json.

        Raises:
            PlantError: a model cannot be simulated.

        """
        stated = self._state_leading_set(decision)
        fitted: dict[tuple[str, ...], Fit] = {}
        for fit in sort_by_evidence(self.search_result.fits):
            fitted.setdefault(fit.names, fit)
        checked, doubt = doubt_on_holdout(stated.decision, fitted, stated.content["verdict"], self.motion, stated.after)
        if doubt:
            stated = self._state_with_direct_evidence(checked)
        direct = [one.name for one in self.direct_evidence]
        measure = partial(self._measure, stated)
        checked, small = drop_small_effects(stated.decision, fitted, measure, direct)
        if small:
            stated = self.state_decision(checked)
        return stated, {"doubted": doubt, "alone": self._list_direct(), "small": small}

    def _state_leading_set(self, decision: Decision) -> Statement:
        """The statement with direct evidence, of the set of effects that leads on the motion."""
        stated = self._state_with_direct_evidence(decision)
        leading = lead_on_unseen_motion(stated.decision, partial(self._measure, stated))
        return stated if leading is stated.decision else self._state_with_direct_evidence(leading)

    def _measure(self, stated: Statement, decision: Decision) -> dict[str, Any]:
        """The gap with a decision; that of the ``stated`` one is known."""
        told = stated if decision is stated.decision else self.state_decision(decision)
        return dict(told.content["gap"])

    def _list_direct(self) -> list[dict[str, Any]]:
        """`alone` of diagnosis.json."""
        return [one.content for one in self.direct_evidence]

    def _state_with_direct_evidence(self, decision: Decision) -> Statement:
        """The statement with direct evidence, or without it where the motion does not confirm it."""
        if (more := add_direct_evidence(decision, self.direct_evidence)) is not decision:
            stated = self.state_decision(more)
            if stated.content["verdict"] == list(more.verdict):
                return stated
        return self.state_decision(decision)


def choose_model(arm: Arm, decision: Decision, content: dict[str, Any]) -> Arm:
    """Choose the model that a verdict is replayed on.

    Args:
        arm: with every effect; drives that the robot file calls rigid are rigid.
        decision: whose fit may be of the model with springs.
        content: of diagnosis.json.

    Returns:
        The arm, or the model with springs where the arm lacks parameters of the verdict.

    """
    said = verdict.read_verdict(content)
    described = arm.parameters.described
    lacks = any(name not in described for name in (*said.effect_parameters, *said.base_parameters))
    return decision.best.sensitivities.shooting.arm if lacks else arm


def choose_decision(
    decision: Decision, judge: HoldoutJudge, search_long_windows: Callable[[Decision], Decision | None]
) -> Decision:
    """Choose the decision where something unknown may be present.

    Args:
        decision: of the short windows.
        judge: on motion that they did not see.
        search_long_windows: searches for effects that act all the time, if something unknown still leads.

    Returns:
        The decision, which names known effects wherever the motion confirms them.

    Raises:
        PlantError: a model cannot be simulated.

    """
    if not decision.is_unknown:
        return decision
    if (better := judge.try_known_effects(decision)) is not None:
        return better
    lasting = search_long_windows(decision)
    better = judge.try_known_effects(lasting) if lasting else None
    return better or decision
