"""The current follows its command with a first-order lag. Legend: T time constant, s."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_time_constant(s: Signals, p: Mapping[str, Any]) -> Any:
    """T of T di/dt = u − i, solved exactly over a row (`hda_input.c`)."""
    return p["current_lag"]


EFFECT = Effect(
    name="current_loop_lag",
    port=Port.LAG,
    parameters=(Parameter("current_lag", "s", 0.0, 0.0, 0.05, "time constant of the current loop", typical=0.002),),
    amplitudes=("current_lag",),
    equation=compute_time_constant,
    citation="Krishnan, Permanent Magnet Synchronous and Brushless DC Motor Drives (2010), 3; size: a current loop"
    " of 80 Hz, slow for an EPOS4 and usual where the drive filters its set value",
    experiment=Experiment("command steps and log the current", "rounds its corners"),
    confusion_groups=(ConfusionGroup.COMMAND_PATH,),
    plot=Plot(PlotKind.INPUT, Abscissa.COMMAND_RATE),
)
