"""The next motion: which safe one separates effects best, and by how much the log evidence will tell them apart.

Every motion (`hdagen.excitation.safe_motion`) is run on the compiled arm. About its path the diagnosis' own linear
model is made, with the effects in question at their typical sizes as differences of whole simulations. A log of a
machine that has effect A is then that model with A present and everything else within its tolerance. The separation of
A and B is the log evidence for A less that for B; first states, base parameters, spikes of all other effects and
unexplained torque are eliminated as in a diagnosis. Source: Lindley, Ann. Math. Stat. 27 (1956) 986; Box, Hill,
Technometrics 9 (1967) 57 (experiments that discriminate between models).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from hdagen.arm.arrays import Array, is_number
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.joint_names import list_joint_names, number_effect, number_joint
from hdagen.control.reference_motion import Reference
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.candidate_priors import CandidateSet, Column
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.marginal_likelihood import compute_posteriors, score_candidate_sets
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess, guess_from_log
from hdagen.excitation.least_motion import (
    LEAST_ENCODER_STEPS,
    count_run_steps,
    explain_narrow_limits,
    find_resting_joints,
)
from hdagen.excitation.motion_limits import MotionLimits, choose_middle_posture, narrow_limits
from hdagen.excitation.motion_shapes import list_motions
from hdagen.excitation.safe_motion import SafeRun, shrink_to_limits, with_parameters
from hdagen.log.measured_log import Log
from hdagen.support.messages import suggest_name
from hdagen.support.parallel import map_in_threads

LEAST_SEPARATION = 7.0  # nats, from where the other holds less than a tenth of a diagnosis' probability
PREDICTION_FACTOR = 3.0  # factor within which a prediction holds
DURATION_RANGE = (2.0, 120.0)  # s
PERIOD_RANGE = (1e-4, 0.01)  # s
MOST_MOTION_ROWS = 40_000  # of a motion, which bounds the memory of the linear model
DRAWS_PER_EFFECT = 2  # of base parameters and spikes, for each true effect of a pair

EffectPair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class TriedMotion:
    """A motion with what it separates: nats by pair (the smaller of A true and of B true); ``kept`` None where the
    limits drop it, with ``drop_reason``."""

    name: str
    safe_run: SafeRun | None
    separations: Mapping[EffectPair, float] = field(default_factory=dict)
    drop_reason: str = ""

    @property
    def smallest_separation(self) -> float:
        """Nats of the pair that is separated least; −inf of a motion that is dropped."""
        return min(self.separations.values(), default=-np.inf)

    @property
    def merit(self) -> float:
        """The figure that is maximised: a soft minimum over the pairs, so that a pair that nothing separates does not
        rule alone; negative nats count as 0."""
        if not self.separations:
            return -np.inf
        x = np.maximum(list(self.separations.values()), 0.0) / (LEAST_SEPARATION * PREDICTION_FACTOR)
        return float(np.log(len(x)) - logsumexp(-x))


@dataclass(frozen=True, eq=False)
class Excitation:
    """All motions that were tried, the best first; ``effects`` to separate as name@joint; ``limits`` that are kept."""

    effects: tuple[str, ...]
    tried_motions: tuple[TriedMotion, ...]
    limits: MotionLimits

    @property
    def best_motion(self) -> TriedMotion:
        """The motion to make."""
        return self.tried_motions[0]

    @property
    def reference(self) -> Reference:
        """Of the best motion: positions of the joints (T, n), their rates, and the period."""
        assert self.best_motion.safe_run is not None
        return self.best_motion.safe_run.reference

    @property
    def is_separating(self) -> bool:
        """Whether each pair is expected to be told apart even where the prediction is off by its factor."""
        return self.best_motion.smallest_separation >= LEAST_SEPARATION * PREDICTION_FACTOR

    def log_columns(self) -> dict[str, Array]:
        """List the columns of the reference.

        Returns:
            ``time`` (s) and ``joint_position_reference_j`` (rad or m), as a log has them.

        """
        reference = self.reference
        return {"time": reference.time} | {
            f"joint_position_reference_{j + 1}": np.ascontiguousarray(x) for j, x in enumerate(reference.position.T)
        }


def excite(
    arm: Arm,
    separate: Sequence[str] = (),
    joint: int | str = 1,
    duration: float = 10.0,
    period: float = 1e-3,
    limits: Mapping[str, tuple[float, ...]] | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> Excitation:
    """Find the safe motion that separates effects best.

    Args:
        arm: An arm that was built with all effects.
        separate: Names of effects of ``joint``, or name@joint; none: every pair of the joint's effects.
        joint: Number of the joint, from 1, or its name.
        duration: Length of the motion, s.
        period: Time from row to row, s.
        limits: Narrower limits, as `motion_limits.narrow_limits` takes them.
        say: Hears the name of each motion as it is tried.

    Returns:
        All motions, the best first.

    Raises:
        PlantError: An effect or a limit does not exist, or no visible motion keeps the limits.

    """
    effects = _choose_effects(arm, separate, joint, duration, period)
    bounds = narrow_limits(arm, limits)
    center = choose_middle_posture(arm, bounds)
    others: list[Arm] = []
    if separate:
        others = [with_parameters(arm, _typical_parameters(arm, name)) for name in effects]
    places = [int(name.rpartition("@")[2]) for name in effects]
    joints = sorted({place - 1 for place in places if place}) or list(range(arm.n))
    shapes = list_motions(arm, places[0], duration, period)
    if find_resting_joints(arm, bounds, shapes, center, period)[joints].all():
        raise PlantError(explain_narrow_limits(arm, bounds, shapes, center, period, joints))
    tried = []
    for motion in shapes:
        say(motion.name)
        kept = shrink_to_limits(arm, others, bounds, motion, center, period)
        if (
            isinstance(kept, SafeRun)
            and max(most := count_run_steps(arm, kept.simulation)[joints]) < LEAST_ENCODER_STEPS
        ):
            kept = (
                f"moves joint {joints[int(np.argmax(most))] + 1} by less than {LEAST_ENCODER_STEPS} steps of its"
                " encoder"
            )
        if isinstance(kept, SafeRun):
            tried.append(TriedMotion(motion.name, kept, predict_separations(arm, effects, kept)))
        else:
            tried.append(TriedMotion(motion.name, None, {}, kept))
    tried.sort(key=lambda t: (-t.merit, -t.smallest_separation))
    if tried[0].safe_run is None:
        whys = [f"{t.name}: {t.drop_reason}" for t in tried[:3]]
        raise PlantError(explain_narrow_limits(arm, bounds, shapes, center, period, joints, whys))
    return Excitation(effects, tuple(tried), bounds)


def _choose_effects(
    arm: Arm, separate: Sequence[str], joint: int | str, duration: float, period: float
) -> tuple[str, ...]:
    """The effects to separate as name@joint. Raises PlantError with every problem."""
    problems = []
    for name, value, (low, high) in (("duration", duration, DURATION_RANGE), ("period", period, PERIOD_RANGE)):
        if not is_number(value) or not low <= value <= high:
            problems.append(f"the {name} is {value:g} s; possible is {low:g} to {high:g} s.")
    if not problems and duration / period > MOST_MOTION_ROWS:
        problems.append(
            f"the motion has {duration / period:.0f} rows; possible are {MOST_MOTION_ROWS}: make it shorter, or"
            " coarser."
        )
    names = list_joint_names(arm)
    own = number_joint(str(joint), names)
    if own not in map(str, range(1, arm.n + 1)):
        named = "".join(f", {name}" for name in names if name)
        problems.append(f"--joint {joint}: the robot has joints 1 to {arm.n}{named}.")
        raise PlantError("\n".join(problems))
    there = [atom.name for atom in build_candidates(arm, InitialGuess({}, {}, {})).members]
    here = sorted({name for name in there if name.endswith((f"@{own}", "@0"))})
    found = []
    for name in separate:
        options = [f"{name}@{own}", f"{name}@0"]
        if "@" in name:
            options = [number_effect(name, names)]
        known = [option for option in options if option in there]
        if not known:
            problems.append(
                f"--separate {name}: joint {joint} has no such effect{suggest_name(options[0], there)}; there are "
                f"{', '.join(here)}, and name@joint means that of another joint."
            )
        found += known[:1]
    if len(set(found)) < len(found):
        problems.append(f"--separate {','.join(separate)}: names the same effect twice; name two that differ.")
    elif len(separate) == 1 and found:
        problems.append(f"--separate {separate[0]}: one effect alone; name two or more, or none for every pair.")
    if problems:
        raise PlantError("\n".join(problems))
    if separate:
        return tuple(found)
    return tuple(here)


def _typical_parameters(arm: Arm, name: str) -> dict[str, float]:
    """The parameters of an effect at its typical size: of several amplitudes the first."""
    words = build_candidates(arm, InitialGuess({}, {}, {}))
    k = next(k for k, atom in enumerate(words.members) if atom.name == name)
    column = next(c for c in words.columns if c.candidate == k)
    return {column.parameter: column.center + _typical_size(arm, column) * column.unit}


def _typical_size(arm: Arm, column: Column) -> float:
    """The size at which an effect is looked at: the usual one, of the sign and as large as its bounds let it."""
    q = arm.parameters.described[column.parameter]
    up, down = (q.high - column.center) / column.unit, (column.center - q.low) / column.unit
    if up >= 1.0 or up >= down:
        return 1.0
    return -min(1.0, down)


# -- prediction -------------------------------------------------------------------------------------------------------


def build_linear_model(arm: Arm, log: Log, effects: Sequence[str], states: Array | None = None) -> Sensitivities:
    """Build the linear model of a log about the nominal arm.

    Args:
        arm: The arm, built with all effects.
        log: The log.
        effects: Effects whose columns have their typical size. They are free or absent, not within a tolerance, which
            would bound their evidence.
        states: States at the rows, (T, nx), from which windows begin; None: as measured.

    Returns:
        The sensitivities of the log.

    """
    seen = cut_windows(arm, LogPortion.all_rows(log), max(DATA.window_length, DATA.fewest_window_rows * log.period))
    shooting = MultipleShooting(arm, seen)
    words = build_candidates(arm, InitialGuess(guess_from_log(arm, seen).shapes, {}, {}))
    columns = []
    for column in words.columns:
        if column.candidate >= 0 and words.members[column.candidate].name in effects:
            sized = replace(column, step=_typical_size(arm, column))
            if not column.in_every_hypothesis:
                sized = replace(sized, spike_width=CANDIDATES.silent_spike_width)
            columns.append(sized)
        elif column.candidate < 0 or words.members[column.candidate].has_default_shapes:
            columns.append(column)
    p, begun = shooting.nominal_start()
    if states is not None:
        begun = states[seen.starts, : shooting.m].copy()
    return compute_sensitivities(shooting, CandidateSet(words.members, tuple(columns)), OperatingPoint(p, begun))


def predict_separations(arm: Arm, effects: Sequence[str], kept: SafeRun) -> dict[EffectPair, float]:
    """Predict the log evidence by which a motion separates effects.

    Args:
        arm: The arm, built with all effects.
        effects: Effects as name@joint.
        kept: The motion with its run.

    Returns:
        Expected nats of each pair; of more than two effects without those that no channel of the log shows.

    """
    at = build_linear_model(arm, kept.simulation.log, effects, kept.simulation.state)
    linear, random = at.linear_model(1.0), np.random.default_rng(0)
    energy = np.diagonal(linear.cross_products.products, axis1=1, axis2=2).sum(0)[linear.m + linear.k :]
    shown = {
        at.candidates.members[c.candidate].name
        for c, e in zip(at.candidates.columns, energy, strict=True)
        if c.candidate >= 0 and e > 0
    }
    count = 1
    if len(effects) == 2:
        count = DRAWS_PER_EFFECT
    logs = [_draw_parameters(at.candidates, effects, true, random) for true in effects for _ in range(count)]
    found = map_in_threads(lambda theta: score_effects(_add_parameters(linear, theta), at.candidates, effects), logs)
    evidence: dict[str, dict[str, float]] = {}
    for k, true in enumerate(effects):
        draws = found[k * count : (k + 1) * count]
        evidence[true] = {name: float(np.mean([one[name] for one in draws])) for name in effects}
    return {
        (a, b): min(evidence[a][a] - evidence[a][b], evidence[b][b] - evidence[b][a])
        for a, b in itertools.combinations(effects, 2)
        if len(effects) == 2 or {a, b} <= shown
    }


def score_effects(linear: LinearModel, words: CandidateSet, effects: Sequence[str]) -> dict[str, float]:
    """Score effects by their log evidence in a linear model.

    Args:
        linear: The linear model of a log.
        words: Its candidates.
        effects: Effects as name@joint.

    Returns:
        Log evidence of each effect, of its best candidate.

    """
    atoms = [k for k, atom in enumerate(words.members) if atom.name in effects]
    best: dict[str, float] = {}
    for one in score_candidate_sets(compute_posteriors(linear, words.spike_widths), words, [(k,) for k in atoms]):
        best.setdefault(words.members[one.effects[0]].name, one.evidence)
    return best


def _draw_parameters(words: CandidateSet, effects: Sequence[str], true: str, random: np.random.Generator) -> Array:
    """θ of a machine that has the effect ``true`` and everything else within its tolerance."""
    theta = random.normal(size=len(words.columns)) * words.spike_widths
    atom = next(k for k, atom in enumerate(words.members) if atom.name == true)
    own, size = words.amplitude_columns((atom,)), np.ones(1)
    if len(own) > 1:
        size = random.normal(size=len(own))
    meant = [k for k, atom in enumerate(words.members) if atom.name in effects]
    theta[words.amplitude_columns(tuple(meant))] = 0.0
    theta[own] = np.sign(words.columns[own[0]].step) * size / np.linalg.norm(size)
    return theta


def _add_parameters(linear: LinearModel, theta: Array) -> LinearModel:
    """The linear model of a log of a machine with θ: its products follow from those of the columns."""
    gram = linear.cross_products
    moved = np.concatenate([np.zeros(gram.m + gram.k), theta])
    added = gram.products @ moved
    return replace(linear, z=linear.z + added, r2=linear.r2 + (2 * linear.z + added) @ moved)
