"""Robots and logs for the tests of replays: what an arm of one's own would log, with its encoders' steps and noise."""

from __future__ import annotations

import math
from typing import Any

import arms
import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.log.column_map import name_command_channel
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay

MOTOR, JOINT, NOISE = 2 * math.pi / 4096, 2 * math.pi / 2**20, 0.01  # rad, rad, A: the sensors of these tests
SENSORS = f"""[joint.sensor]
motor_encoder_resolution = {MOTOR}
joint_encoder_resolution = {JOINT}
current_noise = {NOISE}"""
FLEXIBLE = arms.arm("RR", drive=f"torque_constant = 0.05\nmax_current = 10.0\n{SENSORS}")
RIGID = arms.arm("RP", rigid="rr", drive=f"friction_smoothing = 1.0\n{SENSORS}")
LIMITS = """torque_constant = 0.05
max_current = 10.0
[joint.limits]
position = [-1.5, 1.5]
speed = 2.0
torque = 60.0
motor_torque_rate = 50.0
"""
ONE = arms.arm("R", name="one joint", drive=LIMITS + SENSORS)
MEMORY = ("presliding_friction", "transmission_hysteresis")
SEVERAL = (  # effects of FLEXIBLE for tests that look at one or two of them: one build for all
    "cable_spring",
    "contact",
    "current_bias",
    "current_saturation",
    "payload",
    "sensor_delay",
    "torque_ripple",
    "torque_sensor_gain",
)
RIGID_SEVERAL = (  # the same of RIGID
    "cable_spring",
    "command_delay",
    "contact",
    "current_loop_lag",
    "current_saturation",
    "encoder_eccentricity",
    "presliding_friction",
    "sensor_delay",
)
INPUT_AND_SENSOR = ("command_delay", "current_loop_lag", "encoder_eccentricity")
HYSTERESIS = {"hysteresis_torque_1": 2.0, "hysteresis_angle_1": 2e-4}
MEASURED = ("motor_position", "joint_position", "motor_velocity", "joint_velocity", "motor_current", "motor_torque")


def simulated(arm: Arm, seconds: float = 1.2, velocities: bool = False, seed: int = 0, even: bool = True) -> Log:
    """The log of ``arm`` under sums of sines, from rest, with the encoders' steps and the current's noise."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(
        np.full(round(seconds * 1000), 1e-3) if even else rng.uniform(0.5e-3, 1.5e-3, round(seconds * 1000))
    )
    waves = np.sin(2 * np.pi * np.outer(time, [1.7, 4.1]) + rng.uniform(0, 6, 2))
    swing = waves @ np.array([[1.0, 0.5, -0.7], [0.6, 1.0, 0.9]])
    size = 0.25 * np.array([slot["bound"] for slot in arm.manifest["input"][: arm.n]])
    u = np.zeros((len(time), arm.nu))
    u[:, : arm.n] = size * swing[:, : arm.n]
    u[300:500, arm.index("tip_force_y")] = 8.0
    hanging = np.array([-np.pi / 2, *np.zeros(arm.n - 1)])
    mean, shown = arm.apply_input_stage(u[:, : arm.n], np.append(np.diff(time), 1e-3), np.zeros(arm.n))
    acting = np.hstack([mean, u[:, arm.n :]])
    x = arm.rollout(arm.rest(hanging), acting[:-1], np.diff(time), exact=True)
    seen = arm.outputs(x, np.vstack([np.zeros(arm.nu), acting[:-1]]))
    columns = {"tip_force_x": u[:, -2], "tip_force_y": u[:, -1]}
    for j in range(1, arm.n + 1):
        name = arm.input_names[j - 1]
        columns |= {
            name_command_channel(name): u[:, j - 1],
            name: shown[:, j - 1] + NOISE * rng.standard_normal(len(time)),
        }
        columns[f"motor_position_{j}"] = np.round(seen["motor_position"][:, j - 1] / MOTOR) * MOTOR
        columns[f"joint_position_{j}"] = np.round(seen["joint_position"][:, j - 1] / JOINT) * JOINT
        if velocities:
            columns |= {f"{side}_velocity_{j}": seen[f"{side}_velocity"][:, j - 1] for side in ("motor", "joint")}
    return Log(time, {name: np.ascontiguousarray(values) for name, values in columns.items()}, arm.n, "simulated")


def multiples(found: Replay, what: str) -> list[float]:
    """Errors of a quantity's channels in multiples of their noise."""
    return [found.errors[name] / found.noise[name] for name in found.errors if name.startswith(what)]


def spoilt(log: Log, after: int, keep: tuple[str, ...] = (), seed: int = 1) -> Log:
    """``log`` with all measurements after row ``after`` replaced by noise of their own spread, but for ``keep``."""
    rng = np.random.default_rng(seed)
    columns = {}
    for name, values in log.columns.items():
        columns[name] = values.copy()
        if name.rpartition("_")[0] in MEASURED and name.rpartition("_")[0] not in keep:
            columns[name][after + 1 :] = values.mean() + values.std() * rng.standard_normal(len(log) - after - 1)
    return Log(log.time, columns, log.n_joints, log.source)


def smooth(arm: Arm) -> Log:
    """A rigid arm's log of a slow motion, with exact encoders."""
    log = simulated(arm, 6.0)
    swing = np.sin(2 * np.pi * np.outer(log.time, [0.7, 1.1]))
    u = np.zeros((len(log), arm.nu))
    u[:, :2] = 0.4 * swing  # N m, against 0.03 of dry friction
    x = arm.rollout(arm.rest([-np.pi / 2, 0.0]), u[:-1], np.diff(log.time))
    columns = {f"motor_torque_command_{j}": u[:, j - 1] for j in (1, 2)}
    columns |= {f"joint_position_{j}": np.ascontiguousarray(x[:, arm.index(f"joint_position_{j}")]) for j in (1, 2)}
    return Log(log.time, columns, 2, "smooth")


def diagnosis(**changes: object) -> dict[str, Any]:
    """A diagnosis.json's content."""
    hysteresis = {"hysteresis_torque": {"value": 2.0, "std": 0.1, "unit": "N m"}, "hysteresis_angle": {"value": 2e-4}}
    causes = [
        {"effect": "transmission_hysteresis", "joint": 1, "probability": 0.9, "parameters": hysteresis},
        {"effect": "coulomb_friction", "joint": 2, "parameters": {"coulomb_friction": {"value": 0.05, "std": 0.01}}},
    ]
    base = {"mass_1": {"value": 4.6, "std": 0.1}}
    return {"schema": 2, "verdict": ["transmission_hysteresis@1"], "causes": causes, "parameters": base} | changes


def erring(log: Log, size: float, seed: int) -> Replay:
    """A replay of ``log`` that errs by ``size`` times the noise."""
    rng = np.random.default_rng(seed)
    columns = {name: values + size * 1e-3 * rng.normal(size=len(log)) for name, values in log.columns.items()}
    errors = {name: float(np.sqrt(np.mean((columns[name] - log[name]) ** 2))) for name in columns}
    noise = dict.fromkeys(columns, 1e-3)
    return Replay(columns, np.zeros((len(log), 4)), errors, noise, {}, np.arange(0, len(log), 250), 0, ())
