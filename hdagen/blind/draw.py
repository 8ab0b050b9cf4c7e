"""Random numbers that a seed and a purpose alone decide, whatever else is drawn."""

from __future__ import annotations

import hashlib
import math

import numpy as np


def stream(seed: str, *purpose: object) -> np.random.Generator:
    """A generator that ``seed`` and ``purpose`` alone decide."""
    return np.random.default_rng(int.from_bytes(digest(seed, *purpose), "big"))


def digest(seed: str, *purpose: object) -> bytes:
    """SHA-256 of ``seed`` and ``purpose``, of which names are made that say nothing."""
    return hashlib.sha256("\0".join([seed, *map(str, purpose)]).encode()).digest()


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is even between those of ``low`` and ``high``."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))
