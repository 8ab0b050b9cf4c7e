"""The paper's central claim: compliant control whose F_e comes from estimated joint torques in place of a force sensor,
with and without compensation of the kinematic torsion, beside the same laws with the sensor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.paper.figures.handle_forces import compensating
from hdagen.paper.figures.tracking_runs import (
    SECONDS,
    SENSIBLE,
    SHOVES,
    SHOWN,
    TABLE_4,
    Tracked,
    case,
    followed,
    predictive,
)
from hdagen.paper.prototype.figure_result import Axes, Cell, Choice, Claim, Curve, Grid, Part, Result
from hdagen.paper.prototype.force_observer import BANDWIDTH, Sensorless
from hdagen.paper.prototype.virtual_prototype import (
    LAWS,
    Bench,
    cartesian,
    fine_sensors,
    guard,
    inner_loop,
    uncompensated,
)

SENSOR, WHOLE, PLAIN, BLIND = "force sensor", "estimate", "estimate by (16) alone", "estimate, uncompensated"
FILTER = "estimate of the Kalman filter"
FAR = 0.04  # m: a larger error of the tip is not drawn
YIELDS = 0.1  # relative difference of two displacements under a push that count as equal
OTHERS = (10.0, 40.0)  # rad/s of the observer, alternatives to its own
FINE, HALL = "4096 counts", "Hall sensors"
RUNS = (
    *((law, sensors, source) for law in LAWS for sensors, source in (
        (FINE, SENSOR), (FINE, WHOLE), (FINE, PLAIN), (FINE, BLIND), (HALL, SENSOR), (HALL, WHOLE),
    )),
    ("predictive", HALL, SENSOR),
    ("predictive", HALL, FILTER),
)  # fmt: skip


@dataclass(frozen=True)
class Felt:
    """A run, and the F_e that the law was given (T, 2, N)."""

    run: Tracked
    force: Array

    @property
    def force_error(self) -> Array:
        """rms error of the force by axis until the guard stopped the arm, N (2,)."""
        error = self.force - self.run.simulation.push
        if self.run.lost is not None:
            error = error[self.run.log.time < self.run.lost]
        found: Array = np.sqrt(np.mean(error**2, axis=0))
        return found

    @property
    def yielded(self) -> Array:
        """Largest displacement along each push while it lasts, m (2,); NaN where the guard had stopped the arm."""
        if self.run.lost is not None:
            return np.full(2, np.nan)
        time = self.run.log.time
        rows = [(time >= push.start) & (time < push.end) for push in SHOVES]
        return np.array([np.abs(self.run.off[at, axis]).max() for axis, at in enumerate(rows)])


def model(bench: Bench, source: str, fine: bool) -> Arm:
    """The model of an estimate: with the torsion as Fig. 14 found it or with none, with the hysteresis or without."""
    if source == BLIND:
        return bench.arm(changes=uncompensated(bench.arm()))
    known, _ = compensating(bench, fine)
    if source == PLAIN:
        known.parameters.update({"hysteresis_torque_1": 0.0, "hysteresis_torque_2": 0.0})
    return known


def felt(bench: Bench, law: str, sensors: str, source: str) -> Felt:
    """Run three circles, the second pushed, as in Figs. 16 and 17."""
    fine = sensors == FINE
    if source == SENSOR:
        name = f"{law}, {FINE}" if fine else law
        return _by_sensor(case(bench, name))
    make = partial(_by_estimate, bench, law, fine, source)
    if source == FILTER:
        make = partial(_by_filter, bench, fine)
    return bench.once(("felt", law, sensors, source), make)


def _by_sensor(run: Tracked) -> Felt:
    return Felt(run, np.stack([run.log["tip_force_x"], run.log["tip_force_y"]], axis=1))


def _by_estimate(bench: Bench, law: str, fine: bool, source: str, bandwidth: float = BANDWIDTH) -> Felt:
    gains = {**inner_loop(fine), **cartesian(*SENSIBLE)}
    regulator = Sensorless(bench.arm(), LAWS[law], guard(), gains, model(bench, source, fine), bandwidth)
    run = followed(bench.arm(), regulator, SHOVES, SECONDS, fine)
    return Felt(run, np.array(regulator.felt))


def _by_filter(bench: Bench, fine: bool) -> Felt:
    run = followed(bench.arm(), predictive(bench, SENSIBLE, "estimate"), SHOVES, SECONDS, fine)
    return Felt(run, np.full((len(run.log.time), 2), np.nan))


def sensorless(bench: Bench) -> Result:
    """Make the figure: both laws and predictive control, with the force sensor and without."""
    runs = {key: felt(bench, *key) for key in RUNS}
    parts: list[Part] = [*_panels(runs), _table(runs)]
    numbers = {
        ", ".join(key): {
            "errors_free_mm": 1e3 * one.run.errors((0, 2)), "yielded_mm": 1e3 * one.yielded,
            "force_rms_error": one.force_error, "lost_at": one.run.lost,
        }
        for key, one in runs.items()
    }  # fmt: skip
    text = (
        "Three circles, the second pushed by 10 N in x and then in y, M, B and K as in Fig. 16. F_e comes from a "
        "force sensor at the tip, or from the torsion of both drives alone: (14) to (16), the kinematic torsion taken "
        f"off as Fig. 14 found it, then through the Jacobian, with an observer of {BANDWIDTH:g} rad/s that knows the "
        "links' inertia. Dotted: the push as it is."
    )
    logs = {"_".join(key).replace(", ", "_").replace(" ", "_"): one.run.log for key, one in runs.items()}
    own = bench.robot_file({}, sensors=fine_sensors())
    robots = {end: own for end, key in zip(logs, runs, strict=True) if key[1] == FINE}
    title = "Compliance control without a torque sensor"
    return Result("sensorless", title, text, parts, _claims(runs), numbers, 2, _choices(bench), logs, robots)


def _panels(runs: Mapping[tuple[str, str, str], Felt]) -> list[Axes]:
    """Draw displacement and F_e over time, with encoders of 4096 counts, by law and axis."""
    panels = []
    for law in LAWS:
        shown = {source: runs[law, FINE, source] for source in (SENSOR, WHOLE, BLIND)}
        time = shown[SENSOR].run.log.time
        for axis, word in enumerate("xy"):
            curves = [Curve(source, time, _seen(one.run)[:, axis]) for source, one in shown.items()]
            heading = f"{law} control: tip off the circle in {word}"
            panels.append(Axes(heading, "time (s)", "error (m)", curves, bands=[SHOWN[axis]]))
    for axis, word in enumerate("xy"):
        one = runs["impedance", FINE, WHOLE]
        time, push = one.run.log.time, one.run.simulation.push
        curves = [
            Curve("force sensor", time, one.run.log[f"tip_force_{word}"], color="grey", dash="solid", width=0.5),
            Curve("estimate", time, one.force[:, axis], color="vermilion", dash="solid", width=1.2),
            Curve("push", time, push[:, axis], color="ink", dash="dotted", width=1.2),
        ]
        heading = f"impedance control: force on the tip in {word}"
        panels.append(Axes(heading, "time (s)", "force (N)", curves, bands=[SHOWN[axis]]))
    return panels


def _seen(run: Tracked) -> Array:
    """The tip's path error, NaN from its first value above FAR on."""
    off = run.off.copy()
    gone = np.maximum.accumulate(np.linalg.norm(off, axis=1) > FAR)
    off[gone] = np.nan
    return off


def _table(runs: Mapping[tuple[str, str, str], Felt]) -> Grid:
    rows: list[list[Cell]] = []
    for (law, sensors, source), one in runs.items():
        largest, _, spread = 1e3 * one.run.errors((0, 2))
        stopped = "–" if one.run.lost is None else f"{one.run.lost:.2f}"
        counts = {FINE: "4096", HALL: "42"}
        given = [
            f"{law}, {source}",
            counts[sensors],
            *largest,
            *spread,
            *(1e3 * one.yielded),
            *one.force_error,
            stopped,
        ]
        rows.append(given)
    columns = (
        "F_e from", "counts", "max x (mm)", "max y (mm)", "std x (mm)", "std y (mm)", "pushed x (mm)",
        "pushed y (mm)", "F_e error x (N)", "F_e error y (N)", "stopped (s)",
    )  # fmt: skip
    return Grid(
        "errors on circles 1 and 3, how far the push on circle 2 moves the tip, rms error of F_e", columns, rows, 3
    )


def _claims(runs: Mapping[tuple[str, str, str], Felt]) -> list[Claim]:
    ours = {law: runs[law, FINE, WHOLE] for law in LAWS}
    free = {law: 1e3 * one.run.errors((0, 2))[0] for law, one in ours.items()}
    gave = {law: one.yielded / runs[law, FINE, SENSOR].yielded for law, one in ours.items()}
    kept = all(
        ours[law].run.lost is None and (free[law] <= TABLE_4[law][0]).all() and (np.abs(gave[law] - 1) < YIELDS).all()
        for law in LAWS
    )
    words = [
        f"{law}: at most {free[law][0]:.1f} and {free[law][1]:.1f} mm off the circle without a push, and under it "
        f"{gave[law][0]:.2f} and {gave[law][1]:.2f} times as far as with a force sensor"
        for law in LAWS
    ]
    plain = {law: (runs[law, FINE, PLAIN].yielded / runs[law, FINE, SENSOR].yielded)[0] for law in LAWS}
    blind = {law: runs[law, FINE, BLIND] for law in LAWS}
    hall = {law: 1e3 * runs[law, HALL, WHOLE].run.errors((0, 2))[0].max() for law in LAWS}
    filtered = 1e3 * runs["predictive", HALL, FILTER].run.errors((0, 2))[0].max()
    table = max(max(table[0]) for table in TABLE_4.values())
    return [
        Claim(
            "the torque estimation results of the dual-axis arm can be used as feedback signals for compliant control "
            "(IV.A), which eliminates the need for torque sensors (II.A)",
            f"with 4096 counts, compensated: {'; '.join(words)}",
            kept,
            "with (16) as it is, without the hysteresis, the push in x moves the tip "
            f"{plain['impedance']:.2f} and {plain['admittance']:.2f} times as far (impedance and admittance): what the "
            "hysteresis bears is not felt",
        ),
        Claim(
            "for that the kinematic torsion has to be compensated",
            "uncompensated the arm leaves the circle before any push, and the guard stops it: "
            + ", ".join(f"{law} control at {one.run.lost:.2f} s" for law, one in blind.items()),
            all(one.run.lost is not None for one in blind.values()),
            "joint 1's torsion alone is felt as up to "
            f"{np.abs(blind['impedance'].force[:2000]).max():.0f} N in the first two seconds",
        ),
        Claim(
            "the same with the paper's sensors, Hall, 42 counts a turn",
            f"compensated, up to {hall['impedance']:.0f} mm (impedance) and {hall['admittance']:.0f} mm (admittance) "
            f"off the circle without a push; predictive control with its filter's force {filtered:.0f} mm",
            bool(max(hall.values()) <= table),
            "a count is 1.5 mrad at the joint, some 10 N m or 50 N at the tip, and a motor that hardly turns "
            "shows none",
        ),
    ]


def _choices(bench: Bench) -> list[Choice]:
    words = []
    for bandwidth in OTHERS:
        one = bench.once(("felt", bandwidth), partial(_by_estimate, bench, "admittance", True, WHOLE, bandwidth))
        x, y = 1e3 * one.run.errors((0, 2))[0]
        words.append(f"{bandwidth:g} rad/s: {x:.1f} and {y:.1f} mm, {1e3 * one.yielded[0]:.1f} mm under the push in x")
    mine = felt(bench, "admittance", FINE, WHOLE)
    x, y = 1e3 * mine.run.errors((0, 2))[0]
    return [
        Choice(
            "how (20) is used in motion",
            f"links' momentum observed with {BANDWIDTH:g} rad/s: admittance control at most {x:.1f} and {y:.1f} mm off "
            f"the circle, {1e3 * mine.yielded[0]:.1f} mm under the push in x",
            "; ".join(words),
        )
    ]
