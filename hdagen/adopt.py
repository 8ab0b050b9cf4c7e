"""Adopt: the verdict of a diagnosis put into the robot file, whose comments and layout stay as they are.

What is written is what `replay --with` uses, by the same rule (`hdagen.verdict`): base parameters no further than three
tolerances from where they were, the effects of the verdict as [[effect]] tables. The new file is built before it is put
in its place, and a model whose parameters are not the ones meant is refused.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen import verdict
from hdagen.plant import Arm, PlantError, load
from hdagen.robot_file import RobotFile
from hdagen.whole import open_whole

_LARGEST = 1_000_000  # bytes of a robot file
_ROUNDING = 1e-9  # a lumped inertia goes through a sum and a difference


@dataclass(frozen=True)
class Change:
    """A number of the robot file: ``where`` it stands (``joint[2].drive.coulomb_friction``), in ``unit``; ``before`` is
    None where the file did not hold it."""

    where: str
    before: float | None
    after: float
    unit: str


@dataclass(frozen=True)
class Adopted:
    """A robot file with a verdict in it: its ``text``, what changed, and what a reader must know, in sentences."""

    text: str
    changes: tuple[Change, ...]
    notes: tuple[str, ...]


def adopt(
    diagnosis: str | Path, robot: str | Path, out: str | Path, force: bool = False, profile: str = "portable"
) -> Adopted:
    """Write ``robot`` (a robot.toml) with the verdict of ``diagnosis`` (a diagnosis.json) in it to ``out``.

    A file at ``out`` is kept unless ``force``. Raises PlantError: a diagnosis of another robot or of an older state of
    its file, of an unknown schema or with numbers that are none, an ``out`` that cannot be written.
    """
    robot, out = Path(robot), Path(out)
    raw = _read(robot)
    _writable(out, force)
    stated = verdict.read(diagnosis)
    content = json.loads(Path(diagnosis).read_bytes())
    arm = verdict.with_effects(robot, profile, stated)
    wanted, notes = verdict.applied(arm, stated)
    file = RobotFile(raw, arm)
    changes = _changes(file, arm, wanted, stated, _spreads(content))
    text = file.text()
    try:
        with open_whole(out) as new:
            new.write(text)
            new.flush()
            _agrees(Path(new.name), out, profile, wanted)
    except OSError as error:
        raise PlantError(
            f"{out}: cannot be written ({error.strerror}), and what stood there is unchanged; make room or name "
            "another place."
        ) from None
    notes = [note.replace("nothing is added for it", "nothing is adopted for it") for note in notes]
    if not changes:
        notes.append("The diagnosis changes nothing: what is written is the robot file as it was.")
    return Adopted(text.decode("utf-8-sig"), tuple(changes), tuple(notes))


def _read(robot: Path) -> bytes:
    """The robot file. Raises PlantError."""
    possible = "possible is a robot.toml; for a preset take a copy of its file"
    try:
        if not robot.is_file():
            raise PlantError(f"{robot}: found no such file, {possible}.")
        with robot.open("rb") as stream:
            raw = stream.read(_LARGEST + 1)
    except (OSError, ValueError) as error:
        raise PlantError(f"{robot}: cannot be read ({getattr(error, 'strerror', error)}), {possible}.") from None
    if len(raw) > _LARGEST:
        raise PlantError(f"{robot}: found more than {_LARGEST} bytes, {possible}, which is far smaller.")
    return raw


def _writable(out: Path, force: bool) -> None:
    """Refuses a place that is none, or is taken."""
    if out.suffix != ".toml":
        raise PlantError(f"--out {out}: found a name ending in {out.suffix!r}, possible is .toml; name such a file.")
    if not out.absolute().parent.is_dir():
        raise PlantError(f"--out {out}: there is no folder {out.absolute().parent}; make it or name another.")
    if out.is_dir():
        raise PlantError(f"--out {out}: is a folder; name a file in it.")
    if out.exists() and not force:
        raise PlantError(f"--out {out}: is there already and would be lost; name another file, or add --force.")


def _spreads(content: Mapping[str, Any]) -> dict[tuple[str, int], Mapping[str, Any]]:
    """Parameters of each cause as the diagnosis holds them, with their standard deviations."""
    causes = content.get("causes", [])
    return {(c["effect"], c["joint"]): c.get("parameters") or {} for c in causes}  # verdict.read has checked them


def _changes(
    file: RobotFile,
    arm: Arm,
    wanted: Arm,
    stated: verdict.Verdict,
    spreads: Mapping[tuple[str, int], Mapping[str, Any]],
) -> list[Change]:
    """Put every number that differs into ``file``, the base first, and say where each went."""
    changes = []
    own = {name: effect for effect in stated.effects for name in effect.parameters}
    for name, described in arm.parameters.described.items():
        effect, after = own.get(name), wanted.parameters[name]
        if after == described.nominal and effect is None:
            continue
        place = file.place(name, effect.name if effect else None)
        held = file.holds(place)
        if held and after == described.nominal:
            continue
        entry = spreads[effect.name, effect.joint].get(name.removesuffix(f"_{effect.joint}")) if effect else None
        file.put(place, after, described.unit, _share(entry, after))
        changes.append(Change(str(place), described.nominal if held else None, after, described.unit))
    file.settle(wanted)
    return changes


def _share(entry: Any, value: float) -> float:
    """Standard deviation as a share of the value, 0 where the diagnosis gives none."""
    std = entry.get("std") if isinstance(entry, Mapping) else None
    if isinstance(std, bool) or not isinstance(std, int | float) or not math.isfinite(std) or std < 0 or not value:
        return 0.0
    return float(std / abs(value))


def _agrees(temporary: Path, out: Path, profile: str, wanted: Arm) -> None:
    """Builds the new file and holds its parameters against those meant. Raises PlantError."""
    try:
        found = load(temporary, profile)
    except PlantError as error:
        why = str(error).replace(str(temporary), str(out))
        raise PlantError(
            f"{out}: no model can be built from the corrected file, and nothing was written: {why}"
        ) from None
    differ = [
        f"{name} is {found.parameters[name]:.9g} and should be {value:.9g}"
        for name, value in wanted.parameters.items()
        if name in found.parameters
        and not math.isclose(found.parameters[name], value, rel_tol=_ROUNDING, abs_tol=1e-15)
    ]
    missing = [name for name in wanted.parameters if name not in found.parameters and wanted.parameters[name] != 0]
    if differ or missing:
        said = "; ".join([*differ, *(f"{name} is not in its model" for name in missing)])
        raise PlantError(
            f"{out}: the corrected file would not say what the diagnosis does ({said}), and nothing was written; write "
            "the robot file's tables plainly and adopt again."
        )
