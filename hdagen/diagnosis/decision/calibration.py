"""The calibration of a decision's odds: a temperature and a lapse, fitted on sealed simulated cases and frozen.

A model that is not true is too sure, whether it is right or wrong. So the odds of the leading hypothesis are raised to
the power 1/T. A search that misses an effect does not know of it, however sure it is. So the probability is multiplied
by 1 − λ, the lapse λ being at least the rate that so many cases could hide, had all been right. The other hypotheses
share the rest in proportion. The file has its own hash and those of its seeds, which no check may use.

Source: Guo et al., ICML 70 (2017) 1321 (temperature, for two classes); Wichmann, Hill, Percept. Psychophys. 63 (2001)
1293 (a curve that misses its lapses bends to them); Laplace, Essai philosophique sur les probabilités (1814) (rule of
succession).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.support.input_file import InputFileError, read_json

CALIBRATION_SCHEMA = 2
LARGEST_FILE_BYTES = 10_000_000  # bytes of a file
CALIBRATION_FILE = Path(__file__).with_name("calibration.json")


class CalibrationError(Exception):
    """Calibration data or a frozen file that cannot be used; its message says why and what to do."""


@dataclass(frozen=True)
class Calibration:
    """A calibration of the leading hypothesis' probability.

    ``temperature`` divides the log odds (1); ``lapse`` is the share of logs in which a search may miss something.
    ``seeds`` are hashes of the sealed cases that it was fitted on, ``cases`` their number. ``loss_before`` and
    ``loss_after`` are mean logarithmic losses in nats; ``digest`` is that of the file.
    """

    temperature: float
    lapse: float
    seeds: tuple[str, ...]
    cases: int
    loss_before: float
    loss_after: float
    digest: str

    def calibrate(self, leading: float) -> float:
        """Calibrate the probability of a leading hypothesis.

        Args:
            leading: its posterior probability (1).

        Returns:
            The calibrated one: at least a half where ``leading`` is above it, and ``leading`` itself elsewhere.

        """
        p = min(max(leading, DECISION.probability_margin), 1.0 - DECISION.probability_margin)
        if p <= 0.5:
            return leading
        tempered = 1.0 / (1.0 + math.exp(-math.log(p / (1.0 - p)) / self.temperature))
        return max((1.0 - self.lapse) * tempered, 0.5)


def read(path: Path = CALIBRATION_FILE) -> Calibration:
    """Read a frozen calibration.

    Args:
        path: of the file; by default the one that ships.

    Returns:
        The calibration.

    Raises:
        CalibrationError: the file cannot be read, or is not as it was written.

    """
    try:
        content = read_json(path, LARGEST_FILE_BYTES, "freeze it again")
        stated = content.pop("sha256")
        good = content["schema"] == CALIBRATION_SCHEMA and stated == compute_digest(content)
    except InputFileError as error:
        raise CalibrationError(str(error)) from None
    except (KeyError, AttributeError, TypeError) as error:
        raise CalibrationError(f"{path}: cannot be read ({error}); freeze it again.") from None
    if not good:
        raise CalibrationError(f"{path}: is not as it was frozen; freeze it again.")
    return Calibration(
        content["temperature"],
        content["lapse"],
        tuple(content["seeds"]),
        content["cases"],
        content["loss_before"],
        content["loss_after"],
        stated,
    )


def compute_digest(content: Mapping[str, Any]) -> str:
    """Compute the digest of a frozen file.

    Args:
        content: of the file, without the digest.

    Returns:
        The SHA-256 of its canonical JSON, in hexadecimal digits.

    """
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
