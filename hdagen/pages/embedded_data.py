"""The numbers that travel with a figure, from which the script reads out, zooms and writes the CSV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.pages.axis import Axis
from hdagen.pages.decimation import Array, pack_floats
from hdagen.pages.plot import Plot


def embed_plots(plots: Sequence[Plot], *, shared: bool) -> dict[str, object]:
    """Collect the numbers of plots for the script.

    A column's values are ``start`` plus its packed floats: far from zero, as a clock's time of day is, the differences
    keep their digits, and near zero ``start`` is 0.

    Args:
        plots: The plots as they are drawn.
        shared: Whether all curves have the x of the first one.

    Returns:
        ``columns`` of packed numbers in base units, and for each plot the columns that its curves are made of.

    """
    columns: list[dict[str, object]] = []

    def column(label: str, values: Array) -> int:
        finite, start = values[~np.isnan(values)], 0.0
        if finite.size > 0 and abs(finite[0]) > 10 * np.ptp(finite):
            start = float(finite[0])
        columns.append({"label": label, "start": start, "data": pack_floats(values - start)})
        return len(columns) - 1

    described = []
    for plot in plots:
        curves = []
        for trace in plot.traces:
            of = " ".join(part for part in (plot.heading, trace.label) if part)
            if of:
                of += ": "
            x_label, y_label = plot.x.quantity.base_label, plot.y.quantity.base_label
            x = 0
            if not shared:
                x = column(of + x_label, trace.x)
            elif not columns:
                x = column(x_label, trace.x)
            curve: dict[str, object] = {"x": x, "y": column(of + y_label, trace.y)}
            if trace.spread:
                low, high = trace.spread
                curve["spread"] = [column(f"{of}low {y_label}", low), column(f"{of}high {y_label}", high)]
            if trace.time is not None:
                curve["time"] = column(f"{of}time (s)", trace.time)
            curves.append(curve | {"label": trace.label, "color": trace.color, "draw": trace.draw})
        axes = {"x": _describe_axis(plot.x), "y": _describe_axis(plot.y), "equal": plot.equal}
        described.append({"heading": plot.heading, "curves": curves} | axes)
    return {"shared": shared, "columns": columns, "plots": described}


def _describe_axis(axis: Axis) -> dict[str, object]:
    return {"name": axis.quantity.name, "unit": axis.quantity.unit, "factor": axis.quantity.factor, "log": axis.log}
