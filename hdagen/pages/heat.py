"""A heat map: a number for every cell of a grid, of numbers (speed × load) or of names (effect × joint)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.pages import frame
from hdagen.pages.axis import Axis, fit
from hdagen.pages.frame import LAYOUTS, WIDE, Layout, letters, shortened, text_width
from hdagen.pages.markup import tag
from hdagen.pages.palette import DIVERGING, SEQUENTIAL, blend, lightness
from hdagen.pages.quantity import number
from hdagen.pages.thin import Array, packed, samples

SHADES = 64
CELLS = 40_000  # more cells than that are finer than a pixel
NAMES = 0.35  # of the width of the drawing, at most, for the names of rows
WRITTEN = 120  # up to so many cells carry their number
Edges = Array | list[str]


def heat(
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
    caption: str = "",
) -> str:
    """``values`` (rows, columns), base units; NaN leaves a cell empty. Row 0 lies at the bottom, or on top for names.

    ``x`` holds the columns + 1 edges, ascending, or the columns' names; ``y`` likewise for rows. ``center``: colours
    diverge about that value and reach as far to either side. ValueError where sizes do not fit.
    """
    grid = np.asarray(values, dtype=np.float64)
    if grid.ndim != 2:
        raise ValueError(f"figure {title!r}: values have shape {grid.shape}; give one row for every cell of y")
    rows, columns = grid.shape
    cells = samples(grid).reshape(rows, columns)
    across = _edges(title, "x", x, columns, log_x)
    up = _edges(title, "y", y, rows, log_y)
    if cells.size > CELLS:
        raise ValueError(f"figure {title!r}: {cells.size} cells are more than can be seen; use at most {CELLS}")
    scale = fit(value_label, [cells], margin=0.0)
    if center is not None:
        far = float(np.nanmax(np.abs(cells - center), initial=0.0)) or 1.0
        scale = Axis(center - far, center + far, scale.quantity)
    stops = SEQUENTIAL if center is None else DIVERGING
    shades = np.nan_to_num(scale.place(cells, SHADES), nan=-1.0).clip(-1, SHADES - 1).astype(int)
    axes = (_axis(x_label, across, log_x), _axis(y_label, up, log_y))
    words = f"{title}: {scale.quantity.label} over {x_label} and {y_label}"
    drawings = "".join(
        frame.drawing(layout, *_drawing(layout, axes, across, up, cells, shades, scale, stops, words))
        for layout in LAYOUTS
    )
    data = {
        "x": _sent(across), "y": _sent(up), "cells": packed(cells.ravel()), "log": [log_x, log_y],
        "labels": [axes[0].quantity.base_label, axes[1].quantity.base_label, scale.quantity.base_label],
        "written": [[axis.quantity.name, axis.quantity.unit, axis.quantity.factor] for axis in (*axes, scale)],
    }  # fmt: skip
    note = "Empty cells hold no data." if np.isnan(cells).any() else ""
    return frame.figure("heat", title, drawings, caption=caption, note=note, data=data)


def _edges(title: str, name: str, edges: ArrayLike | Sequence[str], count: int, log: bool) -> Edges:
    listed = list(np.asarray(edges).ravel().tolist())
    if listed and all(isinstance(edge, str) for edge in listed):
        if len(listed) != count:
            raise ValueError(f"figure {title!r}: {name} has {len(listed)} names for {count} cells; give one for each")
        return [str(edge) for edge in listed]
    numbers = samples(listed)
    if (
        numbers.size != count + 1
        or np.isnan(numbers).any()
        or np.any(np.diff(numbers) <= 0)
        or (log and numbers[0] <= 0)
    ):
        raise ValueError(
            f"figure {title!r}: {name} must hold the {count + 1} edges of {count} cells, finite and ascending"
            f"{', above 0 for a log axis' if log else ''}; it holds {numbers.size} numbers"
        )
    return numbers


def _axis(label: str, edges: Edges, log: bool) -> Axis:
    numbers = np.arange(len(edges) + 1.0) if isinstance(edges, list) else edges
    return fit(label, [numbers], log=log and not isinstance(edges, list), margin=0.0)


def _sent(edges: Edges) -> list[str] | list[float]:
    return edges if isinstance(edges, list) else edges.tolist()


def _drawing(
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
    beside = up if isinstance(up, list) else [text for _, text in axes[1].ticks(7)]
    left = 14 + min(max((text_width(name, font) for name in beside), default=0.0), NAMES * layout.width)
    key = 18 + 14 + 8 + max(text_width(text, font) for _, text in scale.ticks(6))
    width = layout.width - left - key
    height = min(30.0 * len(up), 360.0) if isinstance(up, list) else (300.0 if layout is WIDE else 220.0)
    top = 2.2 * font
    name = shortened(axes[1].quantity.label, 0.45 * width, font)
    beside_it = width + key - 1.15 * text_width(name, font) - font  # strong letters are wider
    x = (np.arange(len(across) + 1.0) if isinstance(across, list) else across).astype(np.float64)
    y = (np.arange(len(up) + 1.0) if isinstance(up, list) else up).astype(np.float64)
    px = axes[0].place(x, width)
    py = axes[1].place(y, height) if isinstance(up, list) else height - axes[1].place(y, height)
    body = tag(
        "g",
        letters(0.0, -0.8 * font, name, strong=True),
        letters(width + key, -0.8 * font, shortened(scale.quantity.label, beside_it, font), anchor="end", strong=True),
        *_patches(px, py, shades, stops),
        *(_numerals(px, py, cells, shades, scale, stops, font) if cells.size <= WRITTEN else ()),
        *_tick_texts(layout, axes, across, up, px, py, width, height),
        tag("path", d=f"M0 0V{height:.1f}H{width:.1f}", fill="none", stroke="currentColor", stroke_opacity=0.55),
        _key(scale, stops, width + 18, height, font),
        letters(
            width / 2, height + 3.1 * font, shortened(axes[0].quantity.label, width, font), anchor="middle", strong=True
        ),
        tag("svg", width=width, height=height, class_="area"),
        class_="plot",
        transform=f"translate({left:.1f} {top:.1f})",
    )
    return layout.width, round(top + height + 3.9 * font, 1), words, body


def _patches(px: Array, py: Array, shades: NDArray[np.int_], stops: tuple[str, ...]) -> list[str]:
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
        tag("path", d="".join(boxes), fill=_shade(stops, shade), shape_rendering="crispEdges")
        for shade, boxes in sorted(paths.items())
    ]


def _shade(stops: tuple[str, ...], shade: int) -> str:
    return blend(stops, shade / (SHADES - 1))


def _numerals(
    px: Array, py: Array, cells: Array, shades: NDArray[np.int_], scale: Axis, stops: tuple[str, ...], font: float
) -> list[str]:
    """The number in every cell that is wide enough for it, dark on light shades and light on dark ones."""
    texts = []
    for row, column in np.argwhere(shades >= 0).tolist():
        text = number(float(cells[row, column]) * scale.quantity.factor, 2)
        if text_width(text, font) + 4 > px[column + 1] - px[column] or font + 2 > abs(py[row + 1] - py[row]):
            continue
        dark = lightness(_shade(stops, int(shades[row, column]))) < 0.22
        at_x, at_y = (px[column] + px[column + 1]) / 2, (py[row] + py[row + 1]) / 2 + 0.35 * font
        texts.append(tag("g", letters(at_x, at_y, text, anchor="middle"), fill="#ffffff" if dark else "#000000"))
    return texts


def _tick_texts(
    layout: Layout, axes: tuple[Axis, Axis], across: Edges, up: Edges, px: Array, py: Array, width: float, height: float
) -> list[str]:
    font = layout.font
    if isinstance(across, list):
        x = [((px[at] + px[at + 1]) / 2, name) for at, name in enumerate(across)]
    else:
        x = [(axes[0].place(np.array([at]), width)[0], text) for at, text in axes[0].ticks(int(width / 80) + 1)]
    if isinstance(up, list):
        y = [((py[at] + py[at + 1]) / 2, name) for at, name in enumerate(up)]
    else:
        y = [(height - axes[1].place(np.array([at]), height)[0], text) for at, text in axes[1].ticks(7)]
    room, left = (width / len(x) if isinstance(across, list) else width), NAMES * layout.width
    below = [
        letters(float(at), height + 1.5 * font, shortened(text, room, font), anchor="middle", faint=True)
        for at, text in x
    ]
    beside = [
        letters(-7.0, float(at) + 0.35 * font, shortened(text, left, font), anchor="end", faint=True) for at, text in y
    ]
    return below + beside


def _key(scale: Axis, stops: tuple[str, ...], x: float, height: float, font: float) -> str:
    step = height / SHADES
    parts = [
        tag(
            "rect",
            x=x,
            y=height - (at + 1) * step,
            width=14.0,
            height=step + 0.4,
            fill=_shade(stops, at),
            shape_rendering="crispEdges",
        )
        for at in range(SHADES)
    ]
    free = np.inf  # above the last number; a map of one row has room for few
    for value, text in scale.ticks(6):
        y = height - float(scale.place(np.array([value]), height)[0])
        if y <= free:
            parts.append(letters(x + 20, y + 0.35 * font, text, faint=True))
            free = y - font
    return tag("g", *parts)
