"""The formats of `hdagen export`: each has one entry here, and one module that writes it."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.model_export.corrected_robot import CorrectedRobot
    from hdagen.model_export.mujoco_proof import Proof


@dataclass(frozen=True)
class ExportFormat:
    """A format.

    Attributes:
        module: The module with its function ``write(robot, out, **options) -> Exported``.
        ending: The ending of a file in this format; "" where a folder is written.
        meaning: A phrase on it, for `hdagen export --help`.
        options: The options that its ``write`` takes beside robot and out.

    """

    module: str
    ending: str
    meaning: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExportedNumber:
    """A number that the verdict changed: ``where`` it stands in the file, ``before`` (None: it was not stated) and
    ``after`` in ``unit``."""

    where: str
    before: float | None
    after: float
    unit: str


@dataclass(frozen=True)
class Exported:
    """The result of an export.

    Attributes:
        files: The files that were written.
        changes: Each number that differs from the model without the verdict.
        left_out: Effects of the verdict that the format cannot hold, as ``name@joint``, each with a sentence.
        notes: Sentences for the reader.
        proof: The replay in the other simulator, before and after; None where none was asked for.

    """

    files: tuple[Path, ...]
    changes: tuple[ExportedNumber, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    proof: Proof | None = None


def list_parameter_changes(robot: CorrectedRobot) -> list[ExportedNumber]:
    """List the parameters that the verdict changed, for formats that hold the model's own.

    Args:
        robot: The robot.

    Returns:
        Each parameter that differs, by the model's name.

    """
    file, corrected = robot.file.parameters, robot.corrected.parameters
    return [
        ExportedNumber(name, file.get(name), corrected[name], q.unit)
        for name, q in corrected.described.items()
        if corrected[name] != file.get(name, q.nominal)
    ]


FORMATS = {
    "mjcf": ExportFormat("hdagen.model_export.mjcf_writer", ".xml", "a MuJoCo model", ("into", "prove")),
    "urdf": ExportFormat(
        "hdagen.model_export.urdf_writer", ".urdf", "the chain with inertias, damping and friction", ("into",)
    ),
    "json": ExportFormat("hdagen.model_export.json_writer", ".json", "the joints' numbers by name", ("samples",)),
    "fmu": ExportFormat("hdagen.model_export.fmu_writer", ".fmu", "a unit for co-simulation, FMI", ("fmi",)),
    "c": ExportFormat("hdagen.model_export.c_writer", "", "the controllers' C with this robot's limits, a folder"),
}


def find_format(name: str) -> ExportFormat:
    """Find a format by its name.

    Args:
        name: The format's name.

    Returns:
        The format.

    Raises:
        PlantError: There is none of that name.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.support.messages import join_names, show_value, suggest_name

    if name not in FORMATS:
        meant = suggest_name(str(name), FORMATS)
        raise PlantError(f"there is no format {show_value(name)}{meant}; possible are {join_names(list(FORMATS))}.")
    return FORMATS[name]


def check_destination(name: str, out: Path, force: bool) -> None:
    """Refuse a place where an export in a format cannot go.

    Args:
        name: The format's name.
        out: The file or folder.
        force: Whether a file that is there may be replaced.

    Raises:
        PlantError: The place is taken, is no place in a folder, or has another ending than the format's files.

    """
    from hdagen.arm.build_loader import PlantError

    ending = find_format(name).ending
    if ending and out.suffix != ending:
        raise PlantError(f"--out {out}: found a name ending in {out.suffix!r}, possible is {ending}; name such a file.")
    if not out.absolute().parent.is_dir():
        raise PlantError(f"--out {out}: there is no folder {out.absolute().parent}; make it or name another.")
    if ending and out.is_dir():
        raise PlantError(f"--out {out}: is a folder; name a file in it.")
    if out.exists() and not force:
        raise PlantError(f"--out {out}: is there already and would be lost; name another, or add --force.")


def write_export(name: str, robot: CorrectedRobot, out: Path, **options: Any) -> Exported:
    """Write a robot in a format.

    Args:
        name: The format's name.
        robot: The robot.
        out: Where it goes: a file, or a folder for formats of several files.
        options: More of the format's options; None stands for one that was not given.

    Returns:
        The result.

    Raises:
        PlantError: There is no such format, it takes no such option, or ``out`` cannot be written.

    """
    from hdagen.arm.build_loader import PlantError

    chosen = find_format(name)
    given = {option: value for option, value in options.items() if value is not None}
    foreign = [option for option in given if option not in chosen.options]
    if foreign:
        able = [other for other, entry in FORMATS.items() if set(foreign) <= set(entry.options)]
        possible = ", ".join(able) or "no format"
        raise PlantError(
            f"hdagen export {name} takes no --{', --'.join(foreign)}, which belongs to {possible}; leave it out."
        )
    return importlib.import_module(chosen.module).write(robot, out, **given)
