"""A drive that the robot file calls rigid and that is not. Legend: C compliance, rad/(N m); K stiffness at which
the drive was built, N m/rad; d damping, N m s/rad."""

from collections.abc import Mapping
from typing import Any

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind, SeriesSpring
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_series_spring(s: Signals, p: Mapping[str, Any]) -> Any:
    """(1 / (C K), d): a linear spring of 1/C with a dashpot beside it between rotor and link."""
    return 1 / (p["missing_compliance"] * p["flexspline_stiffness"]), p["missing_damping"]


EFFECT = Effect(
    name="missing_compliance",
    port=Port.SERIES,
    parameters=(
        Parameter(
            "missing_compliance",
            "rad/(N m)",
            0.0001,
            1e-08,
            0.1,
            "torsion by joint torque",
            typical=0.0001,
            sliding="m/N",
        ),
        Parameter(
            "missing_damping",
            "N m s/rad",
            5.0,
            0.0,
            100000.0,
            "damping beside the spring",
            starts=(5.0, 1.0, 20.0),
            sliding="N s/m",
        ),
    ),
    amplitudes=("missing_compliance",),
    equation=compute_series_spring,
    citation="Spong, J. Dyn. Sys. Meas. Control 109 (1987) 310; size: K1 of a CSG-17, Harmonic Drive, CSG/CSF "
    "catalogue (2018)",
    experiment=Experiment("hold the motor and push the tip", "lets the joint give way where the model is rigid"),
    confusion_groups=(
        ConfusionGroup.SOFT_MODE,
        ConfusionGroup.TORSION_OR_READING,
        ConfusionGroup.COMMAND_PATH,
    ),
    plot=Plot(PlotKind.TORSION, Abscissa.TORSION),
    series_spring=SeriesSpring("missing_compliance", "missing_damping"),
)
