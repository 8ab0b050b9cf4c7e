"""Several logs prepared for one diagnosis: each is repaired, and motion that two of them share counts once.

A log that holds hardly anything but another one's recording is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_repair import Repair, repair_log
from hdagen.data_quality.log_repair_settings import LOG_REPAIR
from hdagen.data_quality.log_triage import Triage
from hdagen.data_quality.shared_motion import POSITION_CHANNELS, Mask, find_shared_motion, mask_unshared_rows
from hdagen.log.channel_statistics import compute_channel_statistics
from hdagen.log.column_map import split_column_name
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.support.row_runs import find_true_runs


def prepare_logs(
    arm: Arm, logs: Sequence[Log], hold_out: Sequence[Log]
) -> tuple[list[Log], list[Log], list[Mask], dict[str, Any]]:
    """Repair logs and hold-outs for a diagnosis, and describe them.

    Args:
        arm: The arm.
        logs: The logs to be fitted.
        hold_out: The logs to be held out.

    Returns:
        The repaired logs; the repaired hold-outs; for each of all these the rows (T) whose motion no earlier one
        holds; and a description of the data for a JSON file, with the channels of the first log.

    Raises:
        LogError: Logs are refused, or one holds hardly anything but another one's recording; all problems are listed.

    """
    problems: list[str] = []
    done: list[tuple[Log, list[Repair], Triage | None]] = []
    for one in (*logs, *hold_out):
        try:
            done.append(repair_log(one, arm))
        except LogError as error:
            problems += error.problems
            done.append((one, [], None))
    ready = [one for one, _, _ in done]
    fresh, shared, twice = _find_shared_recordings(ready, len(logs), [seen for _, _, seen in done])
    if twice or problems:
        raise LogError(twice + problems)
    seen = [one for _, _, one in done if one]
    repairs = [(one.source, [*own, *more]) for (one, own, _), more in zip(done, shared, strict=True)]
    said = _describe_data(arm, seen[: len(logs)], seen, repairs)
    return ready[: len(logs)], ready[len(logs) :], fresh, said


def _describe_data(
    arm: Arm, fitted: Sequence[Triage], seen: Sequence[Triage], repairs: Sequence[tuple[str, list[Repair]]]
) -> dict[str, Any]:
    """Describe the data for a JSON file: the triage of the ``fitted`` logs and of all, and the repairs by log."""
    of_first = fitted[0].to_json()
    keys = ("rows", "jitter", "clock", "dropped", "gaps", "lags", "missing", "channels")
    said = {name: of_first[name] for name in keys}
    said["skews"] = list(dict.fromkeys(f.sentence for one in fitted for f in one.findings if f.name == "skew"))
    said["warnings"] = list(dict.fromkeys(s for one in seen for s in one.warnings))
    said["noticed"] = list(dict.fromkeys(s for one in seen for s in one.notices))
    said["repaired"] = [
        {"log": source, "name": each.name, "joint": each.joint, "what": each.sentence}
        for source, done in repairs
        for each in done
    ]
    said["still"] = _find_still_joints(arm, fitted)
    said["refused"] = []  # a log that is refused ends in no diagnosis
    return said


def _find_shared_recordings(
    logs: Sequence[Log], fitted: int, seen: Sequence[Triage | None]
) -> tuple[list[Mask], list[list[Repair]], list[str]]:
    """Find the rows (T) of each log whose motion no earlier one holds.

    The first ``fitted`` logs are no hold-outs; a log that is refused has no triage. Returned too are the repairs of
    each log of which rows are left out, and the problems of those of which hardly anything is left.
    """
    noise: list[dict[str, float]] = [{} for _ in seen]
    for stated, one_seen in zip(noise, seen, strict=True):
        if one_seen:
            stated.update((channel.name, channel.noise) for channel in one_seen.channels)
    fresh, problems = [np.ones(len(log), bool) for log in logs], list[str]()
    said: list[list[Repair]] = [[] for _ in logs]
    for (i, one), (j, two) in combinations(enumerate(logs), 2):
        if not (shared := find_shared_motion(one, two, noise[i])):
            continue
        fresh[j] &= mask_unshared_rows(two, shared)
        where = f"from {shared[0].other[0]:.4g} s on as {one.source} has from {shared[0].one[0]:.4g} s on"
        if _is_long_motion(two, fresh[j]):
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


def _find_still_joints(arm: Arm, seen: Sequence[Triage]) -> list[int]:
    """The joints that no log moves, by any encoder."""
    moved = {split_column_name(c.name) for one in seen for c in one.channels if c.is_moving}
    return [j for j in range(1, arm.n + 1) if moved.isdisjoint((base, j) for base in POSITION_CHANNELS)]


def _is_long_motion(log: Log, rows: Mask) -> bool:
    """Whether ``rows`` (T) of a log are motion of some length."""
    lasts = sum(float(log.time[stop - 1] - log.time[start]) for start, stop in find_true_runs(rows))
    return lasts >= LOG_REPAIR.shortest_motion and any(
        compute_channel_statistics(name, values[rows]).is_moving
        for name, values in log.columns.items()
        if (split_column_name(name) or ("", 0))[0] in POSITION_CHANNELS
    )
