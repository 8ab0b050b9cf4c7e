"""What a motion can tell: which effects would not show in it, and which it would not part from those that are named.

Both are asked of the linear model about the best hypothesis, before the measured values count: had the log held an
effect of its usual size, or what is named as large as it was found, which evidence would every effect have got? What
earns less than takes none out of doubt cannot be named from this log; what would fall behind the truth by little is
confounded with it.

Source: Chaloner, Verdinelli, Stat. Sci. 10 (1995) 273 (expected information of an experiment).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hdagen.diagnosis.decide import DOUBT, NONE
from hdagen.diagnosis.evidence import Posterior, gain, posterior
from hdagen.diagnosis.fitting import Fitted
from hdagen.plant import Array

CLOSE = float(np.log(100.0))  # of expected log evidence, by which what is less far apart counts as confounded


class Told:
    """What the motion of one fit tells of every effect@joint among its columns, at a temperature."""

    def __init__(self, fit: Fitted, temperature: float) -> None:
        """``fit`` with its columns. Nothing is free: all effects are within their tolerance."""
        at, words = fit.score.at, fit.design.words
        self.spike = words.spike
        self.at = posterior(fit.design.linear().reduced(at.s), self.spike, at.s, at.kappa2, None, temperature)
        self.information = np.linalg.inv(self.at.covariance) - np.diag(1.0 / self.spike**2)
        self.sizes = fit.posterior[0]
        self.columns: dict[str, list[int]] = {}
        for k, c in enumerate(words.columns):
            if c.atom >= 0:
                self.columns.setdefault(words.atoms[c.atom].name, []).append(k)

    def _evidence(self, name: str, seen: Posterior) -> float:
        return gain(seen, self.spike, np.array(self.columns[name]))

    def _of(self, places: Sequence[int], sizes: Array) -> Posterior:
        """The posterior of a log without noise in which ``places`` have these ``sizes``."""
        return replace(self.at, mean=self.at.covariance @ (self.information[:, places] @ sizes))

    def unseen(self) -> list[str]:
        """Effects that would not be named though they were there in their usual size, those that show least first."""
        needed = float(np.log(NONE / (1.0 - NONE) * len(self.columns) * (1.0 - DOUBT) / DOUBT))
        found = {
            name: float(np.mean([self._evidence(name, self._of([k], np.ones(1))) for k in places]))
            for name, places in self.columns.items()
        }
        return sorted((name for name in found if found[name] < needed), key=lambda name: (found[name], name))

    def beside(self, name: str) -> list[str]:
        """Effects that would be found nearly as probable, were ``name`` there as large as it was found, the nearest
        first."""
        places = self.columns[name]
        seen = self._of(places, self.sizes[places])
        true = self._evidence(name, seen)
        behind = {other: true - self._evidence(other, seen) for other in self.columns if other != name}
        return sorted((other for other in behind if behind[other] < CLOSE), key=lambda other: (behind[other], other))
