"""The page of `hdagen demo`: simulations and replays as pictures with their numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.demo.demo_runs import BAR, PUSHES, RADIUS, SMOOTHING, TURN, Demo, Followed
from hdagen.demo.shipped_logs import Replayed
from hdagen.pages import animation, figure, page
from hdagen.pages.number_table import Cell
from hdagen.prediction.window_replay import WINDOW
from hdagen.support.version import __version__

NAMES = {"impedance_cartesian": "impedance", "admittance_cartesian": "admittance"}
COLORS = {"impedance_cartesian": "blue", "admittance_cartesian": "vermilion"}
LINK = "circle"  # the figures that share the time of the circle
AXES = ("x", "y")
NB = "\N{NO-BREAK SPACE}"
BANDS = [
    (push.start, push.end, f"{np.hypot(*push.force):g} N in {AXES[int(np.argmax(np.abs(push.force)))]}")
    for push in PUSHES
]


def write(path: Path, demo: Demo) -> None:
    """Write the page, whole or not at all.

    Args:
        path: Where the page goes.
        demo: All results.

    Raises:
        OSError: The page cannot be written.

    """
    sections = [_motion(demo), _displacement(demo), _forces(demo), _torque(demo), *map(_replay, demo.replays)]
    page.write(path, "A dual-joint harmonic-drive arm, compiled", verdict(demo), sections, _reproduce(demo))


def verdict(demo: Demo) -> str:
    """Sum the demo up in one sentence, with its numbers.

    Args:
        demo: All results.

    Returns:
        The sentence.

    """
    drive = demo.arm.robot["joints"][0]["drive"]
    friction = drive["ratio"]["nominal"] * drive["coulomb_friction"]["nominal"]
    shares = " and ".join(f"{100 * f.share:.1f}{NB}% ({NAMES[f.law]})" for f in demo.followed)
    failed = ""
    if not demo.holds:
        failed = f", which misses the bar of {100 * BAR:g}{NB}%"
    text = (
        f"Pushed with {np.hypot(*PUSHES[0].force):g}{NB}N, the tip moves as the mass, damper and spring that it is "
        f"told to be, to within {shares} of their largest displacement, "
        f"{1e3 * demo.followed[0].largest_ideal:.1f}{NB}mm, against {friction:.2g}{NB}N{NB}m of dry friction in each "
        f"joint{failed}; in windows of {WINDOW:g}{NB}s"
    )
    return f"{text} the model replays {' and '.join(_replay_words(one) for one in demo.replays)}."


def _replay_words(replayed: Replayed) -> str:
    errors = " and ".join(f"{1e3 * channel.rms:#.2g}" for channel in replayed.channels)
    return f"a log {_origin(replayed)} to {errors}{NB}m{replayed.channels[0].unit}{NB}rms"


def _origin(replayed: Replayed) -> str:
    if replayed.real:
        return f"measured on {replayed.name}"
    return f"simulated by {replayed.name}"


def _motion(demo: Demo) -> page.Section:
    first = demo.followed[0]
    time, circle = first.reference.time, first.reference.position
    moving = animation.arm(
        "The arm",
        time,
        [animation.Arm(NAMES[f.law], f.points, COLORS[f.law]) for f in demo.followed],
        target=circle,
        pushes=[(push.start, push.end, push.force) for push in PUSHES],
        caption="Arrows are the pushes on the tip. Press play; the cursor of the figures below follows.",
        link=LINK,
    )
    planes = []
    for f in demo.followed:
        curves = [
            _path("circle", circle, time, "grey", "dashed", 1.4),
            _path("tip", f.points[:, -1], time, COLORS[f.law], "solid", 1.8),
            _path("ideal", circle + f.ideal, time, "ink", "dotted", 1.8),
        ]
        planes.append(figure.Plane(curves, heading=f"{NAMES[f.law]} control"))
    paths = figure.planes(
        "Path of the tip",
        planes,
        x_label="x (m)",
        y_label="y (m)",
        caption="Ideal is the circle plus what the pushes do to the wanted mass, damper and spring.",
        link=LINK,
    )
    g = first.gains
    text = (
        "The compiled arm, with dry friction that sticks, encoders that count and sensors with noise, follows a "
        f"circle of {1e3 * RADIUS:g}{NB}mm radius, {TURN:g}{NB}s a turn, and is pushed twice. Both controllers are "
        f"asked to be a mass of {g['mass_x']:g}{NB}kg, a damper of {g['damping_x']:g}{NB}N{NB}s/m and a spring of "
        f"{g['stiffness_x']:g}{NB}N/m about the moving point. Impedance control asks the motors for the torque that "
        "this takes; admittance control reads the force and moves to where the mass would be."
    )
    return page.Section("The arm on its circle", text, [moving, paths, _table(demo)])


def _path(label: str, points: Array, time: Array, color: str, dash: str, width: float) -> figure.Curve:
    return figure.Curve(label, points[:, 0], points[:, 1], time=time, color=color, dash=dash, width=width)


def _table(demo: Demo) -> str:
    rows = [_row(NAMES[f.law], f) for f in demo.followed]
    rows.append(_row(f"{NAMES[demo.uncompensated.law]} without observer", demo.uncompensated))
    columns = ("control", "gap (mm)", "gap (%)", "at (s)", "rms gap (mm)", "limited", "refused")
    met = "missed"
    if demo.holds:
        met = "met"
    caption = (
        "The largest gap between tip and ideal, also as a share of the largest ideal displacement, "
        f"{1e3 * demo.followed[0].largest_ideal:.1f}{NB}mm; the bar for the first two rows, {100 * BAR:g}{NB}%, is "
        f"{met}. The last row shows the effect of dry friction where no observer compensates it. "
        f"Limited: ticks, of {len(demo.followed[0].gap)}, whose torque the guard held back in size or rate."
    )
    faults = "".join(f" {NAMES[f.law]}: {f.fault}" for f in demo.followed if f.fault)
    return figure.table("Tip against ideal", columns, rows, digits=3, caption=caption + faults)


def _row(name: str, f: Followed) -> list[Cell]:
    rms = float(np.sqrt(np.mean(f.gap**2)))
    at = float(f.reference.time[f.gap.argmax()])
    status = f.simulation.status
    limited, refused = int((status > 0).sum()), int((status < 0).sum())
    return [name, 1e3 * float(f.gap.max()), 100 * f.share, at, 1e3 * rms, limited, refused]


def _displacement(demo: Demo) -> page.Section:
    first = demo.followed[0]
    panels = []
    for axis in range(2):
        series = [figure.Series(NAMES[f.law], f.moved[:, axis], COLORS[f.law]) for f in demo.followed]
        ideal = figure.Series("ideal", first.ideal[:, axis], "ink", "dotted")
        panels.append(figure.Panel(f"tip off the circle, {AXES[axis]} (m)", [*series, ideal]))
    gaps = [figure.Series(NAMES[f.law], f.gap, COLORS[f.law]) for f in demo.followed]
    name = f"{NAMES[demo.uncompensated.law]} without observer"
    gaps.append(figure.Series(name, demo.uncompensated.gap, "grey", "solid", width=1.2))
    bar = [(BAR * first.largest_ideal, f"{100 * BAR:g} % of the largest ideal")]
    panels.append(figure.Panel("gap to the ideal (m)", gaps, levels=bar, height=1.2))
    drawn = figure.panels("Displacement", first.reference.time, panels, bands=BANDS, link=LINK)
    text = (
        "How far the tip is off the point that moves on the circle, and how far M ẍ + B ẋ + K x = F says it should be. "
        "The gap peaks where the force steps: the motors' torque may only change so fast, and speeds are filtered "
        "differences of encoder counts. Without the observer that compensates friction (grey) the drives stick, and "
        "the tip lags behind."
    )
    return page.Section("How it gives way", text, [drawn])


def _forces(demo: Demo) -> page.Section:
    first = demo.followed[0]
    log, colors = first.simulation.log, ("green", "purple")
    felt = [
        figure.Series(axis, log[f"tip_force_{axis}"], color, "solid", width=1.2)
        for axis, color in zip(AXES, colors, strict=True)
    ]
    panels = [figure.Panel("force on the tip (N)", felt, height=0.9)]
    for j in range(demo.arm.n):
        series = [
            figure.Series(NAMES[f.law], f.simulation.torque[:, j], COLORS[f.law], draw="step", width=1.2)
            for f in demo.followed
        ]
        limit = _limit(demo.arm, j)
        panels.append(
            figure.Panel(
                "motor torque (N m)", series, heading=f"joint {j + 1}", levels=[(limit, "limit"), (-limit, "")]
            )
        )
    drawn = figure.panels(
        "Force and motor torques",
        first.reference.time,
        panels,
        bands=BANDS,
        caption="The force as its sensor reads it, and the torques that the guard let through to the motors.",
        link=LINK,
    )
    text = (
        "Every tick passes a guard: what comes in is checked, what goes out stays within the motor's torque and its "
        "rate. A force that steps runs into these limits for some ticks, which the table above counts."
    )
    return page.Section("Forces and torques", text, [drawn])


def _limit(arm: Arm, j: int) -> float:
    drive = arm.robot["joints"][j]["drive"]
    return float(drive["torque_constant"]["nominal"] * drive["max_current"])


def _torque(demo: Demo) -> page.Section:
    estimated = demo.estimated
    torques, errors = [], []
    for j in range(demo.arm.n):
        dynamic, series, true = estimated.dynamic[:, j], estimated.series[:, j], estimated.true[:, j]
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
    drawn = figure.panels(
        "Joint torque, true and estimated",
        demo.followed[0].reference.time,
        [*torques, *errors],
        bands=[(start, end, "") for start, end, _ in BANDS],
        columns=demo.arm.n,
        share_y=True,
        caption=f"Under {NAMES[demo.followed[0].law]} control; angles smoothed over {1e3 * SMOOTHING:g} ms.",
        link=LINK,
    )
    rows: list[list[Cell]] = [
        ["series", *map(float, estimated.rms(estimated.series))],
        ["dynamic", *map(float, estimated.rms(estimated.dynamic))],
    ]
    columns = ("estimate", *(f"joint {j}, rms error (N m)" for j in range(1, demo.arm.n + 1)))
    text = (
        "No sensor measures the joints' torque; it is read from the torsion, the difference between two encoders, "
        f"where a count of the motor's is about 0.1{NB}N{NB}m. The series estimate inverts both springs of the drive "
        "at once. The dynamic one takes the wave generator's share from the motor's torque, acceleration and "
        "friction, and errs where the rotor sticks, for there friction is anything up to its level. Neither sees "
        "the torque of the drive's damping, which counts for a moment where the force steps."
    )
    table = figure.table("Errors", columns, rows, digits=2)
    return page.Section("Torque without a torque sensor", text, [drawn, table])


def _replay(replayed: Replayed) -> page.Section:
    above, below = [], []
    origin = replayed.name
    if replayed.real:
        origin = "measured"
    for channel in replayed.channels:
        curves = [
            figure.Series(origin, channel.measured, "ink", "solid", width=1.2),
            figure.Series("replayed", channel.predicted, "vermilion", "dashed"),
        ]
        above.append(figure.Panel(f"position ({channel.unit})", curves, heading=channel.name))
        residual = [figure.Series("", channel.residual, "vermilion", "solid", width=1.1)]
        below.append(figure.Panel(f"replayed − {origin} ({channel.unit})", residual, height=0.8))
    panels = [*above, *below]
    drawn = figure.panels("Replay", replayed.log.time, panels, columns=len(above), share_y=True, link=replayed.name)
    rows: list[list[Cell]] = [
        [c.name, c.unit, c.rms, float(np.abs(c.residual).max()), c.still, 100 * c.rms / c.still]
        for c in replayed.channels
    ]
    columns = ("", "unit", "rms residual", "largest", "rms motion", "residual / motion (%)")
    caption = f"Motion is the way since the start of each window of {WINDOW:g} s."
    table = figure.table("Residuals", columns, rows, digits=3, caption=caption)
    return page.Section(f"Replay of a log {_origin(replayed)}", _replay_text(replayed), [drawn, table])


def _replay_text(replayed: Replayed) -> str:
    if replayed.real:
        text = (
            "EMPS is a real machine: a motor, a ball screw and a carriage, whose position is controlled. The robot "
            "file holds the parameters that its authors published. "
        )
    else:
        text = (
            "This log is simulated, not measured: MuJoCo moves the same arm under PD control, with a push, encoder "
            "counts and noise. It differs as simulators do: its springs are linear where the model's stiffen, and its "
            "dry friction creeps through each reversal where the model's sticks, which makes most of the residual. "
        )
    how = (
        f"Each window of {WINDOW:g}{NB}s starts at the state that the rows before it give, and is simulated from "
        "the logged commands and forces alone; nothing measured inside it counts."
    )
    return "\n\n".join([text + how, *replayed.notes])


def _reproduce(demo: Demo) -> str:
    arms = [demo.arm, *(one.arm for one in demo.replays if one.arm is not demo.arm)]
    return "\n\n".join(
        [
            f"hdagen {__version__} made this page; every number on it is computed when it is made.",
            f"    hdagen demo --profile {demo.arm.manifest['profile']}",
            "It ran these builds, named by the hash of what they were made of:",
            "\n".join(f"    {arm.folder.name}" for arm in arms),
            "The same builds and logs give the same page, to the byte.",
        ]
    )
