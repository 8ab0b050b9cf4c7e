"""The list of all figures and tables, with the module that makes each."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hdagen.arm.build_loader import PlantError
from hdagen.paper.prototype.figure_result import Result
from hdagen.paper.prototype.virtual_prototype import Bench
from hdagen.support.messages import suggest_name

Maker = Callable[[Bench], Result]


@dataclass(frozen=True)
class FigureEntry:
    """A figure or table: its name, the module of `hdagen.paper.figures` whose function of that name makes it, and its
    title. Figures of one module are made one after another."""

    name: str
    module: str
    title: str

    def make_result(self, bench: Bench) -> Result:
        """Simulate and compute the figure.

        Args:
            bench: arms and shared runs.

        Returns:
            The figure or table.

        """
        maker: Maker = getattr(importlib.import_module(f"hdagen.paper.figures.{self.module}"), f"make_{self.name}")
        return maker(bench)


PAPER_FIGURES = (
    FigureEntry("table1", "drive_figures", "Parameters of the validation model"),
    FigureEntry("table2", "drive_figures", "Parameters of the DC motor"),
    FigureEntry("fig3b", "drive_figures", "Hysteresis effect: torque against torsion, input locked"),
    FigureEntry("fig8", "drive_figures", "Stiffness curve of the drive"),
    FigureEntry("fig9", "estimation_validation", "Numerical validation of torque estimation"),
    FigureEntry("fig11", "compliance_figures", "Admittance control: M, B and K varied"),
    FigureEntry("fig12", "compliance_figures", "Impedance control: M, B and K varied"),
    FigureEntry("maps11", "compliance_maps", "Admittance control: maps over M, B and K"),
    FigureEntry("maps12", "compliance_maps", "Impedance control: maps over M, B and K"),
    FigureEntry("fig14", "kinematic_torsion_figures", "Kinematic torsion and the angle of the output"),
    FigureEntry("fig15", "estimation_figures", "Torque estimation of both joints"),
    FigureEntry("resolution", "estimation_validation", "Torque error against encoder resolution"),
    FigureEntry("fig16", "tracking_figures", "Compliance control: paths of the tip"),
    FigureEntry("fig17", "tracking_figures", "Position tracking in x and y"),
    FigureEntry("table3", "tracking_figures", "Parameters of the compliance control"),
    FigureEntry("table4", "tracking_figures", "Tracking errors"),
    FigureEntry("sensorless", "sensorless_figures", "Compliance control without a torque sensor"),
    FigureEntry("fig18", "collision_figures", "Collision: set-up, force and clearance"),
    FigureEntry("fig19", "collision_figures", "Collision, admittance control"),
    FigureEntry("fig20", "collision_figures", "Collision, impedance control"),
    FigureEntry("fig21", "collision_comparison", "Collision: both controllers compared"),
    FigureEntry("table5", "collision_figures", "Parameters of the collision experiment"),
    FigureEntry("joints3", "three_joint_figures", "The outlook: an arm of three joints"),
)


def find_figures(names: Sequence[str]) -> tuple[FigureEntry, ...]:
    """Find figures by name.

    Args:
        names: names of figures; "all" stands for every one.

    Returns:
        The figures, in the order of the names.

    Raises:
        PlantError: there is no figure of a name; the message lists the names.

    """
    known = {figure.name: figure for figure in PAPER_FIGURES}
    problems = []
    for name in names:
        if name == "list":
            problems.append("list stands alone: hdagen paper list.")
        elif name not in known and name != "all":
            near = suggest_name(name.lower().replace(" ", "").replace(".", ""), known)
            problems.append(f"no figure or table named {name[:40]!r}{near}; there are {', '.join(known)}, and all.")
    if problems:
        raise PlantError("\n".join(problems))
    if "all" in names:
        return PAPER_FIGURES
    return tuple(known[name] for name in dict.fromkeys(names))
