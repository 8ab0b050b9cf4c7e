"""`python -m gen check`: what a robot file describes, what a build of it would be, and whether its step carries it."""

from __future__ import annotations

from pathlib import Path

from gen import build
from gen.compile import CompileError
from gen.drive import ERROR
from gen.effect import Effect
from gen.model import Model
from gen.robot import Joint, load


def report(
    source: str, extra: tuple[str, ...] = (), profile: str = "portable", out: Path = Path("build")
) -> tuple[list[str], bool]:
    """Lines to print, and whether `gen build` would build the robot. Raises RobotError, BuildError."""
    robot = load(source)
    made, effects, examined = build.assembled(source, robot, tuple(sorted(set(extra))))
    model = made.graphs.model
    sizes = f"{len(model.x_slots)} states, {len(model.u_slots)} inputs, {len(model.quantities)} parameters"
    all_sizes = f"{sizes}, {made.graphs.c.numel()} constants, {len(made.functions)} functions"
    lines = [f"{robot.name}: {model.n} joint{'s' * (model.n > 1)}, {all_sizes}"]
    lines += [f"  joint {number}  {_joint(joint)}" for number, joint in enumerate(robot.joints, 1)]
    lines += [f"  effect   {_effect(model, effect)}" for effect in effects]
    if model.flexible:
        corrected = f" and {model.plan.corrections} corrections" if model.plan.corrections else ""
        lines.append(
            f"  springs  inverse within {ERROR:g} rad by a polynomial of degree {model.plan.degree}{corrected}"
        )
    method = "L-stable (RODAS), as a memory is stiff" if model.stiff else "RK4"
    lines.append(f"  step     {robot.step:g} s, {method}")
    lines += [f"  {line}" for line in examined.lines()]
    refused = examined.refusals(source)
    return lines + refused + ([] if refused else [_folder(source, profile, out, extra)]), not refused


def _joint(joint: Joint) -> str:
    drive = joint.drive
    torque = f"{joint.limits.torque:g} {'N' if joint.kind == 'prismatic' else 'N m'}" if joint.limits.torque else "none"
    kind = "rigid" if drive.rigid else "springs"
    given = "torque" if drive.torque_constant is None else "current"
    return f"{joint.kind}, {kind}, ratio {drive.ratio.nominal:g}, input {given}, torque limit {torque}"


def _effect(model: Model, effect: Effect) -> str:
    at = ", ".join(str(j) for j in model.applies(effect))
    where = {"0": "arm"}.get(at, f"joint {at}" if at else "no joint")
    return f"{effect.name} ({effect.port.place}, {where}): {effect.citation}"


def _folder(source: str, profile: str, out: Path, extra: tuple[str, ...]) -> str:
    try:
        folder, name, _ = build.place(source, profile, out, extra)
    except CompileError as error:
        return f"cannot be built here: {error}"
    there = "is there" if build.intact(folder, name) else "would be made"
    return f"{folder} ({profile}) {there}"
