"""The proof of an export: the log's held-out rows, replayed by MuJoCo with the file before and after, beside ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_repair import repair_for_replay, repair_log
from hdagen.diagnosis.data.held_out_rows import count_rows
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log, read
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.joint_numbers import list_unheld_effects
from hdagen.model_export.mujoco_machine import MujocoMachine, import_mujoco
from hdagen.model_export.mujoco_replay import replay_in_mujoco
from hdagen.prediction.closed_loop_replay import JointLaw, read_controller, replay_closed_loop
from hdagen.prediction.window_replay import REPLAY_WINDOW, Replay, check_log_fits_arm, replay
from hdagen.support.mujoco_warnings import collect_mujoco_warnings


@dataclass(frozen=True)
class ProofLog:
    """A log to prove an export with, and the laws that close the loop (None: the commands drive)."""

    log: Log
    laws: tuple[JointLaw, ...] | None
    notes: tuple[str, ...]
    rows_known: bool


@dataclass(frozen=True)
class ChannelProof:
    """Errors of one channel over the counted rows, root mean square in ``unit``, and the channel's noise."""

    channel: str
    joint: str
    unit: str
    noise: float
    mujoco_before: float
    mujoco_after: float
    ours_before: float
    ours_after: float


@dataclass(frozen=True)
class Proof:
    """The result of a proof.

    Attributes:
        channels: The errors of each channel.
        gaps: The gaps, in multiples of noise: MuJoCo's before and after, ours before and after.
        closed_share: How much MuJoCo's error falls by how much ours does; None where ours does not fall.
        left_shares: Of each effect that MuJoCo cannot hold, the share of the closed gap that it leaves.
        notes: Sentences for the reader.

    """

    channels: tuple[ChannelProof, ...]
    gaps: tuple[float, float, float, float]
    closed_share: float | None
    left_shares: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether MuJoCo comes nearer to the log with the corrected file, where our model does."""
        return self.closed_share is None or self.closed_share > 0

    @property
    def sentence(self) -> str:
        """The result in one sentence."""
        if self.closed_share is None:
            return "Our own error does not fall with this verdict, so there is nothing to prove."
        if not self.holds:
            return "MuJoCo comes no nearer to the log with the corrected file: the export does not hold there."
        return (
            f"MuJoCo's gap falls from {self.gaps[0]:.4g} to {self.gaps[1]:.4g} times the noise, "
            f"{100 * self.closed_share:.0f} % of the fall of ours, {self.gaps[2]:.4g} to {self.gaps[3]:.4g}."
        )


def read_proof_log(
    path: Path | str,
    diagnosis: Mapping[str, Any] | None = None,
    controller: Path | None = None,
    columns: Path | None = None,
    joints: Sequence[str | None] = (),
) -> ProofLog:
    """Read the log of a proof.

    Args:
        path: The log.
        diagnosis: The content of the diagnosis.json, whose held-out rows then count; None: all rows count.
        controller: A controller.toml; None: the commands drive.
        columns: A columns.toml for foreign names.
        joints: Names of the robot's joints, which columns may have in place of their numbers.

    Returns:
        The log.

    Raises:
        PlantError: MuJoCo is not installed, or the controller cannot be used.
        LogError: The log cannot be read.

    """
    import_mujoco()
    laws = None if controller is None else read_controller(controller)
    known = diagnosis is not None and _names_log(diagnosis, str(path))
    return ProofLog(read(Path(path), columns, holes=known, names=joints), laws, (), known)


def _repair_log(given: ProofLog, arm: Arm) -> ProofLog:
    """The log as the diagnosis took it, or repaired as for a replay. Raises LogError where it is of another robot."""
    check_log_fits_arm(arm, given.log)
    if given.rows_known:
        log, _, seen = repair_log(given.log, arm)
        return replace(given, log=log, notes=tuple(seen.warnings))
    log, mended, seen = repair_for_replay(given.log, arm)
    if seen.refusals:
        raise LogError([f"{log.source}: {sentence}" for sentence in seen.refusals])
    notes = (*seen.warnings, *(one.sentence for one in mended), "No rows of this log are held out: all of them count.")
    return replace(given, log=log, notes=notes)


def prove_in_mujoco(robot: CorrectedRobot, given: ProofLog, before: Path, after: Path) -> Proof:
    """Prove an export.

    Args:
        robot: The robot, with the verdict.
        given: The log.
        before: The model without the verdict.
        after: The model with it.

    Returns:
        The proof.

    Raises:
        PlantError: MuJoCo cannot load a model, or its state leaves all bounds.
        LogError: The log is of another robot.

    """
    import_mujoco()
    with collect_mujoco_warnings() as told:
        proof = _compare_replays(robot, _repair_log(given, robot.file), before, after)
    return replace(proof, notes=(*proof.notes, *(f"MuJoCo warns: {line}" for line in told)))


def _compare_replays(robot: CorrectedRobot, given: ProofLog, before: Path, after: Path) -> Proof:
    """The errors of MuJoCo and of our model, before and after."""
    log, names = given.log, robot.joint_names
    count = _make_counter(robot, given)
    ratios = [robot.file.parameters[f"ratio_{j}"] for j in range(1, len(names) + 1)]
    tip = robot.file.robot["tip"]["origin"] if robot.file.moves_in_space else None
    first = MujocoMachine(before, names, ratios, log.period, tip=tip)
    first.check_motors()
    controls = _find_nominal_gains(robot.file) / first.measure_gains()
    first.controls = controls
    second = MujocoMachine(after, names, ratios, log.period, controls, tip)
    second.check_motors()
    ours = _replay_ours(robot.file, given), _replay_ours(robot.corrected, given)
    theirs = [
        replay_in_mujoco(machine, arm, log, found, given.laws)
        for machine, arm, found in zip((first, second), (robot.file, robot.corrected), ours, strict=True)
    ]
    counted = [count(found) for found in (*theirs, *ours)]
    gaps = (counted[0].gap, counted[1].gap, counted[2].gap, counted[3].gap)
    closed = None
    if gaps[2] - gaps[3] > 0:
        closed = (gaps[0] - gaps[1]) / (gaps[2] - gaps[3])
    notes = (*given.notes, *first.notes, *second.notes)
    left = _measure_left_shares(robot, given, count, gaps)
    return Proof(_list_channels(robot, counted), gaps, closed, left, tuple(dict.fromkeys(notes)))


def _names_log(content: Mapping[str, object], path: str) -> bool:
    """Whether a diagnosis holds rows of a log out."""
    data = content.get("data")
    held = data.get("hold_out") if isinstance(data, Mapping) else None
    if not isinstance(held, Sequence) or isinstance(held, str):
        return False
    names = [str(one.get("log")) for one in held if isinstance(one, Mapping)]
    return path in names or [Path(name).name for name in names].count(Path(path).name) == 1


def _make_counter(robot: CorrectedRobot, given: ProofLog) -> Callable[[Replay], Replay]:
    """What counts a replay over the held-out rows, or over all."""
    if given.rows_known and robot.content is not None:
        content = robot.content
        return lambda found: count_rows(found, given.log, content, "diagnosis")
    rows = np.ones(len(given.log), bool)

    def count_all(found: Replay) -> Replay:
        noise = {name: found.noise[name] for name in found.counted_channels if "position" in name}
        return found.restrict_to_rows(given.log, rows, noise)

    return count_all


def _find_nominal_gains(arm: Arm) -> np.ndarray:
    """Torque at each joint by a unit of the robot's input (n), as the robot file states it."""
    p = arm.parameters
    return np.array([p[f"ratio_{j}"] * p.get(f"torque_constant_{j}", 1.0) for j in range(1, arm.n + 1)])


def _replay_ours(arm: Arm, given: ProofLog) -> Replay:
    """Our replay at the arm's present parameters, open or closed."""
    if given.laws is not None:
        return replay_closed_loop(arm, given.log, given.laws)
    return replay(arm, given.log, REPLAY_WINDOW)


def _measure_left_shares(
    robot: CorrectedRobot,
    given: ProofLog,
    count: Callable[[Replay], Replay],
    gaps: tuple[float, float, float, float],
) -> dict[str, float]:
    """The share of the gap closed by us that each effect leaves in MuJoCo, which cannot hold it.

    MuJoCo's own remainder is known. Several such effects divide it as they do what comes back in our model without each
    of them.
    """
    _, left, before, after = gaps
    if robot.stated is None or not before > after:
        return {}
    named, shares = {(effect.name, effect.joint) for effect in robot.stated.effects}, {}
    unheld = [one for one in list_unheld_effects(robot.corrected) if one in named]
    for name, joint in unheld:
        without = 0.0
        if len(unheld) > 1:
            without = count(_replay_ours(robot.leave_out_effect(name, joint).corrected, given)).gap - after
        shares[f"{name}@{joint}"] = max(without, 0.0)
    remainder, total = min(max((left - after) / (before - after), 0.0), 1.0), sum(shares.values())
    return {name: remainder * (own / total if total else 1 / len(shares)) for name, own in shares.items()}


def _list_channels(robot: CorrectedRobot, counted: Sequence[Replay]) -> tuple[ChannelProof, ...]:
    """The errors of each counted channel of the four replays."""
    channels = []
    for name, noise in counted[0].noise.items():
        quantity, _, number = name.rpartition("_")
        j = int(number)
        slides = robot.file.robot["joints"][j - 1]["kind"] == "prismatic" and quantity == "joint_position"
        unit = "A" if "current" in quantity else "N m" if "torque" in quantity else "m" if slides else "rad"
        errors = [found.errors[name] for found in counted]
        channels.append(ChannelProof(name, robot.joint_names[j - 1], unit, noise, *errors))
    return tuple(channels)
