"""The ladder: what the leading hypotheses leave of the gap on motion that no fit saw, each with an interval.

A probability says how well a hypothesis tells the fitted motion; a rung, how far it carries.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.decide import Decision, Hypothesis
from hdagen.diagnosis.findings import hypothetical
from hdagen.diagnosis.gap import spread
from hdagen.diagnosis.portion import Portion
from hdagen.plant import Arm
from hdagen.replay import Replay
from hdagen.together import together

MOST = 3  # hypotheses beside none and the verdict: each costs as much as the verdict's replay does


def ladder(
    decision: Decision, said: Sequence[str], before: Replay, after: Replay, held: Portion, seen: Callable[[Arm], Replay]
) -> list[dict[str, Any]]:
    """Rungs, the largest gap first: ``model`` (robot file, hypothesis, verdict), ``effects``, ``probability``, ``gap``
    in multiples of noise and its ``interval``. The hypotheses are none, whose base parameters are refitted, and the
    most probable ones that were fitted, each with its own parameters; ``said`` is the verdict that ``after`` has,
    ``seen`` the replay of what is ``held`` out on an arm. Raises PlantError."""
    stated = tuple(said)
    fitted = [h for h in decision.hypotheses if h.fit and h.names != stated]
    tried = [h for h in fitted if not h.names] + [h for h in fitted if h.names][:MOST]

    def replayed(one: Hypothesis) -> Replay:
        assert one.fit
        return seen(verdict.applied(one.fit.design.shooting.arm, hypothetical(one.fit, one.names))[0])

    rungs: list[tuple[str, Sequence[str], float | None]] = [
        ("robot file", (), None),
        *(("hypothesis", h.names, h.probability) for h in tried),
        ("verdict", stated, decision.probability if stated == decision.verdict else None),
    ]
    left = spread(before, [before, *together(replayed, tried), after], held)
    found = [
        {"model": model, "effects": list(names), "probability": p, "gap": value, "interval": interval}
        for (model, names, p), (value, interval) in zip(rungs, left, strict=True)
    ]
    return sorted(found, key=lambda one: -float(one["gap"]))


def left_by(cause: Mapping[str, Any], rungs: Sequence[Mapping[str, Any]]) -> float | None:
    """What the best rung with a cause leaves of the gap; None where none with it was replayed."""
    name = f"{cause['effect']}@{cause['joint']}"
    return min((float(rung["gap"]) for rung in rungs if name in rung["effects"]), default=None)
