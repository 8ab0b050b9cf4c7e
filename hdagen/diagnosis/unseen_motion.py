"""Motion that no fit saw, with what is left of it before any effect is in the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.achievable import corrected
from hdagen.diagnosis.gap import gap, least
from hdagen.diagnosis.portion import Portion, halve
from hdagen.plant import Arm
from hdagen.replay import Replay

Simulate = Callable[[Arm], Replay]


@dataclass(frozen=True, eq=False)
class UnseenMotion:
    """A ``portion`` of logs; ``simulate`` replays these logs on an arm. ``before`` is the replay of the robot file,
    ``base`` that of its base parameters refitted with no effect, ``flexible`` the best that these and a correction
    without structure leave."""

    portion: Portion
    simulate: Simulate
    before: Replay
    base: Replay
    flexible: Replay

    def measure_gap(self, after: Replay) -> dict[str, Any]:
        """`gap` of diagnosis.json.

        Args:
            after: a replay of the same logs.

        Returns:
            What it leaves of what the robot file errs by.

        """
        return gap(self.before, after, self.portion, self.flexible)

    def halve(self) -> tuple[UnseenMotion, UnseenMotion]:
        """Part it into what decides and what is reported.

        Returns:
            Every other second of it, and the rest.

        """
        first, second = (replace(self, portion=half) for half in halve(self.portion))
        return first, second


def measure_unseen(
    plain: Arm, base: verdict.Verdict, shown: Portion, portion: Portion, simulate: Simulate
) -> UnseenMotion:
    """Replay motion that no fit saw without any effect.

    Args:
        plain: the robot file's model.
        base: its parameters as they are refitted with no effect.
        shown: the motion that a correction without structure is fitted to.
        portion: the motion that no fit saw.
        simulate: replays its logs on an arm.

    Returns:
        That motion, but for windows that begin in motion at a guess, which would tell of itself.

    Raises:
        PlantError: a model cannot be simulated.

    """
    refitted = verdict.applied(plain, base)[0]
    before, alone = simulate(plain), simulate(refitted)
    held = portion.without(before.guessed, before.starts)
    flexible = least([before, alone, corrected(refitted, shown, held, alone)], held)
    return UnseenMotion(held, simulate, before, alone, flexible)
