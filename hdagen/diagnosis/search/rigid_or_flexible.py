"""Whether a drive that the robot file calls rigid has a spring: the same record on a model with springs.

Such a model has other states, so it cannot be a candidate among those of the rigid model. It is fitted by itself with
every spring free, then with further effects taken from the rigid model's result. The evidence chooses between the two
models.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import WindowedRecord, cut_windows
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import Fit, start_fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.search.fit_ranking import (
    can_gain,
    drop_columns,
    drop_hopeless_starts,
    leaves_much,
    sort_by_evidence,
)
from hdagen.diagnosis.search.hypothesis_search import SearchResult, run_races
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.diagnosis.stages.time_budget import TimeBudget

LOGGER = logging.getLogger(__name__)


def compare_with_springs(
    robot: str | Path, arm: Arm, seen: WindowedRecord, window: float, found: SearchResult, on_stage: StageListener
) -> SearchResult:
    """Compare the search's result with a model that has springs in its rigid joints.

    Args:
        robot: a preset or a robot.toml.
        arm: the compiled model.
        seen: the record.
        window: length of a window, s.
        found: the result of the search.
        on_stage: receives each stage as it begins.

    Returns:
        ``found`` with the fits of the model with springs; ``found`` alone where no joint has a rotor of its own, and
        where the best fit leaves so little that no spring can gain its price.

    Raises:
        PlantError: the model cannot be loaded.

    """
    rigid = set(range(1, arm.n + 1)) - {*arm.manifest["flexible"]}
    if not any(arm.parameters[f"motor_inertia_{j}"] for j in rigid):
        return found  # no rotor that could turn by itself
    lead, budget = sort_by_evidence(found.fits)[0], found.fits[0].sensitivities.shooting.budget
    if not can_gain(lead):
        return found
    if budget.is_left_out("springs in joints that the robot file calls rigid"):
        return found
    flexible = load_with_springs(robot, arm)
    _log_rigid_joints(flexible)
    if len(flexible.manifest["flexible"]) == len(arm.manifest["flexible"]):
        return found
    on_stage(Stage.SPRINGS)
    shooting = make_spring_simulator(flexible, seen, window, budget)
    candidates = build_candidates(
        flexible,
        guess_from_log(flexible, shooting.record),
        shooting.record.joints_without_command,
        with_numbers=any(one.is_number for one in found.candidates.members),
    ).with_spike_scale(found.candidates.spike_scale)
    at, field = _start_spring_fits(shooting, candidates, found)
    fits = run_races(at, candidates, field, on_stage, find_least_evidence(lead, found.fits))
    return replace(found, fits=tuple(drop_columns(sort_by_evidence([*found.fits, *fits]))))


def find_least_evidence(lead: Fit, fitted: Sequence[Fit]) -> float:
    """Find the log evidence that springs must reach before anything is tried beside them: as much as a good fit has. A
    fit that leaves much is good where an effect need not explain a share of it, and springs may then be a close call;
    else springs must not be hopeless.

    Args:
        lead: the best fit without springs.
        fitted: all fits without springs.

    Returns:
        The log evidence.

    """
    if not leaves_much(lead, fitted):
        return lead.evidence_here
    margin = SEARCH.close_call_margin
    if lead.misfit_temperature > 1.0:
        margin = SEARCH.hopeless_margin
    return lead.evidence_here - margin * lead.misfit_temperature


def load_with_springs(robot: str | Path, arm: Arm) -> Arm:
    """Load the model with springs in the joints that the robot file calls rigid.

    Args:
        robot: a preset or a robot.toml.
        arm: its model without these springs.

    Returns:
        The model with springs, with no more joints that bend than the other where no joint can carry one.

    Raises:
        PlantError: the model cannot be loaded.

    """
    return load(robot, "native", ("all", *arm.effects.series_springs))


def make_spring_simulator(
    flexible: Arm, seen: WindowedRecord, window: float, budget: TimeBudget | None = None
) -> MultipleShooting:
    """Make the simulator of a record on a model with springs, whose bounds are narrowed to stable ones.

    Args:
        flexible: the model with springs.
        seen: the record.
        window: length of a window, s.
        budget: the time of the diagnosis; none: no limit.

    Returns:
        The simulator.

    """
    _narrow_spring_bounds(flexible)
    record = cut_windows(flexible, LogPortion(seen.log, seen.visible_rows), window)
    return MultipleShooting(flexible, record, SEARCH.spring_step, budget or TimeBudget())


def _start_spring_fits(
    shooting: MultipleShooting, words: CandidateSet, found: SearchResult
) -> tuple[Sensitivities, list[Fit]]:
    """Start the fits with springs: the springs alone at each size, and beside the effects found, where the springs
    alone promise less than these have reached. Then the springs alone stay only if they promise a share of that
    gain, and of each set the starts that are not far behind its best one."""
    springs = tuple(k for k, atom in enumerate(words.members) if atom.traits.series_spring and atom.has_default_shapes)
    lead, near = sort_by_evidence(found.fits)[0], found.fits[0].score.posterior.s
    none = next((fit for fit in found.fits if not fit.effects), lead)
    beside = tuple(k for k, atom in enumerate(words.members) if atom.name in lead.names and atom.has_default_shapes)
    spring_fits: list[Fit] = []
    for size in SEARCH.spring_sizes:
        p = _set_springs(shooting.arm, words, springs, shooting.arm.p.copy(), size)
        at = compute_sensitivities(shooting, words, OperatingPoint(p, shooting.filtered_initial_states(p)))
        spring_fits.append(start_fit(at, words, springs, near))
    if not beside or max(fit.score.evidence for fit in spring_fits) >= lead.evidence_here:
        return at, drop_hopeless_starts(spring_fits)
    least = none.evidence_here + SEARCH.trailing_share * (lead.evidence_here - none.evidence_here)
    field = [fit for fit in spring_fits if fit.score.evidence >= least]
    both: list[Fit] = []
    for size in SEARCH.spring_sizes:
        p = _set_springs(shooting.arm, words, springs, _carry_over_parameters(shooting.arm, lead), size)
        both.append(
            start_fit(at, words, (*springs, *beside), near, OperatingPoint(p, shooting.filtered_initial_states(p)))
        )
    return at, [*drop_hopeless_starts(field), *drop_hopeless_starts(both)]


def _set_springs(flexible: Arm, words: CandidateSet, springs: tuple[int, ...], p: Array, size: float) -> Array:
    """Return the parameters (np) with springs at a size, within their bounds."""
    for c in words.columns:
        if c.candidate in springs:
            p[c.index] = c.center + size * c.unit
    return flexible.parameters.clip_to_bounds(p)


def _carry_over_parameters(flexible: Arm, lead: Fit) -> Array:
    """Return the parameters (np) of a model with springs at the point of a fit without."""
    fitted_values = dict(
        zip(lead.sensitivities.shooting.arm.parameters.described, lead.sensitivities.point.p, strict=True)
    )
    return np.array([fitted_values.get(name, q.nominal) for name, q in flexible.parameters.described.items()])


def _log_rigid_joints(flexible: Arm) -> None:
    """Log which joints with a rotor stay rigid even here, and the number that prevents a spring."""
    for j in range(1, flexible.n + 1):
        inertia = flexible.parameters[f"motor_inertia_{j}"]
        if j not in flexible.manifest["flexible"] and inertia:
            step = f"a step of {flexible.step_size:g} s carries no spring beside motor_inertia = {inertia:g} kg m²"
            LOGGER.info("joint %d stays rigid: %s", j, step)


def _narrow_spring_bounds(flexible: Arm) -> None:
    """Limit the springs and their damping to values that the step integrates stably."""
    described = flexible.parameters.described
    names = list(described)
    for place, (least, most) in flexible.stability.spring_bounds(SEARCH.spring_step).items():
        q = described[names[place]]
        low, high = min(max(q.low, least), q.nominal), max(min(q.high, most), q.nominal)
        described[names[place]] = replace(q, low=low, high=high)
