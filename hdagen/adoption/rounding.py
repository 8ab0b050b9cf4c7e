"""Fitted numbers rounded to the digits that the log determines.

A digit counts while it is larger than a hundredth of the standard deviation that the number has with all others held.
The usual standard deviation will not do: parameters that compensate each other are wide one by one, and their
combination, on which the motion depends, is narrow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeGuard

from hdagen.adoption.diagnosis_file import is_finite
from hdagen.adoption.verdict import Verdict
from hdagen.arm.compiled_arm import Arm

ROUNDING_SHARE = 0.01  # of that standard deviation, below which digits are dropped


def read_conditional_deviations(content: Mapping[str, Any], stated: Verdict) -> dict[str, float]:
    """Read the standard deviation that each parameter has with all others held.

    Args:
        content: Content of a diagnosis.json that `hdagen.adoption.verdict` could read.
        stated: Its verdict.

    Returns:
        The deviations by the model's names, in SI units; parameters without one are left out.

    """
    estimates = dict(content.get("parameters", {}))
    parameters = {(cause["effect"], cause["joint"]): cause.get("parameters") for cause in content.get("causes", [])}
    for effect in stated.effects:
        own = parameters[effect.name, effect.joint]
        estimates |= {name: own.get(name.removesuffix(f"_{effect.joint}")) for name in effect.parameters}
    deviations = {name: one.get("conditional_std") for name, one in estimates.items() if isinstance(one, Mapping)}
    return {name: value for name, value in deviations.items() if _is_positive(value)}


def _is_positive(value: Any) -> TypeGuard[float]:
    return (
        not isinstance(value, bool)
        and isinstance(value, int | float)
        and is_finite(value)
        and ROUNDING_SHARE * value > 0
    )


def round_parameters(arm: Arm, deviations: Mapping[str, float]) -> Arm:
    """Copy an arm with rounded parameters.

    Args:
        arm: An arm with fitted parameters.
        deviations: Standard deviation of each parameter while all others are held, by name.

    Returns:
        The copy. A parameter stays as it is where it has no deviation, where it is the robot file's own number, and
        where rounding would leave its bounds.

    """
    rounded = {}
    for name, std in deviations.items():
        described, value = arm.parameters.described[name], arm.parameters[name]
        shortened = round_to_deviation(value, std)
        if value != described.nominal and described.low <= shortened <= described.high:
            rounded[name] = shortened
    copy = arm.with_parameters(arm.p)
    copy.parameters.update(rounded)
    return copy


def round_to_deviation(value: float, std: float) -> float:
    """Round a number to the largest power of ten up to `ROUNDING_SHARE` of its standard deviation.

    Args:
        value: The number.
        std: Its standard deviation, above 0.

    Returns:
        The nearest multiple of that power of ten.

    """
    return round(value, -math.floor(math.log10(ROUNDING_SHARE * std)))
