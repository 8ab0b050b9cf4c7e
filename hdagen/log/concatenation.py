"""Several logs of one machine, concatenated for a diagnosis that takes them together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log

PAUSE_BETWEEN_LOGS = 1.0  # s from the last row of a log to the first of the next: no window reaches over it
# Ratio of periods up to which logs are taken together: a window has half its usual rows at least
MOST_PERIOD_RATIO = 2.0


def concatenate_logs(logs: Sequence[Log]) -> Log:
    """Concatenate logs in time, with the channels that all of them have.

    Args:
        logs: One log or more, of one machine.

    Returns:
        The one log itself, or a new log in which a pause of `PAUSE_BETWEEN_LOGS` parts the recordings.

    Raises:
        LogError: The logs have different numbers of joints, or rates that differ by more than `MOST_PERIOD_RATIO`.

    """
    first = logs[0]
    if len(logs) == 1:
        return first
    problems = [
        f"{log.source}: {log.n_joints} joint(s) at {1 / log.period:.4g} Hz, {first.source} has {first.n_joints} at "
        f"{1 / first.period:.4g} Hz: diagnose logs of one machine and one rate together, others one by one."
        for log in logs[1:]
        if log.n_joints != first.n_joints or not 1 / MOST_PERIOD_RATIO < log.period / first.period < MOST_PERIOD_RATIO
    ]
    if problems:
        raise LogError(problems)
    common = set.intersection(*(set(log.columns) for log in logs))
    shared = [name for name in first.columns if name in common]
    left = sorted({name for log in logs for name in log.columns} - common)
    times, end = [], 0.0
    for log in logs:
        times.append(log.time - log.time[0] + end)
        end = float(times[-1][-1]) + PAUSE_BETWEEN_LOGS
    notes = [note for log in logs for note in log.notes]
    if left:
        notes.append(f"Not in every log, and left out: {', '.join(left)}.")
    columns = {}
    for name in shared:
        columns[name] = np.concatenate([log[name] for log in logs])
    source = ", ".join(log.source for log in logs)
    off = max(log.time_uncertainty for log in logs)
    return Log(
        np.concatenate(times), columns, first.n_joints, source, tuple(dict.fromkeys(notes)), time_uncertainty=off
    )
