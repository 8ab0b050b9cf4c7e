"""Pictures of an effect: the log's residual without it as points, and the fitted effect as a curve through them.

The residual is that of the model after the verdict with the effect taken out: the part of the log beyond the base
parameters and all other effects. The curve is the part that the effect adds in the model, along the same motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.effect_catalogue import Plot
from hdagen.diagnosis.residuals.effect_agreement import measure_agreement
from hdagen.diagnosis.residuals.localization import list_regressors, time_since_reversal
from hdagen.diagnosis.residuals.regressor_tests import explain_variance
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.residual_trace import ResidualTrace, trace_residual
from hdagen.diagnosis.residuals.spectra import Spectra
from hdagen.log.column_map import name_command_channel
from hdagen.pages.curves import Curve, Panel, Plane, Series, draw_panels, draw_planes

MOST_DRAWN_POINTS = 2500  # of the log that are drawn in one plane
CURVE_BINS = 60  # of the abscissa, for a curve of means
FEWEST_POINTS = 5  # points that a bin must have to be drawn
BIN_GROWTH = 2.5  # exponent of the bins' edges, so that bins are narrow near standstill
SETTLING_ROWS = 20  # rows of a log in which commands from before it may still act
SCENE_SECONDS = 0.25  # s, of a stretch of commands and currents
MOST_DRAWN_REGRESSORS = 3  # regressors that are drawn where no effect is named
LOOP_SECONDS = 10.0  # s, of torque over torsion: more loops hide each other
LARGEST_DRAWN_FREQUENCY = 0.1  # of the sampling rate, up to which a response is drawn
FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Abscissa:
    """The abscissa of a plot: label with unit, and values (K,) at the instants of a residual."""

    label: str
    values: Callable[[ResidualTorque, int], Array]


def _read_column(quantity: str) -> Callable[[ResidualTorque, int], Array]:
    return lambda sight, j: sight.motion.read_state(quantity, j)


def _read_acceleration(sight: ResidualTorque, j: int) -> Array:
    return sight.motion.acceleration[1][:, j - 1]


def _read_load(sight: ResidualTorque, j: int) -> Array:
    return sight.balance.link_torque(sight.after)[:, j - 1]


def _wrap_motor_angle(sight: ResidualTorque, j: int) -> Array:
    return np.asarray(np.mod(sight.motion.read_state("motor_position", j), FULL_TURN))


def _measure_travel(sight: ResidualTorque, joint: int) -> Array:
    """The motor's travel since its last reversal (K,), rad."""
    angle, since = sight.motion.read_state("motor_position", joint), time_since_reversal(sight, joint)
    turned = np.searchsorted(sight.motion.time, sight.motion.time - since - 0.5 * sight.motion.grid.period)
    return np.asarray(np.abs(angle - angle[np.clip(turned, 0, len(angle) - 1)]))


def _read_first_acceleration(sight: ResidualTorque, j: int) -> Array:
    return _read_acceleration(sight, 1)


def _read_input(sight: ResidualTorque, j: int) -> Array:
    return sight.balance.inputs(sight.after)[:, j - 1]


def _read_time(sight: ResidualTorque, j: int) -> Array:
    return sight.motion.time - sight.motion.time[0]


ABSCISSAE = {  # by the name that an effect's plot gives
    "first_joint_acceleration": Abscissa("acceleration of joint 1 (rad/s²)", _read_first_acceleration),
    "joint_acceleration": Abscissa("joint acceleration (rad/s²)", _read_acceleration),
    "joint_angle": Abscissa("joint angle (rad)", _read_column("joint_position")),
    "joint_speed": Abscissa("joint speed (rad/s)", _read_column("joint_velocity")),
    "load": Abscissa("load (N m)", _read_load),
    "motor_angle": Abscissa("motor angle within a turn (rad)", _wrap_motor_angle),
    "motor_input": Abscissa("motor input ({input})", _read_input),
    "motor_speed": Abscissa("motor speed (rad/s)", _read_column("motor_velocity")),
    "motor_travel": Abscissa("motor angle since the last reversal (rad)", _measure_travel),
    "time": Abscissa("time (s)", _read_time),
}
BASE_FRICTION_KEYS = ("coulomb_friction", "viscous_friction")  # the friction of a motor that a robot file states
ROBOT_FILE_WORDS = "the robot file's"
LARGEST_DRAWN_TRAVEL = 2.0  # rad, travel of the motor after a reversal that is drawn


def draw_effect(sight: ResidualTorque, entry: str, place: str) -> list[str]:
    """Draw the figures of an effect, or of the residual where it is unknown.

    Args:
        sight: the residual of the held-out log, before and after the verdict.
        entry: the effect, name@joint; joint 0 is the whole arm.
        place: of the effect; it decides which residual is drawn.

    Returns:
        Figures in HTML.

    """
    effect, _, number = entry.partition("@")
    joints = list(range(1, sight.motion.n + 1))
    if int(number):
        joints = [int(number)]
    if effect in ("unknown", "none"):
        return [_plot_unknown(sight, place, joint) for joint in joints]
    plot = sight.motion.arm.effects[effect].plot
    if plot.kind == "residual":
        return [_plot_residual(sight, entry, place, ABSCISSAE[plot.abscissa], joints)]
    return [figure for joint in joints for figure in _plot_joint(sight, entry, plot, joint)]


def _plot_joint(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> list[str]:
    """The figures of an effect at one joint, by the kind that its plot gives."""
    if plot.kind == "input":
        return _plot_input(sight, entry, plot, joint)
    if plot.kind == "friction":
        return [_plot_friction(sight, entry, plot, joint)]
    if plot.kind == "friction_beyond_base":
        return [_plot_friction_dependence(sight, entry, ABSCISSAE[plot.abscissa], joint)]
    if sight.motion.has_both_sides:
        return [_plot_torsion_loop(sight, entry, joint)]
    return [_plot_response(sight, entry, joint)]


def _plot_residual(sight: ResidualTorque, entry: str, place: str, over: Abscissa, joints: Sequence[int]) -> str:
    """Missing torque or angle over one abscissa, a plane for each joint."""
    shown, label, points, added = [], "", list[Array](), list[Array]()
    for joint in joints:
        seen = trace_residual(sight, place, joint, entry)
        clear = np.ones(len(seen.effect_part), bool)
        if seen.quantity.endswith(f"motor {joint}"):
            clear = sight.motion.is_sliding(joint)[seen.instants]
        x, adds, left = over.values(sight, joint)[seen.instants][clear], seen.effect_part[clear], seen.after[clear]
        label = f"{_name_residual(seen)} ({seen.unit})"
        shown.append(Plane(_draw_points_and_fit(x, left + adds, adds), f"joint {joint}"))
        points, added = [*points, left + adds], [*added, adds]
    x_label = over.label.replace("{input}", sight.motion.input_unit(1))
    caption = f"{RESIDUAL_CAPTION} {measure_agreement(np.concatenate(points), np.concatenate(added)).describe()}"
    return draw_planes(
        _write_title(entry), shown, x_label=x_label, y_label=label, equal=False, columns=1, caption=caption
    )


RESIDUAL_CAPTION = (
    "Points: what the log has beyond the base parameters and everything else of the verdict. Dashed: mean of the "
    "points in narrow bins. Solid: what the effect adds in the model with the fitted parameters. Both passed the "
    "filter with which the motion is differentiated: what is fast shows smaller than it is."
)


def _name_residual(seen: ResidualTrace) -> str:
    return {"A": "current beyond command", "N m": "missing torque", "rad": "missing angle"}[seen.unit]


def _draw_points_and_fit(x: Array, y: Array, fit: Array, split: bool = False) -> list[Curve]:
    """Points, their means, and the fit's means, which are drawn as lines; ``split``: apart for each sign of x."""
    few = np.unique(np.linspace(0, len(x) - 1, min(len(x), MOST_DRAWN_POINTS)).round().astype(int))
    return [
        Curve("log", x[few], y[few], draw="points", color="grey", width=1.6),
        Curve("mean of the log", *average_in_bins(x, y, split), color="blue", dash="dashed"),
        Curve("model with the effect", *average_in_bins(x, fit, split), color="vermilion", dash="solid", width=2.4),
    ]


def average_in_bins(x: Array, y: Array, split: bool = False) -> tuple[Array, Array]:
    """Average points in bins of equal width.

    Args:
        x: abscissae (K,).
        y: ordinates (K,).
        split: bins grow from x = 0 to both sides, with a gap there.

    Returns:
        Mean x and mean y of each bin, y being NaN where a bin has few points.

    """
    if not len(x):
        return x, y
    low, high = float(x.min()), float(x.max())
    if high <= low:
        return np.array([low]), np.array([float(y.mean())])
    edges = np.linspace(low, high, CURVE_BINS + 1)
    if split and low < 0 < high:
        grown = np.linspace(0, 1, CURVE_BINS // 2 + 1) ** BIN_GROWTH
        edges = np.unique(np.r_[low * grown, high * grown])
    number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(number, minlength=len(edges) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.bincount(number, x, len(edges) - 1) / count
        mean = np.bincount(number, y, len(edges) - 1) / count
    mean[count < FEWEST_POINTS] = np.nan
    middle = np.where(count < FEWEST_POINTS, (edges[1:] + edges[:-1]) / 2, middle)
    if split and low < 0 < high:
        at = int(np.searchsorted(edges, 0.0))
        middle, mean = np.insert(middle, at, 0.0), np.insert(mean, at, np.nan)
    return middle, mean


def _plot_friction(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> str:
    """All friction of a motor over speed, or over the travel since a reversal."""
    over, j, ok = ABSCISSAE[plot.abscissa], joint - 1, sight.motion.valid & sight.motion.is_sliding(joint)
    bare, by_speed = sight.parameters_without(entry), plot.abscissa == "motor_speed"
    names = list(sight.motion.arm.parameters.described)
    for name in BASE_FRICTION_KEYS:
        bare[names.index(f"{name}_{joint}")] = 0.0
    fit = -sight.balance.effect_torque(sight.after, bare).motor[ok, j]
    left = -sight.balance.residual(sight.after).motor[ok, j]
    robot = fit + sight.balance.effect_torque(sight.after, _restore_file_friction(sight, bare, joint)).motor[ok, j]
    x, side, y_label = over.values(sight, joint)[ok], np.ones(len(fit)), "friction torque (N m)"
    if not by_speed:
        side, y_label = sight.motion.direction[ok, j], "friction against the motion (N m)"
    if plot.abscissa == "motor_travel":
        near = x <= LARGEST_DRAWN_TRAVEL
        x, side, fit, left, robot = x[near], side[near], fit[near], left[near], robot[near]
    curves = _draw_points_and_fit(x, (fit + left) * side, fit * side, by_speed)
    curves.insert(2, Curve("robot file", *average_in_bins(x, robot * side, by_speed), color="green", dash="dotted"))
    return draw_planes(
        _write_title(entry),
        [Plane(curves, f"motor {joint}")],
        x_label=over.label,
        y_label=y_label,
        equal=False,
        caption=(
            "Points: torque that the log needs beyond inertia and load; standstill and the instants of reversal are"
            " left out. Curves: mean of the points in narrow bins, friction as the robot file has it, and with the"
            " effect at its fitted parameters."
            f" {measure_agreement(fit + left - robot, fit - robot).describe(ROBOT_FILE_WORDS)}"
        ),
    )


def _plot_friction_dependence(sight: ResidualTorque, entry: str, over: Abscissa, joint: int) -> str:
    """Friction beyond Coulomb's and the viscous one, over the quantity that the effect depends on."""
    j, ok = joint - 1, sight.motion.valid & sight.motion.is_sliding(joint)
    side = sight.motion.direction[ok, j]
    fit = -sight.balance.effect_torque(sight.after, sight.parameters_without(entry)).motor[ok, j] * side
    left = -sight.balance.residual(sight.after).motor[ok, j] * side
    return draw_planes(
        _write_title(entry),
        [Plane(_draw_points_and_fit(over.values(sight, joint)[ok], fit + left, fit), f"motor {joint}")],
        x_label=over.label,
        y_label="friction beyond the base's (N m)",
        equal=False,
        caption="Against the motion; standstill and the instants of reversal are left out. "
        f"{RESIDUAL_CAPTION} {measure_agreement(fit + left, fit).describe()}",
    )


def _restore_file_friction(sight: ResidualTorque, bare: Array, joint: int) -> Array:
    """``bare`` with Coulomb and viscous friction as in the robot file."""
    p, names = bare.copy(), list(sight.motion.arm.parameters.described)
    for name in BASE_FRICTION_KEYS:
        place = names.index(f"{name}_{joint}")
        p[place] = sight.before[place]
    return p


def _plot_torsion_loop(sight: ResidualTorque, entry: str, joint: int) -> str:
    """Torque over torsion where that goes furthest: the torque that the links require, and the models' torques."""
    j, ok = joint - 1, np.flatnonzero(sight.motion.valid)
    torsion = sight.motion.smooth(
        (
            sight.motion.read_state("motor_position", joint) / sight.motion.ratio[j]
            - sight.motion.read_state("joint_position", joint)
        )[:, None]
    )[:, 0]
    parts = np.array_split(ok, max(1, round(np.ptp(sight.motion.time[ok]) / LOOP_SECONDS)))
    ok = max(parts, key=lambda part: np.ptp(torsion[part]))
    stretch = ""
    if len(parts) > 1:
        stretch = f", where that goes furthest in {LOOP_SECONDS:g} s"
    torsion, needed = torsion[ok], sight.balance.link_torque(sight.after)[ok, j]
    curves = [Curve("log", torsion, needed, color="grey", dash="solid", width=5.0)]
    lacks = list[Array]()
    for label, p, color, dash in (
        ("robot file", sight.before, "green", "dotted"),
        ("model with the effect", sight.after, "vermilion", "solid"),
    ):
        link = sight.balance.residual(p).link
        assert link is not None  # both sides are measured here
        lacks.append(link[ok, j])
        curves.append(Curve(label, torsion, sight.balance.link_torque(p)[ok, j] - link[ok, j], color=color, dash=dash))
    return draw_planes(
        _write_title(entry),
        [Plane(curves, f"joint {joint}")],
        x_label="torsion (rad)",
        y_label="transmitted torque (N m)",
        equal=False,
        caption="Log: torque that the links' motion asks for, over motor angle divided by ratio less joint angle"
        f"{stretch}. The model's torque is that of its springs and effects at the measured states. "
        f"{measure_agreement(lacks[0], lacks[0] - lacks[1]).describe(ROBOT_FILE_WORDS)}",
    )


def _plot_response(sight: ResidualTorque, entry: str, joint: int) -> str:
    """The spectrum of the replay error, where a joint has one encoder and its torsion is not measured."""
    log, period = sight.motion.log, sight.motion.grid.period
    name = next(n for side in ("motor", "joint") if (n := f"{side}_position_{joint}") in log)
    errors = [sight.motion.on_grid(log[name] - replay.columns[name]) for replay in sight.motion.replays]
    found = [Spectra.from_series(error, period) for error in errors]
    shown = (found[0].frequency > 0) & (found[0].frequency <= LARGEST_DRAWN_FREQUENCY / period)
    drawn = [
        Series("robot file", found[0].density[shown], color="green", dash="dashed"),
        Series("model with the effect", found[1].density[shown], color="vermilion", dash="solid"),
    ]
    return draw_panels(
        f"{_write_title(entry)}: what the replays miss",
        found[0].frequency[shown],
        [Panel(f"{name.replace('_', ' ')} (rad/√Hz)", drawn, log=True)],
        x_label="frequency (Hz)",
        caption="Density of measured less replayed position. With one encoder no torsion is measured: what shows of it "
        "is how the joint answers the motor.",
    )


def _plot_input(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> list[str]:
    """Current or torque over time, where the effect changes most, and over its command."""
    if not sight.motion.has_measured_input(joint):
        return [_plot_residual(sight, entry, "motor", Abscissa("motor input", _read_input), [joint])]
    shown = [sight.balance.simulate_inputs(p)[1][:, joint - 1] for p in (sight.before, sight.after)]
    name, log = sight.motion.arm.input_names[joint - 1], sight.motion.log
    word, unit = sight.motion.input_word(joint), sight.motion.input_unit(joint)
    command, measured = log[name_command_channel(name)], log[name]
    rows = max(round(SCENE_SECONDS / log.period), 20)
    change = np.convolve(np.abs(shown[1] - shown[0])[SETTLING_ROWS:], np.ones(rows), "valid")
    span = slice(SETTLING_ROWS + int(np.argmax(change)), SETTLING_ROWS + int(np.argmax(change)) + rows)
    drawn = [
        Series("command", command[span], color="ink", draw="step", dash="dotted"),
        Series("measured", measured[span], color="grey", dash="solid"),
        Series("robot file", shown[0][span], color="green", dash="dashed"),
        Series("model with the effect", shown[1][span], color="vermilion", dash="solid", width=2.4),
    ]
    scene = draw_panels(
        f"{_write_title(entry)}: command and {word}",
        log.time[span],
        [Panel(f"{word} ({unit})", drawn, f"motor {joint}", height=1.8)],
        caption=f"The {SCENE_SECONDS:g} s in which the effect changes most.",
    )
    x, before, after = command, np.zeros(len(command)), shown[1]
    x_label, y_label, hint = f"command ({unit})", f"{word} ({unit})", ""
    if plot.abscissa == "command_rate":
        x, before = np.gradient(command, log.time), shown[0]
        x_label, y_label = f"rate of the command ({unit}/s)", f"measured less undelayed {word} ({unit})"
        hint = "The slope is the delay, s, with its sign reversed. "
    curves = _draw_points_and_fit(
        x[SETTLING_ROWS:], (measured - before)[SETTLING_ROWS:], (after - before)[SETTLING_ROWS:]
    )
    alike = measure_agreement((measured - shown[0])[SETTLING_ROWS:], (shown[1] - shown[0])[SETTLING_ROWS:])
    over = draw_planes(
        f"{_write_title(entry)}: {word} over command",
        [Plane(curves, f"motor {joint}")],
        x_label=x_label,
        y_label=y_label,
        equal=False,
        caption=f"{hint}{alike.describe(ROBOT_FILE_WORDS)}",
    )
    return [scene, over]


def _plot_unknown(sight: ResidualTorque, place: str, joint: int) -> str:
    """The residual that no effect explains, over the three regressors that explain most of it."""
    seen = trace_residual(sight, place, joint, "")
    best = explain_variance(seen.after, list_regressors(sight, joint, seen.instants))[:MOST_DRAWN_REGRESSORS]
    few = np.unique(np.linspace(0, len(seen.after) - 1, min(len(seen.after), MOST_DRAWN_POINTS)).round().astype(int))
    figures = ""
    for one in best:
        x, name, unit = one.regressor.values, one.regressor.name, one.regressor.unit
        curves = [
            Curve("log", x[few], seen.after[few], draw="points", color="grey", width=1.6),
            Curve("mean", *average_in_bins(x, seen.after), color="blue", dash="solid"),
        ]
        figures += draw_planes(
            f"What is missing at joint {joint}, over {name}",
            [Plane(curves)],
            x_label=f"{name.removeprefix('the ')} ({unit})",
            y_label=f"{_name_residual(seen)} ({seen.unit})",
            equal=False,
            caption=f"Its bins explain {100 * one.share:.0f} % of the variance (p = {one.p:.2g} by circular shifts).",
        )
    return figures


def _write_title(entry: str) -> str:
    effect, _, joint = entry.partition("@")
    title = effect.replace("_", " ").capitalize()
    if joint == "0":
        return title
    return f"{title} of joint {joint}"
