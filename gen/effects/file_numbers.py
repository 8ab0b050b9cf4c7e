"""Numbers of the robot file that no effect stands for, and that may be wrong by a factor.

The equations of motion hold them already, so they have no term and no port: the model without them is no model.
"""

from __future__ import annotations

from dataclasses import dataclass

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind, Residual

USUAL_ERROR = 1 / 3  # of the number: three times the 10 % to which CAD and data sheets hold (`gen.robot.trust`)


@dataclass(frozen=True)
class FileNumber:
    """A number of the robot file that may be wrong.

    Attributes:
        name: Its key in the robot file, and its name in reports.
        place: Where it belongs: motor or link.
        meaning: A phrase on it.
        experiment: The experiment that shows that it is wrong.
        plot: The plot that fits it.
        confusion_groups: The groups of effects among which it is hard to tell in a log.
        alternatives: Effects at the same joint that are the same as this number being wrong.
        residual: The residual that shows it.

    """

    name: str
    place: str
    meaning: str
    experiment: Experiment
    plot: Plot
    confusion_groups: tuple[ConfusionGroup, ...]
    alternatives: tuple[str, ...] = ()
    residual: Residual = Residual.AT_PLACE


_OVER_ACCELERATION = Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ACCELERATION)
_OVER_ANGLE = Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE)
_GROUPS = (ConfusionGroup.INERTIA_OR_WEIGHT, ConfusionGroup.GAIN_OR_MASS)

FILE_NUMBERS = (
    FileNumber(
        "motor_inertia",
        "motor",
        "Inertia of the rotor and wave generator, or the armature.",
        Experiment("accelerate hard with the arm folded and stretched", "resists alike in every pose, with the ratio²"),
        _OVER_ACCELERATION,
        _GROUPS,
    ),
    FileNumber(
        "mass",
        "link",
        "Mass of the link.",
        Experiment("hold still at several poses and accelerate in each", "adds weight, and inertia in proportion"),
        _OVER_ANGLE,
        (*_GROUPS, ConfusionGroup.POSE),
        ("payload",),
    ),
    FileNumber(
        "center_of_mass",
        "link",
        "Centre of mass of the link, from the joint's axis.",
        Experiment(
            "hold still at several poses across the range", "changes weight in proportion, inertia with its square"
        ),
        _OVER_ANGLE,
        (*_GROUPS, ConfusionGroup.POSE),
    ),
    FileNumber(
        "inertia",
        "link",
        "Inertia of the link about its centre of mass.",
        Experiment("accelerate hard, and hold still at several poses", "resists acceleration and weighs nothing"),
        _OVER_ACCELERATION,
        _GROUPS,
    ),
)
