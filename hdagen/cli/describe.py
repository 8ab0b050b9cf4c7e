"""`hdagen describe`: a robot as its build knows it: joints, drives, effects, parameters, step."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from hdagen.cli.build import add_build_options, read_effect_names

if TYPE_CHECKING:
    from rich.console import Console

    from hdagen.arm.arm_parameters import Parameter
    from hdagen.arm.compiled_arm import Arm

DESCRIBE_EXAMPLE = """example:
  hdagen describe paper
  hdagen describe robot.toml --effects backlash
  hdagen describe paper coulomb_friction_1 ratio_1

builds the robot first where there is no build of it.
exit codes: 0 done, 2 usage or configuration"""
DONE = 0
FILE_WIDTH = 160  # columns where the output is no terminal


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "describe",
        help="print joints, drives, effects, parameters and step of a robot",
        description="Prints a robot as its build knows it. With names of parameters: those alone.",
        epilog=DESCRIBE_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", help="a preset or a robot.toml")
    p.add_argument("names", nargs="*", metavar="PARAMETER", help="a parameter, such as mass_1")
    add_build_options(p)
    p.add_argument("--json", action="store_true", help="print the description as JSON")


def run(options: argparse.Namespace) -> int:
    """Describe a robot.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: The robot cannot be built, or has no such parameter.

    """
    from hdagen.arm.compiled_arm import load

    arm = load(options.robot, options.profile, read_effect_names(options), options.out)
    parameters = _select_parameters(arm, options.names)
    if options.json:
        print(json.dumps(_make_content(arm, parameters, bool(options.names)), indent=1))
        return DONE
    console = _make_console()
    if not options.names:
        _print_robot(console, arm)
    _print_parameters(console, parameters)
    return DONE


def _make_console() -> Console:
    from rich.console import Console

    if sys.stdout.isatty():
        return Console(highlight=False)
    return Console(highlight=False, width=FILE_WIDTH)


def _select_parameters(arm: Arm, names: Iterable[str]) -> list[Parameter]:
    """The parameters of these names, or all of them. Raises PlantError where there is none of a name."""
    from hdagen.arm.arm_parameters import UnknownParameter
    from hdagen.arm.build_loader import PlantError

    described, problems, found = arm.parameters.described, [], []
    for name in names:
        try:
            arm.parameters.index(name)
            found.append(described[name])
        except UnknownParameter as error:
            problems.append(str(error))
    if problems:
        raise PlantError("\n".join(problems))
    return found or list(described.values())


def _make_content(arm: Arm, parameters: Iterable[Parameter], is_selection: bool) -> dict[str, Any]:
    content: dict[str, Any] = {"parameters": [vars(parameter) for parameter in parameters]}
    if is_selection:
        return content
    from hdagen.arm.ratings import compute_rated_torque

    limit = arm.stability.longest_step_under_load(arm, compute_rated_torque(arm))
    step: dict[str, Any] = {"step": arm.step_size, "is_stiff": arm.manifest["stiff"], "at_rated_torque": None}
    if math.isfinite(limit):
        step["at_rated_torque"] = limit
    return {
        "folder": str(arm.folder),
        "robot": arm.robot,
        "effects": arm.manifest["effects"],
        "state": arm.manifest["state"],
        "input": arm.manifest["input"],
        "step_limits": step,
        **content,
    }


def _print_robot(console: Console, arm: Arm) -> None:
    content = _make_content(arm, (), False)
    joints = f"{arm.n} joint{'s' * (arm.n > 1)}"
    sizes = f"{joints}, {arm.nx} states, {arm.nu} inputs, {len(arm.parameters)} parameters"
    console.print(f"{arm.robot['name']}: {sizes}", markup=False)
    console.print(f"build: {arm.folder}", markup=False, soft_wrap=True)
    _print_joints(console, arm.robot["joints"])
    _print_effects(console, content["effects"])
    _print_step(console, content["step_limits"])


def _print_joints(console: Console, joints: Iterable[Mapping[str, Any]]) -> None:
    from rich.table import Table

    table = Table("joint", "kind", "drive", "input", title="joints and drives", title_justify="left")
    for heading in ("ratio", "length", "mass", "torque limit", "speed limit", "motion"):
        table.add_column(heading, justify="right")
    for number, joint in enumerate(joints, 1):
        drive, limits = joint["drive"], joint["limits"]
        kind, given = "springs", "current"
        if drive["rigid"]:
            kind = "rigid"
        if drive["torque_constant"] is None:
            given = "torque"
        length = joint["length"]["nominal"] if "length" in joint else math.hypot(*joint["origin"])
        numbers = (drive["ratio"]["nominal"], length, joint["mass"]["nominal"])
        bounds = (limits["torque"], limits["speed"])
        motion = "none stated"
        if limits["position"]:
            motion = "{:g} to {:g}".format(*limits["position"])
        stated = [_format_number(value) for value in (*numbers, *bounds)]
        label = f"{joint['name']} ({number})" if "name" in joint else str(number)
        table.add_row(label, joint["kind"], kind, given, *stated, motion)
    console.print(table)


def _print_effects(console: Console, effects: Iterable[Mapping[str, Any]]) -> None:
    from rich.markup import escape
    from rich.table import Table

    table = Table("effect", "acts on", "joints", "source", title="effects in the model", title_justify="left")
    for effect in effects:
        joints = ", ".join(str(joint) for joint in effect["joints"] if joint) or "arm"
        table.add_row(effect["name"], effect["place"], joints, escape(effect["citation"]))
    console.print(table)


def _print_step(console: Console, step: Mapping[str, Any]) -> None:
    method = "RK4"
    if step["is_stiff"]:
        method = "an L-stable method (RODAS), as a memory of an effect is stiff"
    console.print(f"step: {step['step']:g} s, by {method}", markup=False)
    if step["at_rated_torque"] is not None:
        console.print(f"longest stable step at rated torque: {step['at_rated_torque']:.3g} s", markup=False)


def _print_parameters(console: Console, parameters: Iterable[Parameter]) -> None:
    from rich.markup import escape
    from rich.table import Table

    table = Table("parameter", title="parameters, SI units", title_justify="left")
    for heading in ("value", "lowest", "highest"):
        table.add_column(heading, justify="right")
    for heading in ("unit", "role", "meaning"):
        table.add_column(heading)
    for parameter in parameters:
        numbers = map(_format_number, (parameter.nominal, parameter.low, parameter.high))
        table.add_row(parameter.name, *numbers, escape(parameter.unit), parameter.role, escape(parameter.meaning))
    console.print(table)


def _format_number(value: float | None) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}"
