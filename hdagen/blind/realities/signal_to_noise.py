"""How well a log shows what it has of an effect."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def measure_signal_to_noise(
    log: Mapping[str, np.ndarray], without: Mapping[str, np.ndarray], noise: Mapping[str, float]
) -> float:
    """Measure the change that effects make, rms, in multiples of the channel's noise.

    Args:
        log: columns by name.
        without: the same motion without the effects.
        noise: standard deviation of each channel that counts.

    Returns:
        The largest ratio of all channels.

    """
    return max(float(np.sqrt(np.mean((log[name] - without[name]) ** 2))) / sd for name, sd in noise.items())
