"""Springs in drives that the robot file calls rigid: their level and their damping go into the effect that gives them.

A model with such a spring has a level of stiffness and a torsional damping, as any drive with springs has, and a
diagnosis may name either. The file of a rigid drive has no place for them. The same spring is one of another
compliance, C/level, and of another damping, d + torsional damping.
"""

from __future__ import annotations

from hdagen.arm.compiled_arm import Arm
from hdagen.arm.effect_catalogue import SeriesSpring

LEVEL_KEY, DAMPING_KEY = "stiffness_level", "torsional_damping"  # of any drive with springs


def find_series_springs(arm: Arm) -> dict[int, SeriesSpring]:
    """Find the springs that effects give to rigid drives.

    Args:
        arm: The arm.

    Returns:
        By joint, from 1, the names of the spring's parameters.

    """
    return {
        joint: spring
        for joint in range(1, arm.n + 1)
        for spring in arm.effects.series_springs.values()
        if f"{spring.compliance}_{joint}" in arm.parameters
    }


def fold_series_springs(arm: Arm) -> tuple[Arm, frozenset[str]]:
    """Copy an arm so that its rigid drives have the same springs as their file can hold them.

    Args:
        arm: The arm.

    Returns:
        The copy, and the names of the parameters that went into others.

    """
    folded, described, names = arm.with_parameters(arm.p), arm.parameters.described, set[str]()
    for joint, spring in find_series_springs(arm).items():
        level, damping = f"{LEVEL_KEY}_{joint}", f"{DAMPING_KEY}_{joint}"
        if all(arm.parameters[name] == described[name].nominal for name in (level, damping)):
            continue
        names |= {level, damping}
        compliance, own_damping = described[f"{spring.compliance}_{joint}"], described[f"{spring.damping}_{joint}"]
        stiffness = max(arm.parameters[level] / arm.parameters[compliance.name], 1.0 / compliance.high)
        damped = arm.parameters[own_damping.name] + arm.parameters[damping]
        folded.parameters.update(
            {
                level: described[level].nominal,
                damping: described[damping].nominal,
                compliance.name: max(1.0 / stiffness, compliance.low),
                own_damping.name: min(damped, own_damping.high),
            }
        )
    return folded, frozenset(names)
