"""The record that `hdagen simulate --controller mpc` writes beside the log and `hdagen mpc explain` reads: one row a
tick."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.pose_kinematics import add_turns, find_rotation_gap
from hdagen.control.reference_motion import Reference
from hdagen.log import data_table
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import MOST_LOG_BYTES
from hdagen.mpc.closed_loop_trial import Trial
from hdagen.mpc.compiled_settings import LIMIT_FAMILIES
from hdagen.simulation.simulator import Simulation
from hdagen.support.input_file import InputFileError, check_file

RECORD_COLUMNS = (
    "time",
    "tip_x",
    "tip_y",
    "path_x",
    "path_y",
    "target_x",
    "target_y",
    "predicted_x",
    "predicted_y",
    "ahead",
    "status",
    "rung",
    "interior",
    "factored",
    "prepare_time",
    "tick_time",
    "collision",
    "innovation",
    "tip_force_x",
    "tip_force_y",
)


SPACE_COLUMNS = ("tip_z", "path_z", "target_z", "predicted_z", "tip_force_z", "turn_off")


def find_record_path(log: Path) -> Path:
    """Name the record of a log.

    Args:
        log: Path of the log.

    Returns:
        Path of the controller's record beside it.

    """
    return log.with_suffix(".mpc.parquet")


def build_record(arm: Arm, found: Trial, path: Reference, grid: tuple[float, ...]) -> dict[str, Array]:
    """Build the record of a run, one row a tick.

    Args:
        arm: The controller's arm.
        found: The run.
        path: The commanded path.
        grid: Length of each node, s.

    Returns:
        Columns by name, SI. ``target`` is the place of the tip that the admittance asks for; ``predicted`` is its place
        now by the plan that was made ``ahead`` seconds before; ``turn_off``, in space: the angle between the tip's
        orientation and the target's, 0 where joints are followed.

    """
    from hdagen.mpc.predictive_controller import RUNGS

    s, reports = found.simulation, found.reports
    names = arm.manifest["mpc"]["state"]
    node = len(grid) // 2
    ahead = float(sum(grid[: node + 1]))
    q = np.array([r.predicted_states[node] for r in reports])[
        :, [names.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    ]
    axes = "xyz"[: s.tip.shape[1]]
    seen = _find_tips(arm, q)
    late = round(ahead / path.period)
    predicted = np.full_like(seen, np.nan)
    predicted[late:] = seen[: len(seen) - late]
    out: dict[str, Array] = {"time": path.time}
    moved = np.array([r.target_displacement for r in reports])[:, : path.position.shape[1]]
    ways = {"path": path.position, "target": path.position + moved}
    if path.space == "joint":
        ways = {name: _find_tips(arm, way) for name, way in ways.items()}
    for name, way in {"tip": s.tip, **ways, "predicted": predicted, "tip_force": s.push}.items():
        out |= {f"{name}_{axis}": way[:, k] for k, axis in enumerate(axes)}
    if arm.moves_in_space:
        out["turn_off"] = _find_turn_off(arm, s, path, moved)
    out |= {"ahead": np.full(len(seen), ahead), "status": s.status.astype(float)}
    out |= {"rung": np.array([float(RUNGS.index(r.rung)) for r in reports])}
    for name in ("interior", "factored", "collision", "innovation"):
        out[name] = np.array([float(getattr(r, name)) for r in reports])
    out |= {"prepare_time": found.times[:, 0], "tick_time": found.times[:, 1]}
    for family in LIMIT_FAMILIES:
        out[f"active_{family}"] = np.array([float(r.active[family]) for r in reports])
        out[f"violated_{family}"] = np.array([max(0.0, r.violated[family]) for r in reports])
    return {name: np.ascontiguousarray(values, float) for name, values in out.items()}


def _find_tips(arm: Arm, q: Array) -> Array:
    """Places of the tip, (T, 2), in space (T, 3)."""
    points = arm.evaluate("points", q=q)["points"]
    return points[:, -(points.shape[1] // (arm.n + 1)) :]


def _find_turn_off(arm: Arm, s: Simulation, path: Reference, moved: Array) -> Array:
    if path.space == "joint":
        return np.zeros(len(s.tip))
    q = s.state[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    wanted = add_turns(moved[:, 3:], path.position[:, 3:])
    return np.asarray(np.linalg.norm(find_rotation_gap(wanted, arm.evaluate("tip_pose", q=q)["rotation"]), axis=1))


def read_record(path: Path) -> dict[str, Array]:
    """Read the record of a log.

    Args:
        path: The log, or the record itself.

    Returns:
        Columns by name, SI.

    Raises:
        LogError: There is no record, or it cannot be read.

    """
    place = path
    if path.name and not path.name.endswith(".mpc.parquet"):
        place = find_record_path(path)
    try:
        check_file(
            place,
            MOST_LOG_BYTES,
            "`hdagen simulate --controller mpc` writes the predictive controller's record of a log",
        )
    except InputFileError as error:
        raise LogError([str(error)]) from None
    expected = [*RECORD_COLUMNS, *(f"{what}_{family}" for what in ("active", "violated") for family in LIMIT_FAMILIES)]
    content = data_table.read_parquet(place, lambda name: name in expected or name in SPACE_COLUMNS).columns
    if any(name in content for name in SPACE_COLUMNS):
        expected += SPACE_COLUMNS
    missing = [name for name in expected if name not in content]
    if missing:
        raise LogError(
            [
                f"{place}: {', '.join(missing[:5])} missing; it is no record of the predictive controller: "
                f"simulate again."
            ]
        )
    return {name: np.asarray(content[name], float) for name in expected}
