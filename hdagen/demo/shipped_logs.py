"""The logs that `hdagen demo` replays: the one that ships with the package, and EMPS where its data are."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import Log, read
from hdagen.prediction.window_replay import REPLAY_WINDOW, replay

EMPS_FILE = Path("real") / "emps" / "DATA_EMPS.mat"  # in the folder of data


@dataclass(frozen=True)
class ReplayedJoint:
    """A joint's logged position and its replay, (T,) each in ``unit``; ``motion_rms``: rms of the motion since the
    window's start, which is the residual of a model that stands still."""

    name: str
    unit: str
    measured: Array
    predicted: Array
    motion_rms: float

    @property
    def residual(self) -> Array:
        """(T,)."""
        return self.predicted - self.measured

    @property
    def rms_residual(self) -> float:
        """rms of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))


@dataclass(frozen=True)
class ReplayedLog:
    """A log replayed in windows of 0.25 s. ``real``: measured on a machine, not simulated."""

    name: str
    is_measured: bool
    arm: Arm
    log: Log
    joints: tuple[ReplayedJoint, ...]
    notes: tuple[str, ...]


def replay_shipped_log(arm: Arm) -> ReplayedLog:
    """Replay the log that ships with the package, which MuJoCo simulated.

    Args:
        arm: The arm of preset `paper`.

    Returns:
        The replay.

    """
    with resources.as_file(resources.files("hdagen.data") / "mujoco_log.parquet") as path:
        log = read(path, joints=arm.n)
    return _replay_log("MuJoCo", False, arm, log)


def find_data_folder() -> Path | None:
    """Find the folder of data with EMPS in it: $HDAGEN_DATA, else ../shared/data as seen from the current directory or
    from the repository.

    Returns:
        The folder; None where there is none.

    """
    places = [base.parent / "shared" / "data" for base in (Path.cwd(), Path(__file__).resolve().parents[2])]
    if given := os.environ.get("HDAGEN_DATA"):
        places = [Path(given)]
    return next((place for place in places if (place / EMPS_FILE).is_file()), None)


def replay_emps_log(arm: Arm, folder: Path) -> ReplayedLog:
    """Replay the identification log of EMPS.

    Args:
        arm: The arm of preset `replay_emps_log`.
        folder: The folder of data.

    Returns:
        The replay.

    Raises:
        LogError: The log cannot be read.

    """
    with resources.as_file(resources.files("hdagen.data") / "emps_columns.toml") as columns:
        log = read(folder / EMPS_FILE, columns, joints=arm.n)
    return _replay_log("EMPS", True, arm, log)


def _replay_log(name: str, real: bool, arm: Arm, log: Log) -> ReplayedLog:
    found = replay(arm, log, REPLAY_WINDOW)
    window = np.searchsorted(found.starts, np.arange(len(log)), side="right") - 1
    channels = []
    for j, joint in enumerate(arm.robot["joints"], 1):
        measured = log[f"joint_position_{j}"]
        moved = measured - measured[found.starts[window]]
        unit = {"prismatic": "m", "revolute": "rad"}[joint["kind"]]
        predicted = found.columns[f"joint_position_{j}"]
        channels.append(ReplayedJoint(f"joint {j}", unit, measured, predicted, float(np.sqrt(np.mean(moved**2)))))
    return ReplayedLog(name, real, arm, log, tuple(channels), found.notes)
