"""Cases written to disk beside their labels, for developing a diagnosis: they are not sealed and no check."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hdagen.blind.realities.cases import Case, draw_cases
from hdagen.blind.subprocesses import request_log
from hdagen.support.atomic_write import write_atomically


def export_cases(
    out: Path, kind: str, count: int, seed: str, jobs: int, seconds: float, said: Callable[[str], None]
) -> Path:
    """Write cases with their logs and labels.

    Args:
        out: folder of all kinds.
        kind: one of `hdagen.blind.KINDS`.
        count: how many cases.
        seed: the seed that the cases are drawn from.
        jobs: how many cases are made at the same time.
        seconds: length of each log, s.
        said: called with a sentence about the progress.

    Returns:
        The folder ``out``/``kind``: case-000 … with robot.toml, log.parquet and hold_out.parquet, and labels.json.

    Raises:
        ChildError: a case could not be simulated.

    """
    folder = out / kind
    folder.mkdir(parents=True, exist_ok=True)
    drawn, stop = draw_cases(seed, kind, count), threading.Event()
    labels: dict[str, dict[str, object]] = {}

    def one(index: int) -> tuple[str, dict[str, object]]:
        name = f"case-{index:03d}"
        return name, _export_case(folder / name, seed, index, drawn[index], seconds, stop)

    pool = ThreadPoolExecutor(jobs)
    try:
        for done, (name, label) in enumerate(pool.map(one, range(count)), 1):
            labels[name] = label
            said(f"{kind}: {done} of {count} cases")
            write_atomically(folder / "labels.json", json.dumps(labels, indent=1).encode())
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)
    return folder


def _export_case(
    folder: Path, seed: str, index: int, case: Case, seconds: float, stop: threading.Event
) -> dict[str, object]:
    folder.mkdir(exist_ok=True)
    write_atomically(folder / "robot.toml", case.robot.toml().encode())
    request = {"seed": seed, "kind": case.kind, "index": index, "seconds": seconds}
    told = request_log({**request, "motion": "log", "out": str(folder / "log.parquet")}, folder, stop)
    request_log(
        {**request, "motion": "hold_out", "out": str(folder / "hold_out.parquet"), "truth": told["parameters"]},
        folder,
        stop,
    )
    label = case.label()
    names = (*label["verdict"], *label.get("optional", []))
    return {**label, "snr": told["snr"], "parameters": {name: told["parameters"][name] for name in names}}
