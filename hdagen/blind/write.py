"""Cases written to disk with their labels beside them, for developing a diagnosis: not sealed, not a check."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hdagen.blind.cases import Case, Robot, cases, robots
from hdagen.blind.child import ask


def write(out: Path, kind: str, count: int, seed: str, jobs: int, said: Callable[[str], None]) -> Path:
    """``out``/``kind``/case-000 … with robot.toml, log.parquet and hold_out.parquet, and labels.json; returns its
    folder. Cases that are whole already are kept."""
    folder = out / kind
    folder.mkdir(parents=True, exist_ok=True)
    drawn, arms, labels = cases(seed, kind, count), robots(seed), {}

    def one(index: int) -> tuple[str, dict[str, object]]:
        name = f"case-{index:03d}"
        return name, _case(folder / name, seed, index, drawn[index], arms[drawn[index].robot])

    with ThreadPoolExecutor(jobs) as pool:
        for done, (name, label) in enumerate(pool.map(one, range(count)), 1):
            labels[name] = label
            said(f"{kind}: {done} of {count} cases")
            _replace(folder / "labels.json", json.dumps(labels, indent=1))
    return folder


def _case(folder: Path, seed: str, index: int, case: Case, robot: Robot) -> dict[str, object]:
    folder.mkdir(exist_ok=True)
    _replace(folder / "robot.toml", robot.toml())
    request = {"seed": seed, "kind": case.kind, "index": index}
    told = ask({**request, "motion": "log", "out": str(folder / "log.parquet")})
    ask({**request, "motion": "hold_out", "out": str(folder / "hold_out.parquet"), "truth": told["parameters"]})
    names = [str(one) for one in case.truth]
    return {
        "verdict": names,
        "snr": round(told["snr"], 1),
        "sizes": [round(one.size, 3) for one in case.truth],
        "background": case.background,
        "parameters": {name: told["parameters"][name] for name in names},
    }


def _replace(path: Path, text: str) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)
