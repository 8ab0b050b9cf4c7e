"""Checks of currents and torques: milliamperes, a torque at the joint's side, a shifted row."""

from __future__ import annotations

import math

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.channel_check_settings import CHANNEL_CHECK
from hdagen.data_quality.finding import Finding, RobotFacts, Severity, state_max_current
from hdagen.data_quality.input_check_settings import INPUT_CHECK
from hdagen.data_quality.input_lags import COMMAND_MEASUREMENT_PAIRS, Lag
from hdagen.data_quality.inputs_vs_motion import measure_delay_rows
from hdagen.data_quality.log_profile import LogProfile
from hdagen.log.measured_log import Log


def check_current_sizes(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check currents against the drive's largest one: beyond it they are in mA, once misread rows are taken out.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    channels, findings = profile.channels, []
    for joint, stated in enumerate(robot.max_currents, start=1):
        for name in (f"motor_current_command_{joint}", f"motor_current_{joint}"):
            if name not in channels:
                continue
            peak, most = max(abs(channels[name].low), abs(channels[name].high)), CHANNEL_CHECK.most_unstated_current
            if stated:
                most = 10 * stated
            if peak > most:
                sentence = (
                    f"{name} reaches {peak:.4g}, {state_max_current(stated)}: mA? "
                    f'Then set unit = "mA" under [{name}] in columns.toml.'
                )
                findings.append(Finding(Severity.REFUSE, "milliamperes", joint, sentence, {name: {"unit": "mA"}}))
    return findings


def check_measured_inputs(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Check the scale of each measured input against its command, and the row in which it shows it.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, found, behind = profile.log, profile.lags, measure_delay_rows(profile, robot)
    findings = []
    for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
        for joint in range(1, log.n_joints + 1):
            command, name = f"{commanded}_{joint}", f"{measured}_{joint}"
            if name in found:
                findings += _check_scale(found[name], command, name, robot.ratios[joint - 1], joint)
                findings += _check_row_shift(log, found[name], command, name, joint, behind.get(name, math.nan))
    return findings


def _check_scale(one: Lag, command: str, name: str, ratio: float, joint: int) -> list[Finding]:
    """Whether a measured input is in another unit than its command, or at the joint's side of the gear."""
    says = f"{name} is {one.slope:.4g} times its command"
    for factor, what, who in ((1e3, "mA against A", name), (1e-3, "A against mA", command)):
        if 0.5 < one.slope / factor < 2 and "current" in name:
            sentence = f'{says}: {what}; set unit = "mA" under [{who}] in columns.toml.'
            return [Finding(Severity.REFUSE, "milliamperes", joint, sentence, {who: {"unit": "mA"}})]
    for factor, who in ((ratio, name), (1 / ratio, command)):
        if "torque" in name and ratio > 3 and 0.8 < one.slope / factor < 1.25:
            repair = f"joint_side_ratio = {ratio:g} under [{who}]"
            sentence = f"{says}, the ratio: one of them is at the joint; set {repair} in columns.toml."
            return [Finding(Severity.REFUSE, "joint_scale", joint, sentence)]
    if one.slope > 0 and not 0.3 < one.slope < 3:
        sentence = f"{says}: another unit, or a drive that does not follow; give the unit in columns.toml."
        return [Finding(Severity.WARN, "units", joint, sentence)]
    return []


def _check_row_shift(log: Log, one: Lag, command: str, name: str, joint: int, behind: float) -> list[Finding]:
    """A command is held from its row to the next: the measurement cannot show it before the next row."""
    if np.array_equal(log[command], log[name]):
        sentence = (
            f"{name} equals {command} in every row: the command under another name, not a measurement; leave it out, "
            f'ignore = ["{name}"] in columns.toml.'
        )
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence, {"ignore": [name]})]
    if (
        one.rows <= 0
        and one.misfit < 0.9 * one.usual_misfit
        and one.misfit >= INPUT_CHECK.clear_misfit_ratio * one.usual_misfit
    ):
        sentence = (
            f"{name} fits {command} best {-1e3 * one.seconds:.2g} ms ahead of it, which cannot be, and hardly better "
            "than behind it: their shapes differ in another way."
        )
        return [Finding(Severity.NOTE, "row_shift", joint, sentence)]
    if one.rows <= 0 and one.misfit < INPUT_CHECK.clear_misfit_ratio * one.usual_misfit:
        early, shown = 1 - one.rows, "k"
        if one.rows:
            shown = f"k+{-one.rows}"
        sentence = (
            f"{name} shows in row k the command of row {shown}, before it can have acted; set shift_rows = {-early} "
            f"under [{command}] (it is logged late) or shift_rows = {early} under [{name}] (it is logged early), "
            "in columns.toml."
        )
        repair = {name: {"shift_rows": early}}
        # the motion follows the measurement as it stands
        if early >= INPUT_CHECK.least_early_rows and behind > -early / 2:
            repair = {command: {"shift_rows": -early}}
        return [Finding(Severity.REFUSE, "row_shift", joint, sentence, repair)]
    if one.rows == 2 and one.misfit < 0.8 * one.usual_misfit:
        sentence = (
            f"{name} shows in row k the command of row k-2: the command is logged a row early, or the drive takes a "
            f"period more; if it is the log, set shift_rows = 1 under [{command}] in columns.toml."
        )
        return [Finding(Severity.WARN, "row_shift", joint, sentence)]
    return []
