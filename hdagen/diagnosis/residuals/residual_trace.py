"""The residual as it shows at the place of an effect, and the part that the effect adds.

Legend: K instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque


@dataclass(frozen=True, eq=False)
class ResidualTrace:
    """The residual that shows a place best: ``before`` and ``after`` the verdict, and the ``effect_part``
    that the verdict's effect adds (K each), at the valid ``instants`` of the torque balance."""

    quantity: str
    unit: str
    before: Array
    after: Array
    effect_part: Array
    instants: np.ndarray


def trace_residual(sight: ResidualTorque, place: str, joint: int, entry: str) -> ResidualTrace:
    """Compute the residual as it shows at one place of a joint, and the part of an effect in it.

    Args:
        sight: the torque balance.
        place: input, motor, transmission, link or sensor.
        joint: the joint.
        entry: the effect, name@joint.

    Returns:
        The residual before and after the verdict.

    """
    j, less, ok = joint - 1, sight.parameters_without(entry), sight.motion.valid
    if place == "input" and sight.motion.has_measured_input(joint):
        return _trace_input(sight, joint, less)
    traits = sight.motion.arm.effects.get(entry.partition("@")[0])  # none of what is unknown
    kind = traits.residual if traits else "at_place"
    if kind == "torque_reading" and f"joint_torque_{joint}" in sight.motion.log:
        read = sight.motion.smooth(sight.motion.on_grid(sight.motion.log[f"joint_torque_{joint}"])[:, None])[ok, 0]
        first, last, none = (sight.balance.sensed_torque(p)[ok, j] for p in (sight.before, sight.after, less))
        return ResidualTrace(
            f"reading of the torque sensor of joint {joint}", "N m", read - first, read - last, last - none, ok
        )
    before, after, added = (
        sight.balance.residual(sight.before),
        sight.balance.residual(sight.after),
        sight.balance.effect_torque(sight.after, less),
    )
    if before.link is None or added.link is None or place in ("input", "motor"):
        quantity = f"torque missing at motor {joint}"
        return ResidualTrace(quantity, "N m", before.motor[ok, j], after.motor[ok, j], added.motor[ok, j], ok)
    assert after.link is not None  # as before's, which is of the same log
    if place == "sensor":
        slope = sight.balance.spring_stiffness(sight.after)[ok, j]
        read = sight.balance.encoder_error(sight.after, less)[ok, j]
        quantity = f"angle that the encoder of joint {joint} reads too much"
        left = after.link[ok, j] / slope
        return ResidualTrace(quantity, "rad", before.link[ok, j] / slope, left, read, ok)
    if kind == "gear_angle":
        slope = sight.balance.spring_stiffness(sight.after)[ok, j]
        quantity = f"angle missing in the transmission of joint {joint}"
        first, last, more = (side[ok, j] / slope for side in (before.link, after.link, added.link))
        return ResidualTrace(quantity, "rad", first, last, more, ok)
    quantity = f"torque missing at link {joint}"
    return ResidualTrace(quantity, "N m", before.link[ok, j], after.link[ok, j], added.link[ok, j], ok)


def _trace_input(sight: ResidualTorque, joint: int, less: Array) -> ResidualTrace:
    """Compute the measured input less the model's response to the command."""
    name, log, ok = sight.motion.arm.input_names[joint - 1], sight.motion.log, sight.motion.valid

    def seen(values: Array) -> Array:
        return sight.motion.smooth(sight.motion.on_grid(values)[:, None])[ok, 0]

    before, after = (seen(log[name] - r.columns[name]) for r in sight.motion.replays)
    adds = seen(
        sight.balance.simulate_inputs(sight.after)[1][:, joint - 1]
        - sight.balance.simulate_inputs(less)[1][:, joint - 1]
    )
    quantity = f"{sight.motion.input_word(joint)} of motor {joint} beyond the model's"
    return ResidualTrace(quantity, sight.motion.input_unit(joint), before, after, adds, ok)
