"""What the figures of docs/method share: their size, colors and fonts, boxes with arrows, and marks of windows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

ROOT = Path(__file__).parents[3]
BLUE, ORANGE, GREEN, RED, GREY = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#7f7f7f"
BOX = {"boxstyle": "round,pad=0.5", "fc": "white", "lw": 1.4}
STYLE = {
    "svg.fonttype": "none",  # text stays text, in a font of the reader's system
    "svg.hashsalt": "hdagen",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "figure.constrained_layout.use": True,
    "legend.frameon": False,
}

Array = NDArray[np.float64]


def make_panels(columns: int, height: float = 2.6) -> tuple[Figure, list[Axes]]:
    """Open a figure of the width of a page with panels side by side."""
    figure, axes = plt.subplots(1, columns, figsize=(7.5, height), squeeze=False)
    return figure, list(axes[0])


def draw_flow(axes: Axes, boxes: Sequence[tuple[float, float, str, str]], arrows: Sequence[tuple[int, int]]) -> None:
    """Draw boxes (x, y, color, text) with arrows between some of them."""
    axes.set_axis_off()
    drawn = [
        axes.text(
            x,
            y,
            text,
            ha="center",
            va="center",
            bbox=BOX | {"ec": color},
        )
        for x, y, color, text in boxes
    ]
    for start, end in arrows:
        axes.annotate(
            "",
            xy=boxes[end][:2],
            xytext=boxes[start][:2],
            arrowprops={
                "arrowstyle": "->",
                "color": GREY,
                "patchA": drawn[start].get_bbox_patch(),
                "patchB": drawn[end].get_bbox_patch(),
                "shrinkA": 1,
                "shrinkB": 1,
            },
        )


def mark_windows(axes: Axes, edges: Array) -> None:
    """Mark where windows begin."""
    for edge in edges:
        axes.axvline(edge, color=GREY, lw=0.6, ls=":")
