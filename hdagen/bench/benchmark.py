"""How fast, how small, how exact: every compiled function and loop, beside CasADi in the same run, against the bars."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError, find_build_folder
from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.preset_files import find_preset_files
from hdagen.bench.host_computer import describe_machine
from hdagen.bench.simulator_race import compare_simulators, list_simulator_runs
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.prediction.measurement_model import count_mechanical_states
from hdagen.support.child_processes import start_child_process

ROBOT = "paper"  # of which most bars are
BAR_FILES = {ROBOT: "bars.toml", "panda": "bars_panda.toml"}  # of the robots that have bars
PERIOD_NS = 1e6  # ns, of a loop at 1 kHz
CONTESTANTS = ("native", "portable", "casadi_c", "interpreter")
ACCURACY_STEP, ACCURACY_SECONDS, ACCURACY_CURRENT, ACCURACY_FREQUENCY = (
    5e-4,
    3.0,
    2.0,
    1.0,
)  # of the accuracy runs: 0.105 N m at Table I's motors, 1 Hz
ROLLOUT_STEPS, CONTROLLER_TICKS = 2000, 500  # in a rollout, and of a controller
NOISY_RATIO_RANGE = 0.2  # range from 10 to 90 % of a ratio, against its median


@dataclass(frozen=True)
class Timing:
    """Nanoseconds a call: ``row`` where calls follow each other; median, p99, p99.9 and largest of single calls. Of
    loops, a step, over rounds."""

    name: str
    row: float
    median: float
    p99: float
    p999: float
    largest: float
    against: dict[str, float]  # each contestant in a row, ns; empty where only we have the function

    @property
    def share(self) -> float:
        """Of p99.9 in a period of 1 kHz."""
        return self.p999 / PERIOD_NS


@dataclass(frozen=True)
class BenchRequirement:
    """A bar, the reached figure, its spread (10 to 90 %) and whether it is met; ``met`` None: reported, not judged."""

    name: str
    bar: float
    bound: str
    unit: str
    reached: float
    spread: tuple[float, float]
    met: bool | None


@dataclass(frozen=True)
class BenchResult:
    """Everything that a run found."""

    timings: tuple[Timing, ...]
    bars: tuple[BenchRequirement, ...]
    machine: dict[str, str]
    absent: tuple[str, ...] = ()  # simulators that bars are beside and that are not installed

    @property
    def is_noisy(self) -> bool:
        """Whether a ratio varied so much that the machine must have been doing other things."""
        ratios = [bar for bar in self.bars if "faster" in bar.unit]
        return any(bar.spread[1] - bar.spread[0] > NOISY_RATIO_RANGE * bar.reached for bar in ratios)


def run_bench(rounds: int, stage: Callable[[str], None], robot: str = ROBOT) -> BenchResult:
    """Measure times, sizes and errors, and judge them by the bars.

    Args:
        rounds: Rounds over which times are taken.
        stage: Hears the name of each measurement as it begins.
        robot: A preset or the path of a robot.toml. Of one that is not in `BAR_FILES` only times are measured.

    Returns:
        The measurements.

    Raises:
        PlantError: A build fails.

    """
    machine = describe_machine()  # how busy it was before
    stage("building")
    native = load(robot, profile="native")
    stage("CasADi's interpreter and C, in turns with ours")
    raced = _race_functions(robot, rounds)
    reached: dict[str, Array] = {}
    for name in ("rhs", "step"):
        ours = np.array(raced[name]["native"]["row"])
        for who in ("casadi_c", "interpreter"):
            reached[f"native_{name}_against_{who}"] = np.array(raced[name][who]["row"]) / ours
    stage("loops and calls from Python")
    loops, bars = _time_loops(native, rounds)
    loops |= _time_ticks(native, rounds)
    timings = [_summarize_contest(name, contest) for name, contest in raced.items()]
    timings += [_summarize_loop(name, values) for name, values in loops.items()]
    if robot != ROBOT:
        stage("other simulators")
        raced_too = _time_in_turns(list_simulator_runs(native), rounds)
        timings += [_summarize_loop(name, values) for name, values in raced_too.items()]
        machine |= _describe_build(native)
        if robot not in BAR_FILES:
            return BenchResult(tuple(timings), (), machine)
        reached = bars | compare_simulators(raced_too, loops["step upon step in C"])
        judged, absent = _judge_requirements(robot, reached, int(native.module.batch_width))
        return BenchResult(tuple(timings), judged, machine, absent)
    stage("accuracy")
    accuracy = _measure_accuracy(rounds)
    stage("building from nothing")
    reached |= bars | accuracy | _time_builds(load(ROBOT))
    judged, absent = _judge_requirements(ROBOT, reached, int(native.module.batch_width))
    return BenchResult(tuple(timings), judged, machine | _describe_build(native), absent)


def _race_functions(robot: str, rounds: int) -> dict[str, Any]:
    """The output of `python -m gen time`: function -> contestant -> "row" and "single"."""
    return dict(json.loads(_run_gen("time", "--rounds", str(rounds), f"--out={find_build_folder()}", "--", robot)))


def _run_gen(*arguments: str) -> str:
    """The output of a child process of gen. Raises PlantError with its words."""
    beside = os.pathsep.join(filter(None, (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))))
    command = [sys.executable, "-P", "-m", "gen", *arguments]
    environment, pipe = {**os.environ, "PYTHONPATH": beside}, subprocess.PIPE
    with start_child_process(command, stdout=pipe, stderr=pipe, text=True, env=environment) as child:
        printed, said = child.communicate()
    if child.returncode:
        raise PlantError(said.strip() or f"`python -m gen {arguments[0]}` failed without a word.")
    return str(printed)


def _summarize_contest(name: str, contest: dict[str, Any]) -> Timing:
    """Times of one function and of its rivals."""
    rows = {who: float(np.median(times["row"])) for who, times in contest.items()}
    median, p99, p999, largest = contest["native"]["single"]
    return Timing(name, rows["native"], median, p99, p999, largest, rows)


def _summarize_loop(name: str, values: Sequence[float] | Array) -> Timing:
    v = np.asarray(values, float)
    median, p99, p999 = (float(value) for value in np.percentile(v, [50, 99, 99.9]))
    return Timing(name, median, median, p99, p999, float(v.max()), {})


def _judge_requirements(
    robot: str, reached: dict[str, Array], width: int
) -> tuple[tuple[BenchRequirement, ...], tuple[str, ...]]:
    """Every bar of a robot with the reached figure, and the simulators without which some have none."""
    table = tomllib.loads((resources.files("hdagen.bench") / BAR_FILES[robot]).read_text())
    absent = {entry["beside"]: None for name, entry in table.items() if "beside" in entry and name not in reached}
    bars = []
    for name, entry in table.items():
        if entry.get("beside") in absent:
            continue
        values = np.atleast_1d(reached[name])
        value = float(np.median(values))
        met: bool | None = value <= entry["bar"]
        if entry["bound"] == "least":
            met = value >= entry["bar"]
        if entry.get("width", width) != width:
            met = None
        low, high = np.percentile(values, [10, 90])
        bars.append(
            BenchRequirement(name, entry["bar"], entry["bound"], entry["unit"], value, (float(low), float(high)), met)
        )
    return tuple(bars), tuple(absent)


def _describe_build(arm: Arm) -> dict[str, str]:
    return {"compiler": arm.manifest["compiler"], "lanes": str(arm.module.batch_width)}


# -- loops ------------------------------------------------------------------------------------------------------------


def _time_loops(arm: Arm, rounds: int) -> tuple[dict[str, Array], dict[str, Array]]:
    """Rollouts and calls, ns a step over rounds; and the bars that rest on them."""
    many, few, h = 8 * arm.module.batch_width, ROLLOUT_STEPS // 10, arm.step_size
    x0, u = arm.rest(np.full(arm.n, 0.3)), np.zeros((ROLLOUT_STEPS, arm.nu))
    most = np.array([slot["bound"] for slot in arm.manifest["input"][: arm.n]])
    u[:, : arm.n] = (
        np.minimum(ACCURACY_CURRENT, most) * np.sin(np.arange(ROLLOUT_STEPS) / 20)[:, None]
    )  # the motors slide
    batch = np.empty((many, few + 1, arm.nx))
    starts, inputs, held = np.tile(x0, (many, 1)), np.tile(u[:few], (many, 1, 1)), np.full(few, h)
    at = np.arange(many) * (ROLLOUT_STEPS - few) // many  # lanes go over pieces of the one rollout's motion
    begun, pieces = (
        arm.rollout(x0, u, exact=True)[at][:, : count_mechanical_states(arm)].copy(),
        u[at[:, None] + np.arange(few)],
    )
    edges, limit, states = np.array([[0, few]], np.int32), np.full(arm.nx, 1e9), np.empty((many, few, arm.nx))
    own = np.tile(arm.c, (many, 1))
    out, size, first = np.empty(arm.nx), np.array([h]), u[0].copy()
    slopes = [np.empty(k) for k in (arm.nx, arm.nx**2, arm.nx * arm.nu, arm.nx * len(arm.p))]
    call, empty = arm.module.bind("step", x0, first, arm.c, size, out).run, arm.module.empty

    def loop() -> None:  # row k + 1 of a new path from row k, nothing but the loop in C
        path = np.empty((ROLLOUT_STEPS + 1, arm.nx))
        path[0] = x0
        arm.module.map("step", ROLLOUT_STEPS, path[:-1], u, arm.c, size, path[1:])

    runs: dict[str, tuple[Callable[[], Any], int]] = {
        "arm.rollout": (lambda: arm.rollout(x0, u), ROLLOUT_STEPS),
        "arm.rollout, set-valued friction": (lambda: arm.rollout(x0, u, exact=True), ROLLOUT_STEPS),
        "batch": (lambda: arm.module.rollout(2, starts, inputs, arm.c, held, h, many, batch), few * many),
        "batch, set-valued friction": (
            lambda: arm.module.windows(begun, None, edges, pieces, own, held, None, limit, states, h, many),
            few * many,
        ),
        "step upon step in C": (loop, ROLLOUT_STEPS),
        "step with derivatives": (lambda: arm.module.map("step_jacobian", few, x0, u[:few], arm.p, size, *slopes), few),
        "step from Python": (lambda: _repeat_call(call, ROLLOUT_STEPS), ROLLOUT_STEPS),
        "empty call from Python": (lambda: _repeat_call(empty, ROLLOUT_STEPS), ROLLOUT_STEPS),
    }
    t = _time_in_turns(runs, rounds)
    return t, {
        "batch_against_native_step": t["step upon step in C"] / t["batch"],
        "python_call_over_empty_call": t["step from Python"] - t["empty call from Python"],
        "rollout_against_its_loop": t["arm.rollout"] / t["step upon step in C"],
    }


def _time_in_turns(runs: dict[str, tuple[Callable[[], Any], int]], rounds: int) -> dict[str, Array]:
    """Every run twice a round, by turns, the first to warm up: ns a step of the second."""
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, (run, steps) in runs.items():
            run()
            begin = time.perf_counter_ns()
            run()
            times[name].append((time.perf_counter_ns() - begin) / steps)
    return {name: np.array(values) for name, values in times.items()}


def _repeat_call(call: Callable[[], None], count: int) -> None:
    for _ in range(count):
        call()


def _time_ticks(arm: Arm, rounds: int) -> dict[str, Array]:
    """Ticks of every controller, guard and law, called from Python as a loop on a machine would; ns a tick."""
    runs: dict[str, tuple[Callable[[], Any], int]] = {}
    for law in arm.manifest["controllers"]:
        runs[f"tick from Python, {law['name']}"] = (_make_tick_loop(arm, law["name"]), CONTROLLER_TICKS)
    return _time_in_turns(runs, rounds)


def _make_tick_loop(arm: Arm, law: str) -> Callable[[], None]:
    """A run of ticks at rest, guarded by limits that the robot file need not state."""
    ones = (1.0,) * arm.n
    controller = Controller(arm, law, Guard(Safe.ZERO, torque_limit=ones, torque_rate=tuple(50 * k for k in ones)))
    seen = arm.outputs(arm.rest(np.full(arm.n, 0.3)), np.zeros(arm.nu))
    controller.motor_position[:], controller.joint_position[:] = seen["motor_position"], seen["joint_position"]
    period = controller.guard.period

    def loop() -> None:
        controller.restart()
        for k in range(1, CONTROLLER_TICKS + 1):
            status = controller.tick(k * period)
        if status < 0:  # what was timed is the safe state
            raise PlantError(f"{law}: {controller.sentence(status)}")

    return loop


# -- accuracy ---------------------------------------------------------------------------------------------------------


def _measure_accuracy(rounds: int) -> dict[str, Array]:
    """Largest error of a link angle over 3 s at 0.5 ms against a step forty times finer, friction smoothed at 1 rad/s;
    and the cost of bristles. The robot file states them: those only added to a model are slowed to its step."""
    plain = load("paper_table1", profile="native")
    with tempfile.TemporaryDirectory() as folder:
        bristles = load(_write_bristle_robot(Path(folder) / "bristles.toml", plain.n), profile="native")
    for arm in (plain, bristles):
        arm.parameters.update({f"friction_smoothing_{j}": 1.0 for j in range(1, arm.n + 1)})
    return {
        "error_without_bristles": np.array([_measure_link_error(plain)]),
        "error_with_bristles": np.array([_measure_link_error(bristles)]),
        "cost_with_bristles": _time_sliding(bristles, rounds),
    }


def _write_bristle_robot(path: Path, joints: int) -> Path:
    """The robot file of the plain model with all of its dry friction on bristles, written to ``path``."""
    plain = find_preset_files()["paper_table1"]
    effect = '[[effect]]\nname = "presliding_friction"\njoint = {}\npresliding_share = 1.0\n'
    path.write_text("\n".join([plain.read_text(), *(effect.format(j) for j in range(1, joints + 1))]))
    return path


def _measure_link_error(arm: Arm) -> float:
    t = np.arange(round(ACCURACY_SECONDS / ACCURACY_STEP)) * ACCURACY_STEP
    u = np.zeros((len(t), arm.nu))
    u[:, : arm.n] = (ACCURACY_CURRENT * np.sin(2 * np.pi * ACCURACY_FREQUENCY * t))[:, None]
    x0 = arm.rest(np.zeros(arm.n))
    coarse, fine = (arm.rollout(x0, u, dt=ACCURACY_STEP, most=ACCURACY_STEP / parts) for parts in (1, 40))
    links = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    return float(np.abs(coarse - fine)[:, links].max())


def _time_sliding(arm: Arm, rounds: int) -> Array:
    """Microseconds a simulated millisecond while every motor slides one way."""
    rows = 400
    u = np.zeros((rows, arm.nu))
    u[:, : arm.n] = ACCURACY_CURRENT
    x0 = arm.rollout(arm.rest(np.zeros(arm.n)), u, dt=ACCURACY_STEP, most=ACCURACY_STEP)[-1]
    ns = _time_in_turns({"sliding": (lambda: arm.rollout(x0, u, dt=ACCURACY_STEP, most=ACCURACY_STEP), rows)}, rounds)[
        "sliding"
    ]
    return ns * 1e-3 / (ACCURACY_STEP * 1e3)


# -- builds -----------------------------------------------------------------------------------------------------------


def _time_builds(arm: Arm) -> dict[str, Array]:
    with tempfile.TemporaryDirectory() as folder:
        cold, *unchanged = (_time_gen("build", "--out", folder, "--", "paper") for _ in range(6))
    size = (arm.folder / arm.manifest["library"]).stat().st_size / 1e3
    return {"build_cold": np.array([cold]), "build_unchanged": np.array(unchanged), "library_size": np.array([size])}


def _time_gen(*arguments: str) -> float:
    begin = time.perf_counter()
    _run_gen(*arguments)
    return time.perf_counter() - begin
