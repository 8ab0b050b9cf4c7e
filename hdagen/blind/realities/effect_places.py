"""Where each effect of any family acts: the part of the joint that a diagnosis should place the gap at."""

from __future__ import annotations

from collections.abc import Mapping

from hdagen.blind.realities.effect_sizes import EFFECT_SIZES
from hdagen.blind.realities.joint_effects import JOINT_EFFECTS

EFFECT_PLACES: Mapping[str, str] = {
    "motor_inertia": "motor",  # a number of the robot file that the family of a model has wrong
    **{name: one.place for name, one in (*JOINT_EFFECTS.items(), *EFFECT_SIZES.items())},
}
