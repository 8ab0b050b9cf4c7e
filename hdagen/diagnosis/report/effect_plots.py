"""Pictures of an effect: the log's residual without it as points, and the fitted effect as a curve through them.

The residual is that of the model after the verdict with the effect taken out: the part of the log beyond the base
parameters and all other effects. The curve is the part that the effect adds in the model, along the same motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.residuals.effect_agreement import agreement
from hdagen.diagnosis.residuals.localization import Trace, regressors, since_reversal, trace
from hdagen.diagnosis.residuals.regressor_tests import explained
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.diagnosis.residuals.spectra import Spectra
from hdagen.log.column_map import commanded
from hdagen.pages.curves import Curve, Panel, Plane, Series, panels, planes

POINTS = 2500  # of the log that are drawn in one plane
BINS = 60  # of the abscissa, for a curve of means
FEWEST = 5  # points that a bin must have to be drawn
GROWTH = 2.5  # exponent of the bins' edges, so that bins are narrow near standstill
SETTLED = 20  # rows of a log in which commands from before it may still act
SCENE = 0.25  # s, of a stretch of commands and currents
UNKNOWN = 3  # regressors that are drawn where no effect is named
LOOPS = 10.0  # s, of torque over torsion: more loops hide each other
FASTEST = 0.1  # of the sampling rate, up to which a response is drawn
TURN = 2 * np.pi

BY_SPEED = ("coulomb_friction", "viscous_friction", "stribeck_friction", "asymmetric_friction", "quadratic_friction")
BY_INPUT = ("current_saturation", "voltage_sag", "current_loop_lag", "command_delay")
BY_TORSION = (
    "transmission_hysteresis",
    "stiffness",
    "backlash",
    "joint_damping",
    "missing_compliance",
    "kinematic_torsion",
    "transmission_ratio",
)


@dataclass(frozen=True)
class Abscissa:
    """The abscissa of a plot: label with unit, and values (K,) at the instants of a residual."""

    label: str
    of: Callable[[Sight, int], Array]


def _state(quantity: str) -> Callable[[Sight, int], Array]:
    return lambda sight, j: sight.column(quantity, j)


def _acceleration(sight: Sight, j: int) -> Array:
    return sight.acceleration[1][:, j - 1]


def _load(sight: Sight, j: int) -> Array:
    return sight.link_torque(sight.after)[:, j - 1]


def _turn(sight: Sight, j: int) -> Array:
    return np.asarray(np.mod(sight.column("motor_position", j), TURN))


def _since(sight: Sight, joint: int) -> Array:
    """The motor's travel since its last reversal (K,), rad."""
    angle, since = sight.column("motor_position", joint), since_reversal(sight, joint)
    turned = np.searchsorted(sight.time, sight.time - since - 0.5 * sight.grid.period)
    return np.asarray(np.abs(angle - angle[np.clip(turned, 0, len(angle) - 1)]))


INPUT = Abscissa("motor input ({input})", lambda sight, j: sight.inputs(sight.after)[:, j - 1])
OVER = {  # the abscissa of missing torque or angle, by effect
    "torque_ripple": Abscissa("motor angle within a turn (rad)", _turn),
    "kinematic_error": Abscissa("motor angle within a turn (rad)", _turn),
    "torque_constant": INPUT,
    "current_bias": Abscissa("motor speed (rad/s)", _state("motor_velocity")),
    "rotor_coupling": Abscissa("acceleration of joint 1 (rad/s²)", lambda sight, j: _acceleration(sight, 1)),
    "payload": Abscissa("joint acceleration (rad/s²)", _acceleration),
    "link_flexibility": Abscissa("joint acceleration (rad/s²)", _acceleration),
    "base_compliance": Abscissa("joint acceleration (rad/s²)", _acceleration),
    "torque_sensor_gain": Abscissa("load (N m)", _load),
    "sensor_delay": Abscissa("joint speed (rad/s)", _state("joint_velocity")),
}
ALONG = {  # the abscissa of friction against the motion, by effect
    "load_dependent_friction": Abscissa("load (N m)", _load),
    "position_dependent_friction": Abscissa("joint angle (rad)", _state("joint_position")),
    "thermal_friction": Abscissa("time (s)", lambda sight, j: sight.time - sight.time[0]),
}
FILE = "the robot file's"
REACH = 2.0  # rad, travel of the motor after a reversal that is drawn


def pictures(sight: Sight, entry: str, place: str) -> list[str]:
    """Draw the figures of an effect, or of the residual where it is unknown.

    Args:
        sight: the residual of the held-out log, before and after the verdict.
        entry: the effect, name@joint; joint 0 is the whole arm.
        place: of the effect; it decides which residual is drawn.

    Returns:
        Figures in HTML.

    """
    effect, _, number = entry.partition("@")
    joints = list(range(1, sight.n + 1))
    if int(number):
        joints = [int(number)]
    if effect in ("unknown", "none"):
        return [_unknown(sight, place, joint) for joint in joints]
    if effect in BY_INPUT:
        return [figure for joint in joints for figure in _input(sight, entry, joint)]
    if effect in (*BY_SPEED, "presliding_friction"):
        return [_friction(sight, entry, joint) for joint in joints]
    if effect in ALONG:
        return [_against(sight, entry, joint) for joint in joints]
    if effect in BY_TORSION and sight.split:
        return [_loop(sight, entry, joint) for joint in joints]
    if effect in BY_TORSION:
        return [_answer(sight, entry, joint) for joint in joints]
    over = OVER.get(effect, Abscissa("joint angle (rad)", _state("joint_position")))
    return [_plain(sight, entry, place, over, joints)]


def _plain(sight: Sight, entry: str, place: str, over: Abscissa, joints: Sequence[int]) -> str:
    """Missing torque or angle over one abscissa, a plane for each joint."""
    shown, label, points, added = [], "", list[Array](), list[Array]()
    for joint in joints:
        seen = trace(sight, place, joint, entry)
        clear = np.ones(len(seen.adds), bool)
        if seen.words.endswith(f"motor {joint}"):
            clear = sight.slides(joint)[seen.at]
        x, adds, left = over.of(sight, joint)[seen.at][clear], seen.adds[clear], seen.after[clear]
        label = f"{_noun(seen)} ({seen.unit})"
        shown.append(Plane(_points_and_fit(x, left + adds, adds), f"joint {joint}"))
        points, added = [*points, left + adds], [*added, adds]
    x_label = over.label.replace("{input}", sight.input_unit(1))
    caption = f"{CAPTION} {agreement(np.concatenate(points), np.concatenate(added)).words()}"
    return planes(_title(entry), shown, x_label=x_label, y_label=label, equal=False, columns=1, caption=caption)


CAPTION = (
    "Points: what the log has beyond the base parameters and everything else of the verdict. Dashed: mean of the "
    "points in narrow bins. Solid: what the effect adds in the model with the fitted parameters. Both passed the "
    "filter with which the motion is differentiated: what is fast shows smaller than it is."
)


def _noun(seen: Trace) -> str:
    return {"A": "current beyond command", "N m": "missing torque", "rad": "missing angle"}[seen.unit]


def _points_and_fit(x: Array, y: Array, fit: Array, split: bool = False) -> list[Curve]:
    """Points, their means, and the fit's means, which are drawn as lines; ``split``: apart for each sign of x."""
    few = np.unique(np.linspace(0, len(x) - 1, min(len(x), POINTS)).round().astype(int))
    return [
        Curve("log", x[few], y[few], draw="points", color="grey", width=1.6),
        Curve("mean of the log", *means(x, y, split), color="blue", dash="dashed"),
        Curve("model with the effect", *means(x, fit, split), color="vermilion", dash="solid", width=2.4),
    ]


def means(x: Array, y: Array, split: bool = False) -> tuple[Array, Array]:
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
    edges = np.linspace(low, high, BINS + 1)
    if split and low < 0 < high:
        grown = np.linspace(0, 1, BINS // 2 + 1) ** GROWTH
        edges = np.unique(np.r_[low * grown, high * grown])
    number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(number, minlength=len(edges) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.bincount(number, x, len(edges) - 1) / count
        mean = np.bincount(number, y, len(edges) - 1) / count
    mean[count < FEWEST] = np.nan
    middle = np.where(count < FEWEST, (edges[1:] + edges[:-1]) / 2, middle)
    if split and low < 0 < high:
        at = int(np.searchsorted(edges, 0.0))
        middle, mean = np.insert(middle, at, 0.0), np.insert(mean, at, np.nan)
    return middle, mean


def _friction(sight: Sight, entry: str, joint: int) -> str:
    """All friction of a motor over speed, or over the travel since a reversal."""
    effect, j, ok = entry.partition("@")[0], joint - 1, sight.kept & sight.slides(joint)
    bare, by_speed = sight.without(entry), effect in BY_SPEED
    names = list(sight.arm.parameters.described)
    for name in ("coulomb_friction", "viscous_friction"):
        bare[names.index(f"{name}_{joint}")] = 0.0
    fit = -sight.added(sight.after, bare).motor[ok, j]
    left = -sight.missing(sight.after).motor[ok, j]
    robot = fit + sight.added(sight.after, _as_in_the_file(sight, bare, joint)).motor[ok, j]
    if by_speed:
        label, y_label = "motor speed (rad/s)", "friction torque (N m)"
        x, side = sight.column("motor_velocity", joint)[ok], np.ones(len(fit))
    else:
        label, y_label = "motor angle since the last reversal (rad)", "friction against the motion (N m)"
        x, side = _since(sight, joint)[ok], sight.direction[ok, j]
        near = x <= REACH
        x, side, fit, left, robot = x[near], side[near], fit[near], left[near], robot[near]
    curves = _points_and_fit(x, (fit + left) * side, fit * side, by_speed)
    curves.insert(2, Curve("robot file", *means(x, robot * side, by_speed), color="green", dash="dotted"))
    return planes(
        _title(entry),
        [Plane(curves, f"motor {joint}")],
        x_label=label,
        y_label=y_label,
        equal=False,
        caption="Points: torque that the log needs beyond inertia and load; standstill and the instants of reversal "
        "are left out. Curves: mean of the points in narrow bins, friction as the robot file has it, and with the "
        f"effect at its fitted parameters. {agreement(fit + left - robot, fit - robot).words(FILE)}",
    )


def _against(sight: Sight, entry: str, joint: int) -> str:
    """Friction beyond Coulomb's and the viscous one, over the quantity that the effect depends on."""
    over, j, ok = ALONG[entry.partition("@")[0]], joint - 1, sight.kept & sight.slides(joint)
    side = sight.direction[ok, j]
    fit = -sight.added(sight.after, sight.without(entry)).motor[ok, j] * side
    left = -sight.missing(sight.after).motor[ok, j] * side
    return planes(
        _title(entry),
        [Plane(_points_and_fit(over.of(sight, joint)[ok], fit + left, fit), f"motor {joint}")],
        x_label=over.label,
        y_label="friction beyond the base's (N m)",
        equal=False,
        caption="Against the motion; standstill and the instants of reversal are left out. "
        f"{CAPTION} {agreement(fit + left, fit).words()}",
    )


def _as_in_the_file(sight: Sight, bare: Array, joint: int) -> Array:
    """``bare`` with Coulomb and viscous friction as in the robot file."""
    p, names = bare.copy(), list(sight.arm.parameters.described)
    for name in ("coulomb_friction", "viscous_friction"):
        place = names.index(f"{name}_{joint}")
        p[place] = sight.before[place]
    return p


def _loop(sight: Sight, entry: str, joint: int) -> str:
    """Torque over torsion where that goes furthest: the torque that the links require, and the models' torques."""
    j, ok = joint - 1, np.flatnonzero(sight.kept)
    torsion = sight.smooth(
        (sight.column("motor_position", joint) / sight.ratio[j] - sight.column("joint_position", joint))[:, None]
    )[:, 0]
    parts = np.array_split(ok, max(1, round(np.ptp(sight.time[ok]) / LOOPS)))
    ok = max(parts, key=lambda part: np.ptp(torsion[part]))
    stretch = ""
    if len(parts) > 1:
        stretch = f", where that goes furthest in {LOOPS:g} s"
    torsion, needed = torsion[ok], sight.link_torque(sight.after)[ok, j]
    curves = [Curve("log", torsion, needed, color="grey", dash="solid", width=5.0)]
    lacks = list[Array]()
    for label, p, color, dash in (
        ("robot file", sight.before, "green", "dotted"),
        ("model with the effect", sight.after, "vermilion", "solid"),
    ):
        link = sight.missing(p).link
        assert link is not None  # both sides are measured here
        lacks.append(link[ok, j])
        curves.append(Curve(label, torsion, sight.link_torque(p)[ok, j] - link[ok, j], color=color, dash=dash))
    return planes(
        _title(entry),
        [Plane(curves, f"joint {joint}")],
        x_label="torsion (rad)",
        y_label="transmitted torque (N m)",
        equal=False,
        caption="Log: torque that the links' motion asks for, over motor angle divided by ratio less joint angle"
        f"{stretch}. The model's torque is that of its springs and effects at the measured states. "
        f"{agreement(lacks[0], lacks[0] - lacks[1]).words(FILE)}",
    )


def _answer(sight: Sight, entry: str, joint: int) -> str:
    """The spectrum of the replay error, where a joint has one encoder and its torsion is not measured."""
    log, period = sight.log, sight.grid.period
    name = next(n for side in ("motor", "joint") if (n := f"{side}_position_{joint}") in log)
    errors = [sight.on_grid(log[name] - replay.columns[name]) for replay in sight.replays]
    found = [Spectra.of(error, period) for error in errors]
    shown = (found[0].frequency > 0) & (found[0].frequency <= FASTEST / period)
    drawn = [
        Series("robot file", found[0].density[shown], color="green", dash="dashed"),
        Series("model with the effect", found[1].density[shown], color="vermilion", dash="solid"),
    ]
    return panels(
        f"{_title(entry)}: what the replays miss",
        found[0].frequency[shown],
        [Panel(f"{name.replace('_', ' ')} (rad/√Hz)", drawn, log=True)],
        x_label="frequency (Hz)",
        caption="Density of measured less replayed position. With one encoder no torsion is measured: what shows of it "
        "is how the joint answers the motor.",
    )


def _input(sight: Sight, entry: str, joint: int) -> list[str]:
    """Current or torque over time, where the effect changes most, and over its command."""
    if not sight.driven(joint):
        return [_plain(sight, entry, "motor", Abscissa("motor input", INPUT.of), [joint])]
    shown = [sight.commanded(p)[1][:, joint - 1] for p in (sight.before, sight.after)]
    name, log = sight.arm.input_names[joint - 1], sight.log
    word, unit = sight.input_word(joint), sight.input_unit(joint)
    command, measured = log[commanded(name)], log[name]
    rows = max(round(SCENE / log.period), 20)
    change = np.convolve(np.abs(shown[1] - shown[0])[SETTLED:], np.ones(rows), "valid")
    span = slice(SETTLED + int(np.argmax(change)), SETTLED + int(np.argmax(change)) + rows)
    drawn = [
        Series("command", command[span], color="ink", draw="step", dash="dotted"),
        Series("measured", measured[span], color="grey", dash="solid"),
        Series("robot file", shown[0][span], color="green", dash="dashed"),
        Series("model with the effect", shown[1][span], color="vermilion", dash="solid", width=2.4),
    ]
    scene = panels(
        f"{_title(entry)}: command and {word}",
        log.time[span],
        [Panel(f"{word} ({unit})", drawn, f"motor {joint}", height=1.8)],
        caption=f"The {SCENE:g} s in which the effect changes most.",
    )
    x, before, after = command, np.zeros(len(command)), shown[1]
    x_label, y_label, hint = f"command ({unit})", f"{word} ({unit})", ""
    if entry.startswith(("command_delay", "current_loop_lag")):
        x, before = np.gradient(command, log.time), shown[0]
        x_label, y_label = f"rate of the command ({unit}/s)", f"measured less undelayed {word} ({unit})"
        hint = "The slope is the delay, s, with its sign reversed. "
    curves = _points_and_fit(x[SETTLED:], (measured - before)[SETTLED:], (after - before)[SETTLED:])
    alike = agreement((measured - shown[0])[SETTLED:], (shown[1] - shown[0])[SETTLED:])
    over = planes(
        f"{_title(entry)}: {word} over command",
        [Plane(curves, f"motor {joint}")],
        x_label=x_label,
        y_label=y_label,
        equal=False,
        caption=f"{hint}{alike.words(FILE)}",
    )
    return [scene, over]


def _unknown(sight: Sight, place: str, joint: int) -> str:
    """The residual that no effect explains, over the three regressors that explain most of it."""
    seen = trace(sight, place, joint, "")
    best = explained(seen.after, regressors(sight, joint, seen.at))[:UNKNOWN]
    few = np.unique(np.linspace(0, len(seen.after) - 1, min(len(seen.after), POINTS)).round().astype(int))
    figures = ""
    for one in best:
        x, name, unit = one.regressor.values, one.regressor.name, one.regressor.unit
        curves = [
            Curve("log", x[few], seen.after[few], draw="points", color="grey", width=1.6),
            Curve("mean", *means(x, seen.after), color="blue", dash="solid"),
        ]
        figures += planes(
            f"What is missing at joint {joint}, over {name}",
            [Plane(curves)],
            x_label=f"{name.removeprefix('the ')} ({unit})",
            y_label=f"{_noun(seen)} ({seen.unit})",
            equal=False,
            caption=f"Its bins explain {100 * one.share:.0f} % of the variance (p = {one.p:.2g} by circular shifts).",
        )
    return figures


def _title(entry: str) -> str:
    effect, _, joint = entry.partition("@")
    title = effect.replace("_", " ").capitalize()
    if joint == "0":
        return title
    return f"{title} of joint {joint}"
