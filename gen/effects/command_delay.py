"""The command arrives late. Legend: d time, s."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_delay(s: Signals, p: Mapping[str, Any]) -> Any:
    """d: what acts at t was commanded at t − d (`hda_input.c`; a part of a row is read as the mean over it)."""
    return p["command_delay"]


EFFECT = Effect(
    name="command_delay",
    port=Port.DELAY,
    parameters=(Parameter("command_delay", "s", 0.0, 0.0, 0.05, "time from a command to its effect", typical=0.003),),
    amplitudes=("command_delay",),
    equation=compute_delay,
    citation="Åström, Murray, Feedback Systems (2008), 8.2; size: two to three cycles of 1 ms of a CANopen drive "
    "(CiA 402 cyclic modes, 2016)",
    experiment=Experiment("command steps and log the current", "shifts it in time, however large it is"),
    confusion_groups=(ConfusionGroup.COMMAND_PATH,),
    plot=Plot(PlotKind.INPUT, Abscissa.COMMAND_RATE),
)
