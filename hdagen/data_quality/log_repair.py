"""Repair: a log is made fit for a diagnosis where its own numbers show the mistake, or refused in sentences.

Findings of triage that can be stated as lines of a columns.toml are applied (degrees, milliamperes, wrapped encoders, a
measured input logged in the wrong row). Rows without a value, or with a current that no drive gives, are taken out.
Dropped rows stay gaps, at which `split_at_long_gaps` cuts. Anything else that would mislead a diagnosis is refused with
a sentence on how to record it right. A time skew is no mistake but a finding: the diagnosis has it among its
candidates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality import encoder_clock_drift
from hdagen.data_quality.finding import Finding, RobotFacts, Severity, format_repair
from hdagen.data_quality.inputs_vs_model import MODEL_CHECKS
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.log_repair_settings import LOG_REPAIR
from hdagen.data_quality.log_triage import Triage, examine_log
from hdagen.data_quality.outliers import find_outliers
from hdagen.data_quality.shared_motion import POSITION_CHANNELS
from hdagen.log import column_map_file
from hdagen.log.column_map import split_column_name
from hdagen.log.data_table import LogError, Table
from hdagen.log.measured_log import Log, find_gaps, split_at_pauses
from hdagen.support.row_runs import find_true_runs

_MENDED_FINDINGS = ("degrees", "milliamperes", "wrapped", "row_shift")  # refused findings whose repair is unambiguous
_CONTRADICTED = "contradicted"  # a warning that is repaired too
_NEEDED_CHANNELS = (
    ("motor_current_command", "motor_current", "motor_torque_command", "motor_torque"),
    POSITION_CHANNELS,
)


@dataclass(frozen=True)
class Repair:
    """One repair of a log.

    Attributes:
        name: A stable name.
        joint: The joint's number; 0: the whole log.
        sentence: The mistake, its repair, and how to record it right.

    """

    name: str
    joint: int
    sentence: str


def repair_log(log: Log, arm: Arm) -> tuple[Log, list[Repair], Triage]:
    """Repair a log for a diagnosis.

    Args:
        log: The log; it may hold NaN where a value is missing.
        arm: The arm.

    Returns:
        The repaired log, the repairs (also in the log's notes), and the triage of the repaired log.

    Raises:
        LogError: The log has problems that only its owner can mend; all are listed.

    """
    log, repairs = _drop_missing_values(log)
    profile, outliers = _drop_outliers(LogProfile(log), arm)
    repairs += outliers
    problems = _check_joints(profile.log, arm)
    if problems:
        raise LogError(problems)
    robot = RobotFacts.from_robot(arm.robot)
    for _ in range(LOG_REPAIR.most_repair_rounds):
        seen = examine_log(profile, robot)
        findings = _find_suspicions(profile, robot, arm, seen)
        mended = _choose_mendable(findings)
        if not mended:
            break
        profile = LogProfile(_apply_repairs(profile.log, mended))
        repairs += _describe_repairs(mended)
    else:
        seen = examine_log(profile, robot)
    problems = [f"{log.source}: {f.sentence}" for f in findings if f.severity is Severity.REFUSE]
    problems += _find_too_little_content(profile.log, seen)
    if problems:
        raise LogError(list(dict.fromkeys(problems)))
    log, drifting = _put_on_one_clock(profile, arm)
    repairs += drifting + _note_dropped_rows(log)
    notes = (*log.notes, *(one.sentence for one in repairs))
    return replace(log, notes=tuple(dict.fromkeys(notes))), repairs, seen


def repair_for_replay(log: Log, arm: Arm) -> tuple[Log, list[Repair], Triage]:
    """Repair a log for a replay.

    Channels that contradict another one are left out, or scaled where the factor is plain, and the encoders of each
    joint are brought to one clock.

    Args:
        log: The log.
        arm: The arm.

    Returns:
        The repaired log, the repairs, and the triage of the repaired log.

    """
    profile, repairs, robot = LogProfile(log), list[Repair](), RobotFacts.from_robot(arm.robot)
    if any("_velocity_" in name for name in log.columns):
        findings = examine_log(profile, robot).findings
        found = [finding for finding in findings if finding.name == _CONTRADICTED]
        if found:
            profile, repairs = LogProfile(_apply_repairs(log, found)), _describe_repairs(found)
    log, drifting = _put_on_one_clock(profile, arm)
    if drifting:
        profile = LogProfile(log)
    return log, repairs + drifting, examine_log(profile, robot)


def _put_on_one_clock(profile: LogProfile, arm: Arm) -> tuple[Log, list[Repair]]:
    """Bring the readings of a joint's own encoder to its motor's clock, where the two clocks drift apart."""
    log, repairs = profile.log, []
    ratios = [joint["drive"]["ratio"]["nominal"] for joint in arm.robot["joints"]]
    for joint, rate in encoder_clock_drift.find_clock_drifts(profile, ratios).items():
        log = encoder_clock_drift.correct_clock_drift(log, joint, rate)
        over, ever = 1e3 * abs(rate) * float(np.ptp(log.time)), "ever earlier"
        if rate > 0:
            ever = "ever later"
        sentence = (
            f"joint_position_{joint} is read {ever} than motor_position_{joint}, by {over:.3g} ms over the log: two "
            f"clocks, {1e6 * abs(rate):.3g} ppm apart. Read here on the motor's; record both on one clock."
        )
        repairs.append(Repair("drift", joint, sentence))
    return log, repairs


def split_at_long_gaps(time: np.ndarray) -> list[tuple[int, int]]:
    """Split rows at the long gaps, over which no window of a replay may reach.

    A gap is long above 10 ms and 3.5 periods: over less, a command is taken as held.

    Args:
        time: (T,), increasing, s.

    Returns:
        The rows [start, stop) of each part.

    """
    if len(time) < 2:
        return split_at_pauses(time, LOG_REPAIR.long_gap_time)
    return split_at_pauses(
        time, max(LOG_REPAIR.long_gap_time, LOG_REPAIR.long_gap_periods * float(np.median(np.diff(time))))
    )


def _check_joints(log: Log, arm: Arm) -> list[str]:
    """Check that the log has as many joints as the arm, each with an input and a position."""
    if log.n_joints != arm.n:
        return [
            f"{log.source}: the log has {log.n_joints} joint(s), {arm.robot['name']} has {arm.n}: the robot file of "
            "another robot; name this one's, or take the joints wanted with a columns.toml."
        ]
    problems = []
    for j, bases in product(range(1, arm.n + 1), _NEEDED_CHANNELS):
        names = [f"{base}_{j}" for base in bases]
        if log.columns.keys().isdisjoint(names):
            problems.append(f"{log.source}: joint {j} has none of {', '.join(names)}; record one of them.")
    return problems


def _find_suspicions(profile: LogProfile, robot: RobotFacts, arm: Arm, seen: Triage) -> list[Finding]:
    """The findings of triage; where none of them refuses the log, those of the robot's model too."""
    findings = list(seen.findings)
    for checks in MODEL_CHECKS:
        if any(f.severity is Severity.REFUSE for f in findings):
            break
        for check in checks:
            findings += check(profile, robot, arm)
    return findings


def _choose_mendable(findings: list[Finding]) -> list[Finding]:
    """The findings whose repair leaves no choice, one a column: several things can tell the same mistake."""
    found: dict[str, Finding] = {}
    for finding in findings:
        refused = finding.severity is Severity.REFUSE and finding.name in _MENDED_FINDINGS
        if finding.repair and (refused or finding.name == _CONTRADICTED):
            for column in finding.repair:
                key = finding.sentence if column == "ignore" else column
                found.setdefault(key, finding)
    return list(dict.fromkeys(found.values()))


def _describe_repairs(mended: list[Finding]) -> list[Repair]:
    """The repairs of these findings."""
    return [Repair(f.name, f.joint, f"{f.sentence} Read here with {format_repair(f.repair)}.") for f in mended]


def _apply_repairs(log: Log, mended: list[Finding]) -> Log:
    """The log with the tables of all findings, as a columns.toml that held them would read it."""
    tables: dict[str, Any] = {}
    for finding in mended:
        for column, table in finding.repair.items():
            if column == "ignore":
                tables.setdefault("ignore", []).extend(table)
            else:
                tables.setdefault(column, {}).update(table)
    mapping = column_map_file.build_column_map(tables, Path("columns.toml"))
    mapped = mapping.apply(Table({"time": log.time, **log.columns}, ("time", *log.columns), None, ()))
    whole = replace(log, columns=mapped.columns).rows(mapped.start, mapped.stop)
    return replace(whole, columns={name: np.ascontiguousarray(values) for name, values in whole.columns.items()})


def _drop_missing_values(log: Log) -> tuple[Log, list[Repair]]:
    """The log without columns that are mostly empty and without rows in which another has no value."""
    missing = {name: ~np.isfinite(values) for name, values in log.columns.items()}
    empty = [name for name, rows in missing.items() if np.mean(rows) > LOG_REPAIR.empty_column_share]
    repairs = []
    for name in empty:
        share, joint = 100 * np.mean(missing[name]), (split_column_name(name) or (name, 0))[1]
        sentence = f"{name} has no value in {share:.3g} % of the rows: left out; record it, or leave it out of the log."
        repairs.append(Repair("missing", joint, sentence))
    columns = {name: values for name, values in log.columns.items() if name not in empty}
    bad = np.zeros(len(log), bool)
    for name in columns:
        bad |= missing[name]
    if empty:
        log = replace(log, columns=columns)
    if not bad.any():
        return log, repairs
    first, after = find_true_runs(bad).T
    lengths = after - first
    where = ", ".join(name for name in columns if missing[name].any())
    says = (
        f"{where}: no value in {bad.sum()} row(s), {100 * np.mean(bad):.2g} % of the log, in {len(lengths)} run(s), "
        f"the longest of {lengths.max()} row(s), first in row {first[0] + 1} ({log.time[first[0]]:.6g} s)"
    )
    if np.mean(bad) > LOG_REPAIR.most_lost_row_share or np.count_nonzero(~bad) < 2:
        raise LogError([f"{log.source}: {says}: too many; record with a logger that keeps up, or cut the log there."])
    sentence = f"{says}: these rows are taken out, and long runs cut the log; record with a logger that keeps up."
    repairs.append(Repair("missing", 0, sentence))
    return log.select_rows(~bad), repairs


def _drop_outliers(profile: LogProfile, arm: Arm) -> tuple[LogProfile, list[Repair]]:
    """The profile of the log without the rows that were misread, which are as good as rows without a value."""
    found = list(find_outliers(profile, [joint["drive"]["max_current"] for joint in arm.robot["joints"]]))
    bad = np.any([one.rows for one in found], axis=0)
    if not found:
        return profile, []
    log = profile.log
    if np.mean(bad) > LOG_REPAIR.most_lost_row_share:
        raise LogError(
            [f"{log.source}: {one.sentence}: too many; record each channel at the rate it is read at." for one in found]
        )
    taken = "these rows are taken out; look at what the logger wrote there."
    repairs = [Repair(one.name, one.joint, f"{one.sentence}: {taken}") for one in found]
    return LogProfile(log.select_rows(~bad)), repairs


def _find_too_little_content(log: Log, seen: Triage) -> list[str]:
    """The reasons to refuse a log that is too short, moves no joint, or has lost too many rows."""
    problems = []
    lasts = sum(float(log.time[stop - 1] - log.time[start]) for start, stop in split_at_long_gaps(log.time))
    if lasts < LOG_REPAIR.shortest_motion:
        problems.append(
            f"{log.source}: the log lasts {lasts:.3g} s without its gaps, shorter than "
            f"{LOG_REPAIR.shortest_motion:g} s: record at least 10 s of motion with reversals, slow and fast."
        )
    if not any(c.is_moving for c in seen.channels if (split_column_name(c.name) or ("", 0))[0] in _NEEDED_CHANNELS[1]):
        problems.append(
            f"{log.source}: no joint moves, so what is missing cannot be told: at rest the others make up for any "
            "one effect; record a motion of every joint, with reversals, as hdagen excite designs one."
        )
    share = seen.dropped / (seen.rows + seen.dropped)
    if share > LOG_REPAIR.most_lost_row_share:
        problems.append(
            f"{log.source}: {100 * share:.2g} % of the rows are missing; record with a logger that keeps up, or at a "
            "lower rate."
        )
    return problems


def _note_dropped_rows(log: Log) -> list[Repair]:
    """The dropped rows of a log as a repair, if any."""
    rows, missing = find_gaps(log.time)
    lost = int(missing.sum())
    share = lost / (len(log) + lost)
    if not lost:
        return []
    pieces, cut = len(split_at_long_gaps(log.time)), ""
    if pieces > 1:
        cut = f" and the log is cut into {pieces} parts at the long ones"
    sentence = (
        f"{lost} row(s) are missing in {len(rows)} gap(s), {100 * share:.2g} % of the log: they stay gaps over which "
        f"commands are held{cut}; record with a logger that keeps up."
    )
    return [Repair("dropped", 0, sentence)]
