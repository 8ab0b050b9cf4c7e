"""Horizontal bars: names beside lengths, one or more groups, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit
from hdagen.pages.frame import LAYOUTS, Layout, group, letters, shortened, text_width
from hdagen.pages.markup import tag
from hdagen.pages.palette import CYCLE
from hdagen.pages.quantity import number, quantity
from hdagen.pages.thin import Array, samples


@dataclass(frozen=True)
class Bars:
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


def bars(
    title: str,
    names: Sequence[str],
    groups: Sequence[Bars],
    *,
    value_label: str,
    levels: Sequence[tuple[float, str]] = (),
    log: bool = False,
    caption: str = "",
) -> str:
    """A bar for each of ``names`` in each of ``groups``; ``levels`` are (value, words) across all of them.

    ``value_label`` is "name (unit)". On a ``log`` axis bars start at its left end, and what is not positive has none.
    ValueError where a group does not have one value for every name.
    """
    table = [_checked(title, names, bars) for bars in groups]
    values = samples([x for row in table for bar in row for x in (bar.value, bar.low, bar.high)])
    edges = [] if log else [np.zeros(1)]
    axis = fit(value_label, [values, samples([value for value, _ in levels]), *edges], log=log, margin=0.0)
    if log:  # the shortest bar still has a length
        axis = replace(axis, low=10.0 ** math.floor(math.log10(axis.low / 1.5)))
    words = f"{title}: {axis.quantity.label} of {', '.join(names)}"
    drawings = "".join(_drawing(layout, words, names, groups, table, axis, levels) for layout in LAYOUTS)
    header = ["", *(bars.label or axis.quantity.name for bars in groups)]
    rows = [[name, *(_numeral(row[at], axis) for row in table)] for at, name in enumerate(names)]
    numbers = frame.rows_table(header, rows, axis.quantity.label)
    data = {"rows": [["", *(f"{bars.label}: {axis.quantity.base_label}" for bars in groups)]] + [
        [name, *(None if np.isnan(row[at].value) else row[at].value for row in table)] for at, name in enumerate(names)
    ]}  # fmt: skip
    return frame.figure("bars", title, drawings, caption=caption, numbers=numbers, data=data)


def _checked(title: str, names: Sequence[str], bars: Bars) -> list[_Bar]:
    values = samples(bars.values)
    low, high = (samples(side) for side in bars.interval or (np.full(len(names), np.nan),) * 2)
    for what, column in (("values", values), ("interval low", low), ("interval high", high)):
        if column.size != len(names):
            raise ValueError(
                f"figure {title!r}, bars {bars.label!r}: {what} has {column.size} numbers for {len(names)} names; "
                "give one for every name"
            )
    return [_Bar(*(float(x) for x in row)) for row in zip(values, low, high, strict=True)]


def _numeral(bar: _Bar, axis: Axis) -> str:
    """The value and its interval as written beside the bar; over decades each has its own prefix, and so its unit."""
    size = quantity(axis.quantity.base_label, abs(bar.value)) if axis.log and axis.quantity.base else axis.quantity
    low, high = number(bar.low * size.factor, 3), number(bar.high * size.factor, 3)
    interval = f" [{low}, {high}]" if np.isfinite(bar.low + bar.high) else ""
    unit = f" {size.unit}" if axis.log and np.isfinite(bar.value) else ""
    return number(bar.value * size.factor, 3) + interval + unit


def _drawing(
    layout: Layout,
    words: str,
    names: Sequence[str],
    groups: Sequence[Bars],
    table: Sequence[Sequence[_Bar]],
    axis: Axis,
    levels: Sequence[tuple[float, str]],
) -> str:
    """On a wide layout names stand left of the bars, on a narrow one above them."""
    font = layout.font
    longest = max((text_width(name, font) for name in names), default=0.0)
    above = longest > 0.4 * layout.width
    left = 8.0 if above else longest + 14
    room = layout.width - left - max(
        (text_width(_numeral(bar, axis), font) for row in table for bar in row), default=0.0
    ) - 14  # fmt: skip
    thick = 0.95 * font
    name_height = 1.5 * font if above else 0.0
    pitch = name_height + len(groups) * (thick + 4) + 10
    parts, top = [], 3.2 * font if any(bars.label for bars in groups) else 1.6 * font
    height = pitch * len(names)
    scale = _scale(axis, room, height, font, levels)
    for at, name in enumerate(names):
        y = at * pitch + 5
        middle = y + name_height + len(groups) * (thick + 4) / 2 - 2
        short = shortened(name, layout.width - left, font)
        parts.append(
            letters(0.0, y + font, short) if above else letters(-10.0, middle + 0.35 * font, name, anchor="end")
        )
        for which, (bars, row) in enumerate(zip(groups, table, strict=True)):
            at_y = y + name_height + which * (thick + 4)
            solid = which == len(groups) - 1
            parts.append(_bar(row[at], axis, room, at_y, thick, font, bars.color or CYCLE[which % len(CYCLE)], solid))
    key = _key(groups, layout)
    body = tag("g", scale, *parts, transform=f"translate({left:.1f} {top:.1f})", class_="plot")
    return frame.drawing(layout, layout.width, round(top + height + 3.9 * font, 1), words, key, body)


def _bar(bar: _Bar, axis: Axis, room: float, y: float, thick: float, font: float, color: str, solid: bool) -> str:
    """The last group is solid, earlier ones are outlined, so that before and after differ without colour."""
    zero = 0.0 if axis.log else float(axis.place(np.zeros(1), room)[0])
    ends = axis.place(samples([bar.value, bar.low, bar.high]), room)
    text = _numeral(bar, axis)
    if np.isnan(ends[0]):
        return letters(zero + 6, y + 0.82 * thick, text, faint=True)
    left, right = sorted((zero, float(ends[0])))
    box = tag("rect", x=left, y=y, width=max(right - left, 1.0), height=thick, fill="currentColor",
              fill_opacity=0.95 if solid else 0.22, stroke="currentColor")  # fmt: skip
    whisker, reach = "", max(right, zero)
    if np.isfinite(ends).all():
        a, b, middle, half = float(ends[1]), float(ends[2]), y + thick / 2, thick / 4
        stops = "".join(f"M{end:.1f} {middle - half:.1f}v{2 * half:.1f}" for end in (a, b))
        lines = f"M{a:.1f} {middle:.1f}H{b:.1f}{stops}"
        whisker, reach = group("ink", tag("path", d=lines, fill="none", stroke="currentColor")), max(reach, b)
    return group(color, box) + whisker + letters(reach + 6, y + 0.82 * thick, text)


def _scale(axis: Axis, room: float, height: float, font: float, levels: Sequence[tuple[float, str]]) -> str:
    parts, grid = [], []
    for value, text in axis.ticks(int(room / 80) + 1):
        x = float(axis.place(np.array([value]), room)[0])
        grid.append(f"M{x:.1f} 0V{height:.1f}")
        parts.append(letters(x, height + 1.4 * font, text, anchor="middle", faint=True))
    parts.append(tag("path", d="".join(grid), stroke="currentColor", stroke_opacity=0.13))
    if not axis.log:
        zero: Array = axis.place(np.zeros(1), room)
        parts.append(tag("path", d=f"M{zero[0]:.1f} 0V{height:.1f}", stroke="currentColor", stroke_opacity=0.55))
    for value, text in levels:
        x = float(axis.place(np.array([value]), room)[0])
        if np.isfinite(x):
            parts.append(tag("path", d=f"M{x:.1f} -3V{height:.1f}", stroke="currentColor", stroke_dasharray="2 4"))
            parts.append(letters(x, -6.0, shortened(text, room / 2, font), anchor="middle", faint=True))
    parts.append(
        letters(room / 2, height + 2.9 * font, shortened(axis.quantity.label, room, font), anchor="middle", strong=True)
    )
    return "".join(parts)


def _key(groups: Sequence[Bars], layout: Layout) -> str:
    font, room = layout.font, layout.width / max(len(groups), 1) - 40
    parts, x = [], 0.0
    for which, bars in enumerate(groups):
        if bars.label:
            solid = which == len(groups) - 1
            box = tag("rect", x=x, y=0.35 * font, width=16.0, height=0.8 * font, fill="currentColor",
                      fill_opacity=0.95 if solid else 0.22, stroke="currentColor")  # fmt: skip
            parts += [
                group(bars.color or CYCLE[which % len(CYCLE)], box),
                letters(x + 22, 1.1 * font, shortened(bars.label, room, font)),
            ]
            x += 40 + min(text_width(bars.label, font), room)
    return "".join(parts)
