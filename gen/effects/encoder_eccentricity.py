"""A joint encoder whose disc is off centre. Legend: q joint angle; a, b sine and cosine amplitude, rad."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effect import Effect, Parameter, Port, Signals


def error(s: Signals, p: Mapping[str, Any]) -> Any:
    """a sin q + b cos q."""
    return p["eccentricity_sine"] * ca.sin(s.joint_position) + p["eccentricity_cosine"] * ca.cos(s.joint_position)


EFFECT = Effect(
    name="encoder_eccentricity",
    port=Port.SENSOR,
    parameters=(
        Parameter(
            "eccentricity_sine", "rad", 0.0, -0.05, 0.05, "error of the joint encoder once a turn", typical=0.0005
        ),
        Parameter(
            "eccentricity_cosine", "rad", 0.0, -0.05, 0.05, "error of the joint encoder once a turn", typical=0.0005
        ),
    ),
    amplitudes=("eccentricity_sine", "eccentricity_cosine"),
    equation=error,
    citation="Sanchez-Brea, Morlanes, Meas. Sci. Technol. 19 (2008) 115104; size: 20 µm on a disc of 80 mm diameter",
    prismatic=False,
)
