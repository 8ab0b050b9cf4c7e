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
from hdagen.paper.figures.handle_forces import compensating_model
from hdagen.paper.figures.tracking_runs import (
    TABLE_4,
    TRACKING_PUSH_BANDS,
    TRACKING_PUSHES,
    TRACKING_SECONDS,
    TRACKING_SET,
    TrackingRun,
    follow_circle,
    make_predictive_controller,
    run_case,
)
from hdagen.paper.prototype.figure_result import Axes, Cell, Choice, Claim, Curve, Grid, Part, Result
from hdagen.paper.prototype.force_observer import OBSERVER_BANDWIDTH, SensorlessController
from hdagen.paper.prototype.virtual_prototype import (
    CARTESIAN_LAWS,
    Bench,
    cartesian_gains,
    fine_sensors,
    inner_loop,
    make_guard,
    without_kinematic_torsion,
)

FORCE_SENSOR, FULL_ESTIMATE, SPRINGS_ONLY_ESTIMATE, UNCOMPENSATED_ESTIMATE = (
    "force sensor",
    "estimate",
    "estimate by (16) alone",
    "estimate, uncompensated",
)
KALMAN_ESTIMATE = "estimate of the Kalman filter"
LARGEST_DRAWN_ERROR = 0.04  # m: a larger error of the tip is not drawn
YIELD_TOLERANCE = 0.1  # relative difference of two displacements under a push that count as equal
OTHER_BANDWIDTHS = (10.0, 40.0)  # rad/s of the observer, alternatives to its own
FINE_ENCODERS, HALL_SENSORS = "4096 counts", "Hall sensors"
SENSORLESS_RUNS = (
    *((law, sensors, source) for law in CARTESIAN_LAWS for sensors, source in (
        (FINE_ENCODERS, FORCE_SENSOR), (FINE_ENCODERS, FULL_ESTIMATE), (FINE_ENCODERS, SPRINGS_ONLY_ESTIMATE),
        (FINE_ENCODERS, UNCOMPENSATED_ESTIMATE), (HALL_SENSORS, FORCE_SENSOR), (HALL_SENSORS, FULL_ESTIMATE),
    )),
    ("predictive", HALL_SENSORS, FORCE_SENSOR),
    ("predictive", HALL_SENSORS, KALMAN_ESTIMATE),
)  # fmt: skip


@dataclass(frozen=True)
class ForceFeedbackRun:
    """A run, and the F_e that the law was given (T, 2, N)."""

    run: TrackingRun
    force: Array

    @property
    def force_error(self) -> Array:
        """rms error of the force by axis until the guard stopped the arm, N (2,)."""
        error = self.force - self.run.simulation.push
        if self.run.lost_at is not None:
            error = error[self.run.log.time < self.run.lost_at]
        found: Array = np.sqrt(np.mean(error**2, axis=0))
        return found

    @property
    def displacement_under_push(self) -> Array:
        """Largest displacement along each push while it lasts, m (2,); NaN where the guard had stopped the arm."""
        if self.run.lost_at is not None:
            return np.full(2, np.nan)
        time = self.run.log.time
        rows = [(time >= push.start) & (time < push.end) for push in TRACKING_PUSHES]
        return np.array([np.abs(self.run.path_error[at, axis]).max() for axis, at in enumerate(rows)])


def estimator_model(bench: Bench, source: str, fine: bool) -> Arm:
    """The model of an estimate: with the torsion as Fig. 14 found it or with none, with the hysteresis or without."""
    if source == UNCOMPENSATED_ESTIMATE:
        return bench.arm(changes=without_kinematic_torsion(bench.arm()))
    known, _ = compensating_model(bench, fine)
    if source == SPRINGS_ONLY_ESTIMATE:
        known.parameters.update({"hysteresis_torque_1": 0.0, "hysteresis_torque_2": 0.0})
    return known


def run_with_force_from(bench: Bench, law: str, sensors: str, source: str) -> ForceFeedbackRun:
    """Run three circles, the second pushed, as in Figs. 16 and 17."""
    fine = sensors == FINE_ENCODERS
    if source == FORCE_SENSOR:
        name = f"{law}, {FINE_ENCODERS}" if fine else law
        return _run_with_sensor(run_case(bench, name))
    make = partial(_run_with_estimate, bench, law, fine, source)
    if source == KALMAN_ESTIMATE:
        make = partial(_run_with_filter, bench, fine)
    return bench.compute_once(("felt", law, sensors, source), make)


def _run_with_sensor(run: TrackingRun) -> ForceFeedbackRun:
    return ForceFeedbackRun(run, np.stack([run.log["tip_force_x"], run.log["tip_force_y"]], axis=1))


def _run_with_estimate(
    bench: Bench, law: str, fine: bool, source: str, bandwidth: float = OBSERVER_BANDWIDTH
) -> ForceFeedbackRun:
    gains = {**inner_loop(fine), **cartesian_gains(*TRACKING_SET)}
    regulator = SensorlessController(
        bench.arm(), CARTESIAN_LAWS[law], make_guard(), gains, estimator_model(bench, source, fine), bandwidth
    )
    run = follow_circle(bench.arm(), regulator, TRACKING_PUSHES, TRACKING_SECONDS, fine)
    return ForceFeedbackRun(run, np.array(regulator.estimated_forces))


def _run_with_filter(bench: Bench, fine: bool) -> ForceFeedbackRun:
    run = follow_circle(
        bench.arm(),
        make_predictive_controller(bench, TRACKING_SET, "estimate"),
        TRACKING_PUSHES,
        TRACKING_SECONDS,
        fine,
    )
    return ForceFeedbackRun(run, np.full((len(run.log.time), 2), np.nan))


def make_sensorless(bench: Bench) -> Result:
    """Make the figure: both laws and predictive control, with the force sensor and without."""
    runs = {key: run_with_force_from(bench, *key) for key in SENSORLESS_RUNS}
    parts: list[Part] = [*_draw_panels(runs), _make_table(runs)]
    numbers = {
        ", ".join(key): {
            "errors_free_mm": 1e3 * one.run.error_statistics((0, 2)), "yielded_mm": 1e3 * one.displacement_under_push,
            "force_rms_error": one.force_error, "lost_at": one.run.lost_at,
        }
        for key, one in runs.items()
    }  # fmt: skip
    text = (
        "Three circles, the second pushed by 10 N in x and then in y, M, B and K as in Fig. 16. F_e comes from a force"
        " sensor at the tip, or from the torsion of both drives alone: (14) to (16), the kinematic torsion taken off"
        f" as Fig. 14 found it, then through the Jacobian, with an observer of {OBSERVER_BANDWIDTH:g} rad/s that knows"
        " the links' inertia. Dotted: the push as it is."
    )
    logs = {"_".join(key).replace(", ", "_").replace(" ", "_"): one.run.log for key, one in runs.items()}
    own = bench.robot_file({}, sensors=fine_sensors())
    robots = {end: own for end, key in zip(logs, runs, strict=True) if key[1] == FINE_ENCODERS}
    title = "Compliance control without a torque sensor"
    return Result("sensorless", title, text, parts, _make_claims(runs), numbers, 2, _make_choices(bench), logs, robots)


def _draw_panels(runs: Mapping[tuple[str, str, str], ForceFeedbackRun]) -> list[Axes]:
    """Draw displacement and F_e over time, with encoders of 4096 counts, by law and axis."""
    panels = []
    for law in CARTESIAN_LAWS:
        shown = {
            source: runs[law, FINE_ENCODERS, source] for source in (FORCE_SENSOR, FULL_ESTIMATE, UNCOMPENSATED_ESTIMATE)
        }
        time = shown[FORCE_SENSOR].run.log.time
        for axis, word in enumerate("xy"):
            curves = [Curve(source, time, _error_until_far(one.run)[:, axis]) for source, one in shown.items()]
            heading = f"{law} control: tip off the circle in {word}"
            panels.append(Axes(heading, "time (s)", "error (m)", curves, bands=[TRACKING_PUSH_BANDS[axis]]))
    for axis, word in enumerate("xy"):
        one = runs["impedance", FINE_ENCODERS, FULL_ESTIMATE]
        time, push = one.run.log.time, one.run.simulation.push
        curves = [
            Curve("force sensor", time, one.run.log[f"tip_force_{word}"], color="grey", dash="solid", width=0.5),
            Curve("estimate", time, one.force[:, axis], color="vermilion", dash="solid", width=1.2),
            Curve("push", time, push[:, axis], color="ink", dash="dotted", width=1.2),
        ]
        heading = f"impedance control: force on the tip in {word}"
        panels.append(Axes(heading, "time (s)", "force (N)", curves, bands=[TRACKING_PUSH_BANDS[axis]]))
    return panels


def _error_until_far(run: TrackingRun) -> Array:
    """The tip's path error, NaN from its first value above FAR on."""
    off = run.path_error.copy()
    gone = np.maximum.accumulate(np.linalg.norm(off, axis=1) > LARGEST_DRAWN_ERROR)
    off[gone] = np.nan
    return off


def _make_table(runs: Mapping[tuple[str, str, str], ForceFeedbackRun]) -> Grid:
    rows: list[list[Cell]] = []
    for (law, sensors, source), one in runs.items():
        largest, _, spread = 1e3 * one.run.error_statistics((0, 2))
        stopped = "–" if one.run.lost_at is None else f"{one.run.lost_at:.2f}"
        counts = {FINE_ENCODERS: "4096", HALL_SENSORS: "42"}
        given = [
            f"{law}, {source}",
            counts[sensors],
            *largest,
            *spread,
            *(1e3 * one.displacement_under_push),
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


def _make_claims(runs: Mapping[tuple[str, str, str], ForceFeedbackRun]) -> list[Claim]:
    ours = {law: runs[law, FINE_ENCODERS, FULL_ESTIMATE] for law in CARTESIAN_LAWS}
    free = {law: 1e3 * one.run.error_statistics((0, 2))[0] for law, one in ours.items()}
    gave = {
        law: one.displacement_under_push / runs[law, FINE_ENCODERS, FORCE_SENSOR].displacement_under_push
        for law, one in ours.items()
    }
    kept = all(
        ours[law].run.lost_at is None
        and (free[law] <= TABLE_4[law][0]).all()
        and (np.abs(gave[law] - 1) < YIELD_TOLERANCE).all()
        for law in CARTESIAN_LAWS
    )
    words = [
        f"{law}: at most {free[law][0]:.1f} and {free[law][1]:.1f} mm off the circle without a push, and under it "
        f"{gave[law][0]:.2f} and {gave[law][1]:.2f} times as far as with a force sensor"
        for law in CARTESIAN_LAWS
    ]
    plain = {
        law: (
            runs[law, FINE_ENCODERS, SPRINGS_ONLY_ESTIMATE].displacement_under_push
            / runs[law, FINE_ENCODERS, FORCE_SENSOR].displacement_under_push
        )[0]
        for law in CARTESIAN_LAWS
    }
    blind = {law: runs[law, FINE_ENCODERS, UNCOMPENSATED_ESTIMATE] for law in CARTESIAN_LAWS}
    hall = {
        law: 1e3 * runs[law, HALL_SENSORS, FULL_ESTIMATE].run.error_statistics((0, 2))[0].max()
        for law in CARTESIAN_LAWS
    }
    filtered = 1e3 * runs["predictive", HALL_SENSORS, KALMAN_ESTIMATE].run.error_statistics((0, 2))[0].max()
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
            + ", ".join(f"{law} control at {one.run.lost_at:.2f} s" for law, one in blind.items()),
            all(one.run.lost_at is not None for one in blind.values()),
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


def _make_choices(bench: Bench) -> list[Choice]:
    words = []
    for bandwidth in OTHER_BANDWIDTHS:
        one = bench.compute_once(
            ("felt", bandwidth), partial(_run_with_estimate, bench, "admittance", True, FULL_ESTIMATE, bandwidth)
        )
        x, y = 1e3 * one.run.error_statistics((0, 2))[0]
        words.append(
            f"{bandwidth:g} rad/s: {x:.1f} and {y:.1f} mm, {1e3 * one.displacement_under_push[0]:.1f} mm under the push"
            " in x"
        )
    mine = run_with_force_from(bench, "admittance", FINE_ENCODERS, FULL_ESTIMATE)
    x, y = 1e3 * mine.run.error_statistics((0, 2))[0]
    return [
        Choice(
            "how (20) is used in motion",
            f"links' momentum observed with {OBSERVER_BANDWIDTH:g} rad/s: admittance control at most {x:.1f} and"
            f" {y:.1f} mm off the circle, {1e3 * mine.displacement_under_push[0]:.1f} mm under the push in x",
            "; ".join(words),
        )
    ]
