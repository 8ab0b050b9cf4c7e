"""The steps of checking a decision on motion that no fit saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.decision.direct_evidence import Sure, beside
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.decision.verdict_content import estimate_base, findings
from hdagen.diagnosis.holdout.leading_set import lead_on_unseen_motion
from hdagen.diagnosis.holdout.small_effects import drop_small_effects
from hdagen.diagnosis.holdout.unseen_motion import UnseenMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import borne_out, doubted, known, outsized, stands
from hdagen.diagnosis.inference.local_fit import Fitted
from hdagen.diagnosis.search.fit_order import best_first
from hdagen.diagnosis.search.hypothesis_search import Search
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
class Judge:
    """Judges the result ``found`` of a search on a ``motion`` that it did not see.

    ``plain`` is the robot file's model, ``arm`` the one with every effect; ``direct`` are effects with direct evidence.
    """

    plain: Arm
    arm: Arm
    found: Search
    direct: Sequence[Sure]
    motion: UnseenMotion

    def state(self, decision: Decision, *further: UnseenMotion) -> Statement:
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
        content = findings(self.found, decision)
        none = next(fit for fit in best_first(self.found.fitted) if not fit.names)
        model = choose_model(self.arm, decision, content)
        arm, after = stands(self.plain, model, content, motions, estimate_base(none))
        return Statement(decision, content, arm, after)

    def name_known(self, strange: Decision) -> Decision | None:
        """Name known effects in place of something unknown, where the motion confirms them.

        Args:
            strange: a decision whose verdict is something unknown.

        Returns:
            The decision for known effects, or None.

        Raises:
            PlantError: a model cannot be simulated.

        """
        if not (without_it := known(strange)).verdict:
            return None
        alone = self._with_leading_set(without_it)
        if alone.decision.best is not without_it.best and not alone.decision.beside:
            strange = replace(strange, hypotheses=alone.decision.hypotheses, best=alone.decision.best)
        tried = borne_out(strange, alone.content["verdict"], self.motion, alone.after)
        return None if tried.unknown or outsized(alone.content) else tried

    def settle(self, decision: Decision, last: UnseenMotion) -> Statement:
        """Check a decision on the motion, and state it.

        Args:
            decision: to be stated.
            last: the motion on which the gap is measured.

        Returns:
            The statement.

        Raises:
            PlantError: a model cannot be simulated.

        """
        told, judged_so = self.check(decision)
        if last is not self.motion:
            told = self.state(told.decision, last)
        told.content.update(judged_so | {"contradicted": None})
        return told

    def withhold(self, decision: Decision, last: UnseenMotion, contradicted: dict[str, Any]) -> Statement:
        """State that there is no verdict, as the hold-out contradicts the log.

        Args:
            decision: of the log.
            last: the motion on which the gap is measured.
            contradicted: of diagnosis.json.

        Returns:
            The statement.

        """
        content = findings(self.found, replace(decision, verdict=()))
        content |= {"sure": False, "parameters": {}, "gap": last.measure_gap(last.before)}
        content |= {"doubted": None, "alone": self._list_direct(), "small": [], "contradicted": contradicted}
        return Statement(decision, content, self.plain, last.before)

    def check(self, decision: Decision) -> tuple[Statement, dict[str, Any]]:
        """Check a decision on the motion: add direct evidence, doubt, and drop small effects.

        Args:
            decision: to be checked.

        Returns:
            The statement, and ``doubted``, ``alone`` and ``small`` of diagnosis.json.

        Raises:
            PlantError: a model cannot be simulated.

        """
        stated = self._with_leading_set(decision)
        fitted: dict[tuple[str, ...], Fitted] = {}
        for fit in best_first(self.found.fitted):
            fitted.setdefault(fit.names, fit)
        checked, doubt = doubted(stated.decision, fitted, stated.content["verdict"], self.motion, stated.after)
        if doubt:
            stated = self._with_direct(checked)
        direct = [one.name for one in self.direct]
        measure = partial(self._measure, stated)
        checked, small = drop_small_effects(stated.decision, fitted, measure, direct)
        if small:
            stated = self.state(checked)
        return stated, {"doubted": doubt, "alone": self._list_direct(), "small": small}

    def _with_leading_set(self, decision: Decision) -> Statement:
        """The statement with direct evidence, of the set of effects that leads on the motion."""
        stated = self._with_direct(decision)
        leading = lead_on_unseen_motion(stated.decision, partial(self._measure, stated))
        return stated if leading is stated.decision else self._with_direct(leading)

    def _measure(self, stated: Statement, decision: Decision) -> dict[str, Any]:
        """The gap with a decision; that of the ``stated`` one is known."""
        told = stated if decision is stated.decision else self.state(decision)
        return dict(told.content["gap"])

    def _list_direct(self) -> list[dict[str, Any]]:
        """`alone` of diagnosis.json."""
        return [one.content for one in self.direct]

    def _with_direct(self, decision: Decision) -> Statement:
        """The statement with direct evidence, or without it where the motion does not confirm it."""
        if (more := beside(decision, self.direct)) is not decision:
            stated = self.state(more)
            if stated.content["verdict"] == list(more.verdict):
                return stated
        return self.state(decision)


def choose_model(arm: Arm, decision: Decision, content: dict[str, Any]) -> Arm:
    """Choose the model that a verdict is replayed on.

    Args:
        arm: with every effect; drives that the robot file calls rigid are rigid.
        decision: whose fit may be of the model with springs.
        content: of diagnosis.json.

    Returns:
        The arm, or the model with springs where the arm lacks parameters of the verdict.

    """
    said = verdict.read(content)
    described = arm.parameters.described
    lacks = any(name not in described for name in (*said.parameters, *said.base))
    return decision.best.design.shooting.arm if lacks else arm


def choose(decision: Decision, judge: Judge, search_long_windows: Callable[[Decision], Decision | None]) -> Decision:
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
    if not decision.unknown:
        return decision
    if (better := judge.name_known(decision)) is not None:
        return better
    lasting = search_long_windows(decision)
    better = judge.name_known(lasting) if lasting else None
    return better or decision
