"""A search over long windows for effects that act all the time, where short windows leave something unknown.

A torque that no effect explains, as of a rough gear or a drive that does not follow its commands, comes and goes within
hundredths of a second. In short windows it hides effects that act all the time; over long ones it averages out. So
where something unknown leads, this search adds effects once more. It simulates long windows without an unknown torque,
and adds one effect after another, each time the one that lowers the cost most. Then it drops those that lower next to
nothing in parts of the log that they are not fitted to. A set with another effect in the place of one of them shares
the probability.

An error that has begun goes on, so each window counts as one observation of a channel, whatever its rows. The cost is

    W Σ_i log e_i² + Σ (θ / v)²,

e_i being the root mean square error of channel i, the encoders of a joint as one, over that of the model without any
effect. θ are the sizes of the named effects, in usual ones (v = 1), and those of the base parameters, in which v is
their tolerance.

Legend: W windows, S sampled rows, M channels, I of them with a joint's encoders as one, L lanes, C columns of the
dictionary, P of those free in a set of effects; θ (C) is 0 but for these.
Source: Ljung, System Identification (1999), 3.2 and 7.2 (simulation over a horizon as the error that is lowered).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hdagen.adoption.verdict import MOST_TOLERANCES
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.gap import SIGNIFICANT_NOISE_MULTIPLE
from hdagen.diagnosis.data.split import LogPortion, Mask
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout import verdict_withdrawal
from hdagen.diagnosis.inference.bounded_least_squares import solve_box_qp
from hdagen.diagnosis.inference.candidate_priors import SLAB_WIDTH, CandidateSet
from hdagen.diagnosis.inference.local_fit import start_fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import OperatingPoint
from hdagen.diagnosis.search.effect_search import SearchResult
from hdagen.prediction.window_replay import REPLAY_WINDOW

TRIED_SIZES = (0.5, 2.0)  # usual sizes that are tried of each effect
TRIED_PHASES = 6  # directions of two amplitudes, a sine and a cosine
ROLLOUTS_AT_ONCE = 64  # lanes
MOST_EFFECTS = 3  # effects
CANDIDATES_PER_ROUND = 3  # effects that are fitted in each round
MOST_FIT_STEPS, MOST_FOLD_STEPS = 5, 2  # of a fit at most, and of one to parts of the log from where it stands
STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1)  # of a step
DIFFERENCE_STEP = 0.1  # of a standard deviation, by which a size is moved for its column
LEAST_STEP_GAIN = 0.1  # of what is lowered, below which a step was the last
FOLDS = 4  # parts of the log, each of which is told by what the others tell
FEWEST_WINDOWS = 2 * FOLDS  # windows
LEAST_GAIN_PER_WINDOW = -2.0 * float(np.log(0.9))  # of what is lowered, a window: by this much an effect must lower it


def search_long_horizon(
    decision: Decision, found: SearchResult, arm: Arm, shown: LogPortion, window: float, alone: Sequence[DirectEvidence]
) -> Decision | None:
    """Search long windows for known effects where short windows leave something unknown.

    Args:
        decision: whose verdict is something unknown.
        found: the search in short windows.
        arm: the model with every effect.
        shown: the rows (T,) of the log that were fitted.
        window: length of the short windows, s.
        alone: effects with direct evidence, which every model has.

    Returns:
        The decision with the most probable known effects of long windows; None if there are none, or too few windows.

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
    seen = LongHorizonSearch(MultipleShooting(arm, long), found.candidates, p)
    *sets, none = seen.find_effects()
    if not sets:
        return None
    told = sets[0]
    near = next(fit for fit in found.fits if fit.sensitivities.shooting.arm is arm)  # another one may have springs
    model = seen.limit_base_parameters(told)
    p = seen.parameters_at(model)
    start = OperatingPoint(p, near.sensitivities.shooting.measured_initial_states(p))
    fit = start_fit(near.sensitivities, found.candidates, told.atoms, near.score.posterior.s, start)
    weights = {found.candidates.names_of(one.atoms): float(np.exp(0.5 * (told.cost - one.cost))) for one in sets}
    strange = [h for h in decision.hypotheses if h.is_unknown]
    short = [h for h in decision.hypotheses if not h.is_unknown]
    # what short windows know, long ones do not bear out
    share = float(np.exp(0.5 * (told.cost - none.cost))) / sum(h.probability for h in short)
    weights |= {h.names: share * h.probability for h in short if h.names not in weights}
    whole = (1.0 - sum(h.probability for h in strange)) / sum(weights.values())
    known = [Hypothesis(names, whole * w, fit if names == fit.names else None) for names, w in weights.items()]
    return replace(decision, hypotheses=(*known, *strange), best=fit, undetectable=tuple(seen.find_undetectable(model)))


@dataclass(frozen=True, eq=False)
class EffectModel:
    """Effects (atoms of a dictionary) with sizes θ (C), their errors (S, M), and their cost."""

    atoms: tuple[int, ...]
    theta: Array
    errors: Array
    cost: float


@dataclass(eq=False)
class LongHorizonSearch:
    """The search in the windows of ``shooting`` for effects among ``candidates``, about the parameters ``p`` (np)."""

    shooting: MultipleShooting
    candidates: CandidateSet
    p: Array
    extensions: dict[tuple[int, ...], list[EffectModel]] = field(
        init=False, default_factory=dict
    )  # further effects beside a set

    def __post_init__(self) -> None:
        record = self.shooting.record
        kinds = [(j, "" if quantity.endswith("position") else quantity) for quantity, j in record.outputs]
        channels = sorted(set(kinds))
        self.channel_index = np.array([channels.index(kind) for kind in kinds])
        self.window_index = np.repeat(np.arange(len(record.sampled_rows)), [len(rows) for rows in record.sampled_rows])
        self.least_gain = LEAST_GAIN_PER_WINDOW * len(record.sampled_rows)
        self.is_encoder = np.array([not quantity for _, quantity in channels])
        # the noise of what is read of inputs is all that no loop explains, which counts as it is
        noise = record.noise * np.where(self.is_encoder[self.channel_index], SIGNIFICANT_NOISE_MULTIPLE, 1.0)
        self.usual_error = np.ones(len(kinds))
        self.usual_error = np.maximum(np.sqrt((self._simulate_errors([self.p])[0] ** 2).mean(0)), noise)
        self.noise_floor = self._average_encoders((noise / self.usual_error)[None] ** 2)[0]

    def find_effects(self) -> list[EffectModel]:
        """Find the set of effects of the lowest cost.

        Returns:
            That set, then the sets with another effect in the place of one of its, and last the model with no effect.

        """
        none = model = self._fit_model(self._evaluate_model((), np.zeros(len(self.candidates.columns))))
        while len(model.atoms) < MOST_EFFECTS:
            further = self._extend_model(model)
            if not further or further[0].cost > model.cost - self.least_gain:
                break
            model = further[0]
        while (
            model.atoms
            and self._mean_squares(model.errors[None])[0][self.is_encoder].max()
            < verdict_withdrawal.MOST_REMAINING_SHARE**2
        ):
            whole, less = (
                self._cross_validate(model),
                {k: self._fit_model(self._drop_effect(model, k)) for k in model.atoms},
            )
            gains = {k: self._cross_validate(one) - whole for k, one in less.items()}
            doubtful = [k for k in model.atoms if gains[k] <= self.least_gain]
            if not doubtful:
                others = [one for k in model.atoms for one in self._list_alternatives(model, less[k])]
                return [model, *others, none]
            model = less[min(doubtful, key=lambda k: gains[k])]
        return [none]

    def limit_base_parameters(self, model: EffectModel) -> EffectModel:
        """Fit a model again with its base parameters only as far as a verdict may move them.

        Args:
            model: as it was found.

        Returns:
            The model with these bounds.

        """
        theta = model.theta.copy()
        free, wide = self._list_free_columns(model.atoms)
        base = [self.candidates.columns[k].candidate not in model.atoms for k in free]
        theta[free] = np.where(base, np.clip(theta[free], -MOST_TOLERANCES * wide, MOST_TOLERANCES * wide), theta[free])
        return self._fit_model(self._evaluate_model(model.atoms, theta), reach=MOST_TOLERANCES)

    def parameters_at(self, model: EffectModel) -> Array:
        """Place a model's sizes in the parameters.

        Args:
            model: with its sizes.

        Returns:
            The parameters (np,) in SI, within their bounds.

        """
        return self._place_sizes(model.atoms, model.theta)

    def _place_sizes(self, atoms: Sequence[int], theta: Array) -> Array:
        p, arm = self.p.copy(), self.shooting.arm
        described = list(arm.parameters.described.values())
        for k in atoms:
            self.candidates.members[k].apply_shapes(arm, p)
        for c, size in zip(self.candidates.columns, theta, strict=True):
            if size:
                q = described[c.index]
                p[c.index] = min(max(p[c.index] + float(size) * c.unit, q.low), q.high)
        return p

    def _list_free_columns(self, atoms: Sequence[int]) -> tuple[Array, Array]:
        """The free columns (P) of a model, and their prior standard deviations (P)."""
        free = [k for k, c in enumerate(self.candidates.columns) if c.in_every_hypothesis or c.candidate in atoms]
        wide = [
            SLAB_WIDTH if self.candidates.columns[k].candidate in atoms else self.candidates.columns[k].spike_width
            for k in free
        ]
        return np.array(free, int), np.array(wide)

    def _simulate_errors(self, points: Sequence[Array]) -> Array:
        """Errors of the channels (L, S, M) at some parameters, over the usual errors."""
        record = self.shooting.record
        seen = np.stack(
            self.shooting.predict_all([Rollout(p, self.shooting.measured_initial_states(p)) for p in points])
        )
        return np.asarray(record.subtract_prediction(seen) / self.usual_error)

    def _average_encoders(self, squares: Array) -> Array:
        """Average the squares of all channels (L, M) over each joint's encoders (L, I)."""
        counts = np.bincount(self.channel_index)
        return np.stack([np.bincount(self.channel_index, row) / counts for row in squares])

    def _mean_squares(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """Mean squares (L, I) of errors (L, S, M) in some ``rows``, no less than the floor."""
        errors = errors[:, rows]
        return np.maximum(
            self._average_encoders(np.einsum("lsm,lsm->lm", errors, errors) / errors.shape[1]), self.noise_floor
        )

    def _log_misfit(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """W Σ log e² (L) of errors (L, S, M) in some ``rows``."""
        return np.asarray(len(np.unique(self.window_index[rows])) * np.log(self._mean_squares(errors, rows)).sum(1))

    def _cost(self, atoms: Sequence[int], errors: Array, thetas: Array, rows: Mask | slice = slice(None)) -> Array:
        """The cost (L) of errors (L, S, M) at sizes (L, C), in some ``rows`` alone."""
        free, wide = self._list_free_columns(atoms)
        return np.asarray(self._log_misfit(errors, rows) + ((thetas[:, free] / wide) ** 2).sum(1))

    def _evaluate_model(self, atoms: tuple[int, ...], theta: Array) -> EffectModel:
        errors = self._simulate_errors([self._place_sizes(atoms, theta)])
        return EffectModel(atoms, theta, errors[0], float(self._cost(atoms, errors, theta[None])[0]))

    def _differentiate_errors(self, model: EffectModel) -> Array:
        """Derivatives of the errors by each free size (P, S, M)."""
        free, wide = self._list_free_columns(model.atoms)
        steps = np.zeros((len(free), len(model.theta)))
        steps[range(len(free)), free] = DIFFERENCE_STEP * wide * np.where(model.theta[free] < 0, -1.0, 1.0)
        moved = self._simulate_errors([self._place_sizes(model.atoms, model.theta + step) for step in steps])
        return np.asarray((moved - model.errors) / steps.sum(1)[:, None, None])

    def _normal_equations(
        self, model: EffectModel, slopes: Array, errors: Array, rows: Mask | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Normal equations of Newton's steps of θ from a model with other ``errors`` (L, S, M), by some ``rows`` alone:
        (P, P) and (L, P)."""
        free, wide = self._list_free_columns(model.atoms)
        weight = (
            1.0
            / (self._mean_squares(model.errors[None], rows)[0] * np.bincount(self.channel_index))[self.channel_index]
        )
        weight *= len(np.unique(self.window_index[rows])) / len(self.window_index[rows])
        J = slopes[:, rows].reshape(len(free), -1)
        weighted = (slopes[:, rows] * weight).reshape(len(free), -1)
        told = errors[:, rows].reshape(len(errors), -1) @ weighted.T + model.theta[free] / wide**2
        return weighted @ J.T + np.diag(wide**-2), -told

    def _fit_model(
        self, model: EffectModel, rows: Mask | slice = slice(None), steps: int = MOST_FIT_STEPS, reach: float = np.inf
    ) -> EffectModel:
        """Fit a model's sizes by some ``rows`` alone; base parameters ``reach`` so many standard deviations."""
        model = replace(model, cost=float(self._cost(model.atoms, model.errors[None], model.theta[None], rows)[0]))
        free, wide = self._list_free_columns(model.atoms)
        most = np.where([self.candidates.columns[k].candidate in model.atoms for k in free], np.inf, reach * wide)
        for _ in range(steps):
            H, (g,) = self._normal_equations(model, self._differentiate_errors(model), model.errors[None], rows)
            step, here = np.zeros_like(model.theta), model.theta[free]
            step[free] = solve_box_qp(H, g, np.linalg.solve(H, g), (-most - here, most - here))
            thetas = model.theta + np.outer(STEP_FRACTIONS, step)
            errors = self._simulate_errors([self._place_sizes(model.atoms, theta) for theta in thetas])
            costs = self._cost(model.atoms, errors, thetas, rows)
            nearest = int(np.argmin(costs))
            gain = model.cost - float(costs[nearest])
            if gain > 0:
                model = EffectModel(model.atoms, thetas[nearest], errors[nearest], float(costs[nearest]))
            if gain < LEAST_STEP_GAIN:
                break
        return model

    def _extend_model(self, model: EffectModel) -> list[EffectModel]:
        """Fitted models with one more effect, the most promising at one of their sizes; the best first."""
        key = tuple(sorted(model.atoms))
        if key not in self.extensions:
            self.extensions[key] = self._fit_promising(model)
        return self.extensions[key]

    def _fit_promising(self, model: EffectModel) -> list[EffectModel]:
        slopes = self._differentiate_errors(model)
        best: dict[str, tuple[float, int, Array]] = {}
        for some in self._list_options(model, TRIED_SIZES):
            sized = [((*model.atoms, k), model.theta + size) for k, size in some]
            settled = self._predict_optima(
                model, slopes, self._simulate_errors([self._place_sizes(*one) for one in sized])
            )
            for (atoms, theta), (step, errors) in zip(sized, settled, strict=True):
                promise = float(self._cost(atoms, errors[None], (theta + step)[None])[0])
                if promise < best.get(name := self.candidates.members[atoms[-1]].name, (np.inf,))[0]:
                    best[name] = promise, atoms[-1], theta + step
        ranked = sorted(best.values(), key=lambda one: one[0])[:CANDIDATES_PER_ROUND]
        fitted = [self._fit_model(self._evaluate_model((*model.atoms, k), theta)) for _, k, theta in ranked]
        return sorted(fitted, key=lambda one: one.cost)

    def find_undetectable(self, model: EffectModel) -> list[str]:
        """Find effects that would not be found although they were present in their usual size.

        Args:
            model: whose errors remain beside them.

        Returns:
            Their names, effect@joint, those that show least first.

        """
        slopes = self._differentiate_errors(model)
        lowered: dict[str, list[float]] = {}
        for some in self._list_options(model, (1.0,)):
            there = self._simulate_errors(
                [self._place_sizes((*model.atoms, k), model.theta + size) for k, size in some]
            )
            lacking = 2.0 * model.errors - there  # what the model would err by, had the log that effect
            for (k, _), (step, errors) in zip(some, self._predict_optima(model, slopes, lacking), strict=True):
                cost = float(self._cost(model.atoms, errors[None], (model.theta + step)[None])[0])
                lowered.setdefault(self.candidates.members[k].name, []).append(cost - model.cost)
        shows = {name: float(np.mean(each)) for name, each in lowered.items()}
        return sorted((name for name in shows if shows[name] <= self.least_gain), key=lambda name: (shows[name], name))

    def _list_options(self, model: EffectModel, sizes: Sequence[float]) -> Iterator[list[tuple[int, Array]]]:
        """Atoms that a model can take, each with its θ (C) at some usual sizes, as many as run at once."""
        fits = [k for k in range(len(self.candidates.members)) if self._is_distinct(model, k)]
        options = [(k, theta) for k in fits for theta in self._list_sizes(k, sizes)]
        return (options[k : k + ROLLOUTS_AT_ONCE] for k in range(0, len(options), ROLLOUTS_AT_ONCE))

    def _predict_optima(self, model: EffectModel, slopes: Array, errors: Array) -> Iterator[tuple[Array, Array]]:
        """For other errors (L, S, M) than a model's, the linear optimum's step of θ (C) and its errors (S, M)."""
        free = self._list_free_columns(model.atoms)[0]
        H, g = self._normal_equations(model, slopes, errors)
        for one, step in zip(errors, np.linalg.solve(H, g.T).T, strict=True):
            whole = np.zeros_like(model.theta)
            whole[free] = step
            yield whole, one + np.tensordot(step, slopes, 1)

    def _is_distinct(self, model: EffectModel, k: int) -> bool:
        """Whether a model can take atom k beside its own."""
        new = self.candidates.members[k].name not in self.candidates.names_of(model.atoms)
        return new and self.candidates.is_compatible(self.shooting.arm, k, model.atoms)

    def _list_sizes(self, k: int, sizes: Sequence[float]) -> Iterator[Array]:
        """θ (C) of atom k alone at some usual sizes, in all of its directions."""
        own = self.candidates.amplitude_columns((k,))
        turns = 2 * np.pi * np.arange(TRIED_PHASES) / TRIED_PHASES
        two = np.column_stack([np.cos(turns), np.sin(turns)])
        for way in two if len(own) == 2 else np.vstack([np.eye(len(own)), -np.eye(len(own))]):
            for size in sizes:
                theta = np.zeros(len(self.candidates.columns))
                theta[own] = size * way
                yield theta

    def _drop_effect(self, model: EffectModel, k: int) -> EffectModel:
        """A model without one of its effects, all else as it is."""
        theta = model.theta.copy()
        theta[self.candidates.amplitude_columns((k,))] = 0.0
        return self._evaluate_model(tuple(i for i in model.atoms if i != k), theta)

    def _list_alternatives(self, model: EffectModel, less: EffectModel) -> list[EffectModel]:
        """Models with another effect in the place of the one that ``less`` lacks, the best first."""
        names = self.candidates.names_of(model.atoms)
        return [one for one in self._extend_model(less) if self.candidates.names_of(one.atoms) != names]

    def _cross_validate(self, model: EffectModel) -> float:
        """Cross-validated Σ W log e² of a fitted model over parts of the log."""
        told = 0.0
        for windows in np.array_split(np.unique(self.window_index), FOLDS):
            part = np.isin(self.window_index, windows)
            told += float(self._log_misfit(self._fit_model(model, ~part, MOST_FOLD_STEPS).errors[None], part)[0])
        return told
