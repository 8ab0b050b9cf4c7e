"""Horizontal bars: names beside lengths, one or more groups, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit_axis
from hdagen.pages.decimation import Array, as_samples
from hdagen.pages.frame import LAYOUTS, Layout, draw_text, estimate_text_width, group_in_color, shorten_text
from hdagen.pages.markup import build_element
from hdagen.pages.palette import COLOR_CYCLE
from hdagen.pages.quantity import format_number, scale_quantity


@dataclass(frozen=True)
class BarGroup:
    """A group of bars, ``values`` (names,), base units; NaN: no bar. ``interval`` = (low, high), each (names,)."""

    label: str
    values: ArrayLike
    interval: tuple[ArrayLike, ArrayLike] | None = None
    color: str | None = None


@dataclass(frozen=True)
class _Bar:
    value: float
    low: float
    high: float

    @property
    def number(self) -> float | None:
        """The value as JSON takes it: None where it is NaN."""
        if math.isnan(self.value):
            return None
        return self.value


def draw_bars(
    title: str,
    names: Sequence[str],
    groups: Sequence[BarGroup],
    *,
    value_label: str,
    levels: Sequence[tuple[float, str]] = (),
    log: bool = False,
    caption: str = "",
) -> str:
    """Draw horizontal bars, one for each name in each group.

    Args:
        title: Heading.
        names: Names of the bars.
        groups: Values of each group, one for every name.
        value_label: "name (unit)" of the values.
        levels: Lines across all bars as (value, words).
        log: Whether the axis is logarithmic. Bars then start at its left end, and values up to 0 have no bar.
        caption: Text below the drawings.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: A group does not have one value for every name.

    """
    table = [_read_bars(title, names, bars) for bars in groups]
    values = as_samples([x for row in table for bar in row for x in (bar.value, bar.low, bar.high)])
    held = [values, as_samples([value for value, _ in levels])]
    if not log:
        held.append(np.zeros(1))
    axis = fit_axis(value_label, held, log=log, margin=0.0)
    if log:  # the shortest bar still has a length
        axis = replace(axis, low=10.0 ** math.floor(math.log10(axis.low / 1.5)))
    words = f"{title}: {axis.quantity.label} of {', '.join(names)}"
    drawings = "".join(_draw_layout(layout, words, names, groups, table, axis, levels) for layout in LAYOUTS)
    header = ["", *(bars.label or axis.quantity.name for bars in groups)]
    written: list[list[str]] = []
    sent: list[list[str | float | None]] = [["", *(f"{bars.label}: {axis.quantity.base_label}" for bars in groups)]]
    for name, *row in zip(names, *table, strict=True):
        written.append([name, *(_format_bar_value(bar, axis) for bar in row)])
        sent.append([name, *(bar.number for bar in row)])
    numbers = frame.build_rows_table(header, written, axis.quantity.label)
    return frame.build_figure("bars", title, drawings, caption=caption, numbers=numbers, data={"rows": sent})


def _read_bars(title: str, names: Sequence[str], bars: BarGroup) -> list[_Bar]:
    values = as_samples(bars.values)
    low, high = (as_samples(side) for side in bars.interval or (np.full(len(names), np.nan),) * 2)
    for what, column in (("values", values), ("interval low", low), ("interval high", high)):
        if column.size != len(names):
            raise ValueError(
                f"figure {title!r}, bars {bars.label!r}: {what} has {column.size} numbers for {len(names)} names; "
                "give one for every name"
            )
    return [_Bar(*row) for row in zip(values.tolist(), low.tolist(), high.tolist(), strict=True)]


def _format_bar_value(bar: _Bar, axis: Axis) -> str:
    """The value and its interval as written beside the bar; over decades each has its own prefix, and so its unit."""
    size = axis.quantity
    if axis.log and size.base:
        size = scale_quantity(size.base_label, abs(bar.value))
    text = format_number(bar.value * size.factor, 3)
    if np.isfinite(bar.low + bar.high):
        text += f" [{format_number(bar.low * size.factor, 3)}, {format_number(bar.high * size.factor, 3)}]"
    if axis.log and np.isfinite(bar.value):
        text += f" {size.unit}"
    return text


def _draw_box(x: float, y: float, width: float, height: float, solid: bool) -> str:
    """A bar. The last group is solid, earlier ones are outlined, so that before and after differ without colour."""
    opacity = 0.22
    if solid:
        opacity = 0.95
    return build_element(
        "rect",
        x=x,
        y=y,
        width=width,
        height=height,
        fill="currentColor",
        fill_opacity=opacity,
        stroke="currentColor",
    )


def _draw_layout(
    layout: Layout,
    words: str,
    names: Sequence[str],
    groups: Sequence[BarGroup],
    table: Sequence[Sequence[_Bar]],
    axis: Axis,
    levels: Sequence[tuple[float, str]],
) -> str:
    """On a wide layout names stand left of the bars, on a narrow one above them."""
    font = layout.font
    longest = max((estimate_text_width(name, font) for name in names), default=0.0)
    above = longest > 0.4 * layout.width
    left, name_height = longest + 14, 0.0
    if above:
        left, name_height = 8.0, 1.5 * font
    room = layout.width - left - max(
        (estimate_text_width(_format_bar_value(bar, axis), font) for row in table for bar in row), default=0.0
    ) - 14  # fmt: skip
    thick = 0.95 * font
    pitch = name_height + len(groups) * (thick + 4) + 10
    parts, top = [], 1.6 * font
    if any(bars.label for bars in groups):
        top = 3.2 * font
    height = pitch * len(names)
    scale = _draw_scale(axis, room, height, font, levels)
    for at, name in enumerate(names):
        y = at * pitch + 5
        middle = y + name_height + len(groups) * (thick + 4) / 2 - 2
        if above:
            parts.append(draw_text(0.0, y + font, shorten_text(name, layout.width - left, font)))
        else:
            parts.append(draw_text(-10.0, middle + 0.35 * font, name, anchor="end"))
        for which, (bars, row) in enumerate(zip(groups, table, strict=True)):
            at_y = y + name_height + which * (thick + 4)
            solid = which == len(groups) - 1
            parts.append(
                _draw_bar(
                    row[at], axis, room, at_y, thick, font, bars.color or COLOR_CYCLE[which % len(COLOR_CYCLE)], solid
                )
            )
    key = _draw_key(groups, layout)
    body = build_element("g", scale, *parts, transform=f"translate({left:.1f} {top:.1f})", class_="plot")
    return frame.build_svg(layout, layout.width, round(top + height + 3.9 * font, 1), words, key, body)


def _draw_bar(bar: _Bar, axis: Axis, room: float, y: float, thick: float, font: float, color: str, solid: bool) -> str:
    """A bar with its interval as a whisker and its value behind it."""
    zero = 0.0
    if not axis.log:
        zero = float(axis.to_pixels(np.zeros(1), room)[0])
    ends = axis.to_pixels(as_samples([bar.value, bar.low, bar.high]), room)
    text = _format_bar_value(bar, axis)
    if np.isnan(ends[0]):
        return draw_text(zero + 6, y + 0.82 * thick, text, faint=True)
    left, right = sorted((zero, float(ends[0])))
    box = _draw_box(left, y, max(right - left, 1.0), thick, solid)
    whisker, reach = "", max(right, zero)
    if np.isfinite(ends).all():
        a, b, middle, half = float(ends[1]), float(ends[2]), y + thick / 2, thick / 4
        stops = "".join(f"M{end:.1f} {middle - half:.1f}v{2 * half:.1f}" for end in (a, b))
        lines = f"M{a:.1f} {middle:.1f}H{b:.1f}{stops}"
        whisker, reach = (
            group_in_color("ink", build_element("path", d=lines, fill="none", stroke="currentColor")),
            max(reach, b),
        )
    return group_in_color(color, box) + whisker + draw_text(reach + 6, y + 0.82 * thick, text)


def _draw_scale(axis: Axis, room: float, height: float, font: float, levels: Sequence[tuple[float, str]]) -> str:
    parts, grid = [], []
    for value, text in axis.ticks(int(room / 80) + 1):
        x = float(axis.to_pixels(np.array([value]), room)[0])
        grid.append(f"M{x:.1f} 0V{height:.1f}")
        parts.append(draw_text(x, height + 1.4 * font, text, anchor="middle", faint=True))
    parts.append(build_element("path", d="".join(grid), stroke="currentColor", stroke_opacity=0.13))
    if not axis.log:
        zero: Array = axis.to_pixels(np.zeros(1), room)
        parts.append(
            build_element("path", d=f"M{zero[0]:.1f} 0V{height:.1f}", stroke="currentColor", stroke_opacity=0.55)
        )
    for value, text in levels:
        x = float(axis.to_pixels(np.array([value]), room)[0])
        if np.isfinite(x):
            parts.append(
                build_element("path", d=f"M{x:.1f} -3V{height:.1f}", stroke="currentColor", stroke_dasharray="2 4")
            )
            parts.append(draw_text(x, -6.0, shorten_text(text, room / 2, font), anchor="middle", faint=True))
    parts.append(
        draw_text(
            room / 2, height + 2.9 * font, shorten_text(axis.quantity.label, room, font), anchor="middle", strong=True
        )
    )
    return "".join(parts)


def _draw_key(groups: Sequence[BarGroup], layout: Layout) -> str:
    font, room = layout.font, layout.width / max(len(groups), 1) - 40
    parts, x = [], 0.0
    for which, bars in enumerate(groups):
        if bars.label:
            box = _draw_box(x, 0.35 * font, 16.0, 0.8 * font, which == len(groups) - 1)
            parts += [
                group_in_color(bars.color or COLOR_CYCLE[which % len(COLOR_CYCLE)], box),
                draw_text(x + 22, 1.1 * font, shorten_text(bars.label, room, font)),
            ]
            x += 40 + min(estimate_text_width(bars.label, font), room)
    return "".join(parts)
