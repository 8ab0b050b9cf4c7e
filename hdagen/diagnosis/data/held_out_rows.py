"""The rows of each log that a gap is counted over, as diagnosis.json names them, and replays counted over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.diagnosis.data.split import LogPortion, Mask
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay


def name_rows(held: LogPortion, logs: Sequence[Log]) -> list[dict[str, Any]]:
    """Name the rows that a gap is counted over, as `data.hold_out` of diagnosis.json.

    Args:
        held: the counted rows of all ``logs``, which are joined in it.
        logs: in their order, each with its own time.

    Returns:
        For each log its path, the number of rows, and the first and last time, s, of each stretch of them.

    """
    ends = np.cumsum([len(log) for log in logs])
    each = [LogPortion(log, held.rows[end - len(log) : end]) for log, end in zip(logs, ends, strict=True)]
    named = []
    for one in each:
        spans = [list(span) for span in one.spans]
        named.append({"log": one.log.source, "rows": int(one.rows.sum()), "spans": spans})
    return named


def count_rows(found: Replay, log: Log, content: Mapping[str, Any], source: str) -> Replay:
    """Count a replay as a diagnosis counts it: over its rows and its channels, in its noise.

    Args:
        found: a replay of ``log``.
        log: one of the logs that the diagnosis held out of its fit, repaired as `hdagen.data_quality.log_repair` does.
        content: of the diagnosis.json.
        source: path of the diagnosis.json, for sentences.

    Returns:
        ``found`` with other errors and noise, and so with another gap, and with a note that says so.

    Raises:
        PlantError: the content does not say which rows, or holds no such log.
        LogError: the log has other rows or channels than the one of this name had.

    """
    try:
        entries = {str(one["log"]): (int(one["rows"]), one["spans"]) for one in content["data"]["hold_out"]}
        noise = {str(name): float(one["noise"]) for name, one in content["gap"]["by_channel"].items()}
        number, spans = entries[_find_entry(list(entries), log.source, source)]
        rows = _mark_rows(log, np.array(spans, float).reshape(-1, 2))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise PlantError(
            f"{source}: data.hold_out does not say which rows were held out; diagnose again with this version."
        ) from None
    if rows.sum() != number or not number:
        raise LogError(
            [
                f"{log.source}: {source} counts {number} row(s) of it, here are {rows.sum()} at their times: it is not "
                "the log that was held out; take that one, with the same columns.toml."
            ]
        )
    note = f"Errors and gap are counted over {number} of {len(log)} rows and in the noise that {source} states."
    counted = found.restrict_to_rows(log, rows, noise)
    return replace(counted, notes=(*counted.notes, note))


def _find_entry(known: Sequence[str], wanted: str, source: str) -> str:
    """The path among ``known`` that is the log ``wanted``, or the only one with its name. Raises PlantError."""
    if wanted in known:
        return wanted
    named = [one for one in known if Path(one).name == Path(wanted).name]
    if len(named) == 1:
        return named[0]
    verb = "are"
    if len(known) == 1:
        verb = "is"
    raise PlantError(f"{source}: counts no rows of {wanted}; possible {verb} {', '.join(known)}.")


def _mark_rows(log: Log, spans: np.ndarray) -> Mask:
    """The rows of ``log`` (T) at the times of ``spans`` (S, 2), ends included."""
    first, last = np.searchsorted(log.time, spans[:, 0]), np.searchsorted(log.time, spans[:, 1], side="right")
    change = np.zeros(len(log) + 1, int)
    np.add.at(change, first, 1)
    np.add.at(change, last, -1)
    return np.asarray(np.cumsum(change)[:-1] > 0)
