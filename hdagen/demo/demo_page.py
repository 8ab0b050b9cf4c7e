"""The page of `hdagen demo`: a diagnosis, then a compliant arm, as pictures with their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.demo.demo_runs import (
    CIRCLE_RADIUS,
    DEMO_PUSHES,
    LARGEST_GAP_SHARE,
    SECONDS_PER_TURN,
    SMOOTHING_SECONDS,
    CircleRun,
    DemoResult,
)
from hdagen.demo.leg_section import build_leg_sections, describe_leg
from hdagen.pages import animation, figure, page
from hdagen.pages.number_table import TableCell
from hdagen.support.version import __version__

LAW_NAMES = {"impedance_cartesian": "impedance", "admittance_cartesian": "admittance"}
LAW_COLORS = {"impedance_cartesian": "blue", "admittance_cartesian": "vermilion"}
OWN_ROBOT = "hdagen diagnose my_robot.toml my_log.csv"  # the last line of the demo
CIRCLE_LINK = "circle"  # the figures that share the time of the circle
AXIS_NAMES = ("x", "y")
NO_BREAK_SPACE = "\N{NO-BREAK SPACE}"
DEMO_PUSH_BANDS = [
    (push.start, push.end, f"{np.hypot(*push.force):g} N in {AXIS_NAMES[int(np.argmax(np.abs(push.force)))]}")
    for push in DEMO_PUSHES
]


def write_demo_page(path: Path, demo: DemoResult) -> None:
    """Write the page, whole or not at all.

    Args:
        path: Where the page goes.
        demo: All results.

    Raises:
        OSError: The page cannot be written.

    """
    sections = [
        *build_leg_sections(demo.leg),
        _build_motion_section(demo),
        _build_displacement_section(demo),
        _build_forces_section(demo),
        _build_torque_section(demo),
    ]
    title = "A model that is wrong, found and mended; and an arm that gives way"
    page.write_page(path, title, format_demo_verdict(demo), sections, _format_commands(demo))


def format_demo_verdict(demo: DemoResult) -> str:
    """Sum the demo up in a few sentences, with its numbers.

    Args:
        demo: All results.

    Returns:
        The sentences.

    """
    drive = demo.arm.robot["joints"][0]["drive"]
    friction = drive["ratio"]["nominal"] * drive["coulomb_friction"]["nominal"]
    shares = " and ".join(f"{100 * f.gap_share:.1f}{NO_BREAK_SPACE}% ({LAW_NAMES[f.law]})" for f in demo.circle_runs)
    failed = ""
    if not all(followed.meets_bar for followed in demo.circle_runs):
        failed = f", which misses the bar of {100 * LARGEST_GAP_SHARE:g}{NO_BREAK_SPACE}%"
    return (
        f"{describe_leg(demo.leg)} Then an arm: pushed with {np.hypot(*DEMO_PUSHES[0].force):g}{NO_BREAK_SPACE}N, its"
        f" tip moves as the mass, damper and spring that it is told to be, to within {shares} of their largest"
        f" displacement, {1e3 * demo.circle_runs[0].largest_ideal:.1f}{NO_BREAK_SPACE}mm, against"
        f" {friction:.2g}{NO_BREAK_SPACE}N{NO_BREAK_SPACE}m of dry friction in each joint{failed}."
    )


def _build_motion_section(demo: DemoResult) -> page.Section:
    first = demo.circle_runs[0]
    time, circle = first.reference.time, first.reference.position
    moving = animation.animate_arms(
        "The arm",
        time,
        [animation.MovingArm(LAW_NAMES[f.law], f.points, LAW_COLORS[f.law]) for f in demo.circle_runs],
        target=circle,
        pushes=[(push.start, push.end, push.force) for push in DEMO_PUSHES],
        caption="Arrows are the pushes on the tip. Press play; the cursor of the figures below follows.",
        link=CIRCLE_LINK,
    )
    planes = []
    for f in demo.circle_runs:
        curves = [
            _build_path_curve("circle", circle, time, "grey", "dashed", 1.4),
            _build_path_curve("tip", f.points[:, -1], time, LAW_COLORS[f.law], "solid", 1.8),
            _build_path_curve("ideal", circle + f.ideal_displacement, time, "ink", "dotted", 1.8),
        ]
        planes.append(figure.Plane(curves, heading=f"{LAW_NAMES[f.law]} control"))
    paths = figure.draw_planes(
        "Path of the tip",
        planes,
        x_label="x (m)",
        y_label="y (m)",
        caption="Ideal is the circle plus what the pushes do to the wanted mass, damper and spring.",
        link=CIRCLE_LINK,
    )
    g = first.gains
    text = (
        "The compiled arm, with dry friction that sticks, encoders that count and sensors with noise, follows a circle"
        f" of {1e3 * CIRCLE_RADIUS:g}{NO_BREAK_SPACE}mm radius, {SECONDS_PER_TURN:g}{NO_BREAK_SPACE}s a turn, and is"
        f" pushed twice. Both controllers are asked to be a mass of {g['mass_x']:g}{NO_BREAK_SPACE}kg, a damper of"
        f" {g['damping_x']:g}{NO_BREAK_SPACE}N{NO_BREAK_SPACE}s/m and a spring of"
        f" {g['stiffness_x']:g}{NO_BREAK_SPACE}N/m about the moving point. Impedance control asks the motors for the"
        " torque that this takes; admittance control reads the force and moves to where the mass would be."
    )
    return page.Section("The arm on its circle", text, [moving, paths, _build_gap_table(demo)])


def _build_path_curve(label: str, points: Array, time: Array, color: str, dash: str, width: float) -> figure.Curve:
    return figure.Curve(label, points[:, 0], points[:, 1], time=time, color=color, dash=dash, width=width)


def _build_gap_table(demo: DemoResult) -> str:
    rows = [_build_gap_row(LAW_NAMES[f.law], f) for f in demo.circle_runs]
    rows.append(_build_gap_row(f"{LAW_NAMES[demo.uncompensated_run.law]} without observer", demo.uncompensated_run))
    columns = ("control", "gap (mm)", "gap (%)", "at (s)", "rms gap (mm)", "limited", "refused")
    met = "missed"
    if demo.meets_bar:
        met = "met"
    caption = (
        "The largest gap between tip and ideal, also as a share of the largest ideal displacement,"
        f" {1e3 * demo.circle_runs[0].largest_ideal:.1f}{NO_BREAK_SPACE}mm; the bar for the first two rows,"
        f" {100 * LARGEST_GAP_SHARE:g}{NO_BREAK_SPACE}%, is {met}. The last row shows the effect of dry friction where"
        f" no observer compensates it. Limited: ticks, of {len(demo.circle_runs[0].gap)}, whose torque the guard held"
        " back in size or rate."
    )
    faults = "".join(f" {LAW_NAMES[f.law]}: {f.first_fault}" for f in demo.circle_runs if f.first_fault)
    return figure.draw_table("Tip against ideal", columns, rows, digits=3, caption=caption + faults)


def _build_gap_row(name: str, f: CircleRun) -> list[TableCell]:
    rms = float(np.sqrt(np.mean(f.gap**2)))
    at = float(f.reference.time[f.gap.argmax()])
    status = f.simulation.status
    limited, refused = int((status > 0).sum()), int((status < 0).sum())
    return [name, 1e3 * float(f.gap.max()), 100 * f.gap_share, at, 1e3 * rms, limited, refused]


def _build_displacement_section(demo: DemoResult) -> page.Section:
    first = demo.circle_runs[0]
    panels = []
    for axis in range(2):
        series = [
            figure.Series(LAW_NAMES[f.law], f.tip_displacement[:, axis], LAW_COLORS[f.law]) for f in demo.circle_runs
        ]
        ideal = figure.Series("ideal", first.ideal_displacement[:, axis], "ink", "dotted")
        panels.append(figure.Panel(f"tip off the circle, {AXIS_NAMES[axis]} (m)", [*series, ideal]))
    gaps = [figure.Series(LAW_NAMES[f.law], f.gap, LAW_COLORS[f.law]) for f in demo.circle_runs]
    name = f"{LAW_NAMES[demo.uncompensated_run.law]} without observer"
    gaps.append(figure.Series(name, demo.uncompensated_run.gap, "grey", "solid", width=1.2))
    bar = [(LARGEST_GAP_SHARE * first.largest_ideal, f"{100 * LARGEST_GAP_SHARE:g} % of the largest ideal")]
    panels.append(figure.Panel("gap to the ideal (m)", gaps, levels=bar, height=1.2))
    drawn = figure.draw_panels("Displacement", first.reference.time, panels, bands=DEMO_PUSH_BANDS, link=CIRCLE_LINK)
    text = (
        "How far the tip is off the point that moves on the circle, and how far M ẍ + B ẋ + K x = F says it should be. "
        "The gap peaks where the force steps: the motors' torque may only change so fast, and speeds are filtered "
        "differences of encoder counts. Without the observer that compensates friction (grey) the drives stick, and "
        "the tip lags behind."
    )
    return page.Section("How it gives way", text, [drawn])


def _build_forces_section(demo: DemoResult) -> page.Section:
    first = demo.circle_runs[0]
    log, colors = first.simulation.log, ("green", "purple")
    felt = [
        figure.Series(axis, log[f"tip_force_{axis}"], color, "solid", width=1.2)
        for axis, color in zip(AXIS_NAMES, colors, strict=True)
    ]
    panels = [figure.Panel("force on the tip (N)", felt, height=0.9)]
    for j in range(demo.arm.n):
        series = [
            figure.Series(LAW_NAMES[f.law], f.simulation.torque[:, j], LAW_COLORS[f.law], draw="step", width=1.2)
            for f in demo.circle_runs
        ]
        limit = _find_torque_limit(demo.arm, j)
        panels.append(
            figure.Panel(
                "motor torque (N m)", series, heading=f"joint {j + 1}", levels=[(limit, "limit"), (-limit, "")]
            )
        )
    drawn = figure.draw_panels(
        "Force and motor torques",
        first.reference.time,
        panels,
        bands=DEMO_PUSH_BANDS,
        caption="The force as its sensor reads it, and the torques that the guard let through to the motors.",
        link=CIRCLE_LINK,
    )
    text = (
        "Every tick passes a guard: what comes in is checked, what goes out stays within the motor's torque and its "
        "rate. A force that steps runs into these limits for some ticks, which the table above counts."
    )
    return page.Section("Forces and torques", text, [drawn])


def _find_torque_limit(arm: Arm, j: int) -> float:
    drive = arm.robot["joints"][j]["drive"]
    return float(drive["torque_constant"]["nominal"] * drive["max_current"])


def _build_torque_section(demo: DemoResult) -> page.Section:
    estimated = demo.torque_estimates
    torques, errors = [], []
    for j in range(demo.arm.n):
        dynamic, series, true = (
            estimated.dynamic_estimate[:, j],
            estimated.series_estimate[:, j],
            estimated.true_torque[:, j],
        )
        three = [
            figure.Series("dynamic", dynamic, "orange", "solid", width=1.2),
            figure.Series("series", series, "green", "solid", width=1.4),
            figure.Series("true", true, "ink", "dotted"),
        ]
        two = [
            figure.Series("dynamic", dynamic - true, "orange", "solid", width=1.0),
            figure.Series("series", series - true, "green", "solid", width=1.2),
        ]
        torques.append(figure.Panel("τ (N m)", three, heading=f"joint {j + 1}"))
        errors.append(figure.Panel("error (N m)", two, height=0.7))
    drawn = figure.draw_panels(
        "Joint torque, true and estimated",
        demo.circle_runs[0].reference.time,
        [*torques, *errors],
        bands=[(start, end, "") for start, end, _ in DEMO_PUSH_BANDS],
        columns=demo.arm.n,
        share_y=True,
        caption=(
            f"Under {LAW_NAMES[demo.circle_runs[0].law]} control; angles smoothed over {1e3 * SMOOTHING_SECONDS:g} ms."
        ),
        link=CIRCLE_LINK,
    )
    rows: list[list[TableCell]] = [
        ["series", *map(float, estimated.rms_error(estimated.series_estimate))],
        ["dynamic", *map(float, estimated.rms_error(estimated.dynamic_estimate))],
    ]
    columns = ("estimate", *(f"joint {j}, rms error (N m)" for j in range(1, demo.arm.n + 1)))
    text = (
        "No sensor measures the joints' torque; it is read from the torsion, the difference between two encoders,"
        f" where a count of the motor's is about 0.1{NO_BREAK_SPACE}N{NO_BREAK_SPACE}m. The series estimate inverts"
        " both springs of the drive at once. The dynamic one takes the wave generator's share from the motor's torque,"
        " acceleration and friction, and errs where the rotor sticks, for there friction is anything up to its level."
        " Neither sees the torque of the drive's damping, which counts for a moment where the force steps."
    )
    table = figure.draw_table("Errors", columns, rows, digits=2)
    return page.Section("Torque without a torque sensor", text, [drawn, table])


def _format_commands(demo: DemoResult) -> str:
    arms = [demo.leg.arm, demo.arm]
    return "\n\n".join(
        [
            f"hdagen {__version__} made this page; every number on it is computed when it is made.",
            f"    hdagen demo --profile {demo.arm.manifest['profile']}",
            "It ran these builds, named by the hash of what they were made of:",
            "\n".join(f"    {arm.folder.name}" for arm in arms),
            "The same builds give the same page, to the byte. The diagnosis alone, in a checkout of hdagen:",
            "    hdagen diagnose hdagen/data/leg.toml hdagen/data/leg_log.parquet --out diagnosis\n"
            "    hdagen adopt diagnosis/diagnosis.json hdagen/data/leg.toml --out leg.new.toml\n"
            "    hdagen export mjcf hdagen/data/leg.toml --with diagnosis/diagnosis.json"
            " --prove hdagen/data/leg_log.parquet --out leg.xml",
            "And your own robot, described as docs/guides/bring_your_robot.md says:",
            f"    {OWN_ROBOT}",
        ]
    )
