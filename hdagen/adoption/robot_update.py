"""Adopt: the verdict of a diagnosis put into the robot file, whose comments and layout stay as they are.

The file gets the parameters that `replay --with` uses, by the same rule (`hdagen.adoption.verdict`): base parameters
move by at most three tolerances, and not where the log said nothing of them; the effects of the verdict become
[[effect]] tables. Digits that the log does not determine are dropped (`hdagen.adoption.rounding`). Where the corrected
model asks for a smaller step or a wider smoothing of friction, these are written, too. Links whose corrected masses and
inertias no mass matrix can have keep the numbers of the file. The new file is built before it is put in its place, and
a model with other parameters than those is refused.
"""

from __future__ import annotations

import difflib
import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_file import is_finite, read_content
from hdagen.adoption.robot_file import LUMPED_KEYS, SPRING_KEYS, NumberPlace, RobotFile
from hdagen.adoption.rounding import read_conditional_deviations, round_parameters
from hdagen.adoption.series_springs import fold_series_springs
from hdagen.arm.build_loader import PlantError, find_build_folder, find_robot_file, find_stable_settings
from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.preset_files import find_preset_files
from hdagen.model_import.model_file import is_model_file
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_bytes

_MOST_ROBOT_BYTES = 1_000_000  # bytes of a robot file
_KEPT_LINKS = (
    "With the corrected masses, centres of mass and inertias no model can be built, so the links keep the numbers of "
    "the file; the gap is then larger than the diagnosis says."
)
_INERTIA_ROUNDING = 1e-9  # a lumped inertia goes through a sum and a difference


@dataclass(frozen=True)
class Change:
    """A number of the robot file: ``where`` it stands (``joint[2].drive.coulomb_friction``), in ``unit``; ``before`` is
    None where the file did not hold it, ``std`` where the diagnosis states no standard deviation."""

    where: str
    before: float | None
    after: float
    unit: str
    std: float | None = None


@dataclass(frozen=True)
class AdoptedRobot:
    """A robot file with a verdict in it: its ``text``, the changed numbers, notes for the reader, and the lines that
    differ from the file as it was, as `diff -u` has them."""

    text: str
    changes: tuple[Change, ...]
    notes: tuple[str, ...]
    difference: tuple[str, ...]


def adopt(
    diagnosis: str | Path | Mapping[str, Any],
    robot: str | Path,
    out: str | Path | None,
    force: bool = False,
    profile: str = "portable",
) -> AdoptedRobot:
    """Write a robot file with the verdict of a diagnosis in it.

    Args:
        diagnosis: A diagnosis.json, or its content.
        robot: The robot.toml, the preset or the model that was diagnosed; of a model the imported robot file is
            corrected.
        out: Where the new file goes; None: nothing is written.
        force: Whether a file that is there may be replaced.
        profile: Profile of the builds that are made, "portable" or "native".

    Returns:
        The new text, and its changes.

    Raises:
        PlantError: The diagnosis is of another robot (`hdagen.adoption.robot_identity`), of an unknown schema or has a
            number that is not finite; no model can be built from the corrected file; or ``out`` cannot be written.

    """
    label = Path(robot)
    path = find_preset_files().get(str(robot), label)
    if is_model_file(path):
        path = Path(find_robot_file(str(path), find_build_folder()))
    raw = _read_robot_file(path)
    if out is not None:
        label = Path(out)
        _check_destination(label, force)
    stated = verdict.read_verdict(diagnosis)
    content = diagnosis
    if not isinstance(content, Mapping):
        content = read_content(Path(content))
    arm = verdict.load_with_effects(robot, profile, stated)
    fitted, notes = verdict.apply_verdict(arm, stated)
    wanted = round_parameters(fitted, read_conditional_deviations(content, stated))
    causes = _collect_cause_parameters(content)
    try:
        made = _make_candidate(raw, arm, wanted, stated, causes, label, profile)
    except PlantError:
        kept = _restore_links(arm, wanted)
        if kept is None:
            raise
        made = _make_candidate(raw, arm, kept, stated, causes, label, profile)
        notes = [*notes, _KEPT_LINKS]
    _check_parameters(made.found, label, made.wanted)
    text = made.file.to_bytes()
    if out is not None:
        _write_robot_file(label, text)
    notes = [*_write_notes(notes, made), *_note_open_smoothing(arm, made)]
    lines = raw.decode("utf-8-sig").splitlines(), text.decode("utf-8-sig").splitlines()
    difference = difflib.unified_diff(*lines, str(path), str(out or "corrected"), lineterm="")
    return AdoptedRobot(text.decode("utf-8-sig"), (*made.changes, *made.settings), tuple(notes), tuple(difference))


@dataclass(frozen=True)
class _Candidate:
    """A corrected ``file`` that a model can be built from: the model, the one that was ``wanted``, the changed numbers,
    and those of the integration that the model needed."""

    file: RobotFile
    found: Arm
    wanted: Arm
    changes: Sequence[Change]
    settings: Sequence[Change]


def _make_candidate(
    raw: bytes,
    arm: Arm,
    wanted: Arm,
    stated: verdict.Verdict,
    causes: Mapping[tuple[str, int], Mapping[str, Any]],
    label: Path,
    profile: str,
) -> _Candidate:
    """The file ``raw`` with the parameters of ``wanted``, after its model was built. Raises PlantError."""
    file = RobotFile(raw, arm)
    wanted, folded = fold_series_springs(wanted)
    changes = _apply_changes(file, arm, wanted, stated, causes, folded)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.toml"
        path.write_bytes(file.to_bytes())
        try:
            found, settings = _build_candidate(path, file, arm, profile)
        except PlantError as error:
            why = str(error).replace(str(path), str(label))
            raise PlantError(
                f"{label}: no model can be built from the corrected file, and nothing was written: {why}"
            ) from None
    return _Candidate(file, found, wanted, changes, settings)


def _restore_links(arm: Arm, wanted: Arm) -> Arm | None:
    """``wanted`` with masses, centres of mass and inertias of the robot file; None where it has them already."""
    links = tuple(f"{key}_" for key in LUMPED_KEYS)
    stated = {name: arm.parameters[name] for name in arm.parameters if name.startswith(links)}
    if all(wanted.parameters[name] == value for name, value in stated.items()):
        return None
    kept = wanted.with_parameters(wanted.p)
    kept.parameters.update(stated)
    return kept


def _write_notes(notes: Sequence[str], made: _Candidate) -> list[str]:
    """Sentences on what was adopted, and on the steps that the corrected model needs."""
    said = [note.replace("nothing is added for it", "nothing is adopted for it") for note in notes]
    said += [
        f"{change.where}: {change.before:.6g} {change.unit} does not carry the corrected model, {change.after:.6g} "
        "does; this is of the integration, and the robot is the same."
        for change in made.settings
    ]
    if not made.changes:
        said.append("The diagnosis changes nothing: what is written is the robot file as it was.")
    return said


def _note_open_smoothing(arm: Arm, made: _Candidate) -> list[str]:
    """A sentence for each drive whose smoothing of friction the file leaves open, and which widens by itself."""
    written = {change.where for change in made.settings}
    notes = []
    for j in range(1, arm.n + 1):
        before, after = (one.robot["joints"][j - 1]["drive"]["friction_smoothing"] for one in (arm, made.found))
        place = str(NumberPlace("drive", j, "friction_smoothing"))
        if after["nominal"] > before["nominal"] and place not in written:
            notes.append(
                f"{place}: left open, and widens from {before['nominal']:.6g} to {after['nominal']:.6g} rad/s with the "
                "friction; this is of the integration, and the robot is the same."
            )
    return notes


def _build_candidate(candidate: Path, file: RobotFile, arm: Arm, profile: str) -> tuple[Arm, list[Change]]:
    """The model of ``candidate``, which holds ``file``; and the changes to the step and the smoothing of friction that
    both need where those of ``arm`` do not carry the model. Raises PlantError."""
    try:
        return load(candidate, profile), []
    except PlantError:
        step, widths = find_stable_settings(candidate)  # raises where it is something else
    changes = []
    smoothing = [joint["drive"]["friction_smoothing"]["nominal"] for joint in arm.robot["joints"]]
    for place, before, after, unit in (
        (NumberPlace("top", 0, "step"), arm.step_size, step, "s"),
        *(
            (NumberPlace("drive", j, "friction_smoothing"), before, after, "rad/s")
            for j, (before, after) in enumerate(zip(smoothing, widths, strict=True), 1)
        ),
    ):
        if after != before:
            file.set_number(place, after, unit)
            changes.append(Change(str(place), before, after, unit))
    candidate.write_bytes(file.to_bytes())
    try:
        return load(candidate, profile), changes
    except PlantError as error:
        raise PlantError(
            f"{error} The corrected model asks for a step of {step:g} s, which no log can have shown: a number of the "
            "diagnosis is beyond all that a machine has; diagnose again."
        ) from None


def _write_robot_file(out: Path, text: bytes) -> None:
    """The new file, whole or not at all. Raises PlantError."""
    try:
        write_atomically(out, text)
    except OSError as error:
        raise PlantError(
            f"{out}: cannot be written ({error.strerror}), and what stood there is unchanged; make room or name "
            "another place."
        ) from None


def _read_robot_file(robot: Path) -> bytes:
    """The robot file. Raises PlantError."""
    try:
        return read_bytes(robot, _MOST_ROBOT_BYTES, "name a robot.toml or a preset")
    except InputFileError as error:
        raise PlantError(error) from None


def _check_destination(out: Path, force: bool) -> None:
    """Refuse a place that is no file in a folder, or is taken."""
    if out.suffix != ".toml":
        raise PlantError(f"--out {out}: found a name ending in {out.suffix!r}, possible is .toml; name such a file.")
    if not out.absolute().parent.is_dir():
        raise PlantError(f"--out {out}: there is no folder {out.absolute().parent}; make it or name another.")
    if out.is_dir():
        raise PlantError(f"--out {out}: is a folder; name a file in it.")
    if out.exists() and not force:
        raise PlantError(f"--out {out}: is there already and would be lost; name another file, or add --force.")


def _collect_cause_parameters(content: Mapping[str, Any]) -> dict[tuple[str, int], Mapping[str, Any]]:
    """Parameters of each cause as the diagnosis holds them, with their standard deviations."""
    causes = content.get("causes", [])
    return {(c["effect"], c["joint"]): c.get("parameters") or {} for c in causes}  # verdict.read has checked them


def _apply_changes(
    file: RobotFile,
    arm: Arm,
    wanted: Arm,
    stated: verdict.Verdict,
    spreads: Mapping[tuple[str, int], Mapping[str, Any]],
    folded: frozenset[str],
) -> list[Change]:
    """Put every number that differs into ``file``, the base first, and say where each went; those that were ``folded``
    into others need no place."""
    changes = []
    own = {name: effect for effect in stated.effects for name in effect.parameters}
    for name, described in arm.parameters.described.items():
        after, owner, std = wanted.parameters[name], None, stated.standard_deviations.get(name, (None,))[0]
        if name in folded:
            continue
        if effect := own.get(name):
            key = name.removesuffix(f"_{effect.joint}")
            owner, std = effect.name, _read_deviation(spreads[effect.name, effect.joint].get(key))
        elif after == described.nominal:
            continue
        place, before = file.locate_parameter(name, owner), None
        if file.states_number(place):
            before = described.nominal
        if after == before:
            continue
        share = 0.0
        if owner and std and after:
            share = std / abs(after)
        file.set_number(place, after, described.unit, share)
        changes.append(Change(str(place), before, after, described.unit, std))
    file.update_dependent_numbers(wanted)
    return changes


def _read_deviation(entry: Any) -> float | None:
    """The standard deviation of an estimate, None where the diagnosis gives none."""
    if not isinstance(entry, Mapping):
        return None
    std = entry.get("std")
    if isinstance(std, bool) or not isinstance(std, int | float) or not is_finite(std) or std < 0:
        return None
    return float(std)


def _check_parameters(found: Arm, out: Path, wanted: Arm) -> None:
    """Compare the parameters of the new file with the wanted ones. Raises PlantError."""
    own = {name: value for name, value in wanted.parameters.items() if not _is_derived(name, found)}
    differ = [
        f"{name} is {found.parameters[name]:.9g} and should be {value:.9g}"
        for name, value in own.items()
        if name in found.parameters
        and not math.isclose(found.parameters[name], value, rel_tol=_INERTIA_ROUNDING, abs_tol=1e-15)
    ]
    missing = [name for name, value in own.items() if name not in found.parameters and value != 0]
    if differ or missing:
        said = "; ".join([*differ, *(f"{name} is not in its model" for name in missing)])
        raise PlantError(
            f"{out}: the corrected file would not say what the diagnosis does ({said}), and nothing was written; write "
            "the robot file's tables plainly and adopt again."
        )


def _is_derived(name: str, found: Arm) -> bool:
    """Whether a parameter follows from others: the smoothing of friction and the step of effects with a state, which
    belong to the integration, and the springs of a drive that the file calls rigid, which its compliance replaces."""
    key, _, joint = name.rpartition("_")
    given = joint.isdigit() and found.robot["joints"][int(joint) - 1]["drive"]["compliant"]
    return name == "memory_step" or key == "friction_smoothing" or (given and key in SPRING_KEYS)


def describe_change(before: float | None, after: float) -> str:
    """Describe how a number changed.

    Args:
        before: The number before; None where there was none.
        after: The number after.

    Returns:
        "new", a percentage, or from a factor of 2 on that factor; the difference where the number was 0 or changed its
        sign.

    """
    if before is None:
        return "new"
    if before == 0.0 or after * before <= 0.0:
        return f"{after - before:+.3g}"
    ratio = after / before
    if 0.5 < ratio < 2.0:
        return f"{100.0 * (ratio - 1.0):+.3g} %"
    return f"× {ratio:.3g}"
