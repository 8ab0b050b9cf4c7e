"""Repair: a log made fit for a diagnosis where its own numbers say what is wrong, or refused in sentences.

What triage finds and can name as lines of a columns.toml is done (degrees, milliamperes, wrapped encoders, a measured
input logged in the wrong row); rows without a value, or with a current that no drive gives, are taken out; dropped rows
stay gaps, at which `segments` cuts; what two logs share counts once. Everything else that would mislead a diagnosis is
refused with what to record, and so is a log that holds hardly anything but another one's recording. A time skew is no
mistake but a finding: the diagnosis has it among its candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from hdagen import columns_toml
from hdagen.channels import describe
from hdagen.columns import split_name
from hdagen.log import Log, LogError, gaps, parts
from hdagen.plant import Arm
from hdagen.shared_motion import POSITIONS, Mask, fresh_rows, shared_motion
from hdagen.stretches import stretches
from hdagen.suspicion import against_model, drift
from hdagen.suspicion.finding import Finding, Severity, in_words
from hdagen.suspicion.misread import misread
from hdagen.table import Table
from hdagen.triage import Triage, look

SHORTEST = 1.0  # s
_MENDED = ("degrees", "milliamperes", "wrapped", "row_shift")  # findings whose repair leaves no choice
_CONTRADICTED = "contradicted"  # a finding that is no more than a warning, and is repaired too
_ROUNDS = 4  # one mistake can hide another
_EMPTY = 0.5  # share of a column without a value from which the column is left out, not the rows
_LOST = 0.1  # share of rows that may be missing
_GAP = 0.01  # s without a row, over which a command cannot be taken as held
_PERIODS = 3.5  # and at least as many periods
_NEEDED = (
    ("motor_current_command", "motor_current", "motor_torque_command", "motor_torque"),
    POSITIONS,
)


@dataclass(frozen=True)
class Repair:
    """One thing done to a log: a stable name, the joint (0: the whole log), and a sentence that says what was wrong,
    what was done, and how to record it right."""

    name: str
    joint: int
    sentence: str


def repair(log: Log, arm: Arm) -> tuple[Log, list[Repair], Triage]:
    """``log`` as a diagnosis with ``arm`` can use it, what was done, which the log's notes say too, and the triage of
    what it is then.

    ``log`` may hold NaN where a value is missing. Raises LogError with everything that no one but its owner can mend.
    """
    log, repairs = _without_holes(log)
    log, misread_ = _without_misread(log, arm)
    repairs += misread_
    problems = _joints(log, arm)
    if problems:
        raise LogError(problems)
    for _ in range(_ROUNDS):
        seen = look(log, arm.robot)
        findings = _suspicions(log, arm, seen)
        mended = _mendable(findings)
        if not mended:
            break
        log = _applied(log, mended)
        repairs += _said(mended)
    else:
        seen = look(log, arm.robot)
    problems = [f"{log.source}: {f.sentence}" for f in findings if f.severity is Severity.REFUSE]
    problems += _too_little(log, seen)
    if problems:
        raise LogError(list(dict.fromkeys(problems)))
    log, drifting = _on_one_clock(log, arm)
    repairs += drifting + _gaps(log)
    notes = (*log.notes, *(one.sentence for one in repairs))
    return replace(log, notes=tuple(dict.fromkeys(notes))), repairs, seen


def as_measured(log: Log, arm: Arm) -> tuple[Log, list[Repair]]:
    """``log`` as a replay with ``arm`` can use it, and what was done: without channels that contradict another one, or
    with those scaled where the factor is plain, and with the encoders of each joint on one clock."""
    repairs: list[Repair] = []
    if any("_velocity_" in name for name in log.columns):
        found = [finding for finding in look(log, arm.robot).findings if finding.name == _CONTRADICTED]
        log, repairs = (_applied(log, found), _said(found)) if found else (log, [])
    log, drifting = _on_one_clock(log, arm)
    return log, repairs + drifting


def _on_one_clock(log: Log, arm: Arm) -> tuple[Log, list[Repair]]:
    """The log with what a joint's own encoder reads brought to its motor's clock, where the two drift apart."""
    repairs = []
    ratios = [joint["drive"]["ratio"]["nominal"] for joint in arm.robot["joints"]]
    for joint, rate in drift.drifts(log, ratios).items():
        log = drift.on_motor_clock(log, joint, rate)
        over = 1e3 * abs(rate) * float(np.ptp(log.time))
        ever = "ever later" if rate > 0 else "ever earlier"
        sentence = (
            f"joint_position_{joint} is read {ever} than motor_position_{joint}, by {over:.3g} ms over the log: two "
            f"clocks, {1e6 * abs(rate):.3g} ppm apart. Read here on the motor's; record both on one clock."
        )
        repairs.append(Repair("drift", joint, sentence))
    return log, repairs


def prepared(
    arm: Arm, logs: Sequence[Log], hold_out: Sequence[Log]
) -> tuple[list[Log], list[Log], list[Mask], dict[str, Any]]:
    """The logs and hold-outs, each repaired for a diagnosis with ``arm``; of each the rows (T) whose motion no earlier
    one holds; and what to say of the data, for a JSON file: of the channels, that is what the first log has.

    Raises LogError with the problems of all, and where one of them holds hardly anything but another one's recording.
    """
    problems: list[str] = []
    done: list[tuple[Log, list[Repair], Triage | None]] = []
    for one in (*logs, *hold_out):
        try:
            done.append(repair(one, arm))
        except LogError as error:
            problems += error.problems
            done.append((one, [], None))
    ready = [one for one, _, _ in done]
    fresh, shared, twice = _fresh(ready, len(logs), [seen for _, _, seen in done])
    if twice or problems:
        raise LogError(twice + problems)
    seen = [one for _, _, one in done if one]
    of_first = seen[0].data()
    said = {
        name: of_first[name] for name in ("rows", "jitter", "clock", "dropped", "gaps", "lags", "missing", "channels")
    }
    said["skews"] = list(
        dict.fromkeys(f.sentence for one in seen[: len(logs)] for f in one.findings if f.name == "skew")
    )
    said["warnings"] = list(dict.fromkeys(s for one in seen for s in one.warnings))
    said["noticed"] = list(dict.fromkeys(s for one in seen for s in one.noticed))
    said["repaired"] = [
        {"log": one.source, "name": each.name, "joint": each.joint, "what": each.sentence}
        for (one, repairs, _), more in zip(done, shared, strict=True)
        for each in (*repairs, *more)
    ]
    said["still"] = _still_joints(arm, [one for _, _, one in done[: len(logs)] if one])
    said["refused"] = []  # a log that is refused ends in no diagnosis
    return ready[: len(logs)], ready[len(logs) :], fresh, said


def _fresh(
    logs: Sequence[Log], fitted: int, seen: Sequence[Triage | None]
) -> tuple[list[Mask], list[list[Repair]], list[str]]:
    """Of each log, the first ``fitted`` of which are no hold-outs, the rows (T) whose motion no earlier one holds, what
    to say where that is not all, and what is wrong where hardly anything is left. A log that is refused has no
    triage."""
    noise = [{channel.name: channel.noise for channel in one.channels} if one else {} for one in seen]
    fresh, problems = [np.ones(len(log), bool) for log in logs], list[str]()
    said: list[list[Repair]] = [[] for _ in logs]
    for (i, one), (j, two) in combinations(enumerate(logs), 2):
        if not (shared := shared_motion(one, two, noise[i])):
            continue
        fresh[j] &= fresh_rows(two, shared)
        where = f"from {shared[0].other[0]:.4g} s on as {one.source} has from {shared[0].one[0]:.4g} s on"
        if _useful(two, fresh[j]):
            lasts = sum(span.other[1] - span.other[0] for span in shared)
            sentence = f"{two.source}: {lasts:.3g} s are the same motion, {where}: these rows count once, there."
            said[j].append(Repair("shared", 0, sentence))
        elif i < fitted <= j:
            problems.append(
                f"{two.source}: the hold-out is the log itself or a part of it, with the same motion {where}: give "
                "another motion."
            )
        else:
            problems.append(f"{two.source}: the same motion {where}; leave one of them out.")
    return fresh, said, problems


def _still_joints(arm: Arm, seen: Sequence[Triage]) -> list[int]:
    """The joints that no log moves, by any encoder."""
    moved = {split_name(c.name) for one in seen for c in one.channels if c.moves}
    return [j for j in range(1, arm.n + 1) if not any((base, j) in moved for base in POSITIONS)]


def _useful(log: Log, rows: Mask) -> bool:
    """Whether ``rows`` (T) of a log are motion of some length."""
    lasts = sum(float(log.time[stop - 1] - log.time[start]) for start, stop in stretches(rows))
    return lasts >= SHORTEST and any(
        describe(name, values[rows]).moves
        for name, values in log.columns.items()
        if (split_name(name) or ("", 0))[0] in POSITIONS
    )


def segments(time: np.ndarray) -> list[tuple[int, int]]:
    """Rows [start, stop) between the long gaps of ``time`` (T,), s: no window of a replay may reach over one.

    Long is above 10 ms and 3.5 periods: a command is taken as held over less.
    """
    steps = np.diff(time)
    longest = max(_GAP, _PERIODS * float(np.median(steps))) if len(steps) else _GAP
    return parts(time, longest)


def _joints(log: Log, arm: Arm) -> list[str]:
    """Whether the log is of as many joints as the arm, each with an input and a position."""
    if log.n_joints != arm.n:
        return [
            f"{log.source}: the log has {log.n_joints} joint(s), {arm.robot['name']} has {arm.n}: the robot file of "
            "another robot; name this one's, or take the joints wanted with a columns.toml."
        ]
    return [
        f"{log.source}: joint {j} has none of {', '.join(f'{base}_{j}' for base in bases)}; record one of them."
        for j in range(1, arm.n + 1)
        for bases in _NEEDED
        if not any(f"{base}_{j}" in log for base in bases)
    ]


def _suspicions(log: Log, arm: Arm, seen: Triage) -> list[Finding]:
    """What triage finds; where that is nothing to refuse, what the robot's model finds."""
    findings = list(seen.findings)
    if any(f.severity is Severity.REFUSE for f in findings):
        return findings
    findings += against_model.driven(log, arm) + against_model.exchanged(log, arm)
    if any(f.severity is Severity.REFUSE for f in findings):
        return findings
    return findings + against_model.scale(log, arm)


def _mendable(findings: list[Finding]) -> list[Finding]:
    """The findings whose repair leaves no choice, one a column: several things can tell the same mistake."""
    found: dict[str, Finding] = {}
    for finding in findings:
        refused = finding.severity is Severity.REFUSE and finding.name in _MENDED
        if finding.repair and (refused or finding.name == _CONTRADICTED):
            for column in finding.repair:
                found.setdefault(column if column != "ignore" else finding.sentence, finding)
    return list(dict.fromkeys(found.values()))


def _said(mended: list[Finding]) -> list[Repair]:
    """What was done to mend them."""
    return [Repair(f.name, f.joint, f"{f.sentence} Read here with {in_words(f.repair)}.") for f in mended]


def _applied(log: Log, mended: list[Finding]) -> Log:
    """The log with the tables of all findings, as a columns.toml that held them would read it."""
    tables: dict[str, Any] = {}
    for finding in mended:
        for column, table in finding.repair.items():
            if column == "ignore":
                tables.setdefault("ignore", []).extend(table)
            else:
                tables.setdefault(column, {}).update(table)
    mapping = columns_toml.check(tables, Path("columns.toml"))
    mapped = mapping.apply(Table({"time": log.time, **log.columns}, ("time", *log.columns), None, ()))
    whole = replace(log, columns=mapped.columns).rows(mapped.start, mapped.stop)
    return replace(whole, columns={name: np.ascontiguousarray(values) for name, values in whole.columns.items()})


def _without_holes(log: Log) -> tuple[Log, list[Repair]]:
    """The log without columns that are mostly empty and without rows in which another has no value."""
    missing = {name: ~np.isfinite(values) for name, values in log.columns.items()}
    empty = [name for name, rows in missing.items() if np.mean(rows) > _EMPTY]
    repairs = []
    for name in empty:
        share, joint = 100 * np.mean(missing[name]), (split_name(name) or (name, 0))[1]
        sentence = f"{name} has no value in {share:.3g} % of the rows: left out; record it, or leave it out of the log."
        repairs.append(Repair("missing", joint, sentence))
    columns = {name: values for name, values in log.columns.items() if name not in empty}
    bad = np.zeros(len(log), bool)
    for name in columns:
        bad |= missing[name]
    if not bad.any():
        return (replace(log, columns=columns) if empty else log), repairs
    first, after = stretches(bad).T
    lengths = after - first
    where = ", ".join(name for name in columns if missing[name].any())
    says = (
        f"{where}: no value in {bad.sum()} row(s), {100 * np.mean(bad):.2g} % of the log, in {len(lengths)} run(s), "
        f"the longest of {lengths.max()} row(s), first in row {first[0] + 1} ({log.time[first[0]]:.6g} s)"
    )
    if np.mean(bad) > _LOST or np.count_nonzero(~bad) < 2:
        raise LogError([f"{log.source}: {says}: too many; record with a logger that keeps up, or cut the log there."])
    sentence = f"{says}: these rows are taken out, and long runs cut the log; record with a logger that keeps up."
    repairs.append(Repair("missing", 0, sentence))
    return replace(log, columns=columns).taken(~bad), repairs


def _without_misread(log: Log, arm: Arm) -> tuple[Log, list[Repair]]:
    """The log without rows that were misread: as good as without a value."""
    found = list(misread(log, [joint["drive"]["max_current"] for joint in arm.robot["joints"]]))
    bad = np.any([one.rows for one in found], axis=0)
    if not found:
        return log, []
    if np.mean(bad) > _LOST:
        raise LogError(
            [f"{log.source}: {one.sentence}: too many; record each channel at the rate it is read at." for one in found]
        )
    taken = "these rows are taken out; look at what the logger wrote there."
    repairs = [Repair(one.name, one.joint, f"{one.sentence}: {taken}") for one in found]
    return log.taken(~bad), repairs


def _too_little(log: Log, seen: Triage) -> list[str]:
    """Why a log is refused that is too short, moves no joint, or has lost too much."""
    problems = []
    lasts = sum(float(log.time[stop - 1] - log.time[start]) for start, stop in segments(log.time))
    if lasts < SHORTEST:
        problems.append(
            f"{log.source}: the log lasts {lasts:.3g} s without its gaps, shorter than {SHORTEST:g} s: record at least "
            "10 s of motion with reversals, slow and fast."
        )
    if not any(c.moves for c in seen.channels if (split_name(c.name) or ("", 0))[0] in _NEEDED[1]):
        problems.append(
            f"{log.source}: no joint moves, so what is missing cannot be told: at rest the others make up for any "
            "one effect; record a motion of every joint, with reversals, as hdagen excite designs one."
        )
    share = seen.dropped / (seen.rows + seen.dropped)
    if share > _LOST:
        problems.append(
            f"{log.source}: {100 * share:.2g} % of the rows are missing; record with a logger that keeps up, or at a "
            "lower rate."
        )
    return problems


def _gaps(log: Log) -> list[Repair]:
    """Dropped rows, said."""
    rows, missing = gaps(log.time)
    lost = int(missing.sum())
    share = lost / (len(log) + lost)
    if not lost:
        return []
    pieces = len(segments(log.time))
    cut = f" and the log is cut into {pieces} parts at the long ones" if pieces > 1 else ""
    sentence = (
        f"{lost} row(s) are missing in {len(rows)} gap(s), {100 * share:.2g} % of the log: they stay gaps over which "
        f"commands are held{cut}; record with a logger that keeps up."
    )
    return [Repair("dropped", 0, sentence)]
