"""The bars of the predictive controller: everything measured in one go, each figure beside what it has to reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hdagen.mpc.benchmark import law_comparison as comparison
from hdagen.mpc.benchmark import scaling, sqp_convergence
from hdagen.mpc.benchmark import solver_timing as timing
from hdagen.mpc.benchmark.law_comparison import Comparison, RandomRun
from hdagen.mpc.benchmark.scaling import BoxTiming, Scaling
from hdagen.mpc.benchmark.solver_timing import MpcTiming
from hdagen.mpc.benchmark.sqp_convergence import LoopCosts

RANDOM_RUNS = 20  # random runs, unless told otherwise


@dataclass(frozen=True)
class MpcRequirement:
    """A figure beside the number that it has to reach at ``kind`` "least" or "most"."""

    name: str
    kind: str
    asked: float
    reached: float

    @property
    def is_met(self) -> bool:
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
class MpcBenchResult:
    """All measurements; those that a quick run leaves out are None or empty."""

    timing: MpcTiming
    scaling: Scaling | None
    box: BoxTiming | None
    loops: tuple[LoopCosts, ...]
    comparison: Comparison | None
    runs: tuple[RandomRun, ...]
    bars: tuple[MpcRequirement, ...]


def run_mpc_bench(profile: str, quick: bool, runs: int, say: Callable[[str], None]) -> MpcBenchResult:
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
        timed = timing.time_solvers(profile, 3.0, 10, say)
        return MpcBenchResult(timed, None, None, (), None, (), _judge_timing(timed))
    timed = timing.time_solvers(profile, 8.0, 5, say)
    sizes, boxed = scaling.measure_scaling(profile, say), scaling.time_torque_box(profile)
    loops = sqp_convergence.compare_loop_costs(profile, say)
    compared, driven = comparison.compare_controllers(profile, say), []
    for one in comparison.drive_random_runs(runs, compared.tuned.gains, profile):
        driven.append(one)
        say(f"random run {len(driven)} of {runs}")
    bars = (*_judge_timing(timed), *_judge_scaling(sizes), *_judge_loops(loops, compared, tuple(driven)))
    return MpcBenchResult(timed, sizes, boxed, loops, compared, tuple(driven), bars)


def _judge_timing(found: MpcTiming) -> tuple[MpcRequirement, ...]:
    whole, by_name = found.phases[2], {t.name: t for t in found.solvers}
    return (
        MpcRequirement(
            "osqp at 1e-3 over riccati", "least", 10.0, by_name["osqp at 0.001"].median / by_name["riccati"].median
        ),
        MpcRequirement("p99 of a tick over its median", "most", 6.0, whole.p99 / whole.median),
        MpcRequirement("active rows on average", "least", 10.0, sum(found.active.values())),
    )


def _judge_scaling(found: Scaling) -> tuple[MpcRequirement, ...]:
    nodes = max(by_nodes for by_nodes, _ in found.exponents.values())
    joints = max(by_joints for _, by_joints in found.exponents.values())
    return (
        MpcRequirement("exponent of the cost in nodes", "most", scaling.MOST_NODE_EXPONENT, nodes),
        MpcRequirement("exponent of the cost in joints", "most", scaling.MOST_JOINT_EXPONENT, joints),
    )


def _judge_loops(
    loops: tuple[LoopCosts, ...], found: Comparison, runs: tuple[RandomRun, ...]
) -> tuple[MpcRequirement, ...]:
    out = [
        MpcRequirement(
            "closed loop over the converged problem's",
            "most",
            sqp_convergence.MOST_EXTRA_COST,
            max(loop.more for loop in loops),
        )
    ]
    free = {name: float(np.median(values)) for name, values in found.free.items()}
    out.append(
        MpcRequirement(
            f"distance over the admittance law's, no limit near, median of {comparison.NOISE_SEED_COUNT} seeds",
            "most",
            1.0,
            free["mpc"] / free[comparison.COMPARED_LAWS[1]],
        )
    )
    if runs:
        ratios = np.array([one.free.distance / one.admittance.distance for one in runs])
        out += [
            MpcRequirement(f"the same, median of {len(runs)} random runs", "most", 1.0, float(np.median(ratios))),
            MpcRequirement("the same, largest", "most", 1.1, float(ratios.max())),
            MpcRequirement(
                "random runs with legal inputs, share", "least", 1.0, float(np.mean([one.legal for one in runs]))
            ),
            MpcRequirement(
                "random runs with soft limits kept, share", "least", 1.0, float(np.mean([one.kept for one in runs]))
            ),
        ]
    return tuple(out)


def format_mpc_bench(found: MpcBenchResult) -> list[str]:
    """Format all measurements for a terminal.

    Args:
        found: The measurements.

    Returns:
        Lines of text.

    """
    out = timing.format_timing(found.timing)
    if found.scaling is not None and found.box is not None:
        out += scaling.format_scaling(found.scaling, found.box)
    if found.loops:
        out += sqp_convergence.format_loop_costs(found.loops)
    if found.comparison:
        out += comparison.format_comparison(found.comparison, found.runs)
    for bar in found.bars:
        verdict = "met"
        if not bar.is_met:
            verdict = f"missed by {bar.missed_by:.0%}"
        out.append(f"bar: {bar.name} at {bar.kind} {bar.asked:g}: {bar.reached:.3g}, {verdict}")
    return out
