"""A joint encoder that is read later than the motor's. Legend: d delay, s; q̇, q̈ joint speed and acceleration."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, EncoderTerm, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_reading_error(s: Signals, p: Mapping[str, Any]) -> Any:
    """−d q̇ + d² q̈ / 2."""
    d = p["sensor_delay"]
    return d * (0.5 * d * s.joint_acceleration - s.joint_velocity)


EFFECT = Effect(
    name="sensor_delay",
    port=Port.SENSOR,
    parameters=(
        Parameter(
            "sensor_delay",
            "s",
            0.0,
            -0.01,
            0.02,
            "age of the joint encoder's reading against the motor's",
            typical=0.002,
            is_reading_delay=True,
            encoder_term=EncoderTerm.JOINT_SPEED,
        ),
    ),
    amplitudes=("sensor_delay",),
    equation=compute_reading_error,
    citation="Taylor's series of q(t − d); size: two cycles of 1 ms of a field bus (CiA 402 (2016))",
    experiment=Experiment(
        "run at several constant speeds with both encoders", "shifts a reading in proportion to speed"
    ),
    confusion_groups=(ConfusionGroup.TORSION_OR_READING,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_SPEED),
)
