"""Pictures of an effect: the log's residual without it as points, and the fitted effect as a curve through them.

The residual is that of the model after the verdict with the effect taken out: the part of the log beyond the base
parameters and all other effects. The curve is the part that the effect adds in the model, along the same motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.effect_catalogue import Plot
from hdagen.diagnosis.report.effect_picture import EffectPicture
from hdagen.diagnosis.report.input_plots import draw_input
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.report.residual_curves import (
    ROBOT_FILE_WORDS,
    average_in_bins,
    draw_points_and_fit,
    name_residual,
    write_title,
)
from hdagen.diagnosis.residuals.effect_agreement import measure_agreement
from hdagen.diagnosis.residuals.localization import list_regressors, time_since_reversal
from hdagen.diagnosis.residuals.regressor_tests import explain_variance
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.residual_trace import trace_residual
from hdagen.diagnosis.residuals.spectra import Spectra
from hdagen.pages.curves import Curve, Panel, Plane, Series, draw_panels, draw_planes


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
    return np.asarray(np.mod(sight.motion.read_state("motor_position", j), math.tau))


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


def draw_effect(sight: ResidualTorque, entry: str, place: str) -> list[EffectPicture]:
    """Draw the figures of an effect, or of the residual where it is unknown.

    Args:
        sight: the residual of the held-out log, before and after the verdict.
        entry: the effect, name@joint; joint 0 is the whole arm.
        place: of the effect; it decides which residual is drawn.

    Returns:
        The pictures.

    """
    effect, _, number = entry.partition("@")
    joints = list(range(1, sight.motion.n + 1))
    if int(number):
        joints = [int(number)]
    if effect in ("unknown", "none"):
        return [picture for joint in joints for picture in _plot_unknown(sight, place, joint)]
    plot = sight.motion.arm.effects[effect].plot
    if plot.kind == "residual":
        return [_plot_residual(sight, entry, place, ABSCISSAE[plot.abscissa], joints)]
    return [figure for joint in joints for figure in _plot_joint(sight, entry, plot, joint)]


def _plot_joint(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> list[EffectPicture]:
    """The figures of an effect at one joint, by the kind that its plot gives."""
    if plot.kind == "input":
        return draw_input(sight, entry, plot, joint)
    if plot.kind == "friction":
        return [_plot_friction(sight, entry, plot, joint)]
    if plot.kind == "friction_beyond_base":
        return [_plot_friction_dependence(sight, entry, ABSCISSAE[plot.abscissa], joint)]
    if sight.motion.has_both_sides:
        return [_plot_torsion_loop(sight, entry, joint)]
    return [_plot_response(sight, entry, joint)]


def _plot_residual(
    sight: ResidualTorque, entry: str, place: str, over: Abscissa, joints: Sequence[int]
) -> EffectPicture:
    """Missing torque or angle over one abscissa, a plane for each joint."""
    shown, label, points, added = [], "", list[Array](), list[Array]()
    for joint in joints:
        seen = trace_residual(sight, place, joint, entry)
        clear = np.ones(len(seen.effect_part), bool)
        if seen.quantity.endswith(f"motor {joint}"):
            clear = sight.motion.is_sliding(joint)[seen.instants]
        x, adds, left = over.values(sight, joint)[seen.instants][clear], seen.effect_part[clear], seen.after[clear]
        label = f"{name_residual(seen)} ({seen.unit})"
        shown.append(Plane(draw_points_and_fit(x, left + adds, adds), f"joint {joint}"))
        points, added = [*points, left + adds], [*added, adds]
    x_label = over.label.replace("{input}", sight.motion.input_unit(1))
    alike = measure_agreement(np.concatenate(points), np.concatenate(added))
    caption = f"Log: what is there beyond everything else of the verdict. {alike.describe()}"
    return EffectPicture(
        draw_planes(write_title(entry), shown, x_label=x_label, y_label=label, equal=False, columns=1, caption=caption),
        alike,
    )


def _plot_friction(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> EffectPicture:
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
        near = x <= REPORT.largest_drawn_travel
        x, side, fit, left, robot = x[near], side[near], fit[near], left[near], robot[near]
    curves = draw_points_and_fit(x, (fit + left) * side, fit * side, by_speed)
    curves.insert(2, Curve("robot file", *average_in_bins(x, robot * side, by_speed), color="green", dash="dotted"))
    alike = measure_agreement(fit + left - robot, fit - robot)
    drawn = draw_planes(
        write_title(entry),
        [Plane(curves, f"motor {joint}")],
        x_label=over.label,
        y_label=y_label,
        equal=False,
        caption=f"Log: torque beyond inertia and load. {alike.describe(ROBOT_FILE_WORDS)}",
    )
    return EffectPicture(drawn, alike)


def _plot_friction_dependence(sight: ResidualTorque, entry: str, over: Abscissa, joint: int) -> EffectPicture:
    """Friction beyond Coulomb's and the viscous one, over the quantity that the effect depends on."""
    j, ok = joint - 1, sight.motion.valid & sight.motion.is_sliding(joint)
    side = sight.motion.direction[ok, j]
    fit = -sight.balance.effect_torque(sight.after, sight.parameters_without(entry)).motor[ok, j] * side
    left = -sight.balance.residual(sight.after).motor[ok, j] * side
    alike = measure_agreement(fit + left, fit)
    drawn = draw_planes(
        write_title(entry),
        [Plane(draw_points_and_fit(over.values(sight, joint)[ok], fit + left, fit), f"motor {joint}")],
        x_label=over.label,
        y_label="friction beyond the base's (N m)",
        equal=False,
        caption=f"Log: friction against the motion, beyond Coulomb's and the viscous one. {alike.describe()}",
    )
    return EffectPicture(drawn, alike)


def _restore_file_friction(sight: ResidualTorque, bare: Array, joint: int) -> Array:
    """``bare`` with Coulomb and viscous friction as in the robot file."""
    p, names = bare.copy(), list(sight.motion.arm.parameters.described)
    for name in BASE_FRICTION_KEYS:
        place = names.index(f"{name}_{joint}")
        p[place] = sight.before[place]
    return p


def _plot_torsion_loop(sight: ResidualTorque, entry: str, joint: int) -> EffectPicture:
    """Torque over torsion where that goes furthest: the torque that the links require, and the models' torques."""
    j, ok = joint - 1, np.flatnonzero(sight.motion.valid)
    torsion = sight.motion.smooth(
        (
            sight.motion.read_state("motor_position", joint) / sight.motion.ratio[j]
            - sight.motion.read_state("joint_position", joint)
        )[:, None]
    )[:, 0]
    parts = np.array_split(ok, max(1, round(np.ptp(sight.motion.time[ok]) / REPORT.loop_seconds)))
    ok = max(parts, key=lambda part: np.ptp(torsion[part]))
    stretch = ""
    if len(parts) > 1:
        stretch = f", where that goes furthest in {REPORT.loop_seconds:g} s"
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
    alike = measure_agreement(lacks[0], lacks[0] - lacks[1])
    drawn = draw_planes(
        write_title(entry),
        [Plane(curves, f"joint {joint}")],
        x_label="torsion (rad)",
        y_label="transmitted torque (N m)",
        equal=False,
        caption="Log: torque that the links' motion asks for, over motor angle divided by ratio less joint angle"
        f"{stretch}. The model's torque is that of its springs and effects at the measured states. "
        f"{alike.describe(ROBOT_FILE_WORDS)}",
    )
    return EffectPicture(drawn, alike)


def _plot_response(sight: ResidualTorque, entry: str, joint: int) -> EffectPicture:
    """The spectrum of the replay error, where a joint has one encoder and its torsion is not measured."""
    log, period = sight.motion.log, sight.motion.grid.period
    name = next(n for side in ("motor", "joint") if (n := f"{side}_position_{joint}") in log)
    errors = [sight.motion.on_grid(log[name] - replay.columns[name]) for replay in sight.motion.replays]
    found = [Spectra.from_series(error, period) for error in errors]
    shown = (found[0].frequency > 0) & (found[0].frequency <= REPORT.largest_drawn_frequency / period)
    drawn = [
        Series("robot file", found[0].density[shown], color="green", dash="dashed"),
        Series("model with the effect", found[1].density[shown], color="vermilion", dash="solid"),
    ]
    markup = draw_panels(
        f"{write_title(entry)}: what the replays miss",
        found[0].frequency[shown],
        [Panel(f"{name.replace('_', ' ')} (rad/√Hz)", drawn, log=True)],
        x_label="frequency (Hz)",
        caption="Density of measured less replayed position. With one encoder no torsion is measured: what shows of it "
        "is how the joint answers the motor.",
    )
    return EffectPicture(markup)


def _plot_unknown(sight: ResidualTorque, place: str, joint: int) -> list[EffectPicture]:
    """The residual that no effect explains, over what it surely goes with; nothing where there is no such thing."""
    seen = trace_residual(sight, place, joint, "")
    notable = [
        one
        for one in explain_variance(seen.after, list_regressors(sight, joint, seen.instants))
        if one.p <= REPORT.most_drawn_chance and one.share >= REPORT.least_notable_share
    ]
    few = np.unique(
        np.linspace(0, len(seen.after) - 1, min(len(seen.after), REPORT.most_drawn_points)).round().astype(int)
    )
    pictures = []
    for one in notable[: REPORT.most_drawn_regressors]:
        x, name, unit = one.regressor.values, one.regressor.name, one.regressor.unit
        curves = [
            Curve("log", x[few], seen.after[few], draw="points", color="grey", width=1.2),
            Curve("mean", *average_in_bins(x, seen.after), color="blue", dash="solid"),
        ]
        drawn = draw_planes(
            f"What is missing at joint {joint}, over {name}",
            [Plane(curves)],
            x_label=f"{name.removeprefix('the ')} ({unit})",
            y_label=f"{name_residual(seen)} ({seen.unit})",
            equal=False,
            caption=f"The mean curve explains {100 * one.share:.0f} % of the variance (R² = {one.share:.2f}).",
        )
        pictures.append(EffectPicture(drawn))
    return pictures
