"""The solvers of the predictive controller against the installed OSQP, against each other, and against malice."""

from __future__ import annotations

from threading import Thread

import numpy as np
import pytest
from mpc_arms import WALLS, built
from mpc_problems import FREE, Sizes, by_daqp, by_osqp, condensed, price, random_problem

from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark.solver_timing import INTERIOR, OSQP, RICCATI, Solver
from hdagen.mpc.closed_loop_trial import run_trial
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

SOLVED, CAPPED, REFUSED, BUSY = 0, 1, -1, -3


def sizes_of(arm: Arm) -> Sizes:
    m = arm.manifest["mpc"]
    nx, rows = len(m["state"]), len(m["rows"])
    return Sizes(arm.n, nx, m["nodes"], rows - 4 * arm.n, tuple(m["simple"]))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return built()[0]


@pytest.mark.parametrize("seed", range(12))
def test_the_first_torque_is_that_of_osqp_to_a_millionth(arm: Arm, seed: int) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    problem = random_problem(sizes, np.random.default_rng(seed))
    status = solver.solve(problem, RICCATI)
    T = solver.solution[: sizes.nodes * sizes.n].reshape(-1, sizes.n).copy()
    truth = by_osqp(sizes, problem)
    if truth is not None and status == SOLVED:
        assert np.abs(T[0] - truth[0]).max() < 1e-6
        assert price(sizes, problem, T) <= price(sizes, problem, truth) + 1e-6
    assert status in (SOLVED, CAPPED)


def test_the_first_torque_is_that_of_daqp_on_a_closed_loop() -> None:
    """Every tenth problem of a loop pushed hard against its limits, cold and from the last solution."""
    pytest.importorskip("daqp", reason="daqp is not installed; pip install -e '.[test]' brings it")
    arm, c = built()
    sizes, solver = sizes_of(arm), Solver(arm)
    path = circle(0.05, (0.2, 0.0), 5.0, 0.8)
    found = run_trial(arm, MPC(arm, c), path, [Push(0.2, 0.6, (25.0, 10.0))], Sensors(), WALLS, seed=1, keep=True)
    active, warm = [], 0
    for k in range(150, 800, 10):
        problem, solution = found.problems[k]
        truth = by_daqp(sizes, problem)
        assert truth is not None
        statuses = []
        for start in (None, solution):
            statuses.append(solver.solve(problem, RICCATI, start))
            assert np.abs(solver.solution[: sizes.n] - truth[0]).max() < 1e-6, k
        assert statuses == [SOLVED, SOLVED]
        warm += solver.solution[-2] == 0
        active.append(solver.solution[-1])
    assert np.mean(active) > 10
    assert warm > 30


def test_the_first_torque_is_that_of_osqp_on_a_closed_loop() -> None:
    """OSQP at 1e-9, absolute, on cost a hundred times as large: at rest, pushed against every limit, and released."""
    arm, c = built()
    sizes, solver = sizes_of(arm), Solver(arm)
    path = circle(0.05, (0.2, 0.0), 5.0, 0.8)
    found = run_trial(arm, MPC(arm, c), path, [Push(0.2, 0.6, (25.0, 10.0))], Sensors(), WALLS, seed=1, keep=True)
    solved = 0
    for k in (140, 260, 620, 700):
        problem, _ = found.problems[k]
        truth = by_osqp(sizes, problem, relative=False, more=100.0)
        assert solver.solve(problem, RICCATI) == SOLVED
        if truth is not None:
            solved += 1
            assert np.abs(solver.solution[: sizes.n] - truth[0]).max() < 1e-6, k
    assert solved >= 3


def test_most_random_problems_are_solved(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    statuses = [solver.solve(random_problem(sizes, np.random.default_rng(seed)), RICCATI) for seed in range(100, 160)]
    assert np.mean([status == SOLVED for status in statuses]) > 0.9


def test_a_warm_start_ends_at_the_same_solution_with_less_work(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    cold, warm = [], []
    for seed in range(20):
        problem = random_problem(sizes, np.random.default_rng(seed))
        if solver.solve(problem, INTERIOR) != SOLVED:
            continue
        known = solver.solution.copy()
        cold.append(known[-3])
        solver.solve(problem, RICCATI, known)
        warm.append(solver.solution[-3])
        assert np.abs(solver.solution[: sizes.n] - known[: sizes.n]).max() < 1e-6
    assert len(cold) > 10
    assert np.median(warm) < 0.5 * np.median(cold)


def test_embedded_osqp_solves_the_same_problem(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    compared = 0
    for seed in range(12):
        problem = random_problem(sizes, np.random.default_rng(seed))
        if solver.solve(problem, RICCATI) != SOLVED:
            continue
        ours = solver.solution[: sizes.n].copy()
        if solver.solve(problem, OSQP, None, 1e-7, 100_000) == SOLVED:
            compared += 1
            assert np.abs(solver.solution[: sizes.n] - ours).max() < 1e-3
    assert compared > 5


@pytest.mark.parametrize("which", [RICCATI, OSQP, INTERIOR])
@pytest.mark.parametrize(
    "malice", ["nan", "infinite", "huge", "crossed", "negative weight", "negative penalty", "soft input"]
)
def test_what_cannot_be_solved_with_is_refused_and_the_solution_stays(arm: Arm, which: int, malice: str) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    problem = random_problem(sizes, np.random.default_rng(1))
    q = sizes.split(problem)
    match malice:
        case "nan":
            q["A"][3, 1, 2] = np.nan
        case "infinite":
            q["h"][0, 0] = np.inf
        case "huge":
            q["first"][0] = 1e30
        case "crossed":
            q["low"][2, 5], q["high"][2, 5] = 1.0, -1.0
        case "negative weight":
            q["R"][1, 0] = -1.0
        case "negative penalty":
            q["linear"][1, -1] = -1.0
        case "soft input":
            q["linear"][0, 0] = 1.0
    start = np.full_like(solver.solution, 0.25)
    assert solver.solve(problem, which, start) == REFUSED
    assert np.array_equal(solver.solution, start)


def test_after_a_refused_problem_osqp_is_not_poisoned(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    problem = random_problem(sizes, np.random.default_rng(2))
    assert solver.solve(problem, OSQP, None, 1e-5, 50_000) == SOLVED
    first = solver.solution[: sizes.n].copy()
    broken = problem.copy()
    sizes.split(broken)["h"][0, 0] = np.nan
    assert solver.solve(broken, OSQP) == REFUSED
    assert solver.solve(problem, OSQP, None, 1e-5, 50_000) == SOLVED
    assert np.abs(solver.solution[: sizes.n] - first).max() < 1e-2
    assert np.isfinite(solver.solution).all()
    assert np.abs(solver.solution).max() < 1e8  # never OSQP's number for no solution


def test_out_of_iterations_is_not_called_solved(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    problem = random_problem(sizes, np.random.default_rng(3))
    status = solver.solve(problem, OSQP, None, 1e-9, 5)
    assert status != SOLVED
    if status == CAPPED:
        q = sizes.split(problem)
        T = solver.solution[: sizes.nodes * sizes.n].reshape(-1, sizes.n)
        assert (q["high"][:, : sizes.n] >= T).all()
        assert (q["low"][:, : sizes.n] <= T).all()


def test_an_unlimited_problem_is_solved_by_one_factorisation(arm: Arm) -> None:
    sizes, solver = sizes_of(arm), Solver(arm)
    problem = random_problem(sizes, np.random.default_rng(4))
    q = sizes.split(problem)
    q["low"][:], q["high"][:] = -2 * FREE, 2 * FREE
    assert solver.solve(problem, RICCATI) == SOLVED
    assert solver.solution[-3] == 1
    P, g, _, _ = condensed(sizes, q)
    T = np.linalg.solve(P, -g)
    assert np.abs(solver.solution[: T.size] - T).max() < 1e-8 * max(1.0, np.abs(T).max())


def test_two_controllers_share_the_embedded_osqp_in_turns_and_a_thread_is_turned_away_in_between(arm: Arm) -> None:
    """Its workspace is one for the process: what one controller left does not change what another finds, and a thread
    that comes while another is in it is told so at once."""
    sizes = sizes_of(arm)
    one, other = (random_problem(sizes, np.random.default_rng(seed)) for seed in (2, 5))
    first, second = Solver(arm), Solver(arm)
    assert first.solve(one, OSQP, None, 1e-5, 50_000) == SOLVED
    alone = first.solution.copy()
    assert second.solve(other, OSQP, None, 1e-5, 50_000) == SOLVED
    assert Solver(arm).solve(one, OSQP, None, 1e-5, 50_000) == SOLVED
    statuses: list[int] = []

    def race(solver: Solver, problem: object) -> None:
        for _ in range(60):
            statuses.append(solver.solve(problem, OSQP, None, 1e-9, 3000))  # type: ignore[arg-type]

    threads = [Thread(target=race, args=pair) for pair in ((first, one), (second, other))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(statuses) <= {SOLVED, CAPPED, BUSY}
    assert first.solve(one, OSQP, None, 1e-5, 50_000) == SOLVED
    assert np.abs(first.solution[: sizes.n] - alone[: sizes.n]).max() < 1e-2
