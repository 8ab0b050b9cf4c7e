"""Curves over a shared axis (time, frequency) and curves in the plane (paths of the tip, torque against torsion)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit_axis
from hdagen.pages.curve_drawing import draw_plots, note_kept_samples, tabulate_curves
from hdagen.pages.decimation import Array, as_samples, choose_rows
from hdagen.pages.embedded_data import embed_plots
from hdagen.pages.palette import COLOR_CYCLE, DASH_CYCLE, DASH_PATTERNS
from hdagen.pages.plot import Plot, Trace

MOST_NUMBERS = 48_000  # that travel with a figure, about: 5.3 characters each keep a page of twenty figures below 5 MB
DRAW_STYLES = ("line", "step", "points")
AxisBand = tuple[float, float, str]


@dataclass(frozen=True)
class Series:
    """A curve over its panel's x. ``y`` (T,) in base units; NaN leaves a gap; ``band_of`` = (low, high), each (T,).

    ``draw`` is "line", "step" (held until the next sample, as a command is) or "points". Colour and dash follow the
    order of the series unless named (see ``palette.COLORS``, ``palette.DASH_PATTERNS``).
    """

    label: str
    y: ArrayLike
    color: str | None = None
    dash: str | None = None
    draw: str = "line"
    band_of: tuple[ArrayLike, ArrayLike] | None = None
    width: float = 1.8


@dataclass(frozen=True)
class Panel:
    """One pair of axes among several that share x. ``levels`` are (value, words); ``height`` is relative to 1."""

    y_label: str
    series: Sequence[Series]
    heading: str = ""
    levels: Sequence[tuple[float, str]] = ()
    log: bool = False
    height: float = 1.0


@dataclass(frozen=True)
class Curve:
    """A curve in the plane, ``x`` and ``y`` (T,); ``time`` (T,), where given, is read out under the cursor."""

    label: str
    x: ArrayLike
    y: ArrayLike
    time: ArrayLike | None = None
    color: str | None = None
    dash: str | None = None
    draw: str = "line"
    width: float = 1.8


@dataclass(frozen=True)
class Plane:
    """One plane among several of the same axes. ``marks`` are (x, y, words)."""

    curves: Sequence[Curve]
    heading: str = ""
    marks: Sequence[tuple[float, float, str]] = ()


def draw_lines(
    title: str,
    x: ArrayLike,
    series: Sequence[Series],
    *,
    y_label: str,
    x_label: str = "time (s)",
    bands: Sequence[AxisBand] = (),
    levels: Sequence[tuple[float, str]] = (),
    log_x: bool = False,
    log_y: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """Draw one panel of curves over a shared x; ``panels`` says more of each argument.

    Args:
        title: Heading.
        x: Numbers, ascending, (T,).
        series: The curves.
        y_label: "name (unit)" of y.
        x_label: "name (unit)" of x.
        bands: Stretches of x as (start, end, words).
        levels: Lines across the panel as (value, words).
        log_x: Whether x is logarithmic.
        log_y: Whether y is logarithmic.
        caption: Text below the drawings.
        link: Figures of one link share cursor and zoom.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: Lengths differ, or x runs backwards.

    """
    panel = Panel(y_label, series, levels=levels, log=log_y, height=1.6)
    return draw_panels(title, x, [panel], x_label=x_label, bands=bands, log_x=log_x, caption=caption, link=link)


def draw_panels(
    title: str,
    x: ArrayLike,
    panels: Sequence[Panel],
    *,
    x_label: str = "time (s)",
    bands: Sequence[AxisBand] = (),
    columns: int = 1,
    share_y: bool = False,
    log_x: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """Draw panels over a shared x, row after row; an axis takes a prefix where that reads better.

    Args:
        title: Heading.
        x: Numbers, ascending, (T,).
        panels: The panels, whose labels are "name (unit)" in SI base units.
        x_label: "name (unit)" of x.
        bands: Stretches of x as (start, end, words).
        columns: Count of panels beside each other.
        share_y: Whether panels of the same label get the same axis.
        log_x: Whether x is logarithmic.
        caption: Text below the drawings.
        link: Figures of one link share cursor and zoom.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: Lengths differ, or x runs backwards.

    """
    base = _check_ascending(title, x)
    x_axis = fit_axis(x_label, [base], log=log_x, margin=0.0)
    full = [_panel_plot(title, base, x_axis, panel, bands) for panel in panels]
    if share_y:
        axes = [plot.y for plot in full]
        full = [replace(plot, y=_share_axis(axes, plot.y)) for plot in full]
    columns_of_all = [column for plot in full for column in _list_columns(plot)]
    rows = choose_rows(x_axis.to_pixels(base, 1.0), columns_of_all, MOST_NUMBERS // (len(columns_of_all) + 1))
    plots = [_with_rows(plot, [rows] * len(plot.traces)) for plot in full]
    return frame.build_figure(
        "curves",
        title,
        draw_plots(title, plots, columns, limit=1e9, shared=True),
        caption=caption,
        note=note_kept_samples(rows.size, base.size),
        numbers=tabulate_curves(full),
        data=embed_plots(plots, shared=True),
        link=link,
    )


def draw_plane(
    title: str,
    curves: Sequence[Curve],
    *,
    x_label: str,
    y_label: str,
    equal: bool = True,
    marks: Sequence[tuple[float, float, str]] = (),
    log_x: bool = False,
    log_y: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """Draw one plane of curves; ``planes`` says more of each argument.

    Args:
        title: Heading.
        curves: The curves.
        x_label: "name (unit)" of x.
        y_label: "name (unit)" of y.
        equal: Whether a unit is as long on x as on y.
        marks: Places in the plane as (x, y, words).
        log_x: Whether x is logarithmic.
        log_y: Whether y is logarithmic.
        caption: Text below the drawings.
        link: Figures of one link share the time under the cursor.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: The x, y and time of a curve differ in length.

    """
    return draw_planes(
        title,
        [Plane(curves, marks=marks)],
        x_label=x_label,
        y_label=y_label,
        equal=equal,
        log_x=log_x,
        log_y=log_y,
        caption=caption,
        link=link,
    )


def draw_planes(
    title: str,
    planes: Sequence[Plane],
    *,
    x_label: str,
    y_label: str,
    columns: int = 2,
    equal: bool = True,
    log_x: bool = False,
    log_y: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """Draw planes of curves with the same axes, row after row.

    Args:
        title: Heading.
        planes: The planes; curves with a time follow the cursor of their link.
        x_label: "name (unit)" of x.
        y_label: "name (unit)" of y.
        columns: Count of planes beside each other.
        equal: Whether a unit is as long on x as on y.
        log_x: Whether x is logarithmic.
        log_y: Whether y is logarithmic.
        caption: Text below the drawings.
        link: Figures of one link share the time under the cursor.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: The x, y and time of a curve differ in length.

    """
    full = [_plane_traces(title, plane) for plane in planes]
    every = [trace for mine in full for trace in mine]
    marks = [mark for plane in planes for mark in plane.marks]
    x_axis = fit_axis(x_label, [trace.x for trace in every] + [as_samples([mark[0] for mark in marks])], log=log_x)
    y_axis = fit_axis(y_label, [trace.y for trace in every] + [as_samples([mark[1] for mark in marks])], log=log_y)
    if equal and x_axis.quantity.base == y_axis.quantity.base:  # equal lengths ask for one prefix
        named = max(x_axis, y_axis, key=lambda axis: max(abs(axis.low), abs(axis.high))).quantity
        x_axis, y_axis = (replace(axis, quantity=named._replace(name=axis.quantity.name)) for axis in (x_axis, y_axis))
    share, even = MOST_NUMBERS // max(3 * len(every), 1), equal and not (log_x or log_y)
    plots = []
    for plane, mine in zip(planes, full, strict=True):
        plot = Plot(plane.heading, x_axis, y_axis, mine, marks=tuple(plane.marks), equal=even)
        plots.append(_with_rows(plot, [_path_rows(trace, share) for trace in mine]))
    size = sum(trace.x.size for plot in plots for trace in plot.traces)
    limit = 1e9
    if equal and len(plots) == 1:
        limit = 440.0
    drawings = draw_plots(title, plots, columns, limit=limit, shared=False)
    note = note_kept_samples(size, sum(trace.x.size for trace in every))
    data = embed_plots(plots, shared=False)
    return frame.build_figure("curves", title, drawings, caption=caption, note=note, data=data, link=link)


def _check_ascending(title: str, x: ArrayLike) -> Array:
    values = as_samples(x)
    if np.isnan(values).any():
        at = int(np.argmax(np.isnan(values)))
        raise ValueError(f"figure {title!r}: x is not a finite number at sample {at}; leave such samples out")
    if (back := np.flatnonzero(np.diff(values) < 0)).size:
        at = int(back[0]) + 1
        raise ValueError(
            f"figure {title!r}: x runs backwards at sample {at} ({values[at]:g} after {values[at - 1]:g}); "
            "sort the samples, or draw the curve with xy"
        )
    return values


def _choose_style(title: str, line: Series | Curve, at: int) -> tuple[str, str]:
    """Colour and dash of the ``at``-th curve of a plot; the dash changes with every curve, so neither stands alone."""
    for name, value, known in (("draw", line.draw, DRAW_STYLES), ("dash", line.dash or "solid", tuple(DASH_PATTERNS))):
        if value not in known:
            raise ValueError(f"figure {title!r}, curve {line.label!r}: {name} is {value!r}; use {', '.join(known)}")
    return line.color or COLOR_CYCLE[at % len(COLOR_CYCLE)], line.dash or DASH_CYCLE[at % len(DASH_CYCLE)]


def _check_lengths(title: str, label: str, x: Array, named: dict[str, Array]) -> None:
    for name, values in named.items():
        if values.size != x.size:
            raise ValueError(
                f"figure {title!r}, curve {label!r}: {name} has {values.size} samples and x has {x.size}; "
                "give one value for every x"
            )


def _trace_series(title: str, x: Array, series: Series, at: int) -> Trace:
    y, spread = as_samples(series.y), None
    _check_lengths(title, series.label, x, {"y": y})
    if series.band_of:
        spread = as_samples(series.band_of[0]), as_samples(series.band_of[1])
        _check_lengths(title, series.label, x, {"band_of low": spread[0], "band_of high": spread[1]})
    color, dash = _choose_style(title, series, at)
    return Trace(series.label, x, y, spread, None, color, dash, series.draw, series.width)


def _trace_curve(title: str, curve: Curve, at: int) -> Trace:
    x, y, time = as_samples(curve.x), as_samples(curve.y), None
    _check_lengths(title, curve.label, x, {"y": y})
    if curve.time is not None:
        time = as_samples(curve.time)
        _check_lengths(title, curve.label, x, {"time": time})
    color, dash = _choose_style(title, curve, at)
    return Trace(curve.label, x, y, None, time, color, dash, curve.draw, curve.width)


def _list_columns(plot: Plot) -> list[Array]:
    return [column for trace in plot.traces for column in (trace.y, *(trace.spread or ()))]


def _panel_plot(title: str, x: Array, x_axis: Axis, panel: Panel, bands: Sequence[AxisBand]) -> Plot:
    """The plot of a panel with all its samples; the words of bands need room above the curves."""
    traces = tuple(_trace_series(title, x, series, at) for at, series in enumerate(panel.series))
    plot = Plot(panel.heading, x_axis, x_axis, traces, tuple(bands), tuple(panel.levels), height=panel.height)
    levels = as_samples([value for value, _ in panel.levels])
    axis = fit_axis(panel.y_label, [*_list_columns(plot), levels], log=panel.log)
    if not panel.log and any(words for _, _, words in bands):
        axis = replace(axis, high=axis.high + 0.09 * (axis.high - axis.low))
    return replace(plot, y=axis)


def _plane_traces(title: str, plane: Plane) -> tuple[Trace, ...]:
    return tuple(_trace_curve(title, curve, at) for at, curve in enumerate(plane.curves))


def _path_rows(trace: Trace, share: int) -> NDArray[np.intp]:
    """The rows of a path that travel with the page, of about ``share``."""
    return choose_rows(np.arange(trace.x.size, dtype=np.float64), [trace.x, trace.y], share)


def _with_rows(plot: Plot, rows: Sequence[NDArray[np.intp]]) -> Plot:
    """The plot with some rows of each trace."""
    traces = (_take_rows(trace, chosen) for trace, chosen in zip(plot.traces, rows, strict=True))
    return replace(plot, traces=tuple(traces))


def _take_rows(trace: Trace, rows: NDArray[np.intp]) -> Trace:
    spread, time = trace.spread, trace.time
    if spread:
        spread = spread[0][rows], spread[1][rows]
    if time is not None:
        time = time[rows]
    return replace(trace, x=trace.x[rows], y=trace.y[rows], spread=spread, time=time)


def _share_axis(axes: Sequence[Axis], axis: Axis) -> Axis:
    """One axis for all that measure the same; the largest prefix wins."""
    alike = [other for other in axes if other.quantity.base_label == axis.quantity.base_label and other.log == axis.log]
    named = min(alike, key=lambda other: other.quantity.factor)
    return replace(named, low=min(other.low for other in alike), high=max(other.high for other in alike))
