"""A result as SVG and PNG: the parts in the paper's layout, with the colours and units of the pages."""

from __future__ import annotations

import importlib.util
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.pages.axis import fit_axis
from hdagen.pages.decimation import find_extreme_rows
from hdagen.pages.frame import estimate_text_width
from hdagen.pages.palette import COLOR_CYCLE, COLORS, DASH_CYCLE, DASH_PATTERNS, SEQUENTIAL_COLORS
from hdagen.pages.quantity import Quantity, format_number
from hdagen.paper.prototype.figure_result import Axes, Curve, Grid, Map, Part, Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Plot
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

PART_WIDTH, LONE_PART_WIDTH, PART_HEIGHT, TABLE_ROW_HEIGHT = (
    4.4,
    7.0,
    2.5,
    0.24,
)  # inches: a part, a lone part, a row of parts, a row of a table
LEFT_MARGIN, BOTTOM_MARGIN, TOP_MARGIN, EDGE_MARGIN, COLOR_BAR_MARGIN = (
    0.68,
    0.46,
    0.28,
    0.15,
    0.86,
)  # inches around axes; BAR: for the colour scale of a map
LEGEND_FONT_SIZE, LEGEND_WIDTH, LEGEND_ROW_HEIGHT = (
    7.5,
    262.0,
    0.16,
)  # of the legend: letters and width, points; height of a row, inches
NARROW_LOG_RANGE = 400.0  # largest ratio of the ends of a logarithmic axis that leaves room for the numbers 1, 2, 5
MOST_STRETCHES = (
    1000  # stretches of a curve, drawn by their smallest and largest values: more than a printed figure has dots
)
STYLE: Any = {
    "svg.hashsalt": "hdagen", "font.size": 8.5, "axes.titlesize": 9.0, "axes.labelsize": 8.5,
    "legend.fontsize": LEGEND_FONT_SIZE,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.alpha": 0.35, "grid.linewidth": 0.5,
    "font.family": "DejaVu Sans", "figure.dpi": 100, "savefig.facecolor": "white",
}  # fmt: skip


def require_matplotlib() -> None:
    """Check that matplotlib is installed.

    Raises:
        PlantError: matplotlib is missing; the message says how to install it.

    """
    if importlib.util.find_spec("matplotlib") is None:
        raise PlantError(
            "figures are drawn by matplotlib, which is not installed; pip install 'hdagen[paper]' brings it."
        )


def draw_result(result: Result) -> tuple[bytes, bytes]:
    """Draw a result in the paper's layout.

    Args:
        result: the figure or table.

    Returns:
        The contents of an SVG and of a PNG file.

    Raises:
        PlantError: matplotlib is missing.

    """
    require_matplotlib()
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = _arrange_rows(result)
    columns = max(len(row) for row in rows)
    wide = max(PART_WIDTH * columns, LONE_PART_WIDTH)
    heights = [max(_part_height(part) for part in row) for row in rows]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(wide, sum(heights) + EDGE_MARGIN))
        FigureCanvasAgg(figure)
        top = sum(heights)
        for row, height in zip(rows, heights, strict=True):
            cell = wide if len(row) == 1 else wide / columns
            legend = max(_legend_height(part) for part in row)
            for at, part in enumerate(row):
                _draw_part(_place_axes(figure, part, (at * cell, top - height, cell, height - legend)), part, wide)
            top -= height
        svg, png = io.BytesIO(), io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": "hdagen"})
        figure.savefig(png, format="png", dpi=150, metadata={"Software": "hdagen"})
    return svg.getvalue(), png.getvalue()


def _arrange_rows(result: Result) -> list[list[Part]]:
    """The parts row by row; a table has a row of its own."""
    rows: list[list[Part]] = []
    for part in result.parts:
        full = not rows or len(rows[-1]) == result.columns or isinstance(rows[-1][-1], Grid)
        if full or isinstance(part, Grid):
            rows.append([])
        rows[-1].append(part)
    return rows


def _part_height(part: Part) -> float:
    if isinstance(part, Grid):
        return 0.5 + TABLE_ROW_HEIGHT * (len(part.rows) + 1)
    own = PART_HEIGHT
    if isinstance(part, Axes) and part.equal:
        own = PART_WIDTH * 0.85
    return own + _legend_height(part)


def _legend_height(part: Part) -> float:
    """Height of the legend above the axes, inches."""
    if isinstance(part, Axes):
        return LEGEND_ROW_HEIGHT * _legend_layout(_legend_labels(part))[1]
    return 0.0


def _place_axes(figure: Figure, part: Part, cell: tuple[float, float, float, float]) -> Plot:
    """New axes within a cell (left, bottom, width, height in inches), in line with those of its row and column."""
    left, bottom, wide, high = cell
    sides = LEFT_MARGIN, EDGE_MARGIN, BOTTOM_MARGIN, TOP_MARGIN
    if isinstance(part, Grid):
        sides = EDGE_MARGIN, EDGE_MARGIN, EDGE_MARGIN, TOP_MARGIN
    if isinstance(part, Map):
        sides = LEFT_MARGIN, COLOR_BAR_MARGIN, BOTTOM_MARGIN, TOP_MARGIN
    box = left + sides[0], bottom + sides[2], wide - sides[0] - sides[1], high - sides[2] - sides[3]
    width, height = figure.get_size_inches()
    return figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))


def _legend_labels(part: Axes) -> list[str]:
    """The labels of the legend."""
    return [*(curve.label for curve in part.curves if curve.label), *dict.fromkeys(words for _, _, words in part.bands)]


def _legend_layout(labels: Sequence[str]) -> tuple[int, int]:
    """Columns and rows of a legend."""
    if not labels:
        return 1, 0
    widest = max(estimate_text_width(label, LEGEND_FONT_SIZE) + 3.6 * LEGEND_FONT_SIZE for label in labels)
    columns = max(1, min(len(labels), int(LEGEND_WIDTH / widest)))
    return columns, -(-len(labels) // columns)


def _draw_part(plot: Plot, part: Part, wide: float) -> None:
    if isinstance(part, Grid):
        _draw_table(plot, part, wide)
    elif isinstance(part, Map):
        _draw_map(plot, part)
    else:
        _draw_axes(plot, part)


def _draw_axes(plot: Plot, part: Axes) -> None:
    xs = [np.asarray(curve.x, float) for curve in part.curves]
    ys = [np.asarray(curve.y, float) for curve in part.curves]
    if part.equal:  # both axes have one unit
        xs = ys = [*xs, *ys]
    across = fit_axis(part.x_label, xs, log=part.log_x).quantity
    up = fit_axis(part.y_label, ys, log=part.log_y).quantity
    for at, curve in enumerate(part.curves):
        _draw_curve(plot, curve, at, across, up)
    _draw_bands(plot, part, across)
    for x, y, words in part.marks:
        plot.plot([x * across.factor], [y * up.factor], "o", color="#1b1f24", markersize=4, fillstyle="none")
        plot.annotate(words, (x * across.factor, y * up.factor), (5, 4), textcoords="offset points", fontsize=7)
    _set_scales(plot, part)
    if part.equal:
        plot.set_aspect("equal", adjustable="datalim")
    if part.log_x:
        low, high = plot.get_xlim()
        digits: tuple[float, ...] = (1.0,)
        if high < NARROW_LOG_RANGE * low:
            digits = (1.0, 2.0, 5.0)
        _label_decades(plot.xaxis, digits)
    if part.log_y:
        _label_decades(plot.yaxis, (1.0, 2.0, 5.0))
    plot.set_xlabel(across.label)
    plot.set_ylabel(up.label)
    _draw_heading(plot, part.heading)


def _set_scales(plot: Plot, part: Axes | Map) -> None:
    """Make the axes logarithmic that the part has so."""
    if part.log_x:
        plot.set_xscale("log")
    if part.log_y:
        plot.set_yscale("log")


def _draw_bands(plot: Plot, part: Axes, across: Quantity) -> None:
    """Shade the bands; the legend names bands of equal words once."""
    said: set[str] = set()
    for begin, end, words in part.bands:
        label, shade = None, 0.08
        if words not in said:
            label = words
            if said:
                shade = 0.16
        plot.axvspan(begin * across.factor, end * across.factor, color="#1b1f24", alpha=shade, linewidth=0, label=label)
        said.add(words)


def _label_decades(axis: Axis, digits: tuple[float, ...]) -> None:
    """Label a logarithmic axis with plain numbers that begin with ``digits``."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=digits))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _draw_heading(plot: Plot, heading: str) -> None:
    """Write the heading and the legend above the axes, where they cover no curve."""
    handles, labels = plot.get_legend_handles_labels()
    columns, rows = _legend_layout(labels)
    if rows:
        plot.legend(
            handles, labels, loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=columns, frameon=False,
            borderpad=0.1, borderaxespad=0.2, handlelength=2.2, columnspacing=1.2, labelspacing=0.25,
        )  # fmt: skip
    _set_title(plot, heading, 4 + 11.5 * rows)


def _set_title(plot: Plot, heading: str, pad: float = 6.0) -> None:
    """Write the heading ``pad`` points above the axes, without matplotlib's search for room."""
    plot.set_title(heading, loc="left", fontweight="bold", y=1.0, pad=pad)


def _draw_curve(plot: Plot, curve: Curve, at: int, across: Quantity, up: Quantity) -> None:
    x, y = _thin_curve(np.asarray(curve.x, float), np.asarray(curve.y, float))
    color = COLORS[curve.color or COLOR_CYCLE[at % len(COLOR_CYCLE)]][0]
    pattern = DASH_PATTERNS[curve.dash or DASH_CYCLE[at % len(DASH_CYCLE)]]
    style: Any = "-"
    if pattern is not None:
        style = (0, tuple(float(v) / curve.width for v in pattern.split()))
    if curve.draw == "points":
        plot.plot(x * across.factor, y * up.factor, ".", color=color, markersize=3 * curve.width, label=curve.label)
        return
    steps = {"step": "steps-post"}.get(curve.draw, "default")
    plot.plot(
        x * across.factor, y * up.factor, color=color, linestyle=style, linewidth=curve.width, drawstyle=steps,
        label=curve.label,
    )  # fmt: skip


def _thin_curve(x: Array, y: Array) -> tuple[Array, Array]:
    """The drawn points of a curve: all of a short one, the extremes of MOST stretches of a long one."""
    if len(x) <= 2 * MOST_STRETCHES:
        return x, y
    rows = find_extreme_rows(np.arange(len(x), dtype=float), [y], MOST_STRETCHES)
    return x[rows], y[rows]


def _draw_map(plot: Plot, part: Map) -> None:
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullLocator

    values = np.asarray(part.values, float)
    unit = fit_axis(part.value_label, [values], margin=0.0).quantity
    shades = LinearSegmentedColormap.from_list("pages", SEQUENTIAL_COLORS)
    mesh = plot.pcolormesh(np.asarray(part.x), np.asarray(part.y), values * unit.factor, cmap=shades, rasterized=True)
    figure = plot.figure
    assert isinstance(figure, Figure)
    box, width = plot.get_position(), figure.get_size_inches()[0]
    beside = figure.add_axes((box.x1 + 0.08 / width, box.y0, 0.1 / width, box.height))
    figure.colorbar(mesh, cax=beside, label=unit.label)
    plot.grid(visible=False)
    _set_scales(plot, part)
    _set_title(plot, part.heading)
    for label, edges, log, axis in (
        (part.x_label, part.x, part.log_x, plot.xaxis),
        (part.y_label, part.y, part.log_y, plot.yaxis),
    ):
        found = fit_axis(label, [np.asarray(edges, float)], log=log, margin=0.0)
        inside = [(value, text) for value, text in found.ticks(6) if found.low <= value <= found.high]
        axis.set_ticks([value for value, _ in inside], [text for _, text in inside])
        axis.set_minor_locator(NullLocator())
        axis.set_label_text(label)


def _draw_table(plot: Plot, part: Grid, wide: float) -> None:
    """Write a table in columns as wide as their words, between rules."""
    plot.axis("off")
    plot.set_xlim(0, 1)
    plot.set_ylim(len(part.rows) + 1.0, 0)
    _set_title(plot, part.heading)
    words = [[str(name) for name in part.columns]]
    for cells in part.rows:
        words.append([_format_cell(cell, part.digits) for cell in cells])
    widths = []
    for k in range(len(part.columns)):
        widths.append(max(estimate_text_width(row[k], 1.0) for row in words) + 1.2)
    edges = np.concatenate([[0.0], np.cumsum(widths) / sum(widths)])
    size = min(8.0, 0.95 * 72 * wide / sum(widths))
    weight, rule = "bold", 0.8  # of the head
    for k, row in enumerate(words):
        for left, text in zip(edges, row, strict=False):
            plot.text(left, k + 0.5, text, fontsize=size, va="center", fontweight=weight)
        plot.axhline(k + 1.0, color="#1b1f24", linewidth=rule)
        weight, rule = "normal", 0.25


def _format_cell(cell: Any, digits: int) -> str:
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return "–"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, str):
        return cell
    return format_number(cell, digits)
