"""How long the solvers take on the closed loop of the table: all on the same problems, in turns, in one run.

Times are of the thread's processor, so that other programs count little; only ratios hold on another machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time_ns

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark.law_comparison import (
    CIRCLE_CENTER,
    CIRCLE_RADIUS,
    COURSE_WALLS,
    HARD_PUSHES,
    SECONDS_PER_TURN,
    make_table_configuration,
)
from hdagen.mpc.closed_loop_trial import Trial, run_trial
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors

TIMED_SECONDS = 7.0  # of closed loop
RICCATI, OSQP, INTERIOR = range(3)
OSQP_TOLERANCES = (1e-3, 1e-5)


@dataclass(frozen=True)
class SolverTimes:
    """µs of thread time: median, 90 %, 99 %, largest; iterations (mean, largest); share of solved."""

    name: str
    median: float
    p90: float
    p99: float
    largest: float
    iterations: float
    most_iterations: float
    solved: float
    apart: float  # of the first torque from riccati's, median, of the largest torque


@dataclass(frozen=True)
class MpcTiming:
    """All times. ``phases``: preparation, tick, both; ``active``: mean number of active rows by family;
    ``share``: of the period that p99 of the whole tick takes."""

    joints: int
    nodes: int
    samples: int
    phases: tuple[SolverTimes, ...]
    solvers: tuple[SolverTimes, ...]
    active: dict[str, float]
    interior_share: float
    share: float
    machine_quiet: float  # p99 over median of the time of equal short work: the share of the machine itself


def record_closed_loop(
    profile: str = "native", seconds: float = TIMED_SECONDS, c: Configuration | None = None
) -> tuple[Arm, Configuration, Trial]:
    """Record the closed loop of the table's second course, with every problem kept.

    Args:
        profile: Profile of the build.
        seconds: Length of the loop, s.
        c: The configuration; None: that of the table.

    Returns:
        The arm, its configuration, and the run.

    """
    c = c or make_table_configuration()
    arm = load("paper", profile, mpc=c)
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, seconds, float(c["mpc.period"]))
    pushes = [push for push in HARD_PUSHES if push.start < seconds]
    found = run_trial(arm, MPC(arm, c), path, pushes, Sensors(), COURSE_WALLS, seed=1, keep=True)
    return arm, c, found


class Solver:
    """One solver of a library, on a problem of its own."""

    def __init__(self, arm: Arm) -> None:
        module = arm.module
        self.problem = np.zeros(module.length("mpc_solve", "problem"))
        self.solution = np.zeros(module.length("mpc_solve", "solution"))
        work = np.zeros(module.length("mpc_solve", "work"), np.uint8)
        self.method, self.method_options, self.status = (
            np.zeros(1, np.int32),
            np.array([1e-3, 4000.0]),
            np.zeros(1, np.int32),
        )
        self._call = module.bind(
            "mpc_solve", self.problem, self.solution, work, self.method, self.method_options, self.status
        )

    def solve(
        self, problem: Array, which: int, start: Array | None = None, tolerance: float = 1e-3, cap: int = 4000
    ) -> int:
        """Solve a problem and time the call, whose length is in ``taken``, ns.

        Args:
            problem: The problem, as `mpc_solve` takes it.
            which: RICCATI, OSQP or INTERIOR.
            start: A solution to begin from; None: zeros.
            tolerance: Tolerance of OSQP.
            cap: Most iterations.

        Returns:
            The status; 0: solved.

        """
        self.problem[:], self.method[0], self.method_options[:] = problem, which, (tolerance, cap)
        self.solution[:] = 0.0
        if start is not None:
            self.solution[:] = start
        begun = thread_time_ns()
        self._call.run()
        self.elapsed_ns = thread_time_ns() - begun
        return int(self.status[0])


def time_solvers(
    profile: str = "native", seconds: float = TIMED_SECONDS, every: int = 5, say: Callable[[str], None] = lambda _: None
) -> MpcTiming:
    """Record the closed loop, then solve its problems again with every solver, in turns.

    Args:
        profile: Profile of the build.
        seconds: Length of the loop, s.
        every: Of how many ticks one problem is solved again.
        say: Hears how far the timing is.

    Returns:
        All times.

    """
    say("closed loop")
    arm, c, found = record_closed_loop(profile, seconds)
    n, nodes = arm.n, len(c.grid)
    chosen = range(1, len(found.problems), every)
    runs: dict[str, list[tuple[float, float, bool, float]]] = {}
    others = {f"osqp at {t:g}": (OSQP, t, Solver(arm)) for t in OSQP_TOLERANCES} | {
        "interior point alone": (INTERIOR, 1e-3, Solver(arm))
    }
    ours = Solver(arm)
    rows = len(arm.manifest["mpc"]["rows"])
    for count, k in enumerate(chosen):
        if count % 100 == 0:
            say(f"problem {count} of {len(chosen)}")
        problem = found.problems[k][0]
        before = _take_last_multipliers(found, k, nodes * (n + len(arm.manifest["mpc"]["state"])), nodes * rows)
        status = ours.solve(problem, RICCATI, before)
        first = ours.solution[:n].copy()
        runs.setdefault("riccati", []).append((ours.elapsed_ns, ours.solution[-2], status == 0, 0.0))
        for name, (which, tolerance, solver) in others.items():
            if name == "osqp at 1e-05" and count % 5:
                continue
            status = solver.solve(problem, which, None, tolerance)
            apart = float(np.abs(solver.solution[:n] - first).max())
            runs.setdefault(name, []).append((solver.elapsed_ns, solver.solution[-2], status == 0, apart))
    solvers = tuple(_summarize_times(name, values) for name, values in runs.items())
    return _build_timing(arm, c, found, solvers)


def _take_last_multipliers(found: Trial, k: int, at: int, rows: int) -> Array:
    """The solution of the tick before, whose multipliers the next one starts from."""
    start = np.zeros_like(found.problems[k][1])
    start[at : at + rows] = found.problems[k - 1][1][at : at + rows]
    return start


def _summarize_times(name: str, values: list[tuple[float, float, bool, float]]) -> SolverTimes:
    taken, iterations, solved, apart = (np.array(column, float) for column in zip(*values, strict=True))
    low, mid, high = np.quantile(taken / 1e3, [0.5, 0.9, 0.99])
    return SolverTimes(name, float(low), float(mid), float(high), float(taken.max() / 1e3), float(iterations.mean()),
                 float(iterations.max()), float(solved.mean()), float(np.median(apart)))  # fmt: skip


def _build_timing(arm: Arm, c: Configuration, found: Trial, solvers: tuple[SolverTimes, ...]) -> MpcTiming:
    times = 1e9 * found.times[10:]
    inner = np.array([r.interior for r in found.reports[10:]])
    solved = [r.solved == 0 for r in found.reports[10:]]
    parts = {"preparation": times[:, 0], "tick": times[:, 1], "both": times.sum(1)}
    zeros = [0.0] * len(times)
    phases = tuple(
        _summarize_times(name, list(zip(part, inner, solved, zeros, strict=True))) for name, part in parts.items()
    )
    active = {}
    for name in found.reports[0].active:
        active[name] = float(np.mean([r.active[name] for r in found.reports]))
    period = float(c["mpc.period"])
    return MpcTiming(
        arm.n,
        len(c.grid),
        len(times),
        phases,
        solvers,
        active,
        float((inner > 0).mean()),
        phases[2].p99 * 1e-6 / period,
        _measure_machine_noise(),
    )


def _measure_machine_noise() -> float:
    """p99 over median time of equal short work."""
    work, taken = np.ones(64), []
    for _ in range(2000):
        begun = thread_time_ns()
        for _ in range(20):
            work @ work
        taken.append(thread_time_ns() - begun)
    return float(np.quantile(taken, 0.99) / np.median(taken))


def format_timing(found: MpcTiming) -> list[str]:
    """Format the times for a terminal.

    Args:
        found: The times.

    Returns:
        Lines of text.

    """
    out = [
        f"{found.joints} joints, {found.nodes} nodes, {found.samples} ticks of closed loop; µs of thread time",
        f"(idle work on this machine now: p99 over median {found.machine_quiet:.1f})",
    ]
    heads = ("median", "p90", "p99", "largest", "iterations", "most", "solved", "|dT0|")
    out.append(f"{'':22}" + "".join(f"{head:>11}" for head in heads))
    for t in (*found.phases, *found.solvers):
        times = "".join(f"{value:11.1f}" for value in (t.median, t.p90, t.p99, t.largest, t.iterations))
        out.append(f"{t.name:22}{times}{t.most_iterations:11.0f}{t.solved:11.1%}{t.apart:11.1e}")
    active = ", ".join(f"{name} {value:.1f}" for name, value in found.active.items() if value >= 0.05)
    out.append(f"active rows on average: {active}")
    out.append(f"the interior point was needed in {found.interior_share:.0%} of the ticks")
    out.append(f"p99 of the whole tick takes {found.share:.0%} of the period")
    return out
