"""Spectra of a series by segments, their coherence with another one, and what noise alone reaches of that.

Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70 (spectra by segments); Carter, Proc. IEEE 75 (1987) 236
(coherence, and what noise alone reaches).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.diagnosis.missing import Sight
from hdagen.plant import Array

SEGMENT = 1.0  # s, of a spectrum
PASSED = 0.4  # of the balance's filter's first zero, up to which a spectrum says something


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier transforms (S, F) of S segments of a series, each under ``window``, and their ``frequency`` (F,), Hz;
    ``period`` s."""

    frequency: Array
    segments: NDArray[np.complex128]
    window: Array
    period: float

    @classmethod
    def of(cls, values: Array, period: float, segment: float = SEGMENT) -> Spectra:
        """By segments of ``segment`` s that overlap by half, each less its mean and under Hann's window."""
        rows = min(len(values), max(16, round(segment / period)))
        window = np.hanning(rows)
        parts = np.stack([values[b : b + rows] for b in range(0, len(values) - rows + 1, max(rows // 2, 1))])
        transformed = np.asarray(np.fft.rfft((parts - parts.mean(1, keepdims=True)) * window, axis=1))
        return cls(np.asarray(np.fft.rfftfreq(rows, period), float), transformed, window, period)

    @property
    def power(self) -> Array:
        """Mean square of each frequency (F,)."""
        return np.asarray((np.abs(self.segments) ** 2).mean(0))

    @property
    def density(self) -> Array:
        """(F,), unit/√Hz."""
        return np.sqrt(2 * self.power * self.period / float(self.window @ self.window))

    def coherence(self, other: Spectra) -> Array:
        """(F,) with another series of the same rows, in [0, 1]."""
        cross = np.abs((self.segments * other.segments.conj()).mean(0)) ** 2
        both = self.power * other.power
        return np.divide(cross, both, out=np.zeros(len(both)), where=both > 0)

    @property
    def free(self) -> float:
        """How many segments that do not overlap would tell as much, less one."""
        return (len(self.segments) - 1) / 2

    def chance(self, coherence: float) -> float:
        """That noise alone has so much of it at one frequency."""
        return float((1.0 - coherence) ** self.free)


@dataclass(frozen=True)
class Band:
    """An octave from ``low`` to ``high``, Hz, with its ``share`` of a series' energy, the ``coherence`` with another
    one there, weighed by that energy, and how likely noise alone has so much in any of the octaves."""

    low: float
    high: float
    share: float
    coherence: float
    p: float


def loudest(of: Spectra, other: Spectra, passed: NDArray[np.bool_]) -> Band | None:
    """The octave of the frequencies ``passed`` (F,) in which a series has most energy; None where there is none."""
    rows = np.flatnonzero(passed & (of.frequency > 0))
    power, coherence = of.power[rows], of.coherence(other)[rows]
    octave = np.floor(np.log2(np.maximum(rows, 1))).astype(int)  # from the first frequency above 0 on
    energy = np.bincount(octave, power) if len(rows) else np.zeros(1)
    if not energy.sum() > 0.0:
        return None
    best = int(np.argmax(energy))
    inside, step = octave == best, float(of.frequency[1])
    common = float(coherence[inside] @ power[inside] / energy[best])
    tried = int(np.count_nonzero(np.bincount(octave)))
    low, high = 2**best * step, min(2 ** (best + 1) * step, float(of.frequency[rows[-1]]))
    return Band(low, high, float(energy[best] / energy.sum()), common, min(1.0, tried * of.chance(common)))


def beside_input(
    sight: Sight, joint: int, at: NDArray[np.bool_], *series: Array
) -> tuple[NDArray[np.bool_], list[Spectra]]:
    """Which frequencies (F,) the balance's filter passes, and the spectra of the motor's input and of each of the
    ``series``, which are of the instants ``at``."""
    first, last = np.flatnonzero(at)[[0, -1]]
    period, inputs = sight.grid.period, sight.grid.smooth(sight.inputs(sight.after)[:, joint - 1])
    whole = [inputs, *(np.zeros(len(sight.time)) for _ in series)]
    for full, values in zip(whole[1:], series, strict=True):
        full[at] = values
    found = [Spectra.of(values[first : last + 1], period) for values in whole]
    frequency = found[0].frequency
    return (frequency > 0) & (frequency <= PASSED / (sight.grid.width * period)), found
