"""What a motion can tell: which effects would not show in it, and which it would not part from those that are named.

Both are asked of the linear model about the best hypothesis, before the measured values count: had the log held an
effect of its usual size, or what is named as large as it was found, which evidence would every effect have got? What
earns less than takes none out of doubt cannot be named from this log; what would fall behind the truth by little is
confounded with it.

Source: Chaloner, Verdinelli, Stat. Sci. 10 (1995) 273 (expected information of an experiment).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from hdagen.diagnosis.decide import DOUBT, NONE
from hdagen.diagnosis.design import Design
from hdagen.diagnosis.evidence import Posterior, gain, posterior
from hdagen.diagnosis.fitting import Fitted
from hdagen.plant import Array

CLOSE = float(np.log(100.0))  # of expected log evidence, by which what is less far apart counts as confounded


class Told:
    """What the motion of one fit tells of every effect@joint among its columns, at a temperature."""

    def __init__(self, fit: Fitted, temperature: float) -> None:
        """``fit`` with its columns. Nothing is free: all effects are within their tolerance."""
        words = fit.design.words
        self.fit, self.temperature, self.spike, self.sizes = fit, temperature, words.spike, fit.posterior[0]
        self.motion = self._motion(fit.design)
        self.columns: dict[str, list[int]] = {}
        for k, c in enumerate(words.columns):
            if c.atom >= 0:
                self.columns.setdefault(words.atoms[c.atom].name, []).append(k)

    def _motion(self, design: Design) -> tuple[Posterior, Array]:
        """What is known in the columns of a design, and the part of it (P, P) that the log tells."""
        at = self.fit.score.at
        known = posterior(design.linear().reduced(at.s), self.spike, at.s, at.kappa2, None, self.temperature)
        return known, np.asarray(np.linalg.inv(known.covariance) - np.diag(1.0 / self.spike**2), float)

    def _evidence(self, name: str, seen: Posterior) -> float:
        return gain(seen, self.spike, np.array(self.columns[name]))

    def unseen(self) -> list[str]:
        """Effects that would not be named though they were there in their usual size, those that show least first; of
        those that a small step shows as little of, the whole size is tried."""
        needed = float(np.log(NONE / (1.0 - NONE) * len(self.columns) * (1.0 - DOUBT) / DOUBT))
        found = self._shown(self.columns, self.motion)
        quiet = [name for name in found if found[name] < needed]
        found |= self._shown(quiet, self._motion(self.fit.design.widened([k for n in quiet for k in self.columns[n]])))
        return sorted((name for name in found if found[name] < needed), key=lambda name: (found[name], name))

    def _shown(self, names: Iterable[str], motion: tuple[Posterior, Array]) -> dict[str, float]:
        """Evidence that effects would get, were they there in their usual size, the mean of its directions."""
        one = np.ones(1)
        return {n: float(np.mean([self._evidence(n, _of(motion, [k], one)) for k in self.columns[n]])) for n in names}

    def beside(self, name: str) -> list[str]:
        """Effects that would be found nearly as probable, were ``name`` there as large as it was found, the nearest
        first."""
        places = self.columns[name]
        seen = _of(self.motion, places, self.sizes[places])
        true = self._evidence(name, seen)
        behind = {other: true - self._evidence(other, seen) for other in self.columns if other != name}
        return sorted((other for other in behind if behind[other] < CLOSE), key=lambda other: (behind[other], other))


def _of(motion: tuple[Posterior, Array], places: Sequence[int], sizes: Array) -> Posterior:
    """The posterior of a log without noise in which ``places`` have these ``sizes``."""
    known, information = motion
    return replace(known, mean=known.covariance @ (information[:, places] @ sizes))
