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

from hdagen.adoption.verdict import REACH
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.gap import ABOVE
from hdagen.diagnosis.data.split import Mask, Portion
from hdagen.diagnosis.data.windows import record
from hdagen.diagnosis.decision.direct_evidence import Sure
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.holdout import verdict_withdrawal
from hdagen.diagnosis.inference.bounded_least_squares import bounded
from hdagen.diagnosis.inference.candidate_priors import SLAB, Dictionary
from hdagen.diagnosis.inference.local_fit import begun
from hdagen.diagnosis.inference.multiple_shooting import Lane, Shooting
from hdagen.diagnosis.inference.sensitivities import Point
from hdagen.diagnosis.search.hypothesis_search import Search
from hdagen.prediction.window_replay import WINDOW

SIZES = (0.5, 2.0)  # usual sizes that are tried of each effect
TURN = 6  # directions of two amplitudes, a sine and a cosine
AT_ONCE = 64  # lanes
MOST = 3  # effects
CLOSE = 3  # effects that are fitted in each round
STEPS, FEW = 5, 2  # of a fit at most, and of one to parts of the log from where it stands
REACHES = (1.0, 0.5, 0.25, 0.1)  # of a step
NEAR = 0.1  # of a standard deviation, by which a size is moved for its column
ENOUGH = 0.1  # of what is lowered, below which a step was the last
FOLDS = 4  # parts of the log, each of which is told by what the others tell
FEWEST = 2 * FOLDS  # windows
TENTH = -2.0 * float(np.log(0.9))  # of what is lowered, a window: by this much an effect must lower it


def lasting(
    decision: Decision, found: Search, arm: Arm, shown: Portion, window: float, alone: Sequence[Sure]
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
    long = record(arm, shown, max(WINDOW, window))
    if len(long.kept) < FEWEST:
        return None
    p, places = arm.p.copy(), list(arm.parameters.described)
    for name, value in (pair for one in alone for pair in one.parameters.items()):
        p[places.index(name)] = value
    seen = Lasting(Shooting(arm, long), found.words, p)
    *sets, none = seen.found()
    if not sets:
        return None
    told = sets[0]
    near = next(fit for fit in found.fitted if fit.design.shooting.arm is arm)  # another one may have springs
    model = seen.within(told)
    p = seen.at(model)
    start = Point(p, near.design.shooting.begun(p))
    fit = begun(near.design, found.words, told.atoms, near.score.at.s, start)
    weights = {found.words.names(one.atoms): float(np.exp(0.5 * (told.cost - one.cost))) for one in sets}
    strange = [h for h in decision.hypotheses if h.unknown]
    short = [h for h in decision.hypotheses if not h.unknown]
    # what short windows know, long ones do not bear out
    share = float(np.exp(0.5 * (told.cost - none.cost))) / sum(h.probability for h in short)
    weights |= {h.names: share * h.probability for h in short if h.names not in weights}
    whole = (1.0 - sum(h.probability for h in strange)) / sum(weights.values())
    known = [Hypothesis(names, whole * w, fit if names == fit.names else None) for names, w in weights.items()]
    return replace(decision, hypotheses=(*known, *strange), best=fit, unseen=tuple(seen.unseen(model)))


@dataclass(frozen=True, eq=False)
class Model:
    """Effects (atoms of a dictionary) with sizes θ (C), their errors (S, M), and their cost."""

    atoms: tuple[int, ...]
    theta: Array
    errors: Array
    cost: float


@dataclass(eq=False)
class Lasting:
    """The search in the windows of ``shooting`` for effects among ``words``, about the parameters ``p`` (np)."""

    shooting: Shooting
    words: Dictionary
    p: Array
    tried: dict[tuple[int, ...], list[Model]] = field(init=False, default_factory=dict)  # further effects beside a set

    def __post_init__(self) -> None:
        record = self.shooting.record
        kinds = [(j, "" if quantity.endswith("position") else quantity) for quantity, j in record.outputs]
        channels = sorted(set(kinds))
        self.channel = np.array([channels.index(kind) for kind in kinds])
        self.window = np.repeat(np.arange(len(record.looked)), [len(rows) for rows in record.looked])
        self.worth = TENTH * len(record.looked)
        self.encoder = np.array([not quantity for _, quantity in channels])
        # the noise of what is read of inputs is all that no loop explains, which counts as it is
        noise = record.noise * np.where(self.encoder[self.channel], ABOVE, 1.0)
        self.usual = np.ones(len(kinds))
        self.usual = np.maximum(np.sqrt((self._errors([self.p])[0] ** 2).mean(0)), noise)
        self.floor = self._joined((noise / self.usual)[None] ** 2)[0]

    def found(self) -> list[Model]:
        """Find the set of effects of the lowest cost.

        Returns:
            That set, then the sets with another effect in the place of one of its, and last the model with no effect.

        """
        none = model = self._fitted(self._model((), np.zeros(len(self.words.columns))))
        while len(model.atoms) < MOST:
            further = self._further(model)
            if not further or further[0].cost > model.cost - self.worth:
                break
            model = further[0]
        while model.atoms and self._left(model.errors[None])[0][self.encoder].max() < verdict_withdrawal.MOST**2:
            whole, less = self._elsewhere(model), {k: self._fitted(self._without(model, k)) for k in model.atoms}
            gains = {k: self._elsewhere(one) - whole for k, one in less.items()}
            doubtful = [k for k in model.atoms if gains[k] <= self.worth]
            if not doubtful:
                others = [one for k in model.atoms for one in self._others(model, less[k])]
                return [model, *others, none]
            model = less[min(doubtful, key=lambda k: gains[k])]
        return [none]

    def within(self, model: Model) -> Model:
        """Fit a model again with its base parameters only as far as a verdict may move them.

        Args:
            model: as it was found.

        Returns:
            The model with these bounds.

        """
        theta = model.theta.copy()
        free, wide = self._free(model.atoms)
        base = [self.words.columns[k].atom not in model.atoms for k in free]
        theta[free] = np.where(base, np.clip(theta[free], -REACH * wide, REACH * wide), theta[free])
        return self._fitted(self._model(model.atoms, theta), reach=REACH)

    def at(self, model: Model) -> Array:
        """Place a model's sizes in the parameters.

        Args:
            model: with its sizes.

        Returns:
            The parameters (np,) in SI, within their bounds.

        """
        return self._placed(model.atoms, model.theta)

    def _placed(self, atoms: Sequence[int], theta: Array) -> Array:
        p, arm = self.p.copy(), self.shooting.arm
        described = list(arm.parameters.described.values())
        for k in atoms:
            self.words.atoms[k].shape(arm, p)
        for c, size in zip(self.words.columns, theta, strict=True):
            if size:
                q = described[c.index]
                p[c.index] = min(max(p[c.index] + float(size) * c.unit, q.low), q.high)
        return p

    def _free(self, atoms: Sequence[int]) -> tuple[Array, Array]:
        """The free columns (P) of a model, and their prior standard deviations (P)."""
        free = [k for k, c in enumerate(self.words.columns) if c.base or c.atom in atoms]
        wide = [SLAB if self.words.columns[k].atom in atoms else self.words.columns[k].spike for k in free]
        return np.array(free, int), np.array(wide)

    def _errors(self, points: Sequence[Array]) -> Array:
        """Errors of the channels (L, S, M) at some parameters, over the usual errors."""
        record = self.shooting.record
        seen = np.stack(self.shooting.all([Lane(p, self.shooting.begun(p)) for p in points]))
        return np.asarray(record.missed(seen) / self.usual)

    def _joined(self, squares: Array) -> Array:
        """Average the squares of all channels (L, M) over each joint's encoders (L, I)."""
        counts = np.bincount(self.channel)
        return np.stack([np.bincount(self.channel, row) / counts for row in squares])

    def _left(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """Mean squares (L, I) of errors (L, S, M) in some ``rows``, no less than the floor."""
        errors = errors[:, rows]
        return np.maximum(self._joined(np.einsum("lsm,lsm->lm", errors, errors) / errors.shape[1]), self.floor)

    def _told(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """W Σ log e² (L) of errors (L, S, M) in some ``rows``."""
        return np.asarray(len(np.unique(self.window[rows])) * np.log(self._left(errors, rows)).sum(1))

    def _cost(self, atoms: Sequence[int], errors: Array, thetas: Array, rows: Mask | slice = slice(None)) -> Array:
        """The cost (L) of errors (L, S, M) at sizes (L, C), in some ``rows`` alone."""
        free, wide = self._free(atoms)
        return np.asarray(self._told(errors, rows) + ((thetas[:, free] / wide) ** 2).sum(1))

    def _model(self, atoms: tuple[int, ...], theta: Array) -> Model:
        errors = self._errors([self._placed(atoms, theta)])
        return Model(atoms, theta, errors[0], float(self._cost(atoms, errors, theta[None])[0]))

    def _slopes(self, model: Model) -> Array:
        """Derivatives of the errors by each free size (P, S, M)."""
        free, wide = self._free(model.atoms)
        steps = np.zeros((len(free), len(model.theta)))
        steps[range(len(free)), free] = NEAR * wide * np.where(model.theta[free] < 0, -1.0, 1.0)
        moved = self._errors([self._placed(model.atoms, model.theta + step) for step in steps])
        return np.asarray((moved - model.errors) / steps.sum(1)[:, None, None])

    def _normal(
        self, model: Model, slopes: Array, errors: Array, rows: Mask | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Normal equations of Newton's steps of θ from a model with other ``errors`` (L, S, M), by some ``rows`` alone:
        (P, P) and (L, P)."""
        free, wide = self._free(model.atoms)
        weight = 1.0 / (self._left(model.errors[None], rows)[0] * np.bincount(self.channel))[self.channel]
        weight *= len(np.unique(self.window[rows])) / len(self.window[rows])
        J = slopes[:, rows].reshape(len(free), -1)
        weighted = (slopes[:, rows] * weight).reshape(len(free), -1)
        told = errors[:, rows].reshape(len(errors), -1) @ weighted.T + model.theta[free] / wide**2
        return weighted @ J.T + np.diag(wide**-2), -told

    def _fitted(
        self, model: Model, rows: Mask | slice = slice(None), steps: int = STEPS, reach: float = np.inf
    ) -> Model:
        """Fit a model's sizes by some ``rows`` alone; base parameters ``reach`` so many standard deviations."""
        model = replace(model, cost=float(self._cost(model.atoms, model.errors[None], model.theta[None], rows)[0]))
        free, wide = self._free(model.atoms)
        most = np.where([self.words.columns[k].atom in model.atoms for k in free], np.inf, reach * wide)
        for _ in range(steps):
            H, (g,) = self._normal(model, self._slopes(model), model.errors[None], rows)
            step, here = np.zeros_like(model.theta), model.theta[free]
            step[free] = bounded(H, g, np.linalg.solve(H, g), (-most - here, most - here))
            thetas = model.theta + np.outer(REACHES, step)
            errors = self._errors([self._placed(model.atoms, theta) for theta in thetas])
            costs = self._cost(model.atoms, errors, thetas, rows)
            nearest = int(np.argmin(costs))
            gain = model.cost - float(costs[nearest])
            if gain > 0:
                model = Model(model.atoms, thetas[nearest], errors[nearest], float(costs[nearest]))
            if gain < ENOUGH:
                break
        return model

    def _further(self, model: Model) -> list[Model]:
        """Fitted models with one more effect, the most promising at one of their sizes; the best first."""
        key = tuple(sorted(model.atoms))
        if key not in self.tried:
            self.tried[key] = self._promising(model)
        return self.tried[key]

    def _promising(self, model: Model) -> list[Model]:
        slopes = self._slopes(model)
        best: dict[str, tuple[float, int, Array]] = {}
        for some in self._options(model, SIZES):
            sized = [((*model.atoms, k), model.theta + size) for k, size in some]
            settled = self._settled(model, slopes, self._errors([self._placed(*one) for one in sized]))
            for (atoms, theta), (step, errors) in zip(sized, settled, strict=True):
                promise = float(self._cost(atoms, errors[None], (theta + step)[None])[0])
                if promise < best.get(name := self.words.atoms[atoms[-1]].name, (np.inf,))[0]:
                    best[name] = promise, atoms[-1], theta + step
        ranked = sorted(best.values(), key=lambda one: one[0])[:CLOSE]
        fitted = [self._fitted(self._model((*model.atoms, k), theta)) for _, k, theta in ranked]
        return sorted(fitted, key=lambda one: one.cost)

    def unseen(self, model: Model) -> list[str]:
        """Find effects that would not be found although they were present in their usual size.

        Args:
            model: whose errors remain beside them.

        Returns:
            Their names, effect@joint, those that show least first.

        """
        slopes = self._slopes(model)
        lowered: dict[str, list[float]] = {}
        for some in self._options(model, (1.0,)):
            there = self._errors([self._placed((*model.atoms, k), model.theta + size) for k, size in some])
            lacking = 2.0 * model.errors - there  # what the model would err by, had the log that effect
            for (k, _), (step, errors) in zip(some, self._settled(model, slopes, lacking), strict=True):
                cost = float(self._cost(model.atoms, errors[None], (model.theta + step)[None])[0])
                lowered.setdefault(self.words.atoms[k].name, []).append(cost - model.cost)
        shows = {name: float(np.mean(each)) for name, each in lowered.items()}
        return sorted((name for name in shows if shows[name] <= self.worth), key=lambda name: (shows[name], name))

    def _options(self, model: Model, sizes: Sequence[float]) -> Iterator[list[tuple[int, Array]]]:
        """Atoms that a model can take, each with its θ (C) at some usual sizes, as many as run at once."""
        fits = [k for k in range(len(self.words.atoms)) if self._fits(model, k)]
        options = [(k, theta) for k in fits for theta in self._sizes(k, sizes)]
        return (options[k : k + AT_ONCE] for k in range(0, len(options), AT_ONCE))

    def _settled(self, model: Model, slopes: Array, errors: Array) -> Iterator[tuple[Array, Array]]:
        """For other errors (L, S, M) than a model's, the linear optimum's step of θ (C) and its errors (S, M)."""
        free = self._free(model.atoms)[0]
        H, g = self._normal(model, slopes, errors)
        for one, step in zip(errors, np.linalg.solve(H, g.T).T, strict=True):
            whole = np.zeros_like(model.theta)
            whole[free] = step
            yield whole, one + np.tensordot(step, slopes, 1)

    def _fits(self, model: Model, k: int) -> bool:
        """Whether a model can take atom k beside its own."""
        new = self.words.atoms[k].name not in self.words.names(model.atoms)
        return new and self.words.fits(self.shooting.arm, k, model.atoms)

    def _sizes(self, k: int, sizes: Sequence[float]) -> Iterator[Array]:
        """θ (C) of atom k alone at some usual sizes, in all of its directions."""
        own = self.words.free((k,))
        turns = 2 * np.pi * np.arange(TURN) / TURN
        two = np.column_stack([np.cos(turns), np.sin(turns)])
        for way in two if len(own) == 2 else np.vstack([np.eye(len(own)), -np.eye(len(own))]):
            for size in sizes:
                theta = np.zeros(len(self.words.columns))
                theta[own] = size * way
                yield theta

    def _without(self, model: Model, k: int) -> Model:
        """A model without one of its effects, all else as it is."""
        theta = model.theta.copy()
        theta[self.words.free((k,))] = 0.0
        return self._model(tuple(i for i in model.atoms if i != k), theta)

    def _others(self, model: Model, less: Model) -> list[Model]:
        """Models with another effect in the place of the one that ``less`` lacks, the best first."""
        names = self.words.names(model.atoms)
        return [one for one in self._further(less) if self.words.names(one.atoms) != names]

    def _elsewhere(self, model: Model) -> float:
        """Cross-validated Σ W log e² of a fitted model over parts of the log."""
        told = 0.0
        for windows in np.array_split(np.unique(self.window), FOLDS):
            part = np.isin(self.window, windows)
            told += float(self._told(self._fitted(model, ~part, FEW).errors[None], part)[0])
        return told
