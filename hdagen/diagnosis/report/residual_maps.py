"""Maps of where a gap lies: speed × load, motor angle, frequency, reversals, time, before and after the verdict."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.data_quality.rank_check import find_resolved_orders
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.residual_trace import ResidualTrace, trace_residual
from hdagen.diagnosis.residuals.spectra import compare_with_input
from hdagen.pages.curves import Panel, Series, draw_panels
from hdagen.pages.heat_map import draw_heat_map

REPLAY_COLORS = {"before": "orange", "after": "blue"}


def draw_residual_maps(sight: ResidualTorque, joint: int, place: str, entry: str) -> list[str]:
    """Draw all maps of the residual of one joint.

    Args:
        sight: the residual torque of the held-out log, before and after the verdict.
        joint: its number, from 1.
        place: of the effect; it decides which quantity is drawn.
        entry: the effect of the verdict, effect@joint, or "".

    Returns:
        Figures in HTML.

    """
    seen = trace_residual(sight, place, joint, entry)
    found = _map_speed_load(sight, joint, seen)
    found += [*_plot_over_angle(sight, joint, seen), *_plot_over_orders(sight, joint, seen)]
    found += [
        _plot_over_frequency(sight, joint, seen),
        *_plot_about_reversals(sight, joint, seen),
        _plot_over_time(sight, place, entry),
    ]
    return found


def _name_quantity(seen: ResidualTrace) -> str:
    """Name of the quantity that is drawn."""
    return {"A": "current error", "N m": "missing torque", "rad": "missing angle"}[seen.unit]


def _make_series(label: str, y: Array, band: tuple[Array, Array] | None = None) -> Series:
    """A curve before or after the verdict, in its colour."""
    dash = {"before": "dashed", "after": "solid"}[label]
    return Series(label, y, REPLAY_COLORS[label], dash, band_of=band)


def _map_speed_load(sight: ResidualTorque, joint: int, seen: ResidualTrace) -> list[str]:
    """Rms in cells of speed and load, a map before and one after."""
    speed = sight.motion.read_state("motor_velocity", joint)[seen.instants]
    load = sight.balance.link_torque(sight.after)[seen.instants, joint - 1]
    if np.ptp(speed) == 0 or np.ptp(load) == 0:
        return []
    x, y = (np.linspace(v.min(), v.max(), n + 1) for v, n in ((speed, REPORT.speed_cells), (load, REPORT.load_cells)))
    count, *_ = np.histogram2d(load, speed, (y, x))
    maps = {}
    for when, values in (("before", seen.before), ("after", seen.after)):
        squares, *_ = np.histogram2d(load, speed, (y, x), weights=values**2)
        with np.errstate(invalid="ignore", divide="ignore"):
            maps[when] = np.where(count >= REPORT.fewest_samples, np.sqrt(squares / count), np.nan)
    largest = max(float(np.nanmax(cells, initial=0.0)) for cells in maps.values())
    return [
        draw_heat_map(
            f"{_name_quantity(seen).capitalize()} of joint {joint}, {when}",
            x,
            y,
            cells,
            x_label="motor speed (rad/s)",
            y_label="load (N m)",
            value_label=f"rms ({seen.unit})",
            span=(0.0, largest),
        )
        for when, cells in maps.items()
    ]


def _plot_over_angle(sight: ResidualTorque, joint: int, seen: ResidualTrace) -> list[str]:
    """Means over the angle within a turn of the motor, with twice their standard error; none below one turn."""
    turned = sight.motion.read_state("motor_position", joint)[seen.instants]
    if not len(turned) or np.ptp(turned) < 2 * np.pi:
        return []
    angle = np.mod(turned, 2 * np.pi)
    edges = np.linspace(0, 2 * np.pi, REPORT.angle_bins + 1)
    number = np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, REPORT.angle_bins - 1)
    count = np.bincount(number, minlength=REPORT.angle_bins)
    series = []
    for label, values in (("before", seen.before), ("after", seen.after)):
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(number, values, REPORT.angle_bins) / count
            error = 2 * np.sqrt(
                np.maximum(np.bincount(number, values**2, REPORT.angle_bins) / count - mean**2, 0) / count
            )
        mean[count < REPORT.fewest_samples] = np.nan
        series.append(_make_series(label, mean, (mean - error, mean + error)))
    drawn = draw_panels(
        f"{_name_quantity(seen).capitalize()} of joint {joint} over the motor's angle",
        (edges[1:] + edges[:-1]) / 2,
        [Panel(f"mean ({seen.unit})", series, height=1.3)],
        x_label="motor angle within a turn (rad)",
        caption="Band: twice the standard error, as if samples were independent.",
    )
    return [drawn]


def _plot_over_orders(sight: ResidualTorque, joint: int, seen: ResidualTrace) -> list[str]:
    """Amplitudes of the orders of the motor's angle, fitted at once with a constant.

    Only orders that the motion resolves are fitted; a motion below one turn has no figure.
    """
    angle = sight.motion.read_state("motor_position", joint)[seen.instants]
    k = np.array(find_resolved_orders(angle, range(1, EXPLANATION.largest_motor_order + 1)), int)
    if not len(k):
        return []
    matrix = np.hstack([np.ones((len(angle), 1)), np.cos(angle[:, None] * k), np.sin(angle[:, None] * k)])
    series = []
    for label, values in (("before", seen.before), ("after", seen.after)):
        found = np.linalg.lstsq(matrix, values, rcond=1e-6)[0]
        series.append(_make_series(label, np.hypot(found[1 : len(k) + 1], found[len(k) + 1 :])))
    return [
        draw_panels(
            f"{_name_quantity(seen).capitalize()} of joint {joint} by order of the motor's angle",
            k,
            [Panel(f"amplitude ({seen.unit})", series, height=1.3)],
            x_label="order (cycles a turn of the motor)",
            caption="At high speed the filter of the balance takes high orders away, in log and model alike.",
        )
    ]


def _plot_over_frequency(sight: ResidualTorque, joint: int, seen: ResidualTrace) -> str:
    """Densities before and after."""
    drawn, (_, *full) = compare_with_input(sight, joint, seen.instants, seen.before, seen.after)
    both = list(zip(("before", "after"), full, strict=True))
    density = [_make_series(label, s.density[drawn]) for label, s in both]
    return draw_panels(
        f"{_name_quantity(seen).capitalize()} of joint {joint} over frequency",
        full[0].frequency[drawn],
        [Panel(f"density ({seen.unit}/√Hz)", density, log=True, height=1.3)],
        x_label="frequency (Hz)",
    )


def _plot_about_reversals(sight: ResidualTorque, joint: int, seen: ResidualTrace) -> list[str]:
    """Rms about the instants at which the motor turns."""
    direction = sight.motion.direction[:, joint - 1]
    moving = np.flatnonzero(direction)
    turned = moving[1:][np.diff(direction[moving]) != 0]
    period = sight.motion.grid.period
    reach = max(round(REPORT.reversal_margin / period), 3)
    index = np.full(len(sight.motion.time), -1)
    index[seen.instants] = np.arange(int(seen.instants.sum()))
    turned = turned[(turned >= reach) & (turned < len(sight.motion.time) - reach)]
    if len(turned) < 2:
        return []
    rows = index[turned[:, None] + np.arange(-reach, reach + 1)]
    rows = rows[(rows >= 0).all(1)]
    if not len(rows):
        return []
    series = [
        _make_series(label, np.sqrt((values[rows] ** 2).mean(0)))
        for label, values in (("before", seen.before), ("after", seen.after))
    ]
    return [
        draw_panels(
            f"{_name_quantity(seen).capitalize()} of joint {joint} about reversals",
            np.arange(-reach, reach + 1) * period,
            [Panel(f"rms ({seen.unit})", series, height=1.3)],
            x_label="time after the motor turns (s)",
            caption=f"Over {len(rows)} reversals.",
        )
    ]


def _plot_over_time(sight: ResidualTorque, place: str, entry: str) -> str:
    """Rms over the log, every joint."""
    shown, edges = [], np.linspace(sight.motion.time[0], sight.motion.time[-1], REPORT.time_bins + 1)
    for joint in range(1, sight.motion.n + 1):
        seen = trace_residual(sight, place, joint, entry)
        number = np.clip(
            np.searchsorted(edges, sight.motion.time[seen.instants], side="right") - 1, 0, REPORT.time_bins - 1
        )
        count = np.bincount(number, minlength=REPORT.time_bins)
        series = []
        for label, values in (("before", seen.before), ("after", seen.after)):
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = np.sqrt(np.bincount(number, values**2, REPORT.time_bins) / count)
            series.append(_make_series(label, np.where(count >= REPORT.fewest_samples, mean, np.nan)))
        shown.append(Panel(f"rms ({seen.unit})", series, f"joint {joint}"))
    title = f"{_name_quantity(seen).capitalize()} over the log"
    return draw_panels(title, (edges[1:] + edges[:-1]) / 2 - sight.motion.time[0], shown, share_y=True)
