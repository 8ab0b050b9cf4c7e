"""Calibration: how far the odds of a diagnosis can be believed, fitted on seeds of its own and frozen in a file.

    hdagen blind --kind single --cases 200 --calibrate single.json
    hdagen blind --kind background --cases 200 --calibrate background.json
    python -m hdagen.blind.calibrate single.json background.json --out calibration.json

Temperature and lapse make the observed outcomes most likely; `hdagen.diagnosis.decision.calibration` applies them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.blind.scores import Row
from hdagen.diagnosis.decision.calibration import (
    CALIBRATION_FILE,
    CALIBRATION_SCHEMA,
    LARGEST_FILE_BYTES,
    Calibration,
    CalibrationError,
    compute_digest,
    read,
)
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json

_TRIED_TEMPERATURES = np.geomspace(
    1.0, 50.0, 400
)  # tried; from 1 on, as a few cases must not make a search surer than it is
_TRIED_LAPSES = 1000  # number of lapses tried with each temperature
DATA_SCHEMA = 1  # schema of the calibration data
_FEWEST_CASES = 30  # fewest cases


def render_calibration_data(rows: Sequence[Row], kind: str, seed_hash: str) -> str:
    """Render the calibration data of a check.

    Args:
        rows: the scored cases; failed ones are left out.
        kind: the kind of the check.
        seed_hash: hash of its seed, so that no later check counts on the same cases.

    Returns:
        JSON: of each case the log-odds of the leading hypothesis before calibration, and whether the verdict was right.

    """
    cases = []
    for row in rows:
        if not row.failed:
            p = min(max(row.p_stated, DECISION.probability_margin), 1.0 - DECISION.probability_margin)
            cases.append({"log_odds": math.log(p / (1.0 - p)), "right": row.is_right})
    return json.dumps({"schema": DATA_SCHEMA, "kind": kind, "seed_hash": seed_hash, "cases": cases}, indent=1)


def mean_log_loss(log_odds: np.ndarray, right: np.ndarray, temperature: float, lapse: float = 0.0) -> float:
    """Mean logarithmic loss, nats, of the outcomes ``right`` (cases,) under log-odds (cases,) that are divided by
    ``temperature`` and mixed with ``lapse``."""
    left = np.logaddexp(0.0, log_odds / temperature)  # -log of the chance that it is wrong
    hit = np.log1p(-lapse) + log_odds / temperature - left
    return -float(np.mean(np.where(right, hit, np.log(lapse + (1.0 - lapse) * np.exp(-left)))))


def fit_calibration(log_odds: np.ndarray, right: np.ndarray) -> tuple[float, float]:
    """Fit temperature and lapse of least loss. The least lapse tried is the one that n right cases leave, 1/(n + 2).
    The loss is convex in the lapse, so that a third of the remaining lapses can be left out at a time."""
    lapses = np.linspace(1.0 / (len(right) + 2), 0.5, _TRIED_LAPSES).tolist()

    def best(temperature: float) -> tuple[float, float, float]:
        low, high = 0, _TRIED_LAPSES - 1
        while high - low > 2:
            third = (high - low) // 3
            a, b = (mean_log_loss(log_odds, right, temperature, lapses[k]) for k in (low + third, high - third))
            if a <= b:
                high -= third
            else:
                low += third
        return min(
            (mean_log_loss(log_odds, right, temperature, lapse), temperature, lapse) for lapse in lapses[low : high + 1]
        )

    _, temperature, lapse = min(map(best, _TRIED_TEMPERATURES.tolist()))
    return temperature, lapse


def freeze_calibration(sources: Sequence[Path], out: Path) -> Calibration:
    """Fit a calibration and write its frozen file.

    Args:
        sources: files of calibration data.
        out: the frozen file.

    Returns:
        The calibration, read back from the file.

    Raises:
        CalibrationError: a file cannot be read, or the cases cannot be calibrated on; the message names every problem.

    """
    read_, problems = [_read_calibration_data(path) for path in sources], []
    log_odds = np.array([case["log_odds"] for one in read_ for case in one["cases"]], float)
    right = np.array([case["right"] for one in read_ for case in one["cases"]], bool)
    if len(right) < _FEWEST_CASES:
        problems.append(
            f"{len(right)} cases are too few to calibrate on; {_FEWEST_CASES} are the least, 200 are better."
        )
    elif right.all() or not right.any():
        every = "right" if right.all() else "wrong"
        problems.append(f"all {len(right)} cases are {every}: no temperature is best; add harder or easier cases.")
    if problems:
        raise CalibrationError("\n".join(problems))
    temperature, lapse = fit_calibration(log_odds, right)
    content: dict[str, Any] = {
        "schema": CALIBRATION_SCHEMA,
        "temperature": temperature,
        "lapse": lapse,
        "seeds": sorted({one["seed_hash"] for one in read_}),
        "cases": len(right),
        "loss_before": mean_log_loss(log_odds, right, 1.0),
        "loss_after": mean_log_loss(log_odds, right, temperature, lapse),
    }
    write_atomically(out, (json.dumps({**content, "sha256": compute_digest(content)}, indent=1) + "\n").encode())
    return read(out)


def _read_calibration_data(path: Path) -> dict[str, Any]:
    """Read and check calibration data."""
    try:
        content = read_json(path, LARGEST_FILE_BYTES, "`hdagen blind --calibrate` writes calibration data")
        good = content["schema"] == DATA_SCHEMA and len(content["seed_hash"]) == 64
        good = good and all(
            math.isfinite(case["log_odds"]) and type(case["right"]) is bool for case in content["cases"]
        )
    except InputFileError as error:
        raise CalibrationError(str(error)) from None
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        raise CalibrationError(
            f"{path}: cannot be read as calibration data ({type(error).__name__}: {error})."
        ) from None
    if not good:
        raise CalibrationError(f"{path}: is no calibration data; `hdagen blind --calibrate` writes it.")
    return dict(content)


def main() -> int:
    """Freeze a calibration from the command line."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.calibrate", description="Freeze a calibration.")
    p.add_argument("data", nargs="+", type=Path, help="what `hdagen blind --calibrate` wrote")
    p.add_argument(
        "--out", type=Path, default=CALIBRATION_FILE, help="the frozen file (default: the one that diagnose reads)"
    )
    options = p.parse_args()
    try:
        found = freeze_calibration(options.data, options.out)
    except CalibrationError as error:
        print(error, file=sys.stderr)
        return 2
    print(
        f"temperature {found.temperature:.4g} and lapse {found.lapse:.4g} from {found.cases} cases; logarithmic loss "
        f"{found.loss_before:.4g} to {found.loss_after:.4g} nats; {options.out}, SHA-256 {found.digest}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
