"""Maps of where a gap lies: speed × load, motor angle, frequency, reversals, time, before and after the verdict."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.data_quality.rank_check import resolved_orders
from hdagen.diagnosis.residuals.localization import Trace, trace
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.diagnosis.residuals.spectra import SEGMENT, beside_input
from hdagen.pages.curves import Panel, Series, panels
from hdagen.pages.heat_map import heat

SPEEDS, LOADS = 18, 10  # cells of the map of speed and load
FEWEST = 5  # samples that a cell or bin must have to be drawn
ANGLES = 72  # bins of a motor turn
ORDERS = 24  # largest order that is drawn, cycles a motor turn
ABOUT = 0.15  # s before and after a reversal
STEPS = 60  # bins of time over the log
COLORS = {"before": "orange", "after": "blue"}
CHANCE = 0.05  # probability that noise alone exceeds the line of coherence


def maps(sight: Sight, joint: int, place: str, entry: str) -> list[str]:
    """Draw all maps of the residual of one joint.

    Args:
        sight: the residual torque of the held-out log, before and after the verdict.
        joint: its number, from 1.
        place: of the effect; it decides which quantity is drawn.
        entry: the effect of the verdict, effect@joint, or "".

    Returns:
        Figures in HTML.

    """
    seen = trace(sight, place, joint, entry)
    found = _speed_load(sight, joint, seen)
    found += [_angle(sight, joint, seen), *_orders(sight, joint, seen)]
    found += [_frequency(sight, joint, seen), *_reversals(sight, joint, seen), _time(sight, place, entry)]
    return found


def _value(seen: Trace) -> str:
    """Name of the quantity that is drawn."""
    return {"A": "current error", "N m": "missing torque", "rad": "missing angle"}[seen.unit]


def _series(label: str, y: Array, band: tuple[Array, Array] | None = None) -> Series:
    """A curve before or after the verdict, in its colour."""
    dash = {"before": "dashed", "after": "solid"}[label]
    return Series(label, y, COLORS[label], dash, band_of=band)


def _speed_load(sight: Sight, joint: int, seen: Trace) -> list[str]:
    """Rms in cells of speed and load, a map before and one after."""
    speed = sight.column("motor_velocity", joint)[seen.at]
    load = sight.link_torque(sight.after)[seen.at, joint - 1]
    if np.ptp(speed) == 0 or np.ptp(load) == 0:
        return []
    x, y = (np.linspace(v.min(), v.max(), n + 1) for v, n in ((speed, SPEEDS), (load, LOADS)))
    count, *_ = np.histogram2d(load, speed, (y, x))
    drawn = []
    captions = {"before": "", "after": "Mind the scale: each map has its own."}
    for when, values in (("before", seen.before), ("after", seen.after)):
        squares, *_ = np.histogram2d(load, speed, (y, x), weights=values**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            cells = np.where(count >= FEWEST, np.sqrt(squares / count), np.nan)
        figure = heat(
            f"{_value(seen).capitalize()} of joint {joint} over speed and load, {when} the verdict",
            x,
            y,
            cells,
            x_label="motor speed (rad/s)",
            y_label="load on the transmission (N m)",
            value_label=f"{_value(seen)}, rms ({seen.unit})",
            caption=captions[when],
        )
        drawn.append(figure)
    return drawn


def _angle(sight: Sight, joint: int, seen: Trace) -> str:
    """Means over the angle within a turn of the motor, with twice their standard error."""
    angle = np.mod(sight.column("motor_position", joint)[seen.at], 2 * np.pi)
    edges = np.linspace(0, 2 * np.pi, ANGLES + 1)
    number = np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, ANGLES - 1)
    count = np.bincount(number, minlength=ANGLES)
    series = []
    for label, values in (("before", seen.before), ("after", seen.after)):
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(number, values, ANGLES) / count
            error = 2 * np.sqrt(np.maximum(np.bincount(number, values**2, ANGLES) / count - mean**2, 0) / count)
        mean[count < FEWEST] = np.nan
        series.append(_series(label, mean, (mean - error, mean + error)))
    return panels(
        f"{_value(seen).capitalize()} of joint {joint} over the motor's angle",
        (edges[1:] + edges[:-1]) / 2,
        [Panel(f"mean {_value(seen)} ({seen.unit})", series, height=1.3)],
        x_label="motor angle within a turn (rad)",
        caption="Band: twice the standard error, as if samples were independent.",
    )


def _orders(sight: Sight, joint: int, seen: Trace) -> list[str]:
    """Amplitudes of the orders of the motor's angle, fitted at once with a constant.

    Only orders that the motion resolves are fitted; a motion below one turn has no figure.
    """
    angle = sight.column("motor_position", joint)[seen.at]
    k = np.array(resolved_orders(angle, range(1, ORDERS + 1)), int)
    if not len(k):
        return []
    matrix = np.hstack([np.ones((len(angle), 1)), np.cos(angle[:, None] * k), np.sin(angle[:, None] * k)])
    series = []
    for label, values in (("before", seen.before), ("after", seen.after)):
        found = np.linalg.lstsq(matrix, values, rcond=1e-6)[0]
        series.append(_series(label, np.hypot(found[1 : len(k) + 1], found[len(k) + 1 :])))
    return [
        panels(
            f"{_value(seen).capitalize()} of joint {joint} by order of the motor's angle",
            k,
            [Panel(f"amplitude ({seen.unit})", series, height=1.3)],
            x_label="order (cycles a turn of the motor)",
            caption="At high speed the filter of the balance takes high orders away, in log and model alike.",
        )
    ]


def _frequency(sight: Sight, joint: int, seen: Trace) -> str:
    """Densities before and after, and the coherence with the motor's input where the motion is long enough for one."""
    drawn, (inputs, *full) = beside_input(sight, joint, seen.at, seen.before, seen.after)
    both = list(zip(("before", "after"), full, strict=True))
    density = [_series(label, s.density[drawn]) for label, s in both]
    shown, caption = [Panel(f"density ({seen.unit}/√Hz)", density, log=True)], ""
    if inputs.free >= 1.0:  # with fewer segments any two series have a high coherence
        level = 1 - CHANCE ** (1 / inputs.free)
        coherence = [_series(label, s.coherence(inputs)[drawn]) for label, s in both]
        line = [(level, f"noise alone, {100 * (1 - CHANCE):.0f} %")]
        shown.append(Panel("coherence with the motor's input", coherence, levels=line))
        caption = (
            " What goes with the input, in a straight line, has a coherence near 1: a gain, an inertia, a lag. "
            "Friction and periodic effects have little."
        )
    return panels(
        f"{_value(seen).capitalize()} of joint {joint} over frequency",
        full[0].frequency[drawn],
        shown,
        x_label="frequency (Hz)",
        caption=f"{len(inputs.segments)} segments of {SEGMENT:g} s.{caption}",
    )


def _reversals(sight: Sight, joint: int, seen: Trace) -> list[str]:
    """Rms about the instants at which the motor turns."""
    direction = sight.direction[:, joint - 1]
    moving = np.flatnonzero(direction)
    turned = moving[1:][np.diff(direction[moving]) != 0]
    period = sight.grid.period
    reach = max(round(ABOUT / period), 3)
    index = np.full(len(sight.time), -1)
    index[seen.at] = np.arange(int(seen.at.sum()))
    turned = turned[(turned >= reach) & (turned < len(sight.time) - reach)]
    if len(turned) < 2:
        return []
    rows = index[turned[:, None] + np.arange(-reach, reach + 1)]
    rows = rows[(rows >= 0).all(1)]
    if not len(rows):
        return []
    series = [
        _series(label, np.sqrt((values[rows] ** 2).mean(0)))
        for label, values in (("before", seen.before), ("after", seen.after))
    ]
    return [
        panels(
            f"{_value(seen).capitalize()} of joint {joint} about reversals",
            np.arange(-reach, reach + 1) * period,
            [Panel(f"{_value(seen)}, rms ({seen.unit})", series, height=1.3)],
            x_label="time after the motor turns (s)",
            caption=f"Over {len(rows)} reversals.",
        )
    ]


def _time(sight: Sight, place: str, entry: str) -> str:
    """Rms over the log, every joint."""
    shown, edges = [], np.linspace(sight.time[0], sight.time[-1], STEPS + 1)
    for joint in range(1, sight.n + 1):
        seen = trace(sight, place, joint, entry)
        number = np.clip(np.searchsorted(edges, sight.time[seen.at], side="right") - 1, 0, STEPS - 1)
        count = np.bincount(number, minlength=STEPS)
        series = []
        for label, values in (("before", seen.before), ("after", seen.after)):
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = np.sqrt(np.bincount(number, values**2, STEPS) / count)
            series.append(_series(label, np.where(count >= FEWEST, mean, np.nan)))
        shown.append(Panel(f"{_value(seen)}, rms ({seen.unit})", series, f"joint {joint}"))
    return panels("Where in the log", (edges[1:] + edges[:-1]) / 2 - sight.time[0], shown, share_y=True)
