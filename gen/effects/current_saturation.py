"""The drive limits the current below what is commanded. Legend: i current, A (or N m); s inverse of the limit."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def limit_current(s: Signals, p: Mapping[str, Any]) -> Any:
    """i / max(1, |i| s)."""
    return s.current / ca.fmax(1, ca.fabs(s.current) * p["saturation_inverse"])


EFFECT = Effect(
    name="current_saturation",
    port=Port.INPUT,
    parameters=(
        Parameter(
            "saturation_inverse",
            "1/A",
            0.0,
            0.0,
            10000.0,
            "inverse of the largest current that is let through; 0 is no limit",
            typical=2.0,
            scale="1/largest_input",
        ),
    ),
    amplitudes=("saturation_inverse",),
    equation=limit_current,
    citation="Khalil, Nonlinear Systems (2002), 1.2.7; size: maxon, EPOS4 Firmware Specification (2023), nominal "
    "against output current limit, a factor of two",
    experiment=Experiment("repeat one motion faster and faster", "cuts off large currents alone"),
    confusion_groups=(ConfusionGroup.COMMAND_PATH,),
    plot=Plot(PlotKind.INPUT, Abscissa.COMMAND),
)
