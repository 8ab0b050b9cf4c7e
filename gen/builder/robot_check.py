"""`python -m gen check`: the contents of a robot file, the build that it gives, and whether its step carries it."""

from __future__ import annotations

from pathlib import Path

from gen.builder import build
from gen.builder.compiler import CompileError
from gen.effects.effect import Effect
from gen.model.arm_model import Model
from gen.model.base_parameters import find_base_parameters
from gen.model.harmonic_drive import INVERSE_TOLERANCE
from gen.robot.description import Joint
from gen.robot.load_robot import load


def report_robot(
    source: str, extra: tuple[str, ...] = (), profile: str = "portable", out: Path = Path("build")
) -> tuple[list[str], bool]:
    """Describe a robot file and the build that it would give.

    Args:
        source: A preset's name or the path of a robot.toml.
        extra: Names of the effects to add.
        profile: ``portable`` or ``native``.
        out: The folder of all builds.

    Returns:
        Lines to print, and whether `gen build` would build the robot.

    Raises:
        RobotError: The robot file cannot be used.
        BuildError: There is no such effect.

    """
    robot = load(source)
    library, effects, examined = build.assemble_library(source, robot, tuple(sorted(set(extra))))
    model = library.graphs.model
    sizes = f"{len(model.x_slots)} states, {len(model.u_slots)} inputs, {len(model.quantities)} parameters"
    all_sizes = f"{sizes}, {library.graphs.c.numel()} constants, {len(library.functions)} functions"
    lines = [f"{robot.name}: {model.n} joint{'s' * (model.n > 1)}, {all_sizes}"]
    lines += [f"  joint {number}  {_describe_joint(joint)}" for number, joint in enumerate(robot.joints, 1)]
    lines += [f"  effect   {_describe_effect(model, effect)}" for effect in effects]
    if model.flexible:
        corrected = ""
        if model.plan.corrections:
            corrected = f" and {model.plan.corrections} corrections"
        lines.append(
            f"  springs  inverse within {INVERSE_TOLERANCE:g} rad by a polynomial of degree"
            f" {model.plan.degree}{corrected}"
        )
    method = "RK4"
    if model.needs_stiff_step:
        method = "L-stable (RODAS), as a memory is stiff"
    lines.append(f"  step     {robot.step:g} s, {method}")
    lines += [f"  {line}" for line in examined.describe_step()]
    if robot.in_space:
        lines += _describe_base_parameters(model)
    refused = examined.refusals(source)
    if refused:
        return lines + refused, False
    return [*lines, _describe_folder(source, profile, out, extra)], True


def _describe_joint(joint: Joint) -> str:
    drive = joint.drive
    limit, kind, given = "none", "springs", "current"
    if joint.limits.torque:
        unit = "N" if joint.kind == "prismatic" else "N m"
        limit = f"{joint.limits.torque:g} {unit}"
    if drive.rigid:
        kind = "rigid"
    if drive.torque_constant is None:
        given = "torque"
    return f"{joint.kind}, {kind}, ratio {drive.ratio.nominal:g}, input {given}, torque limit {limit}"


def _describe_effect(model: Model, effect: Effect) -> str:
    at = ", ".join(str(j) for j in model.joints_of_effect(effect))
    where = {"0": "arm", "": "no joint"}.get(at, f"joint {at}")
    return f"{effect.name} ({effect.port.place}, {where}): {effect.citation}"


def _describe_base_parameters(model: Model) -> list[str]:
    """A line for each combination of the links' inertial parameters that a motion can tell, and one for the others."""
    found, unseen = find_base_parameters(model.chain, {q.name: q.nominal for q in model.quantities})
    lines = [f"  links    {len(found)} combinations of {10 * model.n} inertial parameters show in a motion"]
    for one in found:
        others = "".join(f" {'-' if share < 0 else '+'} {abs(share):.4g} {name}" for name, share in one.others)
        lines.append(f"  links    {one.name}{others}".replace(" 1 ", " "))
    if unseen:
        lines.append(f"  links    no motion shows {', '.join(unseen)}")
    return lines


def _describe_folder(source: str, profile: str, out: Path, extra: tuple[str, ...]) -> str:
    try:
        folder, name, _ = build.locate_build(source, profile, out, extra)
    except CompileError as error:
        return f"cannot be built here: {error}"
    if build.is_intact(folder, name):
        return f"{folder} ({profile}) is there"
    return f"{folder} ({profile}) would be made"
