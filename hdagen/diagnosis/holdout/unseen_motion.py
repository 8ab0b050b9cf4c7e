"""Held-out motion, with the error that remains before any effect is in the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.gap import gap, least
from hdagen.diagnosis.data.split import Portion, halve
from hdagen.diagnosis.holdout.nonparametric_baseline import corrected
from hdagen.prediction.window_replay import Replay

Simulate = Callable[[Arm], Replay]


@dataclass(frozen=True, eq=False)
class UnseenMotion:
    """A held-out ``portion`` of logs; ``simulate`` replays these logs on an arm. ``before``: replay of the robot file;
    ``base``: replay with its base parameters fitted and no effect; ``flexible``: the best replay of these and of a
    correction without structure."""

    portion: Portion
    simulate: Simulate
    before: Replay
    base: Replay
    flexible: Replay

    def measure_gap(self, after: Replay) -> dict[str, Any]:
        """Measure the gap: `gap` of diagnosis.json.

        Args:
            after: a replay of the same logs.

        Returns:
            The error that it leaves, compared with that of the robot file.

        """
        return gap(self.before, after, self.portion, self.flexible)

    def halve(self) -> tuple[UnseenMotion, UnseenMotion]:
        """Split the motion into the even seconds, which decide, and the odd seconds, which are reported."""
        first, second = (replace(self, portion=half) for half in halve(self.portion))
        return first, second


def measure_unseen(
    plain: Arm, base: verdict.Verdict, shown: Portion, portion: Portion, simulate: Simulate
) -> UnseenMotion:
    """Replay held-out motion without any effect.

    Args:
        plain: the robot file's model.
        base: its parameters as fitted with no effect.
        shown: the motion to which a correction without structure is fitted.
        portion: the held-out motion.
        simulate: replays its logs on an arm.

    Returns:
        That motion, without windows that begin in motion at a guessed velocity, whose error would be the guess's.

    Raises:
        PlantError: a model cannot be simulated.

    """
    refitted = verdict.applied(plain, base)[0]
    before, alone = simulate(plain), simulate(refitted)
    held = portion.without(before.guessed, before.starts)
    flexible = least([before, alone, corrected(refitted, shown, held, alone)], held)
    return UnseenMotion(held, simulate, before, alone, flexible)
