"""The width of smooth friction in drives whose robot file leaves it open: as wide as the step asks for.

Legend: h step, s; M mass matrix with the rotors of rigid drives; N ratio; J_m inertia of a rotor; w width, rad/s at the
motor. At rest smooth friction of a level f has the slope f/w. It stops the rotor of a flexible drive at the rate
f/(J_m w), and couples rigid drives i and j by the rate N_i (M⁻¹)_ij N_j f_j/w_j, in motor speeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gen.robot.description import Joint, Value
from gen.robot.mass_matrix import invert_mass_matrix
from gen.robot.schema import keys_of

USUAL_WIDTH = 0.01  # rad/s (or m/s) at the joint
SMOOTHING_MARGIN = 2.0  # times the width that the step just carries
LARGEST_SMOOTH_FRICTION = 1.0  # rate of smooth friction times the step, for RK4 with room for larger friction


def widen_open_smoothing(joints: tuple[Joint, ...], is_open: Sequence[bool], step: float) -> tuple[Joint, ...]:
    """Widen the smooth friction of the drives that leave it open, where the step does not carry the usual width.

    Args:
        joints: The joints, base first, with the usual width in drives that leave it open.
        is_open: Whether each joint's drive leaves the width open.
        step: Step, s.

    Returns:
        The joints; the same where the step carries them.

    """
    if not any(is_open):
        return joints
    rates = step * _friction_rates(joints) / LARGEST_SMOOTH_FRICTION
    shares = np.abs(rates).sum(axis=1).max(axis=0)  # no eigenvalue lies beyond the largest
    if shares.max() <= 1.0 or np.abs(np.linalg.eigvals(rates)).max() <= 1.0:
        return joints
    return tuple(
        _widen_smoothing(joint, SMOOTHING_MARGIN * float(share)) if left_open and share > 1.0 else joint
        for joint, left_open, share in zip(joints, is_open, shares, strict=True)
    )


def _friction_rates(joints: tuple[Joint, ...]) -> np.ndarray:
    """Rates (poses × n × n), 1/s, at which smooth friction of joint j slows joint i, in motor speeds."""
    rigid = np.array([bool(joint.drive.rigid) for joint in joints])
    ratio = np.array([joint.drive.ratio.nominal for joint in joints])
    slope = np.array(
        [joint.drive.coulomb_friction.nominal / joint.drive.friction_smoothing.nominal for joint in joints]
    )
    rates = invert_mass_matrix(joints) * np.outer(ratio, ratio * slope) * np.outer(rigid, rigid)
    for j in np.flatnonzero(~rigid):
        rates[:, j, j] = slope[j] / joints[j].drive.motor_inertia.nominal
    return np.asarray(rates)


def _widen_smoothing(joint: Joint, factor: float) -> Joint:
    widest = keys_of("joint.drive")["friction_smoothing"].range.high
    width = min(float(f"{factor * joint.drive.friction_smoothing.nominal:.3g}"), widest)
    return replace(joint, drive=replace(joint.drive, friction_smoothing=Value(width, 0.0)))
