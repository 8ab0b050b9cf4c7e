"""The bars of the predictive controller: everything measured in one go, each figure beside what it has to reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdagen.mpc.benchmark import law_comparison as comparison
from hdagen.mpc.benchmark import scaling, sqp_convergence
from hdagen.mpc.benchmark import solver_timing as timing
from hdagen.mpc.benchmark.law_comparison import Comparison, RandomRun
from hdagen.mpc.benchmark.scaling import Box, Scaling
from hdagen.mpc.benchmark.solver_timing import Timing
from hdagen.mpc.benchmark.sqp_convergence import Loop

RUNS = 20  # random runs, unless told otherwise


@dataclass(frozen=True)
class Bar:
    """A figure beside the number that it has to reach at ``kind`` "least" or "most"."""

    name: str
    kind: str
    asked: float
    reached: float

    @property
    def met(self) -> bool:
        """Whether the figure meets the bar."""
        if self.kind == "least":
            return self.reached >= self.asked
        return self.reached <= self.asked

    @property
    def missed_by(self) -> float:
        """Share of the bar by which the figure misses it."""
        if self.kind == "most":
            return self.reached / self.asked - 1
        if self.reached:
            return self.asked / self.reached - 1
        return float("inf")


@dataclass(frozen=True)
class Bench:
    """All measurements; those that a quick run leaves out are None or empty."""

    timing: Timing
    scaling: Scaling | None
    box: Box | None
    loops: tuple[Loop, ...]
    comparison: Comparison | None
    runs: tuple[RandomRun, ...]
    bars: tuple[Bar, ...]


def bench(profile: str, quick: bool, runs: int, say: Callable[[str], None]) -> Bench:
    """Measure the predictive controller and judge it by its bars.

    Args:
        profile: Profile of the builds, "portable" or "native".
        quick: Whether only the solvers are timed, on a shorter loop.
        runs: Count of random runs.
        say: Hears the name of each measurement as it begins.

    Returns:
        All measurements and bars.

    Raises:
        PlantError: A build fails, or a closed loop is refused.

    """
    if quick:
        timed = timing.bench(profile, 3.0, 10, say)
        return Bench(timed, None, None, (), None, (), _timed(timed))
    timed = timing.bench(profile, 8.0, 5, say)
    sizes, boxed = scaling.scaling(profile, say), scaling.box(profile)
    loops = sqp_convergence.loops(profile, say)
    compared, driven = comparison.compare(profile, say), []
    for one in comparison.random_runs(runs, compared.tuned.gains, profile):
        driven.append(one)
        say(f"random run {len(driven)} of {runs}")
    bars = (*_timed(timed), *_grown(sizes), *_followed(loops, compared, tuple(driven)))
    return Bench(timed, sizes, boxed, loops, compared, tuple(driven), bars)


def _timed(found: Timing) -> tuple[Bar, ...]:
    whole, by_name = found.phases[2], {t.name: t for t in found.solvers}
    return (
        Bar("osqp at 1e-3 over riccati", "least", 10.0, by_name["osqp at 0.001"].median / by_name["riccati"].median),
        Bar("p99 of a tick over its median", "most", 6.0, whole.p99 / whole.median),
        Bar("active rows on average", "least", 10.0, sum(found.active.values())),
    )


def _grown(found: Scaling) -> tuple[Bar, ...]:
    nodes = max(by_nodes for by_nodes, _ in found.exponents.values())
    joints = max(by_joints for _, by_joints in found.exponents.values())
    return (
        Bar("exponent of the cost in nodes", "most", scaling.LINEAR, nodes),
        Bar("exponent of the cost in joints", "most", scaling.CUBIC, joints),
    )


def _followed(loops: tuple[Loop, ...], found: Comparison, runs: tuple[RandomRun, ...]) -> tuple[Bar, ...]:
    out = [
        Bar("closed loop over the converged problem's", "most", sqp_convergence.BAR, max(loop.more for loop in loops))
    ]
    free = {name: float(np.median(values)) for name, values in found.free.items()}
    out.append(
        Bar(
            f"distance over the admittance law's, no limit near, median of {comparison.SEEDS} seeds",
            "most",
            1.0,
            free["mpc"] / free[comparison.LAWS[1]],
        )
    )
    if runs:
        ratios = np.array([one.free.distance / one.admittance.distance for one in runs])
        out += [
            Bar(f"the same, median of {len(runs)} random runs", "most", 1.0, float(np.median(ratios))),
            Bar("the same, largest", "most", 1.1, float(ratios.max())),
            Bar("random runs with legal inputs, share", "least", 1.0, float(np.mean([one.legal for one in runs]))),
            Bar("random runs with soft limits kept, share", "least", 1.0, float(np.mean([one.kept for one in runs]))),
        ]
    return tuple(out)


def lines(found: Bench) -> list[str]:
    """Format all measurements for a terminal.

    Args:
        found: The measurements.

    Returns:
        Lines of text.

    """
    out = timing.lines(found.timing)
    if found.scaling is not None and found.box is not None:
        out += scaling.lines(found.scaling, found.box)
    if found.loops:
        out += sqp_convergence.lines(found.loops)
    if found.comparison:
        out += comparison.lines(found.comparison, found.runs)
    for bar in found.bars:
        verdict = "met"
        if not bar.met:
            verdict = f"missed by {bar.missed_by:.0%}"
        out.append(f"bar: {bar.name} at {bar.kind} {bar.asked:g}: {bar.reached:.3g}, {verdict}")
    return out
