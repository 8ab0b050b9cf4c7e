"""Curves over a shared axis (time, frequency) and curves in the plane (paths of the tip, torque against torsion)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit
from hdagen.pages.embed import embedded
from hdagen.pages.frame import LAYOUTS, WIDE
from hdagen.pages.palette import CYCLE, DASH_CYCLE, DASHES
from hdagen.pages.plot import Plot, Trace, arrange
from hdagen.pages.quantity import number
from hdagen.pages.thin import Array, kept, samples

NUMBERS = 48_000  # that travel with a figure, about: 5.3 characters each keep a page of twenty figures below 5 MB
DRAWS = ("line", "step", "points")
Band = tuple[float, float, str]


@dataclass(frozen=True)
class Series:
    """A curve over its panel's x. ``y`` (T,) in base units; NaN leaves a gap; ``band_of`` = (low, high), each (T,).

    ``draw`` is "line", "step" (held until the next sample, as a command is) or "points". Colour and dash follow the
    order of the series unless named (see ``palette.COLORS``, ``palette.DASHES``).
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


def lines(
    title: str,
    x: ArrayLike,
    series: Sequence[Series],
    *,
    y_label: str,
    x_label: str = "time (s)",
    bands: Sequence[Band] = (),
    levels: Sequence[tuple[float, str]] = (),
    log_x: bool = False,
    log_y: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """One panel of ``series`` over ``x``; see ``panels``."""
    panel = Panel(y_label, series, levels=levels, log=log_y, height=1.6)
    return panels(title, x, [panel], x_label=x_label, bands=bands, log_x=log_x, caption=caption, link=link)


def panels(
    title: str,
    x: ArrayLike,
    panels: Sequence[Panel],
    *,
    x_label: str = "time (s)",
    bands: Sequence[Band] = (),
    columns: int = 1,
    share_y: bool = False,
    log_x: bool = False,
    caption: str = "",
    link: str = "",
) -> str:
    """Panels over one ``x`` (T,), row after row, ``columns`` beside each other.

    Labels are "name (unit)" in SI base units; the axis takes a prefix where that reads better. ``bands`` are stretches
    of x, (start, end, words). ``share_y``: panels of the same label get the same axis. Figures of one ``link`` share
    cursor and zoom. ValueError where lengths differ or x runs backwards.
    """
    base = _ascending(title, x)
    x_axis = fit(x_label, [base], log=log_x, margin=0.0)
    full = [
        Plot(
            panel.heading,
            x_axis,
            x_axis,
            tuple(_over(title, base, series, at) for at, series in enumerate(panel.series)),
            bands=tuple(bands),
            levels=tuple(panel.levels),
            height=panel.height,
        )
        for panel in panels
    ]
    headroom = 0.09 if any(words for _, _, words in bands) else 0.0
    axes = [_value_axis(panel, plot, headroom) for panel, plot in zip(panels, full, strict=True)]
    if share_y:
        axes = [_widest(axes, axis) for axis in axes]
    columns_of_all = [column for plot in full for column in _columns(plot)]
    rows = kept(x_axis.place(base, 1.0), columns_of_all, NUMBERS // (len(columns_of_all) + 1))
    plots = [
        replace(plot, y=axis, traces=tuple(_taken(trace, rows) for trace in plot.traces))
        for plot, axis in zip(full, axes, strict=True)
    ]
    drawings = "".join(_drawings(title, plots, columns, limit=1e9, shared=True))
    return frame.figure(
        "curves",
        title,
        drawings,
        caption=caption,
        note=_note(rows.size, base.size),
        numbers=_numbers(replace(plot, y=axis) for plot, axis in zip(full, axes, strict=True)),
        data=embedded(plots, shared=True),
        link=link,
    )


def xy(
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
    """One plane; see ``planes``."""
    return planes(
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


def planes(
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
    """Planes with the same axes, ``columns`` beside each other; ``equal``: a unit is as long on x as on y.

    ValueError where the x, y and time of a curve differ in length. Curves with ``time`` follow the cursor of their
    ``link``.
    """
    full = [[_in_plane(title, curve, at) for at, curve in enumerate(plane.curves)] for plane in planes]
    every = [trace for mine in full for trace in mine]
    marks = [mark for plane in planes for mark in plane.marks]
    x_axis = fit(x_label, [trace.x for trace in every] + [samples([mark[0] for mark in marks])], log=log_x)
    y_axis = fit(y_label, [trace.y for trace in every] + [samples([mark[1] for mark in marks])], log=log_y)
    share = NUMBERS // max(3 * len(every), 1)
    plots = [
        Plot(
            plane.heading,
            x_axis,
            y_axis,
            tuple(
                _taken(trace, kept(np.arange(trace.x.size, dtype=np.float64), [trace.x, trace.y], share))
                for trace in mine
            ),
            marks=tuple(plane.marks),
            equal=equal and not (log_x or log_y),
        )
        for plane, mine in zip(planes, full, strict=True)
    ]
    size = sum(trace.x.size for plot in plots for trace in plot.traces)
    limit = 440.0 if equal and len(plots) == 1 else 1e9
    drawings = "".join(_drawings(title, plots, columns, limit=limit, shared=False))
    note = _note(size, sum(trace.x.size for trace in every))
    data = embedded(plots, shared=False)
    return frame.figure("curves", title, drawings, caption=caption, note=note, data=data, link=link)


def _ascending(title: str, x: ArrayLike) -> Array:
    values = samples(x)
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


def _styled(title: str, line: Series | Curve, at: int) -> tuple[str, str]:
    """Colour and dash of the ``at``-th curve of a plot; the dash changes with every curve, so neither stands alone."""
    for name, value, known in (("draw", line.draw, DRAWS), ("dash", line.dash or "solid", tuple(DASHES))):
        if value not in known:
            raise ValueError(f"figure {title!r}, curve {line.label!r}: {name} is {value!r}; use {', '.join(known)}")
    return line.color or CYCLE[at % len(CYCLE)], line.dash or DASH_CYCLE[at % len(DASH_CYCLE)]


def _equal_lengths(title: str, label: str, x: Array, named: dict[str, Array]) -> None:
    for name, values in named.items():
        if values.size != x.size:
            raise ValueError(
                f"figure {title!r}, curve {label!r}: {name} has {values.size} samples and x has {x.size}; "
                "give one value for every x"
            )


def _over(title: str, x: Array, series: Series, at: int) -> Trace:
    y = samples(series.y)
    spread = (samples(series.band_of[0]), samples(series.band_of[1])) if series.band_of else None
    _equal_lengths(title, series.label, x, {"y": y})
    if spread:
        _equal_lengths(title, series.label, x, {"band_of low": spread[0], "band_of high": spread[1]})
    color, dash = _styled(title, series, at)
    return Trace(series.label, x, y, spread, None, color, dash, series.draw, series.width)


def _in_plane(title: str, curve: Curve, at: int) -> Trace:
    x, y = samples(curve.x), samples(curve.y)
    time = None if curve.time is None else samples(curve.time)
    _equal_lengths(title, curve.label, x, {"y": y} if time is None else {"y": y, "time": time})
    color, dash = _styled(title, curve, at)
    return Trace(curve.label, x, y, None, time, color, dash, curve.draw, curve.width)


def _columns(plot: Plot) -> list[Array]:
    return [column for trace in plot.traces for column in (trace.y, *(trace.spread or ()))]


def _taken(trace: Trace, rows: NDArray[np.intp]) -> Trace:
    spread = (trace.spread[0][rows], trace.spread[1][rows]) if trace.spread else None
    time = None if trace.time is None else trace.time[rows]
    return replace(trace, x=trace.x[rows], y=trace.y[rows], spread=spread, time=time)


def _value_axis(panel: Panel, plot: Plot, headroom: float) -> Axis:
    levels = samples([value for value, _ in panel.levels])
    axis = fit(panel.y_label, [*_columns(plot), levels], log=panel.log)
    return axis if panel.log else replace(axis, high=axis.high + headroom * (axis.high - axis.low))


def _widest(axes: Sequence[Axis], axis: Axis) -> Axis:
    """One axis for all that measure the same; the largest prefix wins."""
    alike = [other for other in axes if other.quantity.base_label == axis.quantity.base_label and other.log == axis.log]
    named = min(alike, key=lambda other: other.quantity.factor)
    return replace(named, low=min(other.low for other in alike), high=max(other.high for other in alike))


def _drawings(title: str, plots: Sequence[Plot], columns: int, *, limit: float, shared: bool) -> Iterator[str]:
    words = _described(title, plots)
    for layout in LAYOUTS:
        height = (150.0 if layout is WIDE else 120.0) * (1.0 if shared else 1.6)
        beside = columns if layout is WIDE else 1
        body, width, tall = arrange(plots, layout, columns=beside, height=height, limit=limit, shared_x=shared)
        yield frame.drawing(layout, width, tall, words, body)


def _described(title: str, plots: Sequence[Plot]) -> str:
    """One sentence for readers who cannot see the drawing."""
    labels = ", ".join(dict.fromkeys(trace.label for plot in plots for trace in plot.traces if trace.label))
    names = ", ".join(dict.fromkeys(plot.y.quantity.label for plot in plots))
    over = plots[0].x.quantity.label if plots else "x"
    return f"{title}: {names} over {over}" + (f"; curves: {labels}." if labels else ".")


def _note(held: int, size: int) -> str:
    if held == size:
        return ""
    few, all_ = (f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") for count in (held, size))
    return f"{few} of {all_} samples are kept, the smallest and the largest of every stretch among them."


def _numbers(plots: Iterator[Plot]) -> str:
    """The key numbers of every curve, over all its samples."""
    rows = []
    for plot in plots:
        for trace in plot.traces:
            values = trace.y[~np.isnan(trace.y)] * plot.y.quantity.factor
            name = " · ".join(dict.fromkeys(part for part in (plot.heading, plot.y.quantity.name, trace.label) if part))
            rms = float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
            three = (values.min(), values.max(), values.mean()) if values.size else (np.nan,) * 3
            rows.append([name, plot.y.quantity.unit, *(number(float(value)) for value in (*three, rms))])
    return frame.rows_table(("curve", "unit", "smallest", "largest", "mean", "rms"), rows)
