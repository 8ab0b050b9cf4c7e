"""The inputs that drive a replay: commanded or measured currents and torques of a log, and the forces on its tip."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import get_torque_constant
from hdagen.log.column_map import is_command_channel
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.input_interpolation import judge_interpolation

INPUT_CHOICES = ("command", "measured")


def read_driving_inputs(arm: Arm, log: Log, source: str) -> tuple[Array, list[str]]:
    """Read the inputs that drive a model from a log.

    A measured current or torque acts from row to row as `judge_interpolation` judges.

    Args:
        arm: The arm.
        log: The log.
        source: "command" or "measured", the channels that are preferred.

    Returns:
        (T, nu), the inputs, each held from its row to the next, A (or N m and N); and sentences on them.

    Raises:
        LogError: A joint has no current or torque that fits the arm's input.
        PlantError: ``source`` is neither word.

    """
    if source not in INPUT_CHOICES:
        raise PlantError(f"the input is {' or '.join(INPUT_CHOICES)}, not {source}.")
    inputs, notes, problems = np.zeros((len(log), arm.nu)), [], []
    for j in range(1, arm.n + 1):
        name = find_driving_channel(log, j, source)
        if name is None:
            problems.append(f"{log.source}: joint {j} has no current or torque; log motor_current_command_{j}.")
            continue
        if "current" in name and arm.input_names[j - 1].startswith("motor_torque"):
            problems.append(
                f"{log.source}: {name} is a current and the robot file has no torque_constant for joint {j}: "
                "state it there."
            )
            continue
        values = _read_in_input_unit(arm, log, j, name)
        if not is_command_channel(name):
            between = judge_interpolation(arm, log, j, values)
            values = between.average_between_rows(values)
            if source == "command":
                notes.append(f"No command is logged for joint {j}: {name} drives the model, {between.description}.")
        elif source == "measured":
            notes.append(f"Joint {j} has no measured current or torque: {name} drives the model.")
        inputs[:, j - 1] = values
        notes += _note_exceeded_current(arm, j, name, inputs[:, j - 1])
    if problems:
        raise LogError(problems)
    for k, name in enumerate(arm.input_names[arm.n :], arm.n):
        if name in log:
            inputs[:, k] = log[name]
    return inputs, notes


def compute_effective_inputs(arm: Arm, log: Log, inputs: Array, source: str) -> tuple[Array, Array]:
    """Compute the inputs that act behind the input effects, and the inputs that each row shows.

    Commands pass through the arm's input effects, the whole log at once; a measured input acts as it is and shows
    itself. A row shows the input that acts at its instant: without input effects that of the row before.

    Args:
        arm: The arm.
        log: The log.
        inputs: (T, nu), as `read_driving_inputs` reads them.
        source: "command" or "measured", as for `read_driving_inputs`.

    Returns:
        (T, nu) the inputs that act over each row, and (T, nu) the inputs that each row shows.

    """
    acting, first, n = inputs.copy(), _find_input_before(arm, log, inputs[:1]), arm.n
    shown = np.concatenate([first, inputs[:-1]])
    names = [find_driving_channel(log, j, source) or "" for j in range(1, n + 1)]
    if arm.has_input_stage:
        dt = np.append(np.diff(log.time), log.period)
        mean, at = arm.apply_input_stage(inputs[:, :n], dt, first[0, :n])
        commanded = [j for j, name in enumerate(names) if is_command_channel(name)]
        acting[:, commanded], shown[:, commanded] = mean[:, commanded], at[:, commanded]
    for j, name in enumerate(names, 1):
        if name and not is_command_channel(name):
            shown[:, j - 1] = _read_in_input_unit(arm, log, j, name)
    return acting, shown


def find_driving_channel(log: Log, j: int, source: str) -> str | None:
    """Find the channel that drives a joint.

    Args:
        log: The log.
        j: The joint's number.
        source: "command" or "measured", the channels that are preferred.

    Returns:
        The name of the logged current or torque, of the other kind where the preferred one is not logged; None where
        neither is.

    """
    kinds = ["", "_command"]
    if source == "command":
        kinds.reverse()
    names = (f"{quantity}{kind}_{j}" for kind in kinds for quantity in ("motor_current", "motor_torque"))
    return next((name for name in names if name in log), None)


def _read_in_input_unit(arm: Arm, log: Log, j: int, name: str) -> Array:
    """A logged current or torque (T,) as the input of joint j."""
    if "torque" in name and arm.input_names[j - 1].startswith("motor_current"):
        return log[name] / get_torque_constant(arm, j)
    return log[name]


def _note_exceeded_current(arm: Arm, j: int, name: str, current: Array) -> list[str]:
    most = arm.robot["joints"][j - 1]["drive"]["max_current"]
    if not most or not arm.input_names[j - 1].startswith("motor_current"):
        return []
    over = int(np.count_nonzero(np.abs(current) > most * (1 + 1e-6)))
    if not over:
        return []
    return [f"{name} exceeds the robot file's max_current of {most:g} A in {over} row(s); the model lets it through."]


def _find_input_before(arm: Arm, log: Log, first: Array) -> Array:
    """The input that acted before the first row (1, nu): the one measured there, else the first command."""
    before = first.copy()
    for j in range(1, arm.n + 1):
        if arm.input_names[j - 1] in log:
            before[0, j - 1] = log[arm.input_names[j - 1]][0]
        elif f"motor_torque_{j}" in log:
            before[0, j - 1] = log[f"motor_torque_{j}"][0] / get_torque_constant(arm, j)
    return before
