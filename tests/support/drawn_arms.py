"""Two arms of two joints as the blind check draws them: one lies flat, one stands."""

from __future__ import annotations

from hdagen.blind.realities.two_joint_arms import NOMINAL_DRIVE, NOMINAL_SENSOR, TwoJointArm

LINKS = (
    {"length": 0.15, "mass": 1.6, "center_of_mass": 0.08, "inertia": 0.03},
    {"length": 0.17, "mass": 0.9, "center_of_mass": 0.08, "inertia": 0.012},
)
JOINTS = tuple({**link, **NOMINAL_DRIVE, **NOMINAL_SENSOR} for link in LINKS)
FLAT = TwoJointArm("flat", (0.0, 0.0), JOINTS)  # type: ignore[arg-type]
STANDING = TwoJointArm("standing", (0.0, -9.81), JOINTS)  # type: ignore[arg-type]
NOTHING: tuple[dict[str, dict[str, float]], ...] = ({}, {})  # effects of each joint
