"""Dots on a common axis with their intervals: one row for each name, one kind of dot for each group."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit_axis
from hdagen.pages.decimation import Array, as_samples
from hdagen.pages.frame import LAYOUTS, Layout, draw_text, estimate_text_width, group_in_color, shorten_text, wrap_text
from hdagen.pages.markup import build_element
from hdagen.pages.palette import COLOR_CYCLE
from hdagen.pages.quantity import format_number, scale_quantity

WIDEST_NAMES = 0.42  # of the width of the drawing; longer names stand above their rows
ROW_HEIGHT = 1.9  # in heights of the letters
DOT_RADIUS = 5.0  # px


@dataclass(frozen=True)
class DotGroup:
    """Dots of one kind, ``values`` (names,), base units; NaN: no dot. ``interval`` = (low, high), each (names,)."""

    label: str
    values: ArrayLike
    interval: tuple[ArrayLike, ArrayLike] | None = None
    color: str | None = None


def draw_dots(
    title: str,
    names: Sequence[str],
    groups: Sequence[DotGroup],
    *,
    value_label: str,
    levels: Sequence[tuple[float, str]] = (),
    log: bool = False,
    caption: str = "",
) -> str:
    """Draw dots, one row for each name; dots of several groups in a row are joined by a line.

    Args:
        title: Heading.
        names: Names of the rows.
        groups: Values of each group, one for every name. The dots of the last group are filled.
        value_label: "name (unit)" of the values.
        levels: Lines across all rows as (value, words).
        log: Whether the axis is logarithmic. Values up to 0 have no dot then.
        caption: Text below the drawings.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: A group does not have one value for every name.

    """
    values = np.stack([_read_column(title, names, one.label, one.values) for one in groups] or [np.zeros(0)])
    ends = np.stack([_read_interval(title, names, one) for one in groups] or [np.zeros((2, 0))])
    axis = fit_axis(value_label, [values, ends, as_samples([value for value, _ in levels])], log=log, margin=0.04)
    texts = [_write_row(values[:, row], ends[:, :, row], axis) for row in range(len(names))]
    words = f"{title}: {axis.quantity.label} of {', '.join(names)}"
    drawings = "".join(
        _draw_layout(layout, words, names, groups, values, ends, texts, axis, levels) for layout in LAYOUTS
    )
    header = ["", *(one.label or axis.quantity.base_label for one in groups)]
    rows = [[name, *map(_encode_number, values[:, row])] for row, name in enumerate(names)]
    return frame.build_figure("dots", title, drawings, caption=caption, data={"rows": [header, *rows]})


def _read_column(title: str, names: Sequence[str], label: str, values: ArrayLike) -> Array:
    column = as_samples(values)
    if column.size != len(names):
        raise ValueError(
            f"figure {title!r}, dots {label!r}: there are {column.size} numbers for {len(names)} names; "
            "give one for every name"
        )
    return column


def _read_interval(title: str, names: Sequence[str], one: DotGroup) -> Array:
    """Low and high of each name (2, names), NaN where there is none."""
    sides = one.interval or (np.full(len(names), np.nan),) * 2
    return np.stack([_read_column(title, names, f"{one.label} interval", side) for side in sides])


def _encode_number(value: float) -> float | None:
    if np.isfinite(value):
        return float(value)
    return None


def _write_row(values: Array, ends: Array, axis: Axis) -> str:
    """The values of a row, the groups in their order, and the interval of the last one."""
    size = axis.quantity
    if axis.log and size.base and np.isfinite(values).any():
        size = scale_quantity(size.base_label, float(np.nanmax(np.abs(values))))
    text = " → ".join(format_number(float(value) * size.factor, 3) for value in values)
    if len(ends) and np.isfinite(ends[-1]).all():
        low, high = (format_number(float(end) * size.factor, 3) for end in ends[-1])
        text += f" [{low}, {high}]"
    return f"{text} {size.unit}".rstrip()


def _draw_layout(
    layout: Layout,
    words: str,
    names: Sequence[str],
    groups: Sequence[DotGroup],
    values: Array,
    ends: Array,
    texts: Sequence[str],
    axis: Axis,
    levels: Sequence[tuple[float, str]],
) -> str:
    """On a wide layout names stand left of the rows, on a narrow one above them."""
    font = layout.font
    longest = max((estimate_text_width(name, font) for name in names), default=0.0)
    above = longest > WIDEST_NAMES * layout.width
    left, lines = longest + 14, [[name] for name in names]
    tops = [ROW_HEIGHT * font * row for row in range(len(names) + 1)]
    if above:
        left = 10.0
        lines = [wrap_text(name, layout.width - left, font) for name in names]
        tops = [0.0, *np.cumsum([(ROW_HEIGHT + 1.3 * len(own)) * font for own in lines]).tolist()]
    beside = max((estimate_text_width(text, font) for text in texts), default=0.0) + 22
    room = max(layout.width - left - beside, 0.3 * layout.width)
    height = tops[-1]
    top = 1.7 * font * bool(levels) + 0.4 * font
    key = ""
    if any(one.label for one in groups):
        key, top = _draw_key(groups, font), top + 1.7 * font
    parts = [_draw_scale(axis, room, height, layout.width - left, font, levels)]
    for row, own in enumerate(lines):
        y = tops[row + 1] - 0.5 * ROW_HEIGHT * font
        if above:
            at = [y - (0.85 + 1.3 * (len(own) - 1 - k)) * font for k in range(len(own))]
            parts += [draw_text(0.0, up, line, halo=True) for up, line in zip(at, own, strict=True)]
        else:
            parts.append(draw_text(-12.0, y + 0.35 * font, own[0], anchor="end"))
        parts.append(_draw_row(groups, values[:, row], ends[:, :, row], axis, room, y))
        parts.append(draw_text(room + 14, y + 0.35 * font, texts[row]))
    body = build_element("g", *parts, transform=f"translate({left:.1f} {top:.1f})")
    return frame.build_svg(layout, layout.width, round(top + height + 3.6 * font, 1), words, key, body)


def _draw_row(groups: Sequence[DotGroup], values: Array, ends: Array, axis: Axis, room: float, y: float) -> str:
    """The dots of one name, the line that joins them, and the interval of each."""
    at = axis.to_pixels(values, room)
    parts = []
    shown = at[np.isfinite(at)]
    if len(shown) > 1:
        line = build_element(
            "path", d=f"M{shown.min():.1f} {y:.1f}H{shown.max():.1f}", stroke="currentColor", stroke_opacity=0.35
        )
        parts.append(group_in_color("ink", line))
    for which, one in enumerate(groups):
        color = one.color or COLOR_CYCLE[which % len(COLOR_CYCLE)]
        low, high = axis.to_pixels(ends[which], room)
        marks = ""
        if np.isfinite(low + high):
            stops = f"M{low:.1f} {y - 4:.1f}v8M{high:.1f} {y - 4:.1f}v8"
            marks = build_element(
                "path", d=f"M{low:.1f} {y:.1f}H{high:.1f}{stops}", stroke="currentColor", stroke_width=1.6, fill="none"
            )
        if np.isfinite(at[which]):
            marks += _draw_dot(float(at[which]), y, which == len(groups) - 1)
        parts.append(group_in_color(color, marks))
    return "".join(parts)


def _draw_dot(x: float, y: float, filled: bool) -> str:
    """A dot of the last group is filled, one of an earlier group is a ring, so that they differ without colour."""
    inside: dict[str, object] = {"fill": "currentColor"}
    if not filled:
        inside = {"fill": "none"}
    return build_element("circle", cx=x, cy=y, r=DOT_RADIUS, stroke="currentColor", stroke_width=1.8, **inside)


def _draw_scale(
    axis: Axis, room: float, height: float, wide: float, font: float, levels: Sequence[tuple[float, str]]
) -> str:
    parts, grid = [], []
    for value, text in axis.ticks(int(room / 80) + 1):
        x = float(axis.to_pixels(np.array([value]), room)[0])
        grid.append(f"M{x:.1f} 0V{height:.1f}")
        parts.append(draw_text(x, height + 1.3 * font, text, anchor="middle", faint=True))
    parts.append(build_element("path", d="".join(grid), stroke="currentColor", stroke_opacity=0.13))
    free = 0.0  # right end of the words that stand already
    for value, text in sorted(levels):
        x = float(axis.to_pixels(np.array([value]), room)[0])
        if not np.isfinite(x):
            continue
        parts.append(
            build_element("path", d=f"M{x:.1f} -3V{height:.1f}", stroke="currentColor", stroke_dasharray="2 4")
        )
        half = estimate_text_width(text, font) / 2
        middle = min(max(x, half - 4, free + half + 10), max(wide - half, half))
        parts.append(draw_text(middle, -7.0, text, anchor="middle", faint=True, halo=True))
        free = middle + half
    label = shorten_text(axis.quantity.label, wide, font)
    half = 0.54 * estimate_text_width(label, font)
    parts.append(draw_text(max(room / 2, half), height + 2.8 * font, label, anchor="middle", strong=True))
    return "".join(parts)


def _draw_key(groups: Sequence[DotGroup], font: float) -> str:
    parts, x = [], 6.0
    for which, one in enumerate(groups):
        if not one.label:
            continue
        dot = _draw_dot(x, 0.7 * font, which == len(groups) - 1)
        color = one.color or COLOR_CYCLE[which % len(COLOR_CYCLE)]
        parts += [group_in_color(color, dot), draw_text(x + 12, 1.05 * font, one.label)]
        x += 36 + estimate_text_width(one.label, font)
    return "".join(parts)
