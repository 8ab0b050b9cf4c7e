"""Spectra of a series by segments, their coherence with another series, and the coherence that noise alone reaches.

Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70 (spectra by segments); Carter, Proc. IEEE 75 (1987) 236
(coherence, and its distribution for noise).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque

SEGMENT_LENGTH = 1.0  # s, length of a segment
PASSBAND_SHARE = 0.4  # of the first zero of the torque balance's filter: the highest frequency of use


@dataclass(frozen=True, eq=False)
class Spectra:
    """Fourier transforms (S, F) of S segments of a series, each under ``window``, and their ``frequency`` (F,), Hz;
    ``period`` s."""

    frequency: Array
    segments: NDArray[np.complex128]
    window: Array
    period: float

    @classmethod
    def from_series(cls, values: Array, period: float, segment: float = SEGMENT_LENGTH) -> Spectra:
        """Transform a series by segments that overlap by half, each without its mean and under Hann's window.

        Args:
            values: the series (K).
            period: sampling period, s.
            segment: length of a segment, s.

        Returns:
            The spectra.

        """
        rows = min(len(values), max(16, round(segment / period)))
        window = np.hanning(rows)
        parts = np.stack([values[b : b + rows] for b in range(0, len(values) - rows + 1, max(rows // 2, 1))])
        transformed = np.asarray(np.fft.rfft((parts - parts.mean(1, keepdims=True)) * window, axis=1))
        return cls(np.asarray(np.fft.rfftfreq(rows, period), float), transformed, window, period)

    @property
    def power(self) -> Array:
        """Mean square at each frequency (F)."""
        return np.asarray((np.abs(self.segments) ** 2).mean(0))

    @property
    def density(self) -> Array:
        """Amplitude spectral density (F), unit/√Hz."""
        return np.sqrt(2 * self.power * self.period / float(self.window @ self.window))

    def coherence(self, other: Spectra) -> Array:
        """Return the coherence (F), 0 to 1, with another series of the same rows.

        Args:
            other: its spectra.

        """
        cross = np.abs((self.segments * other.segments.conj()).mean(0)) ** 2
        both = self.power * other.power
        return np.divide(cross, both, out=np.zeros(len(both)), where=both > 0)

    @property
    def degrees_of_freedom(self) -> float:
        """Number of independent segments with the same information, less one."""
        return (len(self.segments) - 1) / 2

    def chance_probability(self, coherence: float) -> float:
        """Return the probability that noise alone has as much coherence at one frequency.

        Args:
            coherence: the coherence, 0 to 1.

        """
        return float((1.0 - coherence) ** self.degrees_of_freedom)


@dataclass(frozen=True)
class Band:
    """An octave from ``low`` to ``high``, Hz; ``share``: of a series' energy; ``coherence`` with another series there,
    weighted by that energy; ``p``: probability that noise alone has as much coherence in any of the octaves."""

    low: float
    high: float
    share: float
    coherence: float
    p: float


def find_loudest_band(of: Spectra, other: Spectra, passed: NDArray[np.bool_]) -> Band | None:
    """Find the octave in which a series has most energy.

    Args:
        of: spectra of the series.
        other: spectra of another series, for the coherence.
        passed: mask of the frequencies to use (F).

    Returns:
        The octave; None where there is no energy.

    """
    rows = np.flatnonzero(passed & (of.frequency > 0))
    power, coherence = of.power[rows], of.coherence(other)[rows]
    octave = np.floor(np.log2(np.maximum(rows, 1))).astype(int)  # from the first frequency above 0 on
    if not len(rows):
        return None
    energy = np.bincount(octave, power)
    if not energy.sum() > 0.0:
        return None
    best = int(np.argmax(energy))
    inside, step = octave == best, float(of.frequency[1])
    common = float(coherence[inside] @ power[inside] / energy[best])
    tried = int(np.count_nonzero(np.bincount(octave)))
    low, high = 2**best * step, min(2 ** (best + 1) * step, float(of.frequency[rows[-1]]))
    return Band(low, high, float(energy[best] / energy.sum()), common, min(1.0, tried * of.chance_probability(common)))


def compare_with_input(
    sight: ResidualTorque, joint: int, at: NDArray[np.bool_], *series: Array
) -> tuple[NDArray[np.bool_], list[Spectra]]:
    """Compare series with the input of a motor over frequency.

    Args:
        sight: the torque balance.
        joint: the joint.
        at: mask of the instants (K) of the series.
        series: the series, one value for each of these instants.

    Returns:
        A mask of the frequencies (F) that the balance's filter passes, and the spectra of the input and of each series.

    """
    first, last = np.flatnonzero(at)[[0, -1]]
    period, inputs = sight.motion.grid.period, sight.motion.grid.smooth(sight.balance.inputs(sight.after)[:, joint - 1])
    whole = [inputs, *(np.zeros(len(sight.motion.time)) for _ in series)]
    for full, values in zip(whole[1:], series, strict=True):
        full[at] = values
    found = [Spectra.from_series(values[first : last + 1], period) for values in whole]
    frequency = found[0].frequency
    return (frequency > 0) & (frequency <= PASSBAND_SHARE / (sight.motion.grid.window_rows * period)), found
