"""A search over long windows for effects that act all the time, where short windows leave something unknown or much.

A torque that no effect explains, as of a rough gear or a drive that does not follow its commands, comes and goes within
hundredths of a second. In short windows it hides effects that act all the time; over long ones it averages out. So
where something unknown leads, or a verdict leaves much of held-out motion, this search adds effects once more. It
simulates long windows without an unknown torque, and adds one effect after another, each time the one that lowers the
cost most. Then it drops those that lower next to nothing in parts of the log that they are not fitted to, and those
that short windows show neither large nor clearly. A set with another effect in the place of one of them shares the
probability.

`long_window_fit` states the cost of a set of effects, and `long_window_errors` the errors that it counts.

Legend: S sampled rows, M channels, C columns of the dictionary; θ (C) are the sizes of a model's effects.
Source: Ljung, System Identification (1999), 3.2 and 7.2 (simulation over a horizon as the error that is lowered).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence
from hdagen.diagnosis.decision.direct_evidence_settings import DIRECT_EVIDENCE
from hdagen.diagnosis.decision.effect_presence import keep_present_effects, measure_deviations
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.local_fit import Fit, start_fit_at
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.long_horizon_settings import LONG_HORIZON
from hdagen.diagnosis.long_window_errors import LongWindowErrors
from hdagen.diagnosis.long_window_fit import EffectModel, LongWindowFit
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.prediction.window_replay import REPLAY_WINDOW

FEWEST_WINDOWS = LONG_HORIZON.windows_of_part * DIRECT_EVIDENCE.folds


@dataclass(frozen=True, eq=False)
class LastingEffects:
    """The effects that long windows show.

    Attributes:
        costs: by the names of a set, the cost of each set and of no effect; the leading set first.
        fit: of the leading set in short windows, where long ones place it.
        undetectable: effects that long windows would not show in their usual size, effect@joint.

    """

    costs: Mapping[tuple[str, ...], float]
    fit: Fit
    undetectable: tuple[str, ...]

    def reweigh_decision(self, decision: Decision) -> Decision:
        """Give a decision of short windows the known effects of long ones.

        Args:
            decision: of short windows, with or without something unknown.

        Returns:
            The decision with the most probable known effects of long windows first; its verdict is as it was.

        """
        lead = self.costs[self.fit.names]
        weights = {names: float(np.exp(0.5 * (lead - cost))) for names, cost in self.costs.items() if names}
        unexplained = [h for h in decision.hypotheses if h.is_unknown]
        short = [h for h in decision.hypotheses if not h.is_unknown]
        # what short windows know, long ones do not bear out
        share = float(np.exp(0.5 * (lead - self.costs[()]))) / sum(h.probability for h in short)
        weights |= {h.names: share * h.probability for h in short if h.names not in weights}
        whole = (1.0 - sum(h.probability for h in unexplained)) / sum(weights.values())

        def own_fit(names: tuple[str, ...]) -> Fit | None:
            return self.fit if names == self.fit.names else None

        known = [Hypothesis(names, whole * w, own_fit(names)) for names, w in weights.items()]
        return replace(decision, hypotheses=(*known, *unexplained), best=self.fit, undetectable=self.undetectable)


def find_lasting_effects(
    found: SearchResult, arm: Arm, shown: LogPortion, window: float, alone: Sequence[DirectEvidence]
) -> LastingEffects | None:
    """Search long windows for known effects where short windows leave something unknown or much.

    Args:
        found: the search in short windows.
        arm: the model with every effect.
        shown: the rows (T,) of the log that were fitted.
        window: length of the short windows, s.
        alone: effects with direct evidence, which every model has.

    Returns:
        The effects; None if there are none, or too few windows.

    Raises:
        LogError: the log does not fit the model.

    Source: Ljung, System Identification (1999), 3.2 and 7.2 (simulation over a horizon as the error that is lowered).

    """
    long = cut_windows(arm, shown, max(REPLAY_WINDOW, window))
    if len(long.selected_windows) < FEWEST_WINDOWS:
        return None
    p, places = arm.p.copy(), list(arm.parameters.described)
    for name, value in (pair for one in alone for pair in one.parameters.items()):
        p[places.index(name)] = value
    sizes = LongWindowFit(LongWindowErrors(MultipleShooting(arm, long), p), found.candidates)
    seen = LongHorizonSearch(sizes)
    *sets, none = seen.find_effects()
    if not sets:
        return None
    # another fit may have springs
    fit_of_arm = next(fit for fit in found.fits if fit.sensitivities.shooting.arm is arm)
    leading_set, *rivals = sets
    while leading_set.atoms:
        model = sizes.limit_base_parameters(leading_set)
        fit = _fit_short_windows(sizes, model, fit_of_arm)
        open_sizes = _find_open_sizes(fit)
        absent = [k for k in leading_set.atoms if found.candidates.members[k].name in open_sizes]
        if not absent:
            costs = {found.candidates.names_of(one.atoms): one.cost for one in (leading_set, *rivals, none)}
            return LastingEffects(costs, fit, tuple(seen.find_undetectable(model)))
        leading_set, rivals = sizes.fit_model(sizes.drop_effect(leading_set, absent[0])), []
    return None


def _find_open_sizes(fit: Fit) -> tuple[str, ...]:
    """The effects that may as well be absent: too small to count as present, and of a size that is not known."""
    deviations, present = measure_deviations(fit), keep_present_effects(fit)
    return tuple(
        name for name in fit.names if name not in present and deviations[name] < HOLDOUT_CHECK.clear_deviations
    )


def _fit_short_windows(sizes: LongWindowFit, model: EffectModel, beside: Fit) -> Fit:
    """The fit of short windows where long ones place a model; it looks for the unexplained torque ``beside`` another
    fit's."""
    shooting, p = beside.sensitivities.shooting, sizes.parameters_at(model)
    start = OperatingPoint(p, shooting.filtered_initial_states(p))
    return start_fit_at(shooting, sizes.candidates, model.atoms, start, beside.score.posterior.s)


def list_settings_read() -> tuple[Any, ...]:
    """List the settings on which the search over long windows depends.

    Returns:
        Their values.

    """
    return (
        astuple(LONG_HORIZON),
        astuple(CANDIDATES),
        DIRECT_EVIDENCE.folds,
        HOLDOUT_CHECK.most_remaining_share,
        DATA.significant_noise_multiple,
    )


@dataclass(eq=False)
class LongHorizonSearch:
    """The search for the effects whose ``fit`` to long windows has the lowest cost."""

    fit: LongWindowFit
    extensions: dict[tuple[int, ...], list[EffectModel]] = field(
        init=False, default_factory=dict
    )  # further effects beside a set

    @property
    def least_gain(self) -> float:
        """By how much an effect must lower the cost."""
        return -2.0 * float(np.log(LONG_HORIZON.largest_error_ratio)) * self.fit.errors.window_count

    def find_effects(self) -> list[EffectModel]:
        """Find the set of effects of the lowest cost.

        Returns:
            That set, then the sets with another effect in the place of one of its, and last the model with no effect.

        """
        none = model = self.fit.fit_model(self.fit.evaluate_model((), np.zeros(len(self.fit.candidates.columns))))
        while len(model.atoms) < LONG_HORIZON.most_effects:
            further = self._extend_model(model)
            if not further or further[0].cost > model.cost - self.least_gain:
                break
            model = further[0]
        while (
            model.atoms
            and self.fit.errors.mean_squares(model.errors[None])[0][self.fit.errors.is_encoder].max()
            < HOLDOUT_CHECK.most_remaining_share**2
        ):
            whole, less = (
                self.fit.cross_validate(model),
                {k: self.fit.fit_model(self.fit.drop_effect(model, k)) for k in model.atoms},
            )
            gains = {k: self.fit.cross_validate(one) - whole for k, one in less.items()}
            doubtful = [k for k in model.atoms if gains[k] <= self.least_gain]
            if not doubtful:
                others = [one for k in model.atoms for one in self._list_alternatives(model, less[k])]
                return [model, *others, none]
            model = less[min(doubtful, key=lambda k: gains[k])]
        return [none]

    def _extend_model(self, model: EffectModel) -> list[EffectModel]:
        """Fitted models with one more effect, the most promising at one of their sizes; the best first."""
        key = tuple(sorted(model.atoms))
        if key not in self.extensions:
            self.extensions[key] = self._fit_promising(model)
        return self.extensions[key]

    def _fit_promising(self, model: EffectModel) -> list[EffectModel]:
        slopes = self.fit.differentiate_errors(model)
        best: dict[str, tuple[float, int, Array]] = {}
        for some in self._list_options(model, LONG_HORIZON.tried_sizes):
            sized = [((*model.atoms, k), model.theta + size) for k, size in some]
            settled = self.fit.predict_optima(
                model, slopes, self.fit.errors.simulate_errors([self.fit.place_sizes(*one) for one in sized])
            )
            for (atoms, theta), (step, errors) in zip(sized, settled, strict=True):
                promise = float(self.fit.compute_cost(atoms, errors[None], (theta + step)[None])[0])
                if promise < best.get(name := self.fit.candidates.members[atoms[-1]].name, (np.inf,))[0]:
                    best[name] = promise, atoms[-1], theta + step
        ranked = sorted(best.values(), key=lambda one: one[0])[: LONG_HORIZON.candidates_per_round]
        fitted = [self.fit.fit_model(self.fit.evaluate_model((*model.atoms, k), theta)) for _, k, theta in ranked]
        return sorted(fitted, key=lambda one: one.cost)

    def find_undetectable(self, model: EffectModel) -> list[str]:
        """Find effects that would not be found although they were present in their usual size.

        Args:
            model: whose errors remain beside them.

        Returns:
            Their names, effect@joint, those that show least first.

        """
        slopes = self.fit.differentiate_errors(model)
        lowered: dict[str, list[float]] = {}
        for some in self._list_options(model, (1.0,)):
            there = self.fit.errors.simulate_errors(
                [self.fit.place_sizes((*model.atoms, k), model.theta + size) for k, size in some]
            )
            lacking = 2.0 * model.errors - there  # what the model would err by, had the log that effect
            for (k, _), (step, errors) in zip(some, self.fit.predict_optima(model, slopes, lacking), strict=True):
                cost = float(self.fit.compute_cost(model.atoms, errors[None], (model.theta + step)[None])[0])
                lowered.setdefault(self.fit.candidates.members[k].name, []).append(cost - model.cost)
        shows = {name: float(np.mean(each)) for name, each in lowered.items()}
        return sorted((name for name in shows if shows[name] <= self.least_gain), key=lambda name: (shows[name], name))

    def _list_options(self, model: EffectModel, sizes: Sequence[float]) -> Iterator[list[tuple[int, Array]]]:
        """Atoms that a model can take, each with its θ (C) at some usual sizes, as many as run at once."""
        fits = [k for k in range(len(self.fit.candidates.members)) if self._is_distinct(model, k)]
        options = [(k, theta) for k in fits for theta in self._list_sizes(k, sizes)]
        return (
            options[k : k + LONG_HORIZON.rollouts_at_once]
            for k in range(0, len(options), LONG_HORIZON.rollouts_at_once)
        )

    def _is_distinct(self, model: EffectModel, k: int) -> bool:
        """Whether a model can take atom k beside its own."""
        new = self.fit.candidates.members[k].name not in self.fit.candidates.names_of(model.atoms)
        return new and self.fit.candidates.is_compatible(self.fit.errors.shooting.arm, k, model.atoms)

    def _list_sizes(self, k: int, sizes: Sequence[float]) -> Iterator[Array]:
        """θ (C) of atom k alone at some usual sizes, in all of its directions."""
        own = self.fit.candidates.amplitude_columns((k,))
        turns = 2 * np.pi * np.arange(LONG_HORIZON.tried_phases) / LONG_HORIZON.tried_phases
        two = np.column_stack([np.cos(turns), np.sin(turns)])
        for way in two if len(own) == 2 else np.vstack([np.eye(len(own)), -np.eye(len(own))]):
            for size in sizes:
                theta = np.zeros(len(self.fit.candidates.columns))
                theta[own] = size * way
                yield theta

    def _list_alternatives(self, model: EffectModel, less: EffectModel) -> list[EffectModel]:
        """Models with another effect in the place of the one that ``less`` lacks, the best first."""
        names = self.fit.candidates.names_of(model.atoms)
        return [one for one in self._extend_model(less) if self.fit.candidates.names_of(one.atoms) != names]
