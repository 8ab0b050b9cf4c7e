"""How fast, how small, how exact: every compiled function and loop, beside CasADi in the same run, against the bars."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.control import Controller, Guard, Safe
from hdagen.plant import Arm, Array, PlantError, load

PERIOD = 1e6  # ns, of a loop at 1 kHz
WHO = ("native", "portable", "casadi_c", "interpreter")
SECONDS, CURRENT, FREQUENCY = 3.0, 2.0, 1.0  # of the accuracy runs: 0.105 N m at the motors of Table I, at 1 Hz


@dataclass(frozen=True)
class Timing:
    """Nanoseconds a call over rounds: median, p99, p99.9 and largest."""

    name: str
    median: float
    p99: float
    p999: float
    largest: float
    against: dict[str, float]  # median of each contestant, ns

    @property
    def share(self) -> float:
        """Of a period of 1 kHz."""
        return self.median / PERIOD


@dataclass(frozen=True)
class Bar:
    """A bar, what was reached, its spread (10 to 90 %) and whether it is met; ``met`` None: reported, not judged."""

    name: str
    bar: float
    bound: str
    unit: str
    reached: float
    spread: tuple[float, float]
    met: bool | None


@dataclass(frozen=True)
class Bench:
    """Everything that a run found."""

    timings: tuple[Timing, ...]
    bars: tuple[Bar, ...]
    machine: dict[str, str]


def bench(rounds: int, stage: Callable[[str], None]) -> Bench:
    """Measure; ``stage`` is told what begins. Raises PlantError where a build fails."""
    stage("building")
    native, portable = load("paper", profile="native"), load("paper")
    stage("CasADi's interpreter and C, in turns with ours")
    raced = _raced(rounds)
    reached: dict[str, Array] = {}
    for name in ("rhs", "step"):
        ours = np.array(raced[name]["native"])
        reached[f"native_{name}_against_casadi_c"] = np.array(raced[name]["casadi_c"]) / ours
        reached[f"native_{name}_against_interpreter"] = np.array(raced[name]["interpreter"]) / ours
    stage("loops and calls from Python")
    loops = _loops(native, rounds)
    reached |= loops.pop("bars")
    stage("accuracy")
    reached |= _accuracy(rounds)
    stage("building from nothing")
    reached |= _builds(portable)
    timings = [_timing(name, times["native"], times) for name, times in raced.items()]
    timings += [_timing(name, values, {}) for name, values in loops.items()]
    machine = {
        "processor": _processor(),
        "compiler": native.manifest["compiler"],
        "batch": f"{native.module.batch_width} lanes",
    }
    return Bench(tuple(timings), _judged(reached, int(native.module.batch_width)), machine)


def _raced(rounds: int) -> dict[str, dict[str, list[float]]]:
    command = [sys.executable, "-m", "gen", "time", "paper", "--rounds", str(rounds)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PlantError(done.stderr.strip() or "`python -m gen time` failed without a word.")
    found: dict[str, dict[str, list[float]]] = json.loads(done.stdout)
    return found


def _timing(name: str, values: Any, all_of: dict[str, list[float]]) -> Timing:
    v = np.asarray(values, float)
    against = {who: float(np.median(times)) for who, times in all_of.items()}
    p99, p999 = (float(value) for value in np.percentile(v, [99, 99.9]))
    return Timing(name, float(np.median(v)), p99, p999, float(v.max()), against)


def _judged(reached: dict[str, Array], width: int) -> tuple[Bar, ...]:
    """Every bar of bars.toml with what was reached."""
    table = tomllib.loads((resources.files("hdagen") / "bars.toml").read_text())
    bars = []
    for name, entry in table.items():
        values = np.atleast_1d(reached[name])
        value = float(np.median(values))
        met: bool | None = value >= entry["bar"] if entry["bound"] == "least" else value <= entry["bar"]
        if entry.get("width", width) != width:
            met = None
        low, high = np.percentile(values, [10, 90])
        bars.append(Bar(name, entry["bar"], entry["bound"], entry["unit"], value, (float(low), float(high)), met))
    return tuple(bars)


# -- loops
# --------------------------------------------------------------------------------------------------------------


def _loops(arm: Arm, rounds: int) -> dict[str, Any]:
    """Rollouts and calls, ns a step over rounds, and the bars that rest on them."""
    steps, many = 400, 8 * arm.module.batch_width
    x0 = arm.rest(np.full(arm.n, 0.3))
    u = np.zeros((steps, arm.nu))
    u[:, : arm.n] = 0.5 * np.sin(np.arange(steps) / 20)[:, None]
    dt, h = np.full(steps, arm.step_size), arm.step_size
    one, batch = np.empty((steps + 1, arm.nx)), np.empty((many, steps + 1, arm.nx))
    starts, inputs = np.tile(x0, (many, 1)), np.tile(u, (many, 1, 1))
    x, out, size, held = x0.copy(), np.empty(arm.nx), np.array([h]), u[0].copy()
    call, empty = arm.module.bind("step", x0, held, arm.c, size, out).run, arm.module.empty

    slopes = [np.empty(k) for k in (arm.nx, arm.nx**2, arm.nx * arm.nu, arm.nx * len(arm.p))]

    def loop() -> None:  # step upon step, nothing but the loop in C
        x[:] = x0
        arm.module.map("step", steps, x, u, arm.c, size, x)

    runs: dict[str, Callable[[], Any]] = {
        "rollout": lambda: arm.module.rollout(0, x0, u, arm.c, dt, h, 1, one),
        "rollout, set-valued friction": lambda: arm.module.rollout(1, x0, u, arm.c, dt, h, 1, one),
        "batch": lambda: arm.module.rollout(2, starts, inputs, arm.c, dt, h, many, batch),
        "step upon step in C": loop,
        "step with derivatives": lambda: arm.module.map("step_jacobian", steps, x0, u, arm.p, size, *slopes),
        "tick of impedance control, law and guard": _ticking(arm, x0, steps),
        "step from Python": lambda: _repeat(call, steps),
        "empty call from Python": lambda: _repeat(empty, steps),
    }
    counts = {name: steps * (many if name == "batch" else 1) for name in runs}
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 1):
        for name, run in runs.items():
            begin = time.perf_counter_ns()
            run()
            if turn:  # the first one warms up
                times[name].append((time.perf_counter_ns() - begin) / counts[name])
    t = {name: np.array(values) for name, values in times.items()}
    bars = {
        "batch_against_native_step": t["rollout"] / t["batch"],
        "python_call_over_empty_call": t["step from Python"] - t["empty call from Python"],
        "rollout_against_its_loop": t["rollout"] / t["step upon step in C"],
    }
    return {**times, "bars": bars}


def _ticking(arm: Arm, x0: Array, count: int) -> Callable[[], None]:
    """Ticks at rest, called from Python as a loop on the machine would be."""
    limited = all(j["drive"]["max_current"] for j in arm.robot["joints"])
    guard = Guard(Safe.ZERO, torque_limit=None if limited else (100.0,) * arm.n, torque_rate=(50.0,) * arm.n)
    law = Controller(arm, "impedance_cartesian", guard)
    seen = arm.outputs(x0, np.zeros(arm.nu))
    law.motor_position[:], law.joint_position[:] = seen["motor_position"], seen["joint_position"]
    law.reference[:2] = seen["tip"]
    clock = itertools.count(1)

    def run() -> None:
        for _ in range(count):
            law.tick(next(clock) * guard.period)

    return run


def _repeat(call: Callable[[], None], count: int) -> None:
    for _ in range(count):
        call()


# -- accuracy
# -----------------------------------------------------------------------------------------------------------


def _accuracy(rounds: int) -> dict[str, Array]:
    """Largest error of a link angle over 3 s at the robot's step against a step forty times finer, and what bristles
    cost."""
    plain = load("paper_table1", profile="native")
    bristles = load("paper_table1", profile="native", effects=("presliding_friction",))
    bristles.parameters.update({f"presliding_share_{j}": 1.0 for j in range(1, bristles.n + 1)})
    return {
        "error_without_bristles": np.array([_error(plain)]),
        "error_with_bristles": np.array([_error(bristles)]),
        "cost_with_bristles": _cost(bristles, rounds),
    }


def _error(arm: Arm) -> float:
    t = np.arange(round(SECONDS / arm.step_size)) * arm.step_size
    u = np.zeros((len(t), arm.nu))
    u[:, : arm.n] = (CURRENT * np.sin(2 * np.pi * FREQUENCY * t))[:, None]
    x0 = arm.rest(np.zeros(arm.n))
    coarse, fine = (arm.rollout(x0, u, dt=arm.step_size, most=arm.step_size / parts) for parts in (1, 40))
    links = [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]
    return float(np.abs(coarse - fine)[:, links].max())


def _cost(arm: Arm, rounds: int) -> Array:
    """Microseconds a simulated millisecond while every motor slides one way."""
    rows = 400
    u = np.zeros((rows, arm.nu))
    u[:, : arm.n] = CURRENT
    x0 = arm.rollout(arm.rest(np.zeros(arm.n)), u)[-1]
    times = []
    for _ in range(rounds):
        begin = time.perf_counter_ns()
        arm.rollout(x0, u)
        times.append((time.perf_counter_ns() - begin) / 1e3 / (rows * arm.step_size * 1e3))
    return np.array(times)


# -- builds
# -------------------------------------------------------------------------------------------------------------


def _builds(arm: Arm) -> dict[str, Array]:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gen", "build", "paper", "--out", folder]
        cold, again = (_seconds(command) for _ in range(2))
        unchanged = [again, *(_seconds(command) for _ in range(4))]
    size = (arm.folder / arm.manifest["library"]).stat().st_size / 1e3
    return {"build_cold": np.array([cold]), "build_unchanged": np.array(unchanged), "library_size": np.array([size])}


def _seconds(command: list[str]) -> float:
    begin = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PlantError(done.stderr.strip())
    return time.perf_counter() - begin


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return "unknown"
    return next(
        (line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name")), "unknown"
    )
