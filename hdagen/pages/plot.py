"""One pair of axes with its curves, and several of them arranged in rows and columns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdagen.pages.axis import Axis
from hdagen.pages.decimation import Array, find_extreme_rows
from hdagen.pages.frame import Layout, draw_text, estimate_text_width, group_in_color, shorten_text, wrap_text
from hdagen.pages.markup import build_element
from hdagen.pages.palette import DASH_PATTERNS
from hdagen.support.row_runs import find_true_runs

COLUMN_GAP = 26.0  # between columns, px
SHORTEST_STEP = 0.7  # px
RIGHT_MARGIN = 18.0  # half of the last tick's text, px


@dataclass(frozen=True)
class Trace:
    """A curve as it is drawn: ``x`` and ``y`` (T,) in base units, ``spread`` the (low, high) around it.

    ``time`` (T,) belongs to a path in the plane.
    """

    label: str
    x: Array
    y: Array
    spread: tuple[Array, Array] | None
    time: Array | None
    color: str
    dash: str
    draw: str  # line, step (held until the next sample) or points
    width: float


@dataclass(frozen=True)
class Plot:
    """One pair of axes. ``bands`` are stretches of x, ``levels`` values of y, ``marks`` places, each with its words."""

    heading: str
    x: Axis
    y: Axis
    traces: tuple[Trace, ...]
    bands: tuple[tuple[float, float, str], ...] = ()
    levels: tuple[tuple[float, str], ...] = ()
    marks: tuple[tuple[float, float, str], ...] = ()
    height: float = 1.0  # relative to the other plots
    equal: bool = False  # one metre is as long on both axes


def build_path_data(x: Array, y: Array, draw: str = "line") -> str:
    """Write the path data of SVG through points, to a tenth of a pixel.

    Args:
        x: Places to the right, (T,) px; NaN interrupts the path.
        y: Places downwards, (T,) px.
        draw: "line", whose steps shorter than NEAR are skipped, "step" or "points".

    Returns:
        The path data.

    """
    parts: list[str] = []
    pen_down = False
    last_x = last_y = 0.0
    for at_x, at_y in zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True):
        if math.isnan(at_x + at_y):
            pen_down = False
            continue
        if draw == "points":
            parts.append(f"M{at_x:g} {at_y:g}h.01")
            continue
        if not pen_down:
            parts.append(f"M{at_x:g} {at_y:g}")
        elif draw == "step":
            parts.append(f"H{at_x:g}V{at_y:g}")
        elif abs(at_x - last_x) >= SHORTEST_STEP or abs(at_y - last_y) >= SHORTEST_STEP:
            parts.append(f"L{at_x:g} {at_y:g}")
        else:
            continue
        pen_down, last_x, last_y = True, at_x, at_y
    return "".join(parts)


def _draw_trace(trace: Trace, plot: Plot, width: float, height: float) -> str:
    """The trace as paths; where pixels cannot show every sample, each pixel keeps its smallest and its largest."""
    x = plot.x.to_pixels(trace.x, width)
    columns = [height - plot.y.to_pixels(values, height) for values in (trace.y, *(trace.spread or ()))]
    if x.size > 4 * width and np.all(np.diff(x) >= 0):
        rows = find_extreme_rows(x, columns, int(width))
        x, columns = x[rows], [column[rows] for column in columns]
    area = ""
    if trace.spread:
        whole = ~np.isnan(columns[1] + columns[2] + x)
        rings = [
            build_path_data(np.r_[x[a:b], x[a:b][::-1]], np.r_[columns[1][a:b], columns[2][a:b][::-1]]) + "Z"
            for a, b in find_true_runs(whole)
        ]
        area = build_element("path", d="".join(rings), class_="spread", fill="currentColor", fill_opacity=0.18)
    width, dashes, cap = _choose_pen(trace)
    line = build_element(
        "path",
        d=build_path_data(x, columns[0], trace.draw),
        class_="curve",
        fill="none",
        stroke="currentColor",
        stroke_width=width,
        stroke_dasharray=dashes,
        stroke_linejoin="round",
        stroke_linecap=cap,
    )
    return group_in_color(trace.color, area, line, class_="trace")


def _choose_pen(trace: Trace) -> tuple[float, str | None, str | None]:
    """Width, dashes and cap: points are dots of three widths, square where a line would have dashes."""
    if trace.draw != "points":
        return trace.width, DASH_PATTERNS[trace.dash], None
    if trace.dash == "solid":
        return 3 * trace.width, None, "round"
    return 3 * trace.width, None, "square"


def _draw_band(plot: Plot, band: tuple[float, float, str], width: float, height: float) -> str:
    start, end, _ = band
    x = plot.x.to_pixels(np.array([start, end]), width)
    box = build_element("rect", x=float(x[0]), width=max(float(x[1] - x[0]), 1.0), height=height, fill_opacity=0.09)
    return build_element("g", box, class_="band", data_from=repr(float(start)), data_to=repr(float(end)))


def _draw_band_words(plot: Plot, band: tuple[float, float, str], width: float, font: float) -> str:
    start, end, words = band
    x = float(plot.x.to_pixels(np.array([start]), width)[0])
    text = draw_text(x + 4, font, words, faint=True, halo=True)
    return build_element("g", text, class_="band", data_from=repr(float(start)), data_to=repr(float(end)))


def _draw_area(plot: Plot, width: float, height: float, font: float, band_words: bool) -> str:
    """Everything inside the axes, clipped by them."""
    parts = [_draw_band(plot, band, width, height) for band in plot.bands]
    parts += [_draw_trace(trace, plot, width, height) for trace in plot.traces]
    if band_words:  # above the curves
        parts += [_draw_band_words(plot, band, width, font) for band in plot.bands if band[2]]
    for value, words in plot.levels:
        y = height - float(plot.y.to_pixels(np.array([value]), height)[0])
        line = build_element("path", d=f"M0 0H{width:g}", stroke="currentColor", stroke_dasharray="2 4")
        base = -5.0
        if y <= 3 * font:  # below the line, as the words of bands stand above it
            base = 1.2 * font
        text = draw_text(width - 4, base, words, anchor="end", faint=True, halo=True)
        parts.append(
            build_element("g", line, text, class_="level", data_y=repr(float(value)), transform=f"translate(0 {y:.1f})")
        )
    for at_x, at_y, words in plot.marks:
        x, y = plot.x.to_pixels(np.array([at_x]), width)[0], height - plot.y.to_pixels(np.array([at_y]), height)[0]
        dot = build_element("circle", r=4, fill="none", stroke="currentColor", stroke_width=1.5)
        parts.append(
            build_element(
                "g",
                dot,
                draw_text(8.0, 4.0, words, halo=True),
                class_="mark",
                data_x=repr(float(at_x)),
                data_y=repr(float(at_y)),
                transform=f"translate({x:.1f} {y:.1f})",
            )
        )
    if not any(np.isfinite(trace.x + trace.y).any() for trace in plot.traces):
        parts.append(draw_text(width / 2, height / 2, "no data", anchor="middle", faint=True))
    return build_element("svg", *parts, class_="area", width=width, height=height)


def _draw_scales(plot: Plot, width: float, height: float, font: float, x_words: bool) -> str:
    """Grid and tick texts. The script draws this group again when it zooms: keep the two alike."""
    lines, texts = [], []
    for value, words in plot.y.ticks(int(height / 38) + 1):
        y = height - float(plot.y.to_pixels(np.array([value]), height)[0])
        lines.append(f"M0 {y:.1f}H{width:g}")
        texts.append(draw_text(-7.0, y + 0.35 * font, words, anchor="end", faint=True))
    for value, words in plot.x.ticks(int(width / 90) + 1):
        x = float(plot.x.to_pixels(np.array([value]), width)[0])
        lines.append(f"M{x:.1f} 0V{height:g}")
        if x_words:
            texts.append(draw_text(x, height + 1.5 * font, words, anchor="middle", faint=True))
    grid = build_element("path", d="".join(lines), stroke="currentColor", stroke_opacity=0.13)
    frame = build_element(
        "path", d=f"M0 0V{height:g}H{width:g}", fill="none", stroke="currentColor", stroke_opacity=0.55
    )
    return build_element("g", grid, frame, *texts, class_="scales", data_words=x_words)


def _format_plot_name(plot: Plot) -> str:
    return " · ".join(part for part in (plot.heading, plot.y.quantity.label) if part)


def _is_crowded(plot: Plot, room: float, font: float) -> bool:
    """Whether heading, name of y and key do not fit on one line."""
    keys = sum(48 + estimate_text_width(trace.label, font) for trace in plot.traces if trace.label)
    return bool(plot.heading) and 1.08 * estimate_text_width(_format_plot_name(plot), font) + keys > room


def _draw_head(plot: Plot, room: float, font: float, crowded: bool) -> tuple[str, float]:
    """Markup and height of the head above the axes, from their left end: name of y, then the key of the curves."""
    names = wrap_text(_format_plot_name(plot), room / 1.08, font)
    if crowded and plot.heading:
        names = [line for part in (plot.heading, plot.y.quantity.label) for line in wrap_text(part, room / 1.08, font)]
    parts = [draw_text(0.0, 1.45 * font * k, line, strong=True) for k, line in enumerate(names)]
    y = 1.45 * font * (len(names) - 1)
    x = 1.08 * estimate_text_width(names[-1], font) + 18
    for trace in plot.traces:
        if not trace.label:
            continue
        label = shorten_text(trace.label, room - 30, font)
        wide = 30 + estimate_text_width(label, font)
        if x + wide > room and x > 0:
            x, y = 0.0, y + 1.45 * font
        thick, dashes, cap = _choose_pen(trace)
        data = f"M{x + 12:.1f} {y - 0.33 * font:.1f}h.01"
        if trace.draw != "points":
            data = f"M{x:.1f} {y - 0.33 * font:.1f}h24"
            thick = max(thick, 2.0)
        sample = build_element(
            "path",
            d=data,
            fill="none",
            stroke="currentColor",
            stroke_width=thick,
            stroke_dasharray=dashes,
            stroke_linecap=cap,
        )
        parts += [group_in_color(trace.color, sample), draw_text(x + 30, y, label)]
        x += wide + 18
    height = y + 2.2 * font
    return build_element("g", *parts, transform=f"translate(0 {-height + 1.3 * font:.1f})", class_="head"), height


def _equalize_axes(plot: Plot, width: float, height: float) -> Plot:
    """The plot with whichever axis has room to spare widened until a unit is as long on both."""
    unit = max((plot.x.high - plot.x.low) / width, (plot.y.high - plot.y.low) / height)
    return replace(plot, x=plot.x.with_span(unit * width), y=plot.y.with_span(unit * height))


def _place_plot(
    plot: Plot,
    head: str,
    place: tuple[float, float],
    size: tuple[float, float],
    font: float,
    *,
    named: bool,
    band_words: bool,
) -> str:
    """A plot at its place; ``named``: with the numbers and the name of x."""
    width, height = size
    if plot.equal:
        plot = _equalize_axes(plot, width, height)
    parts = [head, _draw_scales(plot, width, height, font, named), _draw_area(plot, width, height, font, band_words)]
    if named:
        name = shorten_text(plot.x.quantity.label, width + place[0] + RIGHT_MARGIN, font)
        half = 0.54 * estimate_text_width(name, font)
        middle = min(width / 2, width + RIGHT_MARGIN - half)  # a long name begins left of the axes
        parts.append(draw_text(middle, height + 3.1 * font, name, anchor="middle", strong=True))
    return build_element(
        "g",
        *parts,
        class_="plot",
        transform=f"translate({place[0]:.1f} {place[1]:.1f})",
        data_x=f"{plot.x.low!r} {plot.x.high!r}",
        data_y=f"{plot.y.low!r} {plot.y.high!r}",
    )


def arrange_plots(
    plots: Sequence[Plot], layout: Layout, *, columns: int, height: float, limit: float = 1e9, shared_x: bool = True
) -> tuple[str, float, float]:
    """Arrange plots row after row.

    Args:
        plots: The plots in their order.
        layout: The layout that the drawing is made for.
        columns: Count of plots beside each other, at most.
        height: Height of the axes of a plot of relative height 1, px.
        limit: Largest width of the axes, px.
        shared_x: Whether only the lowest plot of a column carries the numbers and the name of x.

    Returns:
        Markup, width and height of the whole, px.

    """
    columns = max(1, min(columns, len(plots)))
    font = layout.font
    texts = [words for plot in plots for _, words in plot.y.ticks(6)]
    left = 12 + 0.95 * max(
        estimate_text_width(words, font) for words in ["−0.00", *texts]
    )  # zoomed in, numbers grow longer
    width = min((layout.width - COLUMN_GAP * (columns - 1)) / columns - left - RIGHT_MARGIN, limit)
    crowded = any(_is_crowded(plot, width, font) for plot in plots)
    parts, top = [], 0.0
    for first in range(0, len(plots), columns):
        row = plots[first : first + columns]
        tall = height * max(plot.height for plot in row)
        if row[0].equal:
            tall = width * min(max((p.y.high - p.y.low) / (p.x.high - p.x.low) for p in row), 1.0)
            tall = max(tall, 0.4 * width)
        heads = [_draw_head(plot, width, font, crowded) for plot in row]
        top += max(head_height for _, head_height in heads)
        below = 0.0
        for at, (plot, (head, _)) in enumerate(zip(row, heads, strict=True)):
            x, last = (
                left + at * (width + left + RIGHT_MARGIN + COLUMN_GAP),
                not shared_x or first + at + columns >= len(plots),
            )
            parts.append(_place_plot(plot, head, (x, top), (width, tall), font, named=last, band_words=first == 0))
            below = max(below, 0.5 * font)
            if last:
                below = max(below, 3.7 * font)
        top += tall + below
    whole = columns * (left + width + RIGHT_MARGIN) + (columns - 1) * COLUMN_GAP
    return "".join(parts), round(whole, 1), round(top + 2, 1)
