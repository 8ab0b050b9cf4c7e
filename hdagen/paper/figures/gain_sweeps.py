"""Closed loops of thousands of sets of M, B, K on the prototype, controller and sensors in the compiled batch: settling
time, overshoot and largest displacement of each."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import groupby, pairwise

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.compliance_figures import PUSHED_SECONDS
from hdagen.paper.prototype.step_response import RESPONSE_MEASURES, damping_ratio, measure_responses, simulate_ideal
from hdagen.paper.prototype.virtual_prototype import (
    CIRCLE_PUSHES,
    PERIOD,
    Bench,
    fine_sensors,
    make_controller,
    paper_circle,
)
from hdagen.simulation.batch_closed_loop import closed_loops

SWEPT_RANGES = {"M": (0.5, 32.0), "B": (5.0, 500.0), "K": (200.0, 2000.0)}  # kg, N s/m, N/m
GRID_SHAPE = (16, 25, 25)  # 10 000 sets
DAMPING_REGIONS = {
    "under-damped": (0.0, 0.7),
    "near critical": (0.7, 1.4),
    "over-damped": (1.4, np.inf),
}  # damping ratio
RATIO_EDGES = np.geomspace(0.05, 8.0, 15)  # of damping ratio
LEAST_KEEPING_SHARE = 0.9  # share of neighbouring sets from which a claim holds
IDEAL_BATCH, IDEAL_PERIOD = 2000, 0.01  # sets of the ideal in a batch; s between its rows, at which it is exact


@dataclass(frozen=True)
class Sweep:
    """A grid of sets: ``M``, ``B``, ``K`` each (m, b, k); responses (m, b, k, axes, 3) of arm and ideal; duration of
    the arm's runs by the clock and of all processors, s."""

    M: Array
    B: Array
    K: Array
    arm_responses: Array
    ideal_responses: Array
    seconds: float
    processor_seconds: float

    @property
    def ratio(self) -> Array:
        """Damping ratio of each set (m, b, k)."""
        return damping_ratio(self.M, self.B, self.K)


def sweep_map(bench: Bench, law: str) -> Sweep:
    """Sweep the grid of a law's map.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".

    Returns:
        The sweep of SHAPE; each is simulated once a bench.

    """
    return bench.compute_once(("swept", law), partial(sweep_grid, bench, law, GRID_SHAPE))


def sweep_grid(bench: Bench, law: str, shape: tuple[int, int, int]) -> Sweep:
    """Run every set of a grid: 10 s each at 1 kHz, with encoders of 4096 counts, the same pushes and noise for all.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".
        shape: numbers of values of M, B and K.

    Returns:
        The responses of arm and ideal.

    """
    sides = [np.geomspace(*SWEPT_RANGES[letter], count) for letter, count in zip("MBK", shape, strict=True)]
    M, B, K = np.meshgrid(*sides, indexing="ij")
    path, arm = paper_circle(PUSHED_SECONDS), bench.lean_arm()
    gains = {
        f"{name}_{axis}": grid.ravel()
        for name, grid in (("mass", M), ("damping", B), ("stiffness", K))
        for axis in "xy"
    }
    law_of = make_controller(arm, law, fine=True)

    def judge(tip: Array, _: Array) -> Array:
        return measure_responses(tip - path.position[:, None], CIRCLE_PUSHES, PERIOD).reshape(tip.shape[1], -1)

    begun, worked = time.perf_counter(), time.process_time()
    found = closed_loops(arm, law_of, path, gains, judge, CIRCLE_PUSHES, fine_sensors(), seed=1, threads=bench.threads)
    took = time.perf_counter() - begun, time.process_time() - worked
    ideal = bench.compute_once(
        ("ideal", shape), partial(_sweep_ideal, np.stack([M.ravel(), B.ravel(), K.ravel()], axis=1))
    )
    size = (*shape, len(CIRCLE_PUSHES), len(RESPONSE_MEASURES))
    return Sweep(M, B, K, found.reshape(size), ideal.reshape(size), *took)


def _sweep_ideal(sets: Array) -> Array:
    """Responses (W, axes, 3) of the ideal with ``sets`` (W, 3) of M, B, K, the same for every law."""
    parts = np.array_split(sets, max(1, len(sets) // IDEAL_BATCH))
    return np.concatenate(
        [
            measure_responses(
                simulate_ideal(part, CIRCLE_PUSHES, PUSHED_SECONDS, IDEAL_PERIOD), CIRCLE_PUSHES, IDEAL_PERIOD
            )
            for part in parts
        ]
    )


def mean_exponents(sweep: Sweep, table: Array, measure: str) -> dict[str, dict[str, float]]:
    """Compute the mean exponents of M, B and K in a measure of the push in x.

    Args:
        sweep: the grid.
        table: responses (m, b, k, axes, 3) of its arm or of its ideal.
        measure: one of MEASURES.

    Returns:
        Exponents by letter and region; at −1 doubling the letter halves the measure. A mean, as the settling time moves
        in steps of half a swing; NaN where too few sets have the measure.

    """
    found: dict[str, dict[str, float]] = {}
    for letter in "MBK":
        slope = _log_slopes(sweep, table, letter, measure)
        found[letter] = {}
        for region, (low, high) in DAMPING_REGIONS.items():
            inside = slope[(sweep.ratio >= low) & (sweep.ratio < high) & np.isfinite(slope)]
            found[letter][region] = float("nan")
            if len(inside) > 20:
                found[letter][region] = float(np.mean(inside))
    return found


def _log_slopes(sweep: Sweep, table: Array, letter: str, measure: str) -> Array:
    """d log measure / d log letter at every set (m, b, k), NaN where the measure is too small."""
    axis, values = "MBK".index(letter), table[..., 0, RESPONSE_MEASURES.index(measure)]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(np.where(values > 1e-4, values, np.nan))
    side = np.log(np.moveaxis(getattr(sweep, letter), axis, 0)[:, 0, 0])
    slopes: Array = np.gradient(logs, side, axis=axis)
    return slopes


def exponents_by_ratio(sweep: Sweep, table: Array, letter: str, measure: str) -> list[tuple[float, float]]:
    """Compute the mean exponent of a letter in a measure of the push in x, by damping ratio.

    Args:
        sweep: the grid.
        table: responses (m, b, k, axes, 3) of its arm or of its ideal.
        letter: "M", "B" or "K".
        measure: one of MEASURES.

    Returns:
        Damping ratio and exponent of each class of damping ratio with enough sets.

    """
    slope = _log_slopes(sweep, table, letter, measure)
    found = []
    for low, high in pairwise(RATIO_EDGES):
        inside = slope[(sweep.ratio >= low) & (sweep.ratio < high) & np.isfinite(slope)]
        if len(inside) >= 10:
            found.append((float(np.sqrt(low * high)), float(np.mean(inside))))
    return found


def share_that_keeps(sweep: Sweep, letter: str, measure: str, sign: int) -> list[tuple[float, float]]:
    """Compute the share of neighbouring sets that keep a claim, by damping ratio.

    Args:
        sweep: the grid.
        letter: "M", "B" or "K", along which sets are neighbours.
        measure: one of MEASURES.
        sign: 1 where the measure has to grow with the letter, -1 where it has to fall.

    Returns:
        Damping ratio and share of each class of damping ratio. Changes below a tenth of a percent keep the claim. A run
        that never settles counts as the last to settle; a lost arm does not count.

    """
    axis, values = "MBK".index(letter), sweep.arm_responses[..., 0, RESPONSE_MEASURES.index(measure)]
    lost = np.isnan(sweep.arm_responses[..., 0, RESPONSE_MEASURES.index("largest")])
    values = np.where(np.isnan(values) & ~lost, np.inf, values)
    with np.errstate(invalid="ignore"):  # of two runs that never settle neither is first
        step = np.diff(values, axis=axis)
    usual = float(np.median(values[np.isfinite(values)]))
    middle = np.moveaxis(sweep.ratio, axis, 0)
    ratio = np.moveaxis(np.sqrt(middle[1:] * middle[:-1]), 0, axis)
    found = []
    for low, high in pairwise(RATIO_EDGES):
        inside = (ratio >= low) & (ratio < high) & ~np.isnan(step)
        if inside.sum() >= 10:
            keeps = sign * step[inside] > -1e-3 * usual
            found.append((float(np.sqrt(low * high)), float(keeps.mean())))
    return found


def _nine_in_ten(share: float) -> bool:
    return share >= LEAST_KEEPING_SHARE


def longest_range_that_keeps(
    shares: list[tuple[float, float]], keeps: Callable[[float], bool] = _nine_in_ten
) -> tuple[float, float] | None:
    """Find the longest range of damping ratios whose classes all keep a claim.

    Args:
        shares: damping ratio and share, or exponent, of each class.
        keeps: tells whether a class keeps the claim; by default nine of ten neighbours have to.

    Returns:
        Damping ratios at the ends of the range; None where no class keeps the claim.

    """
    runs = [list(run) for kept, run in groupby(shares, lambda one: keeps(one[1])) if kept]
    if not runs:
        return None
    longest = max(runs, key=len)
    return longest[0][0], longest[-1][0]
