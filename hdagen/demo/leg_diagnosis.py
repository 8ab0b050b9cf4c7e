"""The diagnosis of `hdagen demo`: a log with a hidden effect, diagnosed, adopted, exported to MuJoCo and proved there.

The log ships with the package; MuJoCo simulated it from the numbers of hdagen/data/leg.toml but one
(docs/examples/leg_log/make_log.py).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.adoption.robot_update import AdoptedRobot, Change, adopt
from hdagen.adoption.verdict import read_verdict
from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.pipeline import diagnose
from hdagen.log.measured_log import Log, read
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported, write_export
from hdagen.model_export.mujoco_machine import import_mujoco
from hdagen.model_export.mujoco_proof import Proof, read_proof_log
from hdagen.prediction.window_replay import REPLAY_WINDOW, replay

HIDDEN_EFFECT = "coulomb_friction@2"  # what docs/examples/leg_log/make_log.py changes
JOINT_LABELS = ("hip", "knee")
LEAST_CLOSED = 0.9  # of the gap that has to be closed, in our model and in MuJoCo


@dataclass(frozen=True)
class ReplayedJoint:
    """A joint's logged position and its replays with the robot file and with the adopted one, (T,) each, rad."""

    measured: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class LegDiagnosis:
    """The leg's log, its diagnosis and what became of it.

    Attributes:
        arm: The model of the robot file.
        log: The log.
        content: The content of diagnosis.json.
        joints: The log and its replays, joint by joint.
        adopted: The robot file with the verdict.
        exported: The MuJoCo model with its proof; None where MuJoCo is not installed.
        model: The text of that model; "" without MuJoCo.

    """

    arm: Arm
    log: Log
    content: Mapping[str, Any]
    joints: tuple[ReplayedJoint, ...]
    adopted: AdoptedRobot
    exported: Exported | None
    model: str

    @property
    def proof(self) -> Proof | None:
        """The replay in MuJoCo before and after."""
        return None if self.exported is None else self.exported.proof

    @property
    def names_hidden_effect(self) -> bool:
        """Whether the verdict is the hidden effect and nothing else."""
        return self.content["verdict"] == [HIDDEN_EFFECT]

    def split_changes(self) -> tuple[list[Change], list[Change]]:
        """Split the changes of the robot file.

        Returns:
            Those of the verdict's effects, and all others, which are smaller.

        """
        named, further = list[Change](), list[Change]()
        for change in self.adopted.changes:
            is_named = any(
                change.where.endswith(f"joint[{cause['joint']}].drive.{name}")
                for cause in self.content["causes"]
                for name in cause["parameters"]
                if f"{cause['effect']}@{cause['joint']}" in self.content["verdict"]
            )
            (named if is_named else further).append(change)
        return named, further

    @property
    def meets_bar(self) -> bool:
        """Whether the hidden effect is named, and closes the gap here and in MuJoCo."""
        closed = [self.content["gap"]["shrink"]]
        if self.proof is not None:
            closed.append(self.proof.closed_share or 0.0)
        return self.names_hidden_effect and min(closed) >= LEAST_CLOSED


def diagnose_leg(profile: str, stage: Callable[[str], None]) -> LegDiagnosis:
    """Diagnose the leg's log, adopt the verdict, export it to MuJoCo and prove it there.

    Args:
        profile: Profile of the leg's builds that are replayed, "portable" or "native".
        stage: Hears the name of each step as it begins.

    Returns:
        The results.

    Raises:
        PlantError: A build fails.

    """
    with (
        resources.as_file(resources.files("hdagen.data") / "leg.toml") as robot,
        resources.as_file(resources.files("hdagen.data") / "leg_log.parquet") as path,
        tempfile.TemporaryDirectory() as folder,
    ):
        log = read(path, joints=2)
        stage("diagnosing the leg's log")
        content = diagnose(robot, [log]).content
        stage("adopting the verdict")
        new = Path(folder) / "leg.toml"
        adopted = adopt(content, robot, new, profile=profile)
        before, after = load(robot, profile), load(new, profile)
        joints = _replay_joints(before, after, log)
        exported, model = None, ""
        if _has_mujoco():
            stage("exporting to MuJoCo and proving it there")
            proof = read_proof_log(path, content)
            stated = read_verdict(content)
            corrected = CorrectedRobot(robot, before, after, stated, content, given_names=JOINT_LABELS)
            exported = write_export("mjcf", corrected, Path(folder) / "leg.xml", prove=proof)
            model = (Path(folder) / "leg.xml").read_text("utf-8")
    return LegDiagnosis(before, log, content, joints, adopted, exported, model)


def _has_mujoco() -> bool:
    try:
        import_mujoco()
    except PlantError:
        return False
    return True


def _replay_joints(before: Arm, after: Arm, log: Log) -> tuple[ReplayedJoint, ...]:
    """The joints' positions in the log, and replayed by both models."""
    found = [replay(arm, log, REPLAY_WINDOW).columns for arm in (before, after)]
    names = [f"joint_position_{j}" for j in range(1, before.n + 1)]
    return tuple(ReplayedJoint(log[name], *(columns[name] for columns in found)) for name in names)


def summarize_leg(leg: LegDiagnosis) -> dict[str, Any]:
    """Sum the diagnosis up in figures.

    Args:
        leg: The results.

    Returns:
        Figures by name, SI, as JSON takes them.

    """
    gap, proof = leg.content["gap"], leg.proof
    named, further = leg.split_changes()
    return {
        "verdict": leg.content["verdict"],
        "sure": leg.content["sure"],
        "probability": leg.content["hypotheses"][0]["probability"],
        "gap": {key: gap[key] for key in ("before", "after", "shrink")},
        "changes": {change.where: [change.before, change.after, change.unit] for change in named},
        "further_changes": len(further),
        "rms_error": {
            f"joint_position_{j}": [float(np.sqrt(np.mean((p - one.measured) ** 2))) for p in (one.before, one.after)]
            for j, one in enumerate(leg.joints, 1)
        },
        "mujoco": proof and {"gap": list(proof.gaps[:2]), "closed_share": proof.closed_share},
    }
