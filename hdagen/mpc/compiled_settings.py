"""A configuration and an arm as the numbers that the compiled controller takes, and its report by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.pose_kinematics import POSE_SIZE
from hdagen.mpc.configuration import Configuration, expand_values, resolve_limits
from hdagen.mpc.target_coordinates import count_positions, count_tip_coordinates, follows_pose
from hdagen.prediction.measurement_model import compute_encoder_noise

TURN_WEIGHTS = ((1e5, 1.0), (10.0, 1e-4))  # 1/rad² and s²/rad²: usual, and of fewer than six joints
SOLVERS = ("riccati", "osqp", "interior")
LIMIT_FAMILIES = ("motor_torque", "torque_rate", "joint_position", "motor_speed", "joint_torque", "tip_speed", "wall")


def list_drives(arm: Arm) -> list[dict[str, Any]]:
    """List the drives of an arm.

    Args:
        arm: The arm.

    Returns:
        The drives of its robot file, base first.

    """
    return [joint["drive"] for joint in arm.robot["joints"]]


def find_torque_limits(arm: Arm, c: Configuration) -> tuple[float, ...] | None:
    """Take the largest motor torques from the configured limits of torque and current.

    Args:
        arm: The arm.
        c: The configuration.

    Returns:
        The largest motor torque of each joint, N m; None where only the robot file limits it.

    """
    limits = {"torque": c["limits.motor_torque"], "current": c["limits.motor_current"]}
    stated = {name: expand_values(value, arm.n) for name, value in limits.items() if value is not None}
    if not stated:
        return None
    endless, out = [np.inf] * arm.n, []
    pairs = stated.get("torque", endless), stated.get("current", endless)
    for drive, torque, current in zip(list_drives(arm), *pairs, strict=True):
        constant, most = drive["torque_constant"], drive["max_current"] or np.inf
        if constant:
            out.append(min(torque, constant["nominal"] * min(current, most)))
        else:
            out.append(torque)
    return tuple(out)


def pack_settings(arm: Arm, c: Configuration) -> Array:
    """Pack a configuration as the compiled controller takes it.

    Args:
        arm: The arm.
        c: A configuration that fits the arm.

    Returns:
        hda_mpc_settings as an array, SI.

    """
    grid, positions = c.grid, count_positions(arm.robot, c["mpc.space"])
    limits = resolve_limits(arm.robot, c)
    mass, rotor = find_inertias(arm)
    values = [SOLVERS.index(c["mpc.solver"]), c["mpc.tolerance"], c["mpc.iterations"]]
    values += [c["mpc.delay"], c["mpc.steps"]]
    values += [c["admittance.force"] == "sensor", c["estimator.acting"] == "measured"]
    values += [c["admittance.force_decay"], c["weights.terminal"]]
    values += [c[f"weights.{name}"] for name in ("position", "velocity", "posture", "torque", "torque_rate")]
    values += _choose_turn_weights(arm, c)
    values += [
        c["limits.linear"],
        c["limits.square"],
        c["limits.tip_speed"] - c["limits.sudden"],
        c["limits.margin"],
        *grid,
    ]
    for name in ("mass", "damping", "stiffness"):
        values += expand_values(c[f"admittance.{name}"], positions)
        if follows_pose(arm.robot, c["mpc.space"]):
            values += expand_values(c[f"admittance.rotation_{name}"], 3)
    for name in ("joint_low", "joint_high", "motor_speed", "joint_torque"):
        values += limits[name]
    values += _choose_friction_widths(arm, c, rotor)
    bandwidth = c["fallback.bandwidth"]
    values += [*(rotor * bandwidth**2), *(2 * rotor * bandwidth)]
    values += [number for wall in c.walls for number in (*wall.normal, wall.offset - wall.margin)] or [0.0] * (
        count_tip_coordinates(arm.robot) + 1
    )
    values += [wall.give for wall in c.walls] or [0.0]
    values += _pack_noise(arm, c, rotor, mass)
    return np.array(values, float)


def find_inertias(arm: Arm) -> tuple[Array, Array]:
    """Find what a torque moves in a bent posture.

    Args:
        arm: The arm.

    Returns:
        Inertia about each joint (n), kg m² or kg; of each motor (n), kg m², where the robot file states none that of
        the joint seen through the gear.

    """
    drives = list_drives(arm)
    inertia = np.array([drive["motor_inertia"]["nominal"] for drive in drives])
    ratio = np.array([abs(drive["ratio"]["nominal"]) for drive in drives])
    mass = np.diag(arm.evaluate("mass_matrix", q=np.full(arm.n, 0.6))["M"].reshape(arm.n, arm.n))
    return mass, np.where(inertia > 0, inertia, mass / ratio**2)


def _choose_turn_weights(arm: Arm, c: Configuration) -> list[float]:
    """Weights of the tip's turn. An arm of fewer than six joints gives it up where it costs the place."""
    names, few = ("weights.orientation", "weights.turning"), arm.n < POSE_SIZE
    return [usual[few] if c[name] is None else c[name] for name, usual in zip(names, TURN_WEIGHTS, strict=True)]


def _choose_friction_widths(arm: Arm, c: Configuration, rotor: Array) -> list[float]:
    """Width of friction's smooth sign in the prediction: the change of motor speed that dry friction makes in a node,
    so that a node carries it."""
    if c["estimator.friction_width"] is not None:
        return expand_values(c["estimator.friction_width"], arm.n)
    out = []
    for drive, inertia in zip(list_drives(arm), rotor, strict=True):
        carried = drive["coulomb_friction"]["nominal"] * max(c.grid) / inertia
        out.append(max(carried, drive["friction_smoothing"]["nominal"]))
    return out


def _pack_noise(arm: Arm, c: Configuration, rotor: Array, mass: Array) -> list[float]:
    n, sensors = arm.n, [joint["sensor"] for joint in arm.robot["joints"]]
    out = []
    for side in ("motor", "joint"):
        out += [max(compute_encoder_noise(sensor, side), 1e-7) for sensor in sensors]
    out += list(np.array(expand_values(c["estimator.torque"], n)) / rotor)
    out += list(np.array(expand_values(c["estimator.load"], n)) / mass)
    out += expand_values(c["estimator.disturbance"], n)
    moments = arm.nu - n - count_tip_coordinates(arm.robot)
    for force, moment in (("force", "moment"), ("sensor", "moment_sensor")):
        out += [c[f"estimator.{force}"]] * (arm.nu - n - moments) + [c[f"estimator.{moment}"]] * moments
    return [*out, c["estimator.observer"], c["estimator.collision"]]


def list_report_parts(arm: Arm) -> Iterator[tuple[str, int]]:
    """List the parts of hda_mpc_report in their order.

    Args:
        arm: An arm that was built with a predictive controller.

    Yields:
        Name and length of each part.

    """
    m, n = arm.manifest["mpc"], arm.n
    axes, wrench = m["axes"], arm.nu - n
    for name in ("rung", "failures", "solved", "factored", "interior", "active", "residual"):
        yield name, 1
    for name in ("active_of", "violated_by", "foreseen_by"):
        yield name, len(LIMIT_FAMILIES)
    yield from (("tip_force", wrench), ("observed_force", count_tip_coordinates(arm.robot)))
    yield from (("disturbance", n), ("innovation", 1), ("collision", 1))
    yield from (("yielded", 2 * axes), ("x", arm.nx), ("plan", m["nodes"] * n))
    yield "predicted", m["nodes"] * len(m["state"])
