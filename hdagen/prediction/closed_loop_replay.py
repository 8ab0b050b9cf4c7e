"""Closed-loop replay: the controller that drove the machine drives the model, from the logged reference and the
simulated encoders.

controller.toml states for every joint the cascade of a position loop in a velocity loop, or a PD law on the reference:

    command = torque_scale · clip(kv (kp (reference − position) − velocity), ± limit)
    command = torque_scale · clip(proportional (reference − position) − derivative · velocity, ± limit)

The velocity is the mean rate over the last ``velocity_filter_samples`` rows, the difference of a moving average.
Source: Janot, Gautier, Brunot, Data set and reference models of EMPS (2019), 1.3 and Fig. 2, where the average is over
two rows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.input_stage import InputStage
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.channel_noise import measure_shown_noise
from hdagen.prediction.driving_inputs import compute_effective_inputs, read_driving_inputs
from hdagen.prediction.kalman_filter import estimate_states
from hdagen.prediction.measurement_model import Readings, count_mechanical_states
from hdagen.prediction.prediction_settings import PREDICTION
from hdagen.prediction.window_replay import Replay, check_log_fits_arm, compare_with_log, find_window_starts
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import show_path, show_value

_MOST_CONTROLLER_BYTES = 100_000  # bytes of a controller.toml
_MOST_FILTER_SAMPLES = 1000
_CASCADE_KEYS, _PD_KEYS = ("kp", "kv"), ("proportional", "derivative")


@dataclass(frozen=True)
class JointLaw:
    """The law of one joint.

    Attributes:
        kp: Of a cascade, the gain of the position loop, 1/s.
        kv: Of a cascade, the gain of the velocity loop, the command's unit before ``torque_scale`` a rad/s (m/s).
        velocity_filter_samples: Rows over which the velocity is the mean rate.
        torque_scale: Factor on the command.
        limit: Largest command before ``torque_scale``.
        encoder: "joint", or "motor" (its angle over the ratio).
        proportional: Of a PD law, the command before ``torque_scale`` a rad (m) of error.
        derivative: Of a PD law, the command before ``torque_scale`` a rad/s (m/s); None: the law is a cascade.

    """

    kp: float = 0.0
    kv: float = 0.0
    velocity_filter_samples: int = 1
    torque_scale: float = 1.0
    limit: float = math.inf
    encoder: str = "joint"
    proportional: float = 0.0
    derivative: float | None = None

    def compute_output(self, error: float, velocity: float) -> float:
        """Compute the command before limit and scale.

        Args:
            error: Reference less position, rad or m.
            velocity: The velocity, rad/s or m/s.

        Returns:
            The command before ``torque_scale``.

        """
        if self.derivative is None:
            return self.kv * (self.kp * error - velocity)
        return self.proportional * error - self.derivative * velocity


def read_controller(path: str | Path) -> tuple[JointLaw, ...]:
    """Read the laws of a controller.toml.

    Args:
        path: The file.

    Returns:
        One law a [[joint]], base first.

    Raises:
        PlantError: The file cannot be used; every problem is listed.

    """
    try:
        content = read_toml(Path(path), _MOST_CONTROLLER_BYTES, "see docs/method/prediction.md for its keys")
    except InputFileError as error:
        raise PlantError(error) from None
    path = show_path(path)
    problems = [
        f"{path}: unknown key {key[:40]!r}; possible is [[joint]], one a joint." for key in content if key != "joint"
    ]
    tables = content.get("joint")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise PlantError(
            "\n".join(
                [
                    *problems,
                    f"{path}: found no [[joint]] table; write one a joint, with its kp and kv (or a PD law).",
                ]
            )
        )
    laws = [_parse_joint_law(f"{path}, joint {j}", table, problems) for j, table in enumerate(tables, 1)]
    if problems:
        raise PlantError("\n".join(problems))
    return tuple(law for law in laws if law is not None)


def _parse_joint_law(where: str, table: Mapping[str, Any], problems: list[str]) -> JointLaw | None:
    """One joint's law, or None and why not."""
    before = len(problems)
    known = {"kp": (0.0, 1e6), "kv": (0.0, 1e9), "torque_scale": (-1e6, 1e6), "limit": (0.0, 1e9)}
    known |= dict.fromkeys(_PD_KEYS, (0.0, 1e9))
    for key, value in table.items():
        if key == "velocity_filter_samples":
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _MOST_FILTER_SAMPLES:
                problems.append(
                    f"{where}, {key}: found {show_value(value)}, possible is a whole number from 1 to"
                    f" {_MOST_FILTER_SAMPLES}."
                )
        elif key == "encoder":
            if value not in ("joint", "motor"):
                problems.append(f'{where}, {key}: found {show_value(value)}, possible is "joint" or "motor".')
        elif key not in known:
            names = ", ".join((*known, "velocity_filter_samples", "encoder"))
            problems.append(f"{where}: unknown key {key[:40]!r}; possible are {names}.")
        elif (
            isinstance(value, bool) or not isinstance(value, int | float) or not known[key][0] <= value <= known[key][1]
        ):
            low, high = known[key]
            problems.append(
                f"{where}, {key}: found {show_value(value)}, possible is a number from {low:g} to {high:g}."
            )
    gains, others = _CASCADE_KEYS, _PD_KEYS
    if any(key in table for key in _PD_KEYS):
        gains, others = _PD_KEYS, _CASCADE_KEYS
    problems += [f"{where}: {key} is missing; state it." for key in gains if key not in table]
    problems += [
        f"{where}: {key} belongs to a cascade and {gains[0]} to a PD law; state one law."
        for key in others
        if key in table
    ]
    if len(problems) > before:
        return None
    return JointLaw(**table)


def replay_closed_loop(arm: Arm, log: Log, laws: tuple[JointLaw, ...], window: float = math.inf) -> Replay:
    """Replay a log with control laws that close the loop around the arm.

    Args:
        arm: The arm.
        log: The log, with the joints' references.
        laws: One law a joint.
        window: The length of a window, s; inf: the whole log.

    Returns:
        The replay; its columns hold the commands too.

    Raises:
        LogError: The log has no reference, or does not fit the arm.
        PlantError: The laws do not fit the arm, or the loop leaves all bounds.

    """
    check_log_fits_arm(arm, log)
    _check_laws_fit(arm, log, laws)
    logged, _ = read_driving_inputs(arm, log, "command")
    readings, m = Readings.from_log(arm, log), count_mechanical_states(arm)
    starts = find_window_starts(log.time, window)
    begun = np.stack([readings.state_at(arm, int(row)) for row in starts])
    if not readings.measures_full_state(arm) and len(starts) > 1:
        acting, _ = compute_effective_inputs(arm, log, logged, "command")
        found = estimate_states(arm, log, readings, acting, starts[1:], np.zeros((len(log), arm.nx - m)))
        begun[1:] = np.where(np.isfinite(found).all(1, keepdims=True), found, begun[1:])
    states, inputs, hidden = np.empty((len(log), arm.nx)), logged.copy(), np.zeros(arm.nx - m)
    for x, first, end in zip(begun, starts, np.append(starts[1:], len(log)), strict=True):
        x[m:] = hidden
        hidden = _simulate_window(arm, log, laws, x, range(int(first), int(end)), states, inputs)[m:]
    lost = np.flatnonzero(~np.isfinite(states).all(1))
    if len(lost):
        raise PlantError(
            f"{log.source}: the closed loop left all bounds by {log.time[lost[0]]:.4g} s; check signs, units and "
            "torque_scale of the controller."
        )
    note = f"The stated law closes the loop in {len(starts)} window(s); logged commands are not used."
    return _add_command_columns(
        compare_with_log(arm, log, states, compute_effective_inputs(arm, log, inputs, "command")[1], starts, [note]),
        arm,
        log,
        inputs,
    )


def _check_laws_fit(arm: Arm, log: Log, laws: tuple[JointLaw, ...]) -> None:
    if len(laws) != arm.n:
        raise PlantError(f"the controller has {len(laws)} joint(s), the robot {arm.n}: write one [[joint]] for each.")
    missing = [
        f"joint_position_reference_{j}" for j in range(1, arm.n + 1) if f"joint_position_reference_{j}" not in log
    ]
    if missing:
        raise LogError(
            [f"{log.source}: {', '.join(missing)} is not logged, and the loop cannot be closed: log it, or map it."]
        )


class JointController:
    """The controller of one joint, with its encoder's readings in rad or m at the joint, as measured before the
    window.

    ``arm`` and ``log`` are the robot and its log; ``j`` is the joint's number, and ``law`` its law.
    """

    def __init__(self, arm: Arm, log: Log, j: int, law: JointLaw) -> None:
        ratio = arm.parameters[f"ratio_{j}"]
        self.law, self.time, self.period = law, log.time.tolist(), log.period
        self.reference = log[f"joint_position_reference_{j}"].tolist()
        units = {"motor": ratio, "joint": 1.0}
        self.unit = units[law.encoder]
        side = next(one for one in (law.encoder, *units) if f"{one}_position_{j}" in log)
        self.seen = (log[f"{side}_position_{j}"] / units[side]).tolist()
        self.step = float(arm.robot["joints"][j - 1]["sensor"][f"{law.encoder}_encoder_resolution"])

    def compute_command(self, row: int, angle: float) -> float:
        """Compute the command of a row.

        Args:
            row: The row.
            angle: The angle at the law's encoder, before it is counted: rad at the motor, or rad or m at the joint.

        Returns:
            The command, in the unit of the robot's input.

        """
        law = self.law
        if self.step:
            angle = round(angle / self.step) * self.step
        self.seen[row] = angle / self.unit
        back = max(row - law.velocity_filter_samples, 0)
        missing = back - row + law.velocity_filter_samples  # rows before the log's first, in which it stood still
        span = self.time[row] - self.time[back] + missing * self.period
        velocity = (self.seen[row] - self.seen[back]) / span
        output = law.compute_output(self.reference[row] - self.seen[row], velocity)
        return law.torque_scale * min(max(output, -law.limit), law.limit)


def _simulate_window(
    arm: Arm, log: Log, laws: tuple[JointLaw, ...], x: Array, rows: range, states: Array, inputs: Array
) -> Array:
    """Fill ``rows`` of ``states`` and of the motors' ``inputs``; return the state after the last row."""
    joints = [JointController(arm, log, j, law) for j, law in enumerate(laws, 1)]
    u, h, now, then = inputs[rows[0]].copy(), np.empty(1), x.copy(), np.empty(arm.nx)
    shapes = next(f["outputs"] for f in arm.manifest["functions"] if f["name"] == "outputs")
    outputs = {name: np.empty(length) for name, length in shapes}
    look = arm.module.bind("outputs", now, u, arm.c, *outputs.values())
    move = arm.module.bind("step_exact", now, u, arm.c, h, then)
    sides = [outputs[f"{law.encoder}_position"] for law in laws]
    held = np.diff(log.time, append=log.time[-1])
    parts = [arm.count_steps(float(span)) for span in held]
    each = (held / parts).tolist()
    stage = _start_input_stage(arm, inputs, held, rows[0])
    for row in rows:
        states[row] = now
        u[arm.n :] = inputs[row, arm.n :]
        look.run()
        for j, (joint, side) in enumerate(zip(joints, sides, strict=True)):
            angle = float(side[j])
            if not math.isfinite(angle):
                states[row:] = np.nan
                return now
            inputs[row, j] = joint.compute_command(row, angle)
        if held[row] <= 0:
            continue
        h[0] = each[row]
        u[: arm.n] = stage.step(inputs[row, : arm.n], float(held[row]))
        for _ in range(parts[row]):
            move.run()
            now[:] = then
    return now


def _start_input_stage(arm: Arm, inputs: Array, held: Array, first: int) -> InputStage:
    """The input stage at row ``first``, after the commands of the rows before it."""
    begin = max(0, first - PREDICTION.input_memory_rows)
    stage = InputStage(arm, inputs[begin, : arm.n])
    if arm.has_input_stage:
        for row in range(begin, first):
            stage.step(inputs[row, : arm.n], float(held[row]))
    return stage


def _add_command_columns(result: Replay, arm: Arm, log: Log, inputs: Array) -> Replay:
    """``result`` with the simulated commands beside the logged ones."""
    columns, errors, noise, relative = (
        dict(result.columns),
        dict(result.errors),
        dict(result.noise),
        dict(result.relative),
    )
    for j in range(1, arm.n + 1):
        own = arm.input_names[j - 1]
        name = own.replace("motor_current", "motor_current_command").replace("motor_torque", "motor_torque_command")
        columns[name] = inputs[:, j - 1].copy()
        if name in log:
            errors[name] = float(np.sqrt(np.mean((columns[name] - log[name]) ** 2)))
            noise[name] = measure_shown_noise(log, name)
            size = float(np.sqrt(np.mean(log[name] ** 2)))
            if size:
                relative[name] = errors[name] / size
    return replace(result, columns=columns, errors=errors, noise=noise, relative=relative)
