"""The paper's outlook, more joints: the same laws and the same estimate on an arm of three, by its robot file alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.control.reference_motion import Reference
from hdagen.log.measured_log import Log
from hdagen.paper.figures.compliance_figures import BASE_SET, PUSHED_SECONDS
from hdagen.paper.prototype.figure_result import Axes, Cell, Claim, Curve, Grid, Part, Result
from hdagen.paper.prototype.step_response import measure_responses, simulate_ideal
from hdagen.paper.prototype.torque_estimator import column_rms, estimate_torques
from hdagen.paper.prototype.virtual_prototype import (
    CARTESIAN_LAWS,
    CIRCLE_PUSHES,
    PERIOD,
    PUSH_BANDS,
    THREE_JOINTS,
    Bench,
    cartesian_gains,
    fine_sensors,
    make_controller,
    paper_circle,
)
from hdagen.simulation.simulator import run

START_POSTURE = (1.2, -0.9, -1.3)  # rad: bent posture near which the arm starts


def make_joints3(bench: Bench) -> Result:
    """Make the outlook's figure: impedance and admittance control of three joints, and their estimated torques."""
    path, arm = paper_circle(PUSHED_SECONDS), bench.arm(THREE_JOINTS)
    runs = {
        law: run(
            arm,
            make_controller(arm, law, cartesian_gains(*BASE_SET.values()), fine=True),
            path,
            CIRCLE_PUSHES,
            fine_sensors(3),
            1,
            START_POSTURE,
        )
        for law in CARTESIAN_LAWS
    }
    ideal = simulate_ideal(np.array([list(BASE_SET.values())]), CIRCLE_PUSHES, PUSHED_SECONDS, PERIOD)[:, 0]
    moved = {law: one.tip - path.position for law, one in runs.items()}
    gap = {law: float(np.linalg.norm(off - ideal, axis=1).max() / np.abs(ideal).max()) for law, off in moved.items()}
    log, truth = runs["impedance"].log, runs["impedance"].joint_torque
    found = estimate_torques(arm, log)
    error, peak = column_rms(found.whole - truth), np.abs(truth).max(axis=0)
    parts: list[Part] = [*_draw_panels(path, moved, ideal, log, truth, found.whole)]
    answer = {law: measure_responses(off[:, None], CIRCLE_PUSHES, PERIOD)[0] for law, off in moved.items()}
    promised = measure_responses(ideal[:, None], CIRCLE_PUSHES, PERIOD)[0]
    rows: list[list[Cell]] = []
    for law, table in {**answer, "ideal": promised}.items():
        scaled = table * np.array([1.0, 100.0, 1e3])
        rows.append([law, *scaled.ravel().tolist()])
    measures = ("settling (s)", "overshoot (%)", "largest (mm)")
    columns = ("", *(f"{measure} {axis}" for axis in "xy" for measure in measures))
    parts.append(Grid("how the tip answers", columns, rows, 3))
    refused = {law: int((one.status < 0).sum()) for law, one in runs.items()}
    claims = [
        Claim(
            "the system can be extended to multi-axis motion",
            f"three joints by a robot file alone: tip within {100 * gap['impedance']:.0f} % (impedance) and "
            f"{100 * gap['admittance']:.0f} % (admittance) of the ideal's largest displacement, torques to "
            f"{', '.join(f'{100 * e / p:.1f}' for e, p in zip(error, peak, strict=True))} % of their peaks",
            max(gap.values()) < 0.2 and not any(refused.values()),
            "the third joint is one more than the tip needs; what it does is damped",
        )
    ]
    numbers = {"largest_gap_to_ideal": gap, "torque_rms_error": error, "torque_peak": peak, "refused": refused}
    text = (
        "An arm of three of the prototype's drives on the same circle, with the same pushes, laws and gains, "
        "encoders of 4096 counts."
    )
    logs = {law: one.log for law, one in runs.items()}
    return Result(
        "joints3",
        "An arm of three joints",
        text,
        parts,
        claims,
        numbers,
        2,
        logs=logs,
        robots=dict.fromkeys(logs, bench.robot_file({}, THREE_JOINTS, fine_sensors(3))),
    )


def _draw_panels(
    path: Reference, moved: Mapping[str, Array], ideal: Array, log: Log, truth: Array, found: Array
) -> Iterator[Axes]:
    time = path.time
    for axis, word in enumerate("xy"):
        curves = [Curve(law, time, off[:, axis]) for law, off in moved.items()]
        curves.append(Curve("ideal", time, ideal[:, axis], color="ink", dash="dotted"))
        yield Axes(f"in {word}", "time (s)", "tip off the circle (m)", curves, bands=[PUSH_BANDS[axis]])
    angles = [Curve(f"joint {j}", time, log[f"joint_position_{j}"]) for j in (1, 2, 3)]
    yield Axes("joint angles, impedance control", "time (s)", "joint angle (rad)", angles)
    torques = [
        Curve(f"joint {j + 1}", time, truth[:, j], color=color, dash="solid", width=2.2)
        for j, color in enumerate(("blue", "vermilion", "green"))
    ]
    torques += [Curve("", time, found[:, j], color="ink", dash="solid", width=0.6) for j in range(3)]
    yield Axes("joint torques: true, and estimated (thin)", "time (s)", "joint torque (N m)", torques)
