"""Drawings of plots for every layout, with their description, a note on left-out samples, and their key numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdagen.pages import frame
from hdagen.pages.frame import LAYOUTS, WIDE
from hdagen.pages.plot import Plot, arrange_plots
from hdagen.pages.quantity import format_number


def draw_plots(title: str, plots: Sequence[Plot], columns: int, *, limit: float, shared: bool) -> str:
    """Draw plots for every layout, one below the other on the narrow one.

    Args:
        title: Heading of the figure, for the description.
        plots: The plots in their order.
        columns: Count of plots beside each other on the wide layout.
        limit: Largest width of the axes, px.
        shared: Whether the plots share x; their axes are lower then.

    Returns:
        The drawings as markup.

    """
    drawings, words = [], _describe_plots(title, plots)
    for layout in LAYOUTS:
        height, beside = 120.0, 1
        if layout is WIDE:
            height, beside = 150.0, columns
        if not shared:
            height *= 1.6
        body, width, tall = arrange_plots(plots, layout, columns=beside, height=height, limit=limit, shared_x=shared)
        drawings.append(frame.build_svg(layout, width, tall, words, body))
    return "".join(drawings)


def _describe_plots(title: str, plots: Sequence[Plot]) -> str:
    """One sentence for readers who cannot see the drawing."""
    labels = ", ".join(dict.fromkeys(trace.label for plot in plots for trace in plot.traces if trace.label))
    names = ", ".join(dict.fromkeys(plot.y.quantity.label for plot in plots))
    over = "x"
    if plots:
        over = plots[0].x.quantity.label
    if labels:
        return f"{title}: {names} over {over}; curves: {labels}."
    return f"{title}: {names} over {over}."


def note_kept_samples(held: int, size: int) -> str:
    """Say how many samples travel with a figure.

    Args:
        held: Count of the samples that are kept.
        size: Count of all samples.

    Returns:
        A sentence, or nothing where all are kept.

    """
    if held == size:
        return ""
    few, all_ = (f"{count:,}".replace(",", "\N{NARROW NO-BREAK SPACE}") for count in (held, size))
    return f"{few} of {all_} samples are kept, the smallest and the largest of every stretch among them."


def tabulate_curves(plots: Sequence[Plot]) -> str:
    """Tabulate the key numbers of every curve, over all its samples.

    Args:
        plots: Plots with all their samples.

    Returns:
        The table as markup.

    """
    rows = []
    for plot in plots:
        for trace in plot.traces:
            values = trace.y[~np.isnan(trace.y)] * plot.y.quantity.factor
            name = " · ".join(dict.fromkeys(part for part in (plot.heading, plot.y.quantity.name, trace.label) if part))
            found = [np.nan] * 4
            if values.size:
                found = [values.min(), values.max(), values.mean(), np.sqrt(np.mean(values**2))]
            rows.append([name, plot.y.quantity.unit, *(format_number(float(value)) for value in found)])
    return frame.build_rows_table(("curve", "unit", "smallest", "largest", "mean", "rms"), rows)
