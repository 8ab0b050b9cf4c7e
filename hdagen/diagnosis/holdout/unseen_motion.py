"""Held-out motion, with the error that remains before any effect is in the model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import choose_closest_replay, evaluate_gap
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.data.split import LogPortion, split_in_halves
from hdagen.diagnosis.decision.verdict_content import build_hypothetical_verdict
from hdagen.diagnosis.holdout.nonparametric_baseline import fit_nonparametric_baseline
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.prediction.window_replay import Replay

Simulator = Callable[[Arm], Replay]


@dataclass(frozen=True, eq=False)
class HoldoutMotion:
    """A held-out ``portion`` of logs; ``simulate`` replays these logs on an arm. ``before``: replay of the robot file;
    ``base``: replay with its base parameters fitted and no effect; ``flexible``: the best replay of these and of a
    correction without structure."""

    portion: LogPortion
    simulate: Simulator
    before: Replay
    refitted_base: Replay
    flexible: Replay

    def measure_gap(self, after: Replay) -> dict[str, Any]:
        """Measure the gap: `gap` of diagnosis.json.

        Args:
            after: a replay of the same logs.

        Returns:
            The error that it leaves, compared with that of the robot file.

        """
        return evaluate_gap(self.before, after, self.portion, self.flexible)

    def split_in_halves(self) -> tuple[HoldoutMotion, HoldoutMotion]:
        """Split the motion into the even seconds, which decide, and the odd seconds, which are reported."""
        first, second = (replace(self, portion=half) for half in split_in_halves(self.portion))
        return first, second


def measure_without_effects(models: Models, data: PreparedData, null: Fit) -> HoldoutMotion:
    """Replay the held-out motion of a diagnosis without any effect.

    Args:
        models: of the robot.
        data: of the diagnosis.
        null: the fitted null model, whose base parameters are taken.

    Returns:
        That motion.

    Raises:
        PlantError: a model cannot be simulated.

    """
    base = build_hypothetical_verdict(null, ())
    return measure_holdout(models.nominal, base, data.fitted, data.held_out, data.replay_held_out)


def measure_holdout(
    plain: Arm, base: verdict.Verdict, shown: LogPortion, portion: LogPortion, simulate: Simulator
) -> HoldoutMotion:
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
    refitted = verdict.apply_verdict(plain, base)[0]
    before, without_effects = simulate(plain), simulate(refitted)
    held = portion.without_windows(before.guessed_starts, before.starts)
    flexible = choose_closest_replay(
        [before, without_effects, fit_nonparametric_baseline(refitted, shown, held, without_effects)], held
    )
    return HoldoutMotion(held, simulate, before, without_effects, flexible)
