"""A heat map: a number for every cell of a grid, of numbers (speed × load) or of names (effect × joint)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit_axis
from hdagen.pages.decimation import Array, as_samples, pack_floats
from hdagen.pages.frame import LAYOUTS, WIDE, Layout, draw_text, estimate_text_width, shorten_text
from hdagen.pages.markup import build_element
from hdagen.pages.palette import DIVERGING_COLORS, SEQUENTIAL_COLORS, blend_colors, compute_luminance
from hdagen.pages.quantity import format_number

SHADE_COUNT = 64
HATCH_PITCH = 7.0  # px, between the lines that mark empty cells
VISIBLE_CELLS = 40_000  # more cells than that are finer than a pixel
NAME_WIDTH_SHARE = 0.35  # of the width of the drawing, at most, for the names of rows
MOST_WRITTEN_CELLS = 120  # up to so many cells carry their number
Edges = Array | list[str]


def draw_heat_map(
    title: str,
    x: ArrayLike | Sequence[str],
    y: ArrayLike | Sequence[str],
    values: ArrayLike,
    *,
    x_label: str,
    y_label: str,
    value_label: str,
    log_x: bool = False,
    log_y: bool = False,
    center: float | None = None,
    span: tuple[float, float] | None = None,
    caption: str = "",
) -> str:
    """Draw a heat map, whose row 0 lies at the bottom, or on top where rows have names.

    Args:
        title: Heading.
        x: Edges of the columns (columns + 1), ascending, or the columns' names.
        y: Edges of the rows (rows + 1), ascending, or the rows' names.
        values: Numbers (rows, columns) in base units; NaN leaves a cell empty.
        x_label: "name (unit)" of x.
        y_label: "name (unit)" of y.
        value_label: "name (unit)" of the values.
        log_x: Whether x is logarithmic.
        log_y: Whether y is logarithmic.
        center: Value about which the colours diverge, as far to either side; None: they rise from low to high.
        span: Lowest and highest value of the colours, which maps to be compared share; None: those of the cells.
        caption: Text below the drawings.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: Sizes do not fit each other, or there are more cells than can be seen.

    """
    cells = _check_grid(title, values)
    rows, columns = cells.shape
    across = _check_edges(title, "x", x, columns, log_x)
    up = _check_edges(title, "y", y, rows, log_y)
    scale, stops = _color_scale(value_label, cells, center, span)
    shades = np.nan_to_num(scale.to_pixels(cells, SHADE_COUNT), nan=-1.0).clip(-1, SHADE_COUNT - 1).astype(int)
    axes = (_fit_edge_axis(x_label, across, log_x), _fit_edge_axis(y_label, up, log_y))
    words = f"{title}: {scale.quantity.label} over {x_label} and {y_label}"
    drawings = "".join(
        frame.build_svg(layout, *_draw_layout(layout, axes, across, up, cells, shades, scale, stops, words))
        for layout in LAYOUTS
    )
    data = {
        "x": _encode_edges(across), "y": _encode_edges(up), "cells": pack_floats(cells.ravel()), "log": [log_x, log_y],
        "labels": [axes[0].quantity.base_label, axes[1].quantity.base_label, scale.quantity.base_label],
        "written": [[axis.quantity.name, axis.quantity.unit, axis.quantity.factor] for axis in (*axes, scale)],
    }  # fmt: skip
    note = ""
    if np.isnan(cells).any():
        note = "Hatched: no data."
    return frame.build_figure("heat", title, drawings, caption=caption, note=note, data=data)


def _check_grid(title: str, values: ArrayLike) -> Array:
    grid = np.asarray(values, dtype=np.float64)
    if grid.ndim != 2:
        raise ValueError(f"figure {title!r}: values have shape {grid.shape}; give one row for every cell of y")
    if grid.size > VISIBLE_CELLS:
        raise ValueError(f"figure {title!r}: {grid.size} cells are more than can be seen; use at most {VISIBLE_CELLS}")
    return as_samples(grid).reshape(grid.shape)


def _color_scale(
    label: str, cells: Array, center: float | None, span: tuple[float, float] | None
) -> tuple[Axis, tuple[str, ...]]:
    """The axis of the values and its colours from low to high."""
    held = [cells]
    if span is not None:
        held.append(np.array(span))
    scale = fit_axis(label, held, margin=0.0)
    if center is None:
        return scale, SEQUENTIAL_COLORS
    far = float(np.nanmax(np.abs(cells - center), initial=0.0)) or 1.0
    return Axis(center - far, center + far, scale.quantity), DIVERGING_COLORS


def _check_edges(title: str, name: str, edges: ArrayLike | Sequence[str], count: int, log: bool) -> Edges:
    listed = list(np.asarray(edges).ravel().tolist())
    if listed and all(isinstance(edge, str) for edge in listed):
        if len(listed) != count:
            raise ValueError(f"figure {title!r}: {name} has {len(listed)} names for {count} cells; give one for each")
        return [str(edge) for edge in listed]
    numbers = as_samples(listed)
    if (
        numbers.size != count + 1
        or np.isnan(numbers).any()
        or np.any(np.diff(numbers) <= 0)
        or (log and numbers[0] <= 0)
    ):
        needed = f"the {count + 1} edges of {count} cells, finite and ascending"
        if log:
            needed += ", above 0 for a log axis"
        raise ValueError(f"figure {title!r}: {name} must hold {needed}; it holds {numbers.size} numbers")
    return numbers


def _edge_numbers(edges: Edges) -> Array:
    """Edges as numbers; cells with names are one wide."""
    if isinstance(edges, list):
        return np.arange(len(edges) + 1.0)
    return edges.astype(np.float64)


def _fit_edge_axis(label: str, edges: Edges, log: bool) -> Axis:
    return fit_axis(label, [_edge_numbers(edges)], log=log and not isinstance(edges, list), margin=0.0)


def _encode_edges(edges: Edges) -> list[str] | list[float]:
    if isinstance(edges, list):
        return edges
    return edges.tolist()


def _draw_layout(
    layout: Layout,
    axes: tuple[Axis, Axis],
    across: Edges,
    up: Edges,
    cells: Array,
    shades: NDArray[np.int_],
    scale: Axis,
    stops: tuple[str, ...],
    words: str,
) -> tuple[float, float, str, str]:
    """Width, height, description and body of the drawing."""
    font = layout.font
    beside, height = [text for _, text in axes[1].ticks(7)], 220.0
    if layout is WIDE:
        height = 300.0
    if isinstance(up, list):
        beside, height = up, min(30.0 * len(up), 360.0)
    left = 14 + min(
        max((estimate_text_width(name, font) for name in beside), default=0.0), NAME_WIDTH_SHARE * layout.width
    )
    key = 18 + 14 + 8 + max(estimate_text_width(text, font) for _, text in scale.ticks(6))
    width = layout.width - left - key
    top = 2.2 * font
    name = shorten_text(axes[1].quantity.label, 0.45 * width, font)
    beside_it = width + key - 1.15 * estimate_text_width(name, font) - font  # strong letters are wider
    px, py = axes[0].to_pixels(_edge_numbers(across), width), axes[1].to_pixels(_edge_numbers(up), height)
    if not isinstance(up, list):
        py = height - py
    numerals: list[str] = []
    if cells.size <= MOST_WRITTEN_CELLS:
        numerals = _draw_numerals(px, py, cells, shades, scale, stops, font)
    body = build_element(
        "g",
        draw_text(0.0, -0.8 * font, name, strong=True),
        draw_text(
            width + key, -0.8 * font, shorten_text(scale.quantity.label, beside_it, font), anchor="end", strong=True
        ),
        _draw_hatch(shades, width, height),
        *_draw_patches(px, py, shades, stops),
        *numerals,
        *_draw_tick_texts(layout, axes, across, up, px, py, width, height),
        build_element(
            "path", d=f"M0 0V{height:.1f}H{width:.1f}", fill="none", stroke="currentColor", stroke_opacity=0.55
        ),
        _draw_key(scale, stops, width + 18, height, font),
        draw_text(
            width / 2,
            height + 3.1 * font,
            shorten_text(axes[0].quantity.label, width, font),
            anchor="middle",
            strong=True,
        ),
        build_element("svg", width=width, height=height, class_="area"),
        class_="plot",
        transform=f"translate({left:.1f} {top:.1f})",
    )
    return layout.width, round(top + height + 3.9 * font, 1), words, body


def _draw_hatch(shades: NDArray[np.int_], width: float, height: float) -> str:
    """Oblique lines below the cells: where a cell is empty they show, which no colour of the scale looks like."""
    if (shades >= 0).all():
        return ""
    starts = np.arange(-height, width, HATCH_PITCH)
    lines = "".join(f"M{x:.0f} {height:.0f}l{height:.0f} -{height:.0f}" for x in starts.tolist())
    path = build_element("path", d=lines, fill="none", stroke="currentColor", stroke_opacity=0.25)
    return build_element("svg", path, width=width, height=height)


def _draw_patches(px: Array, py: Array, shades: NDArray[np.int_], stops: tuple[str, ...]) -> list[str]:
    """One path a shade; neighbours in a row that share a shade are one rectangle."""
    paths: dict[int, list[str]] = {}
    for row, line in enumerate(shades):
        top, bottom = sorted((float(py[row]), float(py[row + 1])))
        ends = np.flatnonzero(np.diff(np.r_[line, -2])) + 1
        for start, end in zip(np.r_[0, ends[:-1]], ends, strict=True):
            if line[start] >= 0:
                box = f"M{px[start]:.1f} {top:.1f}H{px[end]:.1f}V{bottom:.1f}H{px[start]:.1f}Z"
                paths.setdefault(int(line[start]), []).append(box)
    return [
        build_element("path", d="".join(boxes), fill=_find_shade_color(stops, shade), shape_rendering="crispEdges")
        for shade, boxes in sorted(paths.items())
    ]


def _find_shade_color(stops: tuple[str, ...], shade: int) -> str:
    return blend_colors(stops, shade / (SHADE_COUNT - 1))


def _draw_numerals(
    px: Array, py: Array, cells: Array, shades: NDArray[np.int_], scale: Axis, stops: tuple[str, ...], font: float
) -> list[str]:
    """The number in every cell that is wide enough for it, dark on light shades and light on dark ones."""
    texts = []
    for row, column in np.argwhere(shades >= 0).tolist():
        text = format_number(float(cells[row, column]) * scale.quantity.factor, 2)
        if estimate_text_width(text, font) + 4 > px[column + 1] - px[column] or font + 2 > abs(py[row + 1] - py[row]):
            continue
        ink = "#000000"
        if compute_luminance(_find_shade_color(stops, int(shades[row, column]))) < 0.22:
            ink = "#ffffff"
        at_x, at_y = (px[column] + px[column + 1]) / 2, (py[row] + py[row + 1]) / 2 + 0.35 * font
        texts.append(build_element("g", draw_text(at_x, at_y, text, anchor="middle"), fill=ink))
    return texts


def _draw_tick_texts(
    layout: Layout, axes: tuple[Axis, Axis], across: Edges, up: Edges, px: Array, py: Array, width: float, height: float
) -> list[str]:
    font, room = layout.font, width
    if isinstance(across, list):
        x = [((px[at] + px[at + 1]) / 2, name) for at, name in enumerate(across)]
        room = width / len(x)
    else:
        x = [(axes[0].to_pixels(np.array([at]), width)[0], text) for at, text in axes[0].ticks(int(width / 80) + 1)]
    if isinstance(up, list):
        y = [((py[at] + py[at + 1]) / 2, name) for at, name in enumerate(up)]
    else:
        y = [(height - axes[1].to_pixels(np.array([at]), height)[0], text) for at, text in axes[1].ticks(7)]
    below = [
        draw_text(float(at), height + 1.5 * font, shorten_text(text, room, font), anchor="middle", faint=True)
        for at, text in x
    ]
    beside = [
        draw_text(
            -7.0,
            float(at) + 0.35 * font,
            shorten_text(text, NAME_WIDTH_SHARE * layout.width, font),
            anchor="end",
            faint=True,
        )
        for at, text in y
    ]
    return below + beside


def _draw_key(scale: Axis, stops: tuple[str, ...], x: float, height: float, font: float) -> str:
    step = height / SHADE_COUNT
    parts = [
        build_element(
            "rect",
            x=x,
            y=height - (at + 1) * step,
            width=14.0,
            height=step + 0.4,
            fill=_find_shade_color(stops, at),
            shape_rendering="crispEdges",
        )
        for at in range(SHADE_COUNT)
    ]
    free = np.inf  # above the last number; a map of one row has room for few
    for value, text in scale.ticks(6):
        y = height - float(scale.to_pixels(np.array([value]), height)[0])
        if y <= free:
            parts.append(draw_text(x + 20, y + 0.35 * font, text, faint=True))
            free = y - font
    return build_element("g", *parts)
