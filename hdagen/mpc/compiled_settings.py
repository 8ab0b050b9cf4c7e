"""A configuration and an arm as the numbers that the compiled controller takes, and its report by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.mpc.configuration import Configuration, expand_values, resolve_limits
from hdagen.prediction.measurement_model import compute_encoder_noise

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
    n, grid, axes = arm.n, c.grid, arm.n
    if c["mpc.space"] == "tip":
        axes = 2
    limits = resolve_limits(arm.robot, c)
    inertia = np.array([drive["motor_inertia"]["nominal"] for drive in list_drives(arm)])
    ratio = np.array([abs(drive["ratio"]["nominal"]) for drive in list_drives(arm)])
    mass = np.diag(arm.evaluate("mass_matrix", q=np.full(n, 0.6))["M"].reshape(n, n))
    rotor = np.where(inertia > 0, inertia, mass / ratio**2)
    values = [SOLVERS.index(c["mpc.solver"]), c["mpc.tolerance"], c["mpc.iterations"]]
    values += [c["mpc.delay"], c["mpc.steps"]]
    values += [c["admittance.force"] == "sensor", c["estimator.acting"] == "measured"]
    values += [c["admittance.force_decay"], c["weights.terminal"]]
    values += [c[f"weights.{name}"] for name in ("position", "velocity", "posture", "torque", "torque_rate")]
    values += [
        c["limits.linear"],
        c["limits.square"],
        c["limits.tip_speed"] - c["limits.sudden"],
        c["limits.margin"],
        *grid,
    ]
    for name in ("mass", "damping", "stiffness"):
        values += expand_values(c[f"admittance.{name}"], axes)
    for name in ("joint_low", "joint_high", "motor_speed", "joint_torque"):
        values += limits[name]
    values += _choose_friction_widths(arm, c, rotor)
    bandwidth = c["fallback.bandwidth"]
    values += [*(rotor * bandwidth**2), *(2 * rotor * bandwidth)]
    values += [number for wall in c.walls for number in (*wall.normal, wall.offset - wall.margin)] or [0.0] * 3
    values += [wall.give for wall in c.walls] or [0.0]
    values += _pack_noise(arm, c, rotor, mass)
    return np.array(values, float)


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
    return [*out, c["estimator.force"], c["estimator.sensor"], c["estimator.observer"], c["estimator.collision"]]


def list_report_parts(arm: Arm) -> Iterator[tuple[str, int]]:
    """List the parts of hda_mpc_report in their order.

    Args:
        arm: An arm that was built with a predictive controller.

    Yields:
        Name and length of each part.

    """
    m, n, axes = arm.manifest["mpc"], arm.n, arm.n
    if m["space"] == "tip":
        axes = 2
    for name in ("rung", "failures", "solved", "factored", "interior", "active", "residual"):
        yield name, 1
    for name in ("active_of", "violated_by", "foreseen_by"):
        yield name, len(LIMIT_FAMILIES)
    yield from (("tip_force", 2), ("observed_force", 2), ("disturbance", n), ("innovation", 1), ("collision", 1))
    yield from (("yielded", 2 * axes), ("x", arm.nx), ("plan", m["nodes"] * n))
    yield "predicted", m["nodes"] * len(m["state"])
