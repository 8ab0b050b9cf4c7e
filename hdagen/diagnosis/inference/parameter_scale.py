"""Parameters whose size spans orders of magnitude."""

from __future__ import annotations

from hdagen.arm.arm_parameters import Parameter

SCALE_FREE_UNITS = ("N m/rad", "N/m", "N m s/rad", "N s/m")  # units of walls and dampers


def is_scale_free(parameter: Parameter) -> bool:
    """Tell whether a parameter's size spans orders of magnitude, so that its typical size says little.

    Args:
        parameter: the parameter.

    """
    return parameter.unit.endswith(SCALE_FREE_UNITS) or parameter.is_guess
