"""MJCF: a whole MuJoCo model of a robot, or a model that the user has with the corrected numbers in it."""

from __future__ import annotations

import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported
from hdagen.model_export.joint_numbers import read_robot_numbers
from hdagen.model_export.mjcf_document import write_document
from hdagen.model_export.mjcf_patch import find_model_joints, patch_model
from hdagen.model_export.model_files import open_model_files
from hdagen.model_export.mujoco_proof import ProofLog, prove_in_mujoco
from hdagen.model_export.number_changes import describe_left_out, list_number_changes
from hdagen.support.mujoco_warnings import collect_mujoco_warnings

SPRING_STEP_SHARE = 0.25  # of the robot file's step, where joints have springs: MuJoCo's friction creeps two steps long


def write(robot: CorrectedRobot, out: Path, into: Path | None = None, prove: ProofLog | None = None) -> Exported:
    """Write a robot as a MuJoCo model.

    Args:
        robot: The robot.
        out: The file.
        into: A model that the user has, whose numbers are corrected; None: a whole model is written.
        prove: A log that MuJoCo replays with the model before and after; None: no proof.

    Returns:
        The result.

    Raises:
        PlantError: The model of the user does not fit the robot, the proof cannot be made, or the file cannot be
            written; then nothing is.

    """
    if into is not None:
        robot = replace(robot, given_names=find_model_joints(into, robot))
    names = robot.joint_names
    before, after = read_robot_numbers(robot.file, names), read_robot_numbers(robot.corrected, names)
    changes, notes, unheld = list_number_changes(before, after), list(robot.notes), dict[str, str]()
    old = b""
    if into is None:
        name, step = robot.file.robot["name"], robot.corrected.stable_step
        if any(joint.transmission for joint in after.joints):
            step *= SPRING_STEP_SHARE
        files, old = {out: write_document(name, after, step).encode()}, write_document(name, before, step).encode()
    else:
        patched = patch_model(into, out, before, after)
        files, changes, unheld = patched.files, patched.changes, dict(patched.left_out)
        notes += patched.notes
    proof = None
    with open_model_files(out, files) as written, tempfile.TemporaryDirectory() as folder:
        if prove is not None:
            first = into
            if first is None:
                first = Path(folder) / "before.xml"
                first.write_bytes(old)
            proof = prove_in_mujoco(robot, prove, first, written)
        elif into is not None:
            _check_model_loads(written, into, out)
    shares = None if proof is None else proof.left_shares
    left_out = describe_left_out(robot, shares, "MuJoCo") | unheld
    return Exported(
        (out, *(path for path in files if path != out)), changes, left_out, tuple(dict.fromkeys(notes)), proof
    )


def _check_model_loads(written: Path, into: Path, out: Path) -> None:
    """Refuse a place where a corrected model does not find what it includes; without MuJoCo nothing is checked."""
    with suppress(ImportError), collect_mujoco_warnings():
        import mujoco

        try:
            mujoco.MjModel.from_xml_path(str(into))
        except ValueError:
            return  # a part of a model, which cannot be loaded alone
        try:
            mujoco.MjModel.from_xml_path(str(written))
        except ValueError as error:
            why = " ".join(str(error).split())[:200]
            raise PlantError(
                f"--out {out}: the corrected model cannot be loaded from there ({why}); write it beside {into}."
            ) from None
