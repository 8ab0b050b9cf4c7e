"""Identifiability: the effects that a motion would not show, and those that it would not separate from a verdict.

Both follow from the linear model about the best hypothesis, without the measured values. It gives the evidence that
each effect would gain if the log held an effect of its usual size, or a named effect as large as it was found. An
effect that would gain too little to exclude the hypothesis of no effect cannot be named from this log. An effect that
would gain nearly as much as the true one is confounded with it.

Source: Chaloner, Verdinelli, Stat. Sci. 10 (1995) 273 (expected information of an experiment).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.marginal_likelihood import Posterior, compute_evidence_gain, solve_at_scales
from hdagen.diagnosis.inference.sensitivities import Sensitivities

CONFUSABLE_EVIDENCE = float(np.log(DECISION.confusable_odds))  # difference of expected log evidence


class Identifiability:
    """Which of a fit's effects its motion can identify.

    ``columns`` has the places of each effect@joint among the fit's columns; ``motion`` is the knowledge that the motion
    gives of them.
    """

    def __init__(self, fit: Fit, temperature: float) -> None:
        """Prepare the linear model of a fit.

        Args:
            fit: with the columns of all effects.
            temperature: of the likelihood (1).

        """
        candidates = fit.sensitivities.candidates
        self.fit, self.temperature, self.spike, self.sizes = fit, temperature, candidates.spike_widths, fit.posterior[0]
        self.motion = self._measure_information(fit.sensitivities)
        self.columns: dict[str, list[int]] = {}
        for k, c in enumerate(candidates.columns):
            if c.candidate >= 0:
                self.columns.setdefault(candidates.members[c.candidate].name, []).append(k)

    def _measure_information(self, design: Sensitivities) -> tuple[Posterior, Array]:
        """The posterior of a design's columns with all effects in tolerance, and the log's information (P, P)."""
        at = self.fit.score.posterior
        known = solve_at_scales(
            design.linear_model().normal_equations(at.s), self.spike, at.s, at.kappa2, None, self.temperature
        )
        return known, np.asarray(np.linalg.inv(known.covariance) - np.diag(1.0 / self.spike**2), float)

    def _measure_gain(self, name: str, seen: Posterior) -> float:
        """Log evidence that an effect gains in a posterior."""
        return compute_evidence_gain(seen, self.spike, np.array(self.columns[name]))

    def find_undetectable(self) -> list[str]:
        """Find effects that would not be named although they were present in their usual size.

        An effect that shows little in a small step is tried at its whole size.

        Returns:
            Their names, effect@joint, those that show least first.

        """
        needed = float(
            np.log(
                DECISION.prior_no_effect
                / (1.0 - DECISION.prior_no_effect)
                * len(self.columns)
                * (1.0 - DECISION.no_effect_threshold)
                / DECISION.no_effect_threshold
            )
        )
        found = self._expect_evidence(self.columns, self.motion)
        quiet = [name for name in found if found[name] < needed]
        found |= self._expect_evidence(
            quiet,
            self._measure_information(
                self.fit.sensitivities.with_finite_step([k for n in quiet for k in self.columns[n]])
            ),
        )
        return sorted((name for name in found if found[name] < needed), key=lambda name: (found[name], name))

    def _expect_evidence(self, names: Iterable[str], motion: tuple[Posterior, Array]) -> dict[str, float]:
        """Log evidence that effects of their usual size would gain, the mean over their directions."""
        one = np.ones(1)
        gained = {}
        for name in names:
            directions = [self._measure_gain(name, _expect_posterior(motion, [k], one)) for k in self.columns[name]]
            gained[name] = float(np.mean(directions))
        return gained

    def find_confusable(self, name: str) -> list[str]:
        """Find effects that would be nearly as probable as one that is present as large as it was found.

        Args:
            name: the effect that is present, effect@joint.

        Returns:
            The names of the others, the nearest first.

        """
        places = self.columns[name]
        posterior = _expect_posterior(self.motion, places, self.sizes[places])
        true = self._measure_gain(name, posterior)
        behind = {other: true - self._measure_gain(other, posterior) for other in self.columns if other != name}
        return sorted(
            (other for other in behind if behind[other] < CONFUSABLE_EVIDENCE), key=lambda other: (behind[other], other)
        )


def _expect_posterior(motion: tuple[Posterior, Array], places: Sequence[int], sizes: Array) -> Posterior:
    """The posterior of a log without noise in which ``places`` have these ``sizes``."""
    known, information = motion
    return replace(known, mean=known.covariance @ (information[:, places] @ sizes))
