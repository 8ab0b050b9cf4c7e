"""Position tracking: three circles with a push on the second, Figs. 16 and 17, Tables III and IV.

A sensible set of parameters and predictive control of the same admittance stand beside the published parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from hdagen.control import Controller
from hdagen.log import Log
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.controller import MPC
from hdagen.paper.prototype import ROBOT, STRUCTURE, TURN, Bench, cartesian, controller, encoders_of, guard, turns
from hdagen.paper.result import Axes, Choice, Claim, Curve, Grid, Result
from hdagen.paper.result import path as drawn
from hdagen.plant import Arm, Array, load
from hdagen.simulation import Push, Simulation, World, run

SECONDS = 3 * TURN
STARTS = 1.0  # s in which the circle is brought to speed; they do not count
SHOVE = 10.0  # N, assumed; the paper says "an external force"
SHOVES = (Push(6.0, 7.0, (SHOVE, 0.0)), Push(8.0, 9.0, (0.0, SHOVE)))
SHOWN = ((6.0, 7.0, f"{SHOVE:g} N in x"), (8.0, 9.0, f"{SHOVE:g} N in y"))
PUBLISHED = {"impedance": (0.001, 1e-10, 1e-5), "admittance": (1000.0, 0.5, 10.0)}  # kg, N s/m, N/m: Table III
SENSIBLE = (2.0, 45.0, 500.0)  # a load for a hand, damping ratio 0.7, 20 mm under the push
TABLE_4 = {"impedance": ((3.1, 3.6), (1.5, 0.3), (2.4, 1.8)), "admittance": ((3.4, 3.7), (0.4, 1.5), (1.7, 0.8))}  # mm
MEASURES = ("max", "mean", "std")
ALL = "all of these"
NEAR = 3.7e-3  # m, the largest error of Table IV


@dataclass(frozen=True)
class Tracked:
    """A run along a ``path`` (T, 2, m): ``refused`` counts the ticks that the guard refused; ``lost`` is the time of
    the first of them, s (None without one), ``fault`` its message."""

    simulation: Simulation
    path: Array
    refused: int
    lost: float | None
    fault: str

    @property
    def off(self) -> Array:
        """Path error (T, 2, m): the tip less the path."""
        return self.simulation.tip - self.path

    @property
    def log(self) -> Log:
        """The log of the run."""
        return self.simulation.log

    def errors(self, circles: Sequence[int]) -> Array:
        """Compute largest error, mean and standard deviation over whole ``circles`` (from 0) without the start.

        Returns:
            MEASURES by axis (3, 2), m.
        """
        off = self.over(circles)
        return np.stack([np.abs(off).max(axis=0), np.abs(off.mean(axis=0)), off.std(axis=0)])

    def over(self, circles: Sequence[int]) -> Array:
        """Select the path error of whole ``circles`` (from 0) without the start.

        Returns:
            Path error (rows, 2), m.
        """
        time = self.log.time
        rows = np.zeros(len(time), bool)
        for k in circles:
            rows |= (time >= max(k * TURN, STARTS)) & (time < (k + 1) * TURN)
        return self.off[rows]


def tracked(
    bench: Bench,
    law: str,
    mbk: tuple[float, float, float],
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    changes: Mapping[str, float] | None = None,
    gains: Mapping[str, float] | None = None,
    world: World | None = None,
    seed: int = 1,
) -> Tracked:
    """Run a law on the prototype along the circle; the controller does not know ``changes``.

    Args:
        bench: arms and shared runs.
        law: "impedance", "admittance" or "predictive".
        mbk: M, kg, B, N s/m, K, N/m.
        pushes: forces on the tip.
        seconds: length of the run, s.
        fine: encoders of 4096 counts in place of Hall sensors.
        changes: parameters of the true arm that differ from the prototype's, SI.
        gains: gains that differ from the law's own.
        world: the world that touches the tip.
        seed: of the sensors' noise.

    Returns:
        The run.
    """
    if law == "predictive":
        regulator = predictive(bench, mbk)
    else:
        regulator = controller(bench.once("known", bench.arm), law, {**cartesian(*mbk), **(gains or {})}, fine)
    return followed(bench.arm(changes=changes), regulator, pushes, seconds, fine, world, seed)


def followed(
    plant: Arm,
    regulator: Controller,
    pushes: Sequence[Push],
    seconds: float,
    fine: bool = False,
    world: World | None = None,
    seed: int = 1,
) -> Tracked:
    """Run ``regulator`` on the true arm ``plant`` along the circle; the other arguments are those of `tracked`.

    Returns:
        The run.
    """
    path = turns(seconds)
    found = run(plant, regulator, path, pushes, encoders_of(fine), seed, world=world)
    refused = np.flatnonzero(found.status < 0)
    if not len(refused):
        return Tracked(found, path.position, 0, None, "")
    first = int(refused[0])
    fault = regulator.sentence(int(found.status[first]))
    return Tracked(found, path.position, len(refused), float(found.log.time[first]), fault)


def predictive(bench: Bench, mbk: tuple[float, float, float], force: str = "sensor") -> Controller:
    """Make predictive control of an admittance.

    Args:
        bench: arms and shared runs.
        mbk: M, kg, B, N s/m, K, N/m.
        force: the tip force from the "sensor", or the "estimate" of the controller's filter.

    Returns:
        The controller.
    """
    names = ("mass", "damping", "stiffness")
    admittance: dict[str, Any] = {f"admittance__{name}": value for name, value in zip(names, mbk, strict=True)}
    wanted = Configuration().changed(**admittance, admittance__force=force)
    arm: Arm = bench.once("predictive", lambda: load(ROBOT, bench.profile, mpc=wanted))
    return MPC(arm, wanted, guard())


CASES = {  # law, M, B and K, whether with encoders of 4096 counts
    "impedance": ("impedance", SENSIBLE, False),
    "admittance": ("admittance", SENSIBLE, False),
    "predictive": ("predictive", SENSIBLE, False),
    "impedance, 4096 counts": ("impedance", SENSIBLE, True),
    "admittance, 4096 counts": ("admittance", SENSIBLE, True),
    "impedance, Table III": ("impedance", PUBLISHED["impedance"], False),
    "admittance, Table III": ("admittance", PUBLISHED["admittance"], False),
}


def case(bench: Bench, name: str) -> Tracked:
    """Run one of CASES, by its key.

    Returns:
        The run; each is simulated once a bench.
    """
    law, mbk, fine = CASES[name]
    return bench.once(("tracked", name), partial(tracked, bench, law, mbk, SHOVES, SECONDS, fine))


def built(bench: Bench, law: str, part: str) -> Tracked:
    """Run a law on an arm with one of STRUCTURE's faults, or with all of them."""
    changes = dict(STRUCTURE).get(part) or {name: v for one in STRUCTURE.values() for name, v in one.items()}
    make = partial(tracked, bench, law, SENSIBLE, SHOVES, SECONDS, changes=changes)
    return bench.once(("built", law, part), make)


def cases(bench: Bench) -> dict[str, Tracked]:
    """Run all of CASES."""
    return {name: case(bench, name) for name in CASES}


def fig16(bench: Bench) -> Result:
    """Make Fig. 16: paths of the tip in the plane."""
    found = cases(bench)
    parts, per = [], round(TURN / 1e-3)
    for name, heading in (
        ("impedance", "(a) impedance control"),
        ("admittance", "(b) admittance control"),
        ("predictive", "predictive control"),
        ("admittance, Table III", "admittance, Table III as published"),
    ):
        tip, circle = found[name].simulation.tip, found[name].path
        curves = [drawn("circle", circle[:per], color="grey", dash="dashed", width=1.0)]
        for k, (word, color) in enumerate((("first", "blue"), ("second, pushed", "vermilion"), ("third", "green"))):
            curves.append(
                drawn(word, tip[k * per : (k + 1) * per], color=color, dash=("solid", "dashed", "dash-dotted")[k])
            )
        parts.append(Axes(heading, "x (m)", "y (m)", curves, equal=True))
    back = {name: _back(found[name]) for name in ("impedance", "admittance", "predictive")}
    claims = [
        Claim(
            "both controllers can successfully track back to the circle after the push",
            f"as near to it as the paper's largest error, {1e3 * NEAR:g} mm, {back['impedance']:.2f} s (impedance) "
            f"and {back['admittance']:.2f} s (admittance) after the last push",
            max(back["impedance"], back["admittance"]) < 1.0,
            "with M = 2 kg, B = 45 N s/m, K = 500 N/m",
        ),
        Claim("the same with the parameters of Table III", _as_published(found), False, _why_published()),
    ]
    text = (
        "Three circles, the second pushed by 10 N in x and then in y. Hall sensors, friction, torsion, delay as in "
        "the prototype."
    )
    logs = {
        name.replace(", ", "_").replace(" ", "_").lower(): one.log for name, one in found.items() if "4096" not in name
    }
    numbers = {"seconds_until_near": back, "lost_at": {name: one.lost for name, one in found.items()}}
    return Result(
        "fig16", "Compliance control: paths of the tip", text, parts, claims, numbers, 2, _choices(bench), logs
    )


def _back(one: Tracked) -> float:
    """Time from the end of the last push until the tip stays NEAR its path, s."""
    time, distance = one.log.time, np.linalg.norm(one.off, axis=1)
    after = time[(time >= SHOVES[-1].end) & (distance > NEAR)] - SHOVES[-1].end
    return float(after.max(initial=0.0))


def _as_published(found: Mapping[str, Tracked]) -> str:
    impedance, admittance = found["impedance, Table III"], found["admittance, Table III"]
    off = 1e3 * np.linalg.norm(admittance.off[-1])
    lost = "impedance: not lost"
    if impedance.lost is not None:
        lost = f"impedance: the guard stops the arm at {impedance.lost:.3f} s ({impedance.fault.rstrip('.')})"
    return f"{lost}; admittance: still {off:.0f} mm off at the end"


def _why_published() -> str:
    return (
        "a mass of one gram without spring or damper is thrown by the force sensor's own noise; 1000 kg on 10 N/m "
        "swing once in 63 s, so what a push began goes on"
    )


def fig17(bench: Bench) -> Result:
    """Make Fig. 17: x and y over time."""
    found = cases(bench)
    parts = []
    for row, law in enumerate(("impedance", "admittance")):
        one = found[law]
        for axis, word in enumerate("xy"):
            curves = [
                Curve("circle", one.log.time, one.path[:, axis], color="grey", dash="dashed"),
                Curve(law, one.log.time, one.simulation.tip[:, axis], color="blue", dash="solid"),
            ]
            heading = f"({'abcd'[2 * row + axis]}) {law}, {word}"
            parts.append(Axes(heading, "time (s)", f"{word} (m)", curves, bands=[SHOWN[axis]]))
    shown = ("impedance", "admittance", "predictive")
    for axis, word in enumerate("xy"):
        errors = [Curve(name, found[name].log.time, found[name].off[:, axis]) for name in shown]
        parts.append(Axes(f"off the circle in {word}", "time (s)", "error (m)", errors, bands=SHOWN))
    apart = np.linalg.norm(found["impedance"].simulation.tip - found["admittance"].simulation.tip, axis=1)
    claims = [
        Claim(
            "both controllers exhibit similar position-tracking results",
            f"their tips are {1e3 * apart.mean():.2f} mm apart in the mean, {1e3 * apart.max():.1f} mm at most",
            bool(apart.mean() < 2e-3),
            "of 100 mm across; the same M, B and K in both",
        )
    ]
    numbers = {"apart_mean": apart.mean(), "apart_max": apart.max()}
    text = "The runs of Fig. 16 over time."
    logs = {law: found[law].log for law in shown}
    return Result("fig17", "Position tracking in x and y", text, parts, claims, numbers, 2, logs=logs)


def table3(bench: Bench) -> Result:
    """Make Table III: the parameters, and the runs with them."""
    found = cases(bench)
    rows = []
    for law, published in PUBLISHED.items():
        for name, (M, B, K) in ((f"{law}, Table III", published), (law, SENSIBLE)):
            one = found[name]
            outcome = f"{1e3 * _largest(one):.1f} mm under the push"
            if one.lost is not None:
                outcome = f"stopped at {one.lost:.2f} s"
            rows.append((name, M, B, K, float(B / (2 * np.sqrt(K * M))), float(2 * np.pi * np.sqrt(M / K)), outcome))
    columns = ("", "M (kg)", "B (N s/m)", "K (N/m)", "damping ratio", "swing (s)", "what the arm does")
    impedance, admittance = str(rows[0][-1]), f"{rows[2][-1]}, damping ratio {rows[2][4]:.4f}"
    why = _why_published()
    claims = [
        Claim("impedance control with M = 0.001 kg, B = 1e-10 N s/m, K = 1e-5 N/m", impedance, False, why),
        Claim("admittance control with M = 1000 kg, B = 0.5 N s/m, K = 10 N/m", admittance, False, why),
    ]
    text = "Table III as published, and a set that makes physical sense beside it."
    grid = Grid("Table III: parameters of the compliance control", columns, rows, 3)
    return Result("table3", "Parameters of the compliance control", text, [grid], claims, {"rows": rows}, 1)


def _largest(one: Tracked) -> float:
    return float(np.linalg.norm(one.off, axis=1).max())


def table4(bench: Bench) -> Result:
    """Make Table IV: tracking errors by axis."""
    found = cases(bench)
    shown = ("impedance", "admittance", "predictive", "impedance, 4096 counts", "admittance, 4096 counts")
    free = {name: found[name].errors((0, 2)) for name in shown}
    pushed = {name: found[name].errors((1,)) for name in shown}
    columns = ("mm", *(f"{measure} {axis}" for measure in MEASURES for axis in "xy"))
    rows: list[tuple[str | float, ...]] = []
    for law, table in TABLE_4.items():
        rows.append((f"{law}, the paper", *(value for pair in table for value in pair)))
    for name in shown:
        rows.append((f"{name}, circles 1 and 3", *(1e3 * free[name]).ravel()))
    for name in shown[:3]:
        rows.append((f"{name}, circle 2, pushed", *(1e3 * pushed[name]).ravel()))
    structure = (*STRUCTURE, ALL)
    faults = {(law, part): built(bench, law, part).errors((0, 2)) for law in TABLE_4 for part in structure}
    rows += [(f"{law}, {part}", *(1e3 * errors).ravel()) for (law, part), errors in faults.items()]
    claims = []
    for law, table in TABLE_4.items():
        ours, theirs, printed = 1e3 * free[law], np.array(table), 1e3 * faults[law, ALL]
        claims.append(
            Claim(
                f"{law}: max error {theirs[0, 0]:g} and {theirs[0, 1]:g} mm, mean {theirs[1, 0]:g} and "
                f"{theirs[1, 1]:g}, std {theirs[2, 0]:g} and {theirs[2, 1]:g} in x and y",
                f"max {ours[0, 0]:.2f} and {ours[0, 1]:.2f} mm, mean {ours[1, 0]:.2f} and {ours[1, 1]:.2f}, std "
                f"{ours[2, 0]:.2f} and {ours[2, 1]:.2f}",
                bool((ours <= theirs).all()),
                "smaller: friction is observed and compensated, the structure does not bend, and no camera measures. "
                f"With play, bending links and a mounting that yields: max {printed[0, 0]:.2f} and "
                f"{printed[0, 1]:.2f} mm, std {printed[2, 0]:.2f} and {printed[2, 1]:.2f}",
            )
        )
    structure_errors = {", ".join(key): errors for key, errors in faults.items()}
    numbers = {"free": free, "pushed": pushed, "structure": structure_errors, "paper_mm": TABLE_4}
    text = (
        "Errors of the tip against the circle, by axis, in millimetres; the first second, in which the circle is "
        "brought to speed, is left out. The mean is that of the signed error, its size printed, and the standard "
        "deviation is about it. Below: the printed structure's faults, whose sizes are assumed, on circles 1 and 3."
    )
    parts = [Grid("Table IV: tracking errors", columns, rows, 3)]
    return Result("table4", "Tracking errors", text, parts, claims, numbers, 1, [_mean_of(found)])


def _mean_of(found: Mapping[str, Tracked]) -> Choice:
    """The choice between mean and standard deviation of the signed error and of its size."""

    def words(name: str, off: Array) -> str:
        (x, y), (u, v) = np.abs(off.mean(axis=0)), off.std(axis=0)
        return f"{name} {x:.2f} and {y:.2f} ± {u:.2f} and {v:.2f} mm"

    signed = {law: 1e3 * found[law].over((0, 2)) for law in TABLE_4}
    of_signed = ", ".join(words(law, off) for law, off in signed.items())
    of_sizes = ", ".join(words(law, np.abs(off)) for law, off in signed.items())
    return Choice(
        "mean and standard deviation of what",
        f"of the signed error: {of_signed}",
        f"of its size: {of_sizes}; of sizes, 3.1 mm at most and 1.5 mm in the mean, none can deviate by the paper's "
        "2.4 mm",
    )


def _scaled(push: Push, share: float) -> Push:
    x, y = push.force
    return Push(push.start, push.end, (share * x, share * y))


def _choices(bench: Bench) -> list[Choice]:
    one = case(bench, "admittance")
    third, second = (1e3 * one.errors(circles)[0] for circles in ((0, 2), (1,)))
    given = []
    for size in (SHOVE / 2, 2 * SHOVE):
        other = [_scaled(push, size / SHOVE) for push in SHOVES]
        found = bench.once(("shoved", size), partial(tracked, bench, "admittance", SENSIBLE, other, SECONDS))
        given.append(f"{size:g} N: {1e3 * _largest(found):.1f} mm")
    return [
        Choice(
            "which circles Table IV speaks of",
            f"the first and the third, without a push: admittance control at most {third[0]:.1f} and {third[1]:.1f} mm",
            f"the second, pushed: {second[0]:.1f} and {second[1]:.1f} mm",
        ),
        Choice(
            "size and time of the push",
            f"{SHOVE:g} N for 1 s in x, then in y: admittance control gives way by {1e3 * _largest(one):.1f} mm",
            "; ".join(given),
        ),
    ]
