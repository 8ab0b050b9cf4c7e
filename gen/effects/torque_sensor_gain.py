"""A joint torque sensor with a wrong gain. Legend: g error of the gain; τ joint torque, N m."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, Experiment, Plot, PlotKind, Residual
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_reading_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """g τ."""
    return p["torque_sensor_error"] * s.joint_torque


EFFECT = Effect(
    name="torque_sensor_gain",
    port=Port.TORQUE_SENSOR,
    parameters=(
        Parameter(
            "torque_sensor_error", "1", 0.0, -1.0, 1.0, "relative error of the torque sensor's gain", typical=0.1
        ),
    ),
    amplitudes=("torque_sensor_error",),
    equation=compute_reading_error,
    citation="Taghirad, Bélanger, J. Dyn. Sys. Meas. Control 120 (1998) 439, strain gauges on a flexspline, with "
    "its size",
    experiment=Experiment("hang a known weight on the arm at rest", "is wrong in the sensor's reading alone"),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.LOAD),
    residual=Residual.TORQUE_READING,
)
