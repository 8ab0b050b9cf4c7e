"""Checks of the sampling of a log and of the channels that it has."""

from __future__ import annotations

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.input_lags import COMMAND_MEASUREMENT_PAIRS, INPUT_QUANTITIES
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.log_repair_settings import LOG_REPAIR
from hdagen.log.column_map import split_column_name

_MISSING_CHANNEL_COSTS = (  # the cost of a channel that a joint does not have
    ("motor_position", "in a flexible joint, torsion, backlash and kinematic error cannot be told apart"),
    ("joint_position", "what bends or errs behind the motor is seen only through the motor"),
    ("joint_position_reference", "the loop cannot be closed in a replay"),
)


def check_sampling(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find dropped rows, long gaps, and a log that is too short or too slow.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, (rows, missing), findings = profile.log, profile.gaps, []
    steps = np.diff(log.time)
    duration, lost = float(log.time[-1] - log.time[0]), int(missing.sum())
    share = lost / (len(log) + lost)
    if lost:
        k = int(rows[np.argmax(missing)])
        says = (
            f"{lost} row(s) are missing in {len(rows)} gap(s), {100 * share:.2g} % of the log, the longest of "
            f"{steps[k]:.3g} s after row {k + 1} ({log.time[k]:.6g} s)"
        )
        if share > LOG_REPAIR.dropped_share_limits[1]:
            sentence = f"{says}: too many; record with a logger that keeps up, or at a lower rate."
            findings.append(Finding(Severity.REFUSE, "dropped", 0, sentence))
        elif steps[k] > LOG_REPAIR.warned_gap_time:
            sentence = f"{says}: nothing is known in between; cut the log there if it matters."
            findings.append(Finding(Severity.WARN, "dropped", 0, sentence))
        elif share > LOG_REPAIR.dropped_share_limits[0]:
            findings.append(Finding(Severity.WARN, "dropped", 0, f"{says}: commands are held across them."))
    if duration < LOG_REPAIR.short_log_time:
        sentence = f"the log lasts {duration:.3g} s; a diagnosis needs several seconds of motion: record longer."
        findings.append(Finding(Severity.WARN, "short", 0, sentence))
    if 1 / profile.period < LOG_REPAIR.slow_sample_rate:
        rate = f"{1 / profile.period:.4g} Hz"
        sentence = f"{rate} is slow for joints that ring at 15 to 140 Hz: record at 500 Hz or more if possible."
        findings.append(Finding(Severity.NOTE, "slow", 0, sentence))
    return findings


def check_channels(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
    """Find channels that are missing, constant or saturated, with the cost of each.

    Args:
        profile: of the log.
        robot: its facts.
        model: the robot file's, where there is one.

    Returns:
        The findings.

    """
    log, channels, findings = profile.log, profile.channels, []
    for joint in range(1, log.n_joints + 1):
        for base, cost in _MISSING_CHANNEL_COSTS:
            if f"{base}_{joint}" not in channels:
                findings.append(Finding(Severity.NOTE, "missing", joint, f"{base}_{joint} is not logged: {cost}."))
        for commanded, measured in COMMAND_MEASUREMENT_PAIRS:
            command, name = f"{commanded}_{joint}", f"{measured}_{joint}"
            absent = [one for one in (command, name) if one not in channels]
            if len(absent) == 1:
                sentence = f"{absent[0]} is not logged: delay, lag and saturation of the drive cannot be seen."
                findings.append(Finding(Severity.NOTE, "missing", joint, sentence))
    for name, channel in channels.items():
        _, joint = split_column_name(name) or (name, 0)
        if "_position_" in name and "reference" not in name and not channel.is_moving:
            sentence = (
                f"{name} stays between {channel.low:.5g} and {channel.high:.5g}: the joint was not moved, so nothing "
            )
            findings.append(
                Finding(Severity.WARN, "still", joint, sentence + "is learned about it; record a log that moves it.")
            )
        elif channel.is_constant and not name.startswith("tip_force"):
            findings.append(
                Finding(Severity.NOTE, "constant", joint, f"{name} stays at {channel.low:.5g}: it says nothing.")
            )
        if channel.saturated_share > 0.002 and name.rpartition("_")[0] in INPUT_QUANTITIES:
            sentence = (
                f"{name} sits at {channel.low:.4g} or {channel.high:.4g} in {100 * channel.saturated_share:.2g} % of"
                " the rows: saturated; record with less acceleration if that was not meant."
            )
            findings.append(Finding(Severity.WARN, "saturated", joint, sentence))
    return findings
