"""Random numbers that depend on a seed and a purpose alone, whatever else is drawn."""

from __future__ import annotations

import hashlib
import math

import numpy as np


def seeded_generator(seed: str, *purpose: object) -> np.random.Generator:
    """Make a random generator for one purpose.

    Args:
        seed: the seed of a check.
        purpose: words and numbers; each purpose has a sequence of its own.

    Returns:
        A generator that depends on ``seed`` and ``purpose`` alone.

    """
    return np.random.default_rng(int.from_bytes(purpose_digest(seed, *purpose), "big"))


def purpose_digest(seed: str, *purpose: object) -> bytes:
    """Hash a seed and a purpose; names made of the hash reveal neither.

    Args:
        seed: the seed of a check.
        purpose: words and numbers.

    Returns:
        SHA-256, 32 bytes.

    """
    return hashlib.sha256("\0".join([seed, *map(str, purpose)]).encode()).digest()


def draw_log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform.

    Args:
        rng: the random generator.
        low: the smallest number, above 0.
        high: the largest number.

    Returns:
        A number between ``low`` and ``high``, in their unit.

    """
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))
