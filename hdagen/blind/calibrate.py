"""Calibration: how much of a diagnosis' log-odds to believe, fitted on seeds of its own, frozen in a file.

    hdagen blind --kind single --cases 200 --calibrate single.json
    hdagen blind --kind background --cases 200 --calibrate background.json
    python -m hdagen.blind.calibrate single.json background.json --out calibration.json

A temperature T divides log-odds: p_i becomes proportional to p_i^(1/T) (Guo et al., ICML 70 (2017) 1321). It is the one
that makes what happened most likely. The frozen file has the hashes of its seeds, with which no check may be made, and
its own hash.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.blind.run import replace
from hdagen.blind.score import Row

SCHEMA = 1
FROZEN = Path(__file__).parents[1] / "diagnosis" / "calibration.json"
_CLOSEST = 1e-6  # probabilities nearer to 0 or 1 count as this
_COLDEST, _HOTTEST = 0.05, 50.0  # temperatures that are tried
_LEAST = 30  # cases


class CalibrationError(Exception):
    """Calibration data or a frozen file that cannot be used; a sentence."""


@dataclass(frozen=True)
class Calibration:
    """``temperature`` of the log-odds; ``seeds``: hashes of those it was fitted on; ``cases``; mean logarithmic loss,
    nats, ``before`` and ``after``; ``digest`` of the file."""

    temperature: float
    seeds: tuple[str, ...]
    cases: int
    before: float
    after: float
    digest: str


def data(rows: Sequence[Row], kind: str, seed_hash: str) -> str:
    """The calibration data of a check, as JSON: log-odds of each first cause, and whether the verdict was right."""
    cases = []
    for row in rows:
        if not row.failed and row.verdict:
            p = min(max(row.p_top, _CLOSEST), 1.0 - _CLOSEST)
            cases.append({"log_odds": math.log(p / (1.0 - p)), "right": row.verdict == row.truth})
    return json.dumps({"schema": SCHEMA, "kind": kind, "seed_hash": seed_hash, "cases": cases}, indent=1)


def loss(log_odds: np.ndarray, right: np.ndarray, temperature: float) -> float:
    """Mean logarithmic loss, nats, of log-odds (cases,) divided by ``temperature`` against what was ``right``."""
    signed = np.where(right, log_odds, -log_odds) / temperature
    return float(np.mean(np.logaddexp(0.0, -signed)))


def fit(log_odds: np.ndarray, right: np.ndarray) -> float:
    """The temperature of least loss; the loss is convex in 1/T, so a golden section over it finds the only one."""
    low, high, golden = 1.0 / _HOTTEST, 1.0 / _COLDEST, (math.sqrt(5.0) - 1.0) / 2.0
    while high - low > 1e-7:
        left, far = high - golden * (high - low), low + golden * (high - low)
        if loss(log_odds, right, 1.0 / left) < loss(log_odds, right, 1.0 / far):
            high = far
        else:
            low = left
    return 2.0 / (low + high)


def freeze(sources: Sequence[Path], out: Path) -> Calibration:
    """Fit on the data of ``sources`` and write the frozen file. Raises CalibrationError, with every problem."""
    read_, problems = [_data(path) for path in sources], []
    log_odds = np.array([case["log_odds"] for one in read_ for case in one["cases"]], float)
    right = np.array([case["right"] for one in read_ for case in one["cases"]], bool)
    if len(right) < _LEAST:
        problems.append(f"{len(right)} cases are too few to calibrate on; {_LEAST} are the least, 200 are better.")
    elif right.all() or not right.any():
        every = "right" if right.all() else "wrong"
        problems.append(f"all {len(right)} cases are {every}: no temperature is best; add harder or easier cases.")
    if problems:
        raise CalibrationError("\n".join(problems))
    temperature = fit(log_odds, right)
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "temperature": temperature,
        "seeds": sorted({one["seed_hash"] for one in read_}),
        "cases": len(right),
        "loss_before": loss(log_odds, right, 1.0),
        "loss_after": loss(log_odds, right, temperature),
    }
    replace(out, json.dumps({**content, "sha256": _digest(content)}, indent=1) + "\n")
    return read(out)


def read(path: Path = FROZEN) -> Calibration:
    """A frozen file. Raises CalibrationError where it is not as it was written."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        stated = content.pop("sha256")
        good = content["schema"] == SCHEMA and stated == _digest(content)
    except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
        raise CalibrationError(f"{path}: cannot be read ({error}); freeze it again.") from None
    if not good:
        raise CalibrationError(f"{path}: is not as it was frozen; freeze it again.")
    return Calibration(
        content["temperature"],
        tuple(content["seeds"]),
        content["cases"],
        content["loss_before"],
        content["loss_after"],
        stated,
    )


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _data(path: Path) -> dict[str, Any]:
    """Calibration data, checked."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        good = content["schema"] == SCHEMA and len(content["seed_hash"]) == 64
        good = good and all(
            math.isfinite(case["log_odds"]) and type(case["right"]) is bool for case in content["cases"]
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CalibrationError(
            f"{path}: cannot be read as calibration data ({type(error).__name__}: {error})."
        ) from None
    if not good:
        raise CalibrationError(f"{path}: is no calibration data; `hdagen blind --calibrate` writes it.")
    return dict(content)


def main() -> int:
    """Freeze from the command line."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.calibrate", description="Freeze a calibration.")
    p.add_argument("data", nargs="+", type=Path, help="what `hdagen blind --calibrate` wrote")
    p.add_argument("--out", type=Path, default=FROZEN, help="the frozen file (default: the one that diagnose reads)")
    options = p.parse_args()
    try:
        found = freeze(options.data, options.out)
    except CalibrationError as error:
        print(error, file=sys.stderr)
        return 2
    print(
        f"temperature {found.temperature:.4g} from {found.cases} cases; logarithmic loss {found.before:.4g} to "
        f"{found.after:.4g} nats; {options.out}, SHA-256 {found.digest}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
