"""Impedance, admittance and predictive control on the paper's circle with pushes and against a wall: one table, and the
same over random runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference, circle
from hdagen.mpc.benchmark.admittance_tuning import TUNING_METHOD, TunedGains, tune_admittance
from hdagen.mpc.closed_loop_trial import Trial, TrialOutcome, evaluate_trial, run_trial
from hdagen.mpc.configuration import Configuration, check_configuration, list_admittance_gains, resolve_limits
from hdagen.mpc.impact import SuddenForceResponse, measure_sudden_force
from hdagen.mpc.impact import format_sudden_force as jolted
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.wall import Wall
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

NOISE_SEED_COUNT = 8
CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, COURSE_SECONDS = 0.05, (0.2, 0.0), 5.0, 8.0  # of the circle: m, m, s, s
COMPARED_LAWS = ("impedance_cartesian", "admittance_cartesian")
FREE_PUSHES = (Push(3.0, 4.0, (15.0, 0.0)), Push(6.0, 7.0, (0.0, 15.0)))  # the paper's Fig. 11
HARD_PUSHES = (Push(1.0, 2.0, (25.0, 0.0)), Push(3.0, 4.0, (0.0, 25.0)), Push(5.0, 6.5, (30.0, 15.0)))
COURSE_WALLS = (Wall((1.0, 0.0), 0.265, 2e4, 20.0), Wall((0.0, 1.0), 0.07))  # a surface that bears 20 N, and a fixture
SUDDEN_SPEED = 0.035  # m/s: half of the most that `jolt` finds for SUDDEN_FORCE on the circle
SUDDEN_FORCE = 30.0  # N
ALLOWED_EXCESS = {"joint_position": 0.005, "wall": 1e-3}  # rad, m; of speeds and torques SHARE
ALLOWED_SHARE = 0.02
RANDOM_DELAYS, PARAMETER_SPREAD, PUSH_SIZES = (1, 3), 0.1, (5.0, 30.0)  # ticks; of parameters; N
VARIED_PARAMETERS = (
    "mass",
    "inertia",
    "motor_inertia",
    "coulomb_friction",
    "viscous_friction",
    "flexspline_stiffness",
    "torsional_damping",
)


@dataclass(frozen=True)
class CourseResult:
    """One controller on one course."""

    course: str
    controller: str
    outcome: TrialOutcome


@dataclass(frozen=True)
class Comparison:
    """The table, and how the admittance law was tuned. ``free``: by controller, the distances from the ideal motion
    where no limit is near, m, one for each seed of the sensors' noise."""

    rows: tuple[CourseResult, ...]
    free: Mapping[str, tuple[float, ...]]
    tuned: TunedGains
    configuration: Configuration
    jolt: SuddenForceResponse


@dataclass(frozen=True)
class RandomRun:
    """One random run: the predictive controller among its limits, and both controllers with no limit near."""

    seed: int
    delay: int
    predictive: TrialOutcome
    free: TrialOutcome
    admittance: TrialOutcome
    legal: bool
    kept: bool


def make_courses(
    c: Configuration,
) -> Iterator[tuple[str, Reference, tuple[Push, ...], tuple[Wall, ...], Configuration]]:
    """Make the courses of the table.

    Args:
        c: The configuration, whose limits each course narrows or widens.

    Yields:
        Name, path, pushes, walls of the world, and the configuration of the course.

    """
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, COURSE_SECONDS, float(c["mpc.period"]))
    away = tuple(replace(wall, offset=10.0) for wall in COURSE_WALLS)
    yield "circle, pushed, no limit near", path, FREE_PUSHES, (), c.with_changes(away, limits__tip_speed=1.0)
    yield "circle, pushed hard, wall", path, HARD_PUSHES, COURSE_WALLS, c.with_changes(COURSE_WALLS)


def make_table_configuration() -> Configuration:
    """Make the configuration of the table: two walls, a tip that moves at most 0.15 m/s, defaults otherwise.

    Returns:
        The configuration.

    """
    return check_configuration({"limits": {"tip_speed": 0.15, "sudden": SUDDEN_SPEED}}, "table").with_changes(
        COURSE_WALLS
    )


def compare_controllers(
    profile: str = "native", say: Callable[[str], None] = lambda _: None, evaluations: int = 40
) -> Comparison:
    """Drive both courses with each of the three controllers.

    Args:
        profile: Profile of the build, "portable" or "native".
        say: Hears the name of each run as it begins.
        evaluations: Runs that the tuning of the admittance law may take.

    Returns:
        The table.

    Raises:
        PlantError: A build fails, or a controller refuses its configuration.

    """
    c = make_table_configuration()
    say("building")
    arm = load("paper", profile, mpc=c)
    predictive = MPC(arm, c)
    guard = predictive.guard
    controllers: dict[str, Controller] = {
        name: Controller(arm, name, guard, list_admittance_gains(arm.robot, c)) for name in COMPARED_LAWS
    }
    say("tuning the admittance law's inner loop")
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, 4.0, float(c["mpc.period"]))
    pushes = (Push(1.0, 2.0, (15.0, 0.0)), Push(2.5, 3.0, (0.0, 15.0)))
    tuned = tune_admittance(arm, c, controllers[COMPARED_LAWS[1]], path, pushes, Sensors(), evaluations)
    rows = []
    for course, way, shoves, walls, limits in make_courses(c):
        predictive.configure_with(limits)
        for name, controller in {**controllers, "mpc": predictive}.items():
            say(f"{course}: {name}")
            found = run_trial(arm, controller, way, shoves, Sensors(), walls, seed=1)
            rows.append(CourseResult(course, name, evaluate_trial(arm, limits, way, found, controller)))
    free = _measure_free_distances(arm, c, {**controllers, "mpc": predictive}, say)
    return Comparison(tuple(rows), free, tuned, c, measure_sudden_force(arm, path.position[::250], SUDDEN_FORCE))


def _measure_free_distances(
    arm: Arm, c: Configuration, controllers: Mapping[str, Controller], say: Callable[[str], None]
) -> dict[str, tuple[float, ...]]:
    _, way, pushes, walls, limits = next(make_courses(c))
    """Median distances from the ideal motion where no limit is near, m, by controller, for each seed of the noise."""
    out = {}
    for name, controller in controllers.items():
        say(f"other noise: {name}")
        if isinstance(controller, MPC):
            controller.configure_with(limits)
        runs = [
            run_trial(arm, controller, way, pushes, Sensors(), walls, seed) for seed in range(1, NOISE_SEED_COUNT + 1)
        ]
        out[name] = tuple(evaluate_trial(arm, limits, way, found, controller).distance for found in runs)
    return out


@dataclass(frozen=True)
class RandomRunBench:
    """What random runs share: the arm that controllers believe, the plant whose parameters vary, both controllers, the
    configuration among limits and the one far from them, and the path."""

    arm: Arm
    plant: Arm
    predictive: MPC
    admittance: Controller
    near: Configuration
    far: Configuration
    path: Reference


def make_random_bench(tuned: Mapping[str, float], profile: str, out: Path | None = None) -> RandomRunBench:
    """Build what random runs share.

    Args:
        tuned: Gains of the admittance law.
        profile: Profile of the builds.
        out: Folder of the builds; None: the usual one.

    Returns:
        Arms, controllers, configurations and path.

    Raises:
        PlantError: A build fails, or a controller refuses its configuration.

    """
    c = make_table_configuration()
    arm, plant = (load("paper", profile, out=out, mpc=c) for _ in range(2))
    far = c.with_changes(
        tuple(replace(w, offset=10.0) for w in COURSE_WALLS), limits__tip_speed=1.0, limits__sudden=0.0
    )
    predictive = MPC(arm, c)
    admittance = Controller(arm, COMPARED_LAWS[1], predictive.guard, list_admittance_gains(arm.robot, c) | dict(tuned))
    path = circle(CIRCLE_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, 4.0, float(c["mpc.period"]))
    return RandomRunBench(arm, plant, predictive, admittance, c, far, path)


def drive_random_run(bench: RandomRunBench, seed: int) -> RandomRun:
    """Drive one random run: sizes of pushes, parameters off by up to 10 %, sensor noise, and a delay of 1 to 3 ticks of
    which the stamps tell the controller.

    Args:
        bench: What runs share.
        seed: Seed of the run, which decides it.

    Returns:
        The run.

    """
    random = np.random.default_rng(seed)
    plant, predictive, c, far = bench.plant, bench.predictive, bench.near, bench.far
    vary_parameters(plant, random)
    sensors = Sensors(delay=int(random.integers(RANDOM_DELAYS[0], RANDOM_DELAYS[1] + 1)))
    pushes = _draw_pushes(random)
    predictive.configure_with(c)
    hard = run_trial(plant, predictive, bench.path, pushes, sensors, COURSE_WALLS, seed=seed)
    ours = evaluate_trial(plant, c, bench.path, hard, predictive)
    predictive.configure_with(far)
    loose = run_trial(plant, predictive, bench.path, pushes, sensors, (), seed=seed)
    free = evaluate_trial(plant, far, bench.path, loose, predictive)
    found = run_trial(plant, bench.admittance, bench.path, pushes, sensors, (), seed=seed)
    theirs = evaluate_trial(plant, far, bench.path, found, bench.admittance)
    lawful = sends_legal_torques(predictive, hard) and sends_legal_torques(predictive, loose)
    return RandomRun(seed, sensors.delay, ours, free, theirs, lawful, keeps_soft_limits(bench.arm, c, ours))


def drive_random_runs(
    count: int, tuned: Mapping[str, float], profile: str = "native", first: int = 0, out: Path | None = None
) -> Iterator[RandomRun]:
    """Drive random runs in this process.

    Args:
        count: Count of runs.
        tuned: Gains of the admittance law.
        profile: Profile of the builds.
        first: Seed of the first run; each further run adds 1.
        out: Folder of the builds; None: the usual one.

    Yields:
        One run after the other.

    Raises:
        PlantError: A build fails, or a controller refuses its configuration.

    """
    bench = make_random_bench(tuned, profile, out)
    for seed in range(first, first + count):
        yield drive_random_run(bench, seed)


def format_comparison(found: Comparison, runs: Sequence[RandomRun] = ()) -> list[str]:
    """Format the table for a terminal, then the random runs.

    Args:
        found: The table.
        runs: Random runs, or none.

    Returns:
        Lines of text: the tip against the ideal motion, broken limits, contact forces.

    """
    heads = ("median", "largest", "after release", "contact N", "refused")
    out = [f"tip against the ideal admittance motion, mm:{'':16}" + "".join(f"{h:>15}" for h in heads)]
    for row in found.rows:
        o = row.outcome
        cells = [f"{1e3 * v:.3f}" for v in (o.distance, o.largest, o.released)] + [f"{o.contact:.1f}", str(o.refused)]
        out.append(f"  {row.course:32}{row.controller:26}" + "".join(f"{cell:>15}" for cell in cells))
        broken = [f"{name} {value:.3g}" for name, value in o.violated.items() if value > 0]
        out.append(f"    largest violation of each limit, SI: {', '.join(broken) or 'none'}")
    medians = ", ".join(f"{name} {1e3 * float(np.median(values)):.4f} mm" for name, values in found.free.items())
    out.append(f"no limit near, median over {NOISE_SEED_COUNT} seeds of the noise: {medians}")
    gains = ", ".join(f"{name} {value:.1f}" for name, value in found.tuned.gains.items())
    out.append(f"admittance law: inner loop tuned by {TUNING_METHOD}: {gains} after {found.tuned.evaluations} runs")
    out.append(f"{jolted(found.jolt)}; limits.sudden keeps {found.configuration['limits.sudden']:g} free")
    if not runs:
        return out
    legal, held = sum(one.legal for one in runs), sum(one.kept for one in runs)
    out.append(f"random runs: {len(runs)}; inputs legal in {legal}, soft limits kept to what is allowed in {held}")
    for name in runs[0].predictive.violated:
        out.append(f"  largest excess of {name}: {max(one.predictive.violated[name] for one in runs):.3g}")
    ours = np.array([one.free.distance for one in runs])
    theirs = np.array([one.admittance.distance for one in runs])
    refused = sum(one.free.refused > 0 for one in runs)
    lost = sum(one.admittance.refused > 0 for one in runs)
    where = f"mpc {1e3 * np.median(ours):.3f} mm, admittance {1e3 * np.median(theirs):.3f} mm"
    out.append(f"median distance where no limit is near: {where}; largest ratio of a run {np.max(ours / theirs):.2f}")
    out.append(f"where no limit is near, the guard refused the admittance law in {lost} runs, mpc in {refused}")
    return out


def keeps_soft_limits(arm: Arm, c: Configuration, found: TrialOutcome) -> bool:
    """Tell whether every soft limit was kept within its allowance: 1 mm at walls, 0.005 rad, 2 % of speeds and torques.

    Args:
        arm: The controller's arm.
        c: The configuration.
        found: The numbers of a run.

    Returns:
        Whether no excess is larger than its allowance.

    """
    limits = resolve_limits(arm.robot, c)
    sizes = {"motor_speed": max(limits["motor_speed"]), "joint_torque": max(limits["joint_torque"])}
    sizes["tip_speed"] = float(c["limits.tip_speed"])
    for name, over in found.violated.items():
        family = name
        if name.startswith("wall"):
            family = "wall"
        if over > ALLOWED_EXCESS.get(family, ALLOWED_SHARE * sizes.get(family, 0.0)):
            return False
    return True


def sends_legal_torques(controller: Controller, found: Trial) -> bool:
    """Whether every torque that was sent was finite, within the guard's limit, and no farther from the one before
    (none before the first) than the guard's rate allows in a period."""
    most, rate = controller.torque_limits()
    torque = found.simulation.torque
    change = np.diff(torque, axis=0, prepend=0.0)
    slack = 1e-9  # relative, of rounding in the product of rate and time
    within = np.isfinite(torque) & (np.abs(torque) <= most)
    return bool((within & (np.abs(change) <= rate * controller.guard.period * (1 + slack))).all())


def vary_parameters(plant: Arm, random: np.random.Generator) -> None:
    """Draw the parameters of a plant, each up to 10 % off its nominal value.

    Args:
        plant: The arm, whose parameters are changed.
        random: The generator to draw from.

    """
    plant.parameters.reset()
    changed = {}
    for name, described in plant.parameters.described.items():
        if name.rpartition("_")[0] in VARIED_PARAMETERS:
            value = described.nominal * (1 + random.uniform(-PARAMETER_SPREAD, PARAMETER_SPREAD))
            changed[name] = float(np.clip(value, described.low, described.high))
    plant.parameters.update(changed)


def _draw_pushes(random: np.random.Generator) -> tuple[Push, ...]:
    out = []
    for begin in (1.0, 2.5):
        size, angle = random.uniform(*PUSH_SIZES), random.uniform(0, 2 * np.pi)
        out.append(Push(begin, begin + float(random.uniform(0.3, 1.0)), (size * np.cos(angle), size * np.sin(angle))))
    return tuple(out)
