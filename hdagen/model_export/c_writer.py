"""C: the model and controllers of one robot as a folder for firmware, with the limits of its robot file filled in."""

from __future__ import annotations

import json
import secrets
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.generator import run_generator
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.guard_limits import NEVER_TICKS, Guard, Safe, pack_limits
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported, list_parameter_changes

ROBOT_HEADER = "hda_robot.h"  # by which a folder is known as such an export
EXAMPLE_WAY = {"revolute": 0.1, "prismatic": 0.01}  # rad, m: of each joint in example_control.c
JOINT_LIMITS = (  # of a guard, in the order of `pack_limits`, with their units
    *(("torque_limit", "N m"), ("torque_rate", "N m/s"), ("motor_jump", "rad in a tick")),
    *(("joint_jump", "rad or m in a tick"), ("safe_damping", "N m s/rad"), ("safe_stiffness", "N m/rad")),
)
ARM_LIMITS = (("period", "s"), ("period_min", "s"), ("period_max", "s"), ("watchdog", "s"), ("force_limit", "N"))
DESCRIBED = ("build", "robot", "effects", "state", "input", "controllers", "functions")  # of a build's manifest


def write(robot: CorrectedRobot, out: Path) -> Exported:
    """Write a robot's C as a folder.

    Args:
        robot: The robot.
        out: The folder, whole or not at all; one of an earlier export is replaced.

    Returns:
        The folder, and the parameters that the verdict changed.

    Raises:
        PlantError: The robot file states no limits for its controllers, ``out`` holds something else, or it cannot be
            written.

    """
    if out.exists() and not (out / ROBOT_HEADER).is_file():
        raise PlantError(f"--out {out}: is there and no C of an earlier export; name another folder.")
    arm = robot.corrected
    guard = Guard(Safe.ZERO)
    header = write_robot_header(arm, guard)
    part = out.absolute().with_name(f".{out.name}.part-{secrets.token_hex(8)}")
    try:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "c"
            folder.mkdir()
            (folder / ROBOT_HEADER).write_text(header, encoding="utf-8")
            (folder / "manifest.json").write_text(json.dumps(_describe_contents(arm), indent=1) + "\n", "utf-8")
            done = run_generator("wrap", "firmware", "--", str(arm.folder), str(folder))
            if done.code:
                raise PlantError("\n".join(done.messages))
            shutil.copytree(folder, part)
        _replace_folder(part, out)
    except OSError as error:
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
    changes = tuple(list_parameter_changes(robot))
    advice = f"cmake -S {out} -B {out}/out && cmake --build {out}/out && {out}/out/example_control"
    return Exported((out,), changes, {}, (*robot.notes, f"to compile and try it: {advice}"))


def write_robot_header(arm: Arm, guard: Guard) -> str:
    """Write hda_robot.h: a robot's parameters and its guard's limits as C lists.

    Args:
        arm: The arm, with its present parameters.
        guard: The guard.

    Returns:
        The C text.

    Raises:
        PlantError: The robot file does not state a limit.

    """
    problems: list[str] = []
    limits = pack_limits(arm, guard, problems)
    if problems:
        raise PlantError("\n".join(problems))
    rows: list[tuple[str, str, str]] = [("NAME", json.dumps(arm.robot["name"]), "")]
    rows.append(("PARAMETERS", _format_list(arm.p), "p, in the order of manifest.json"))
    rows.append(("TORQUE_PER_INPUT", _format_list(compute_torque_per_input(arm)), "N m/A, or 1"))
    rows.append(("EXAMPLE_WAY", _format_list(EXAMPLE_WAY[j["kind"]] for j in arm.robot["joints"]), "rad, m"))
    rows.append(("STALE_STAMP_TICKS", str(guard.stale_stamp_ticks), "ticks with one stamp that are a fault"))
    for (name, unit), value in zip(ARM_LIMITS, limits, strict=False):
        rows.append((name.upper(), repr(float(value)), unit))
    for k, (name, unit) in enumerate(JOINT_LIMITS):
        first = len(ARM_LIMITS) + k * arm.n
        rows.append((name.upper(), _format_list(limits[first : first + arm.n]), unit))
    every = ", ".join(f"HDA_ROBOT_{name.upper()}" for name, _ in (*ARM_LIMITS, *JOINT_LIMITS))
    rows.append(("LIMITS", f"{{{every}}}", "in the order of hda_config.h"))
    assert guard.stale_bits_ticks == NEVER_TICKS, "the templates say HDA_NEVER"
    lines = "".join(f"#define HDA_ROBOT_{name} {value}{_comment_on(meaning)}\n" for name, value, meaning in rows)
    return (
        "/* This robot: its parameters, and the limits that its robot file states, a value for each joint.\n"
        " * Torques are at the motors. 1e+100 switches a limit off. */\n"
        f"#ifndef HDA_ROBOT_H\n#define HDA_ROBOT_H\n\n{lines}\n#endif\n"
    )


def _comment_on(meaning: str) -> str:
    return f" /* {meaning} */" if meaning else ""


def _format_list(values: Iterable[Any]) -> str:
    return ", ".join(repr(float(value)) for value in values)


def _describe_contents(arm: Arm) -> dict[str, Any]:
    """Names, units and order of every vector, with the values of the parameters."""
    described = {key: arm.manifest[key] for key in DESCRIBED}
    parameters = [q | {"value": float(value)} for q, value in zip(arm.manifest["parameters"], arm.p, strict=True)]
    return described | {"parameters": parameters}


def _replace_folder(part: Path, out: Path) -> None:
    """Put a folder in its place; one that is there goes aside first, and back where that fails."""
    if not out.exists():
        part.rename(out)
        return
    aside = part.with_name(f"{part.name}-old")
    out.rename(aside)
    try:
        part.rename(out)
    except OSError:
        aside.rename(out)
        raise
    shutil.rmtree(aside, ignore_errors=True)
