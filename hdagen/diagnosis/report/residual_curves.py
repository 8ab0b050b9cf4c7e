"""Curves that pictures of an effect share: the log's points, their means, and the fitted effect."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.residuals.residual_trace import ResidualTrace
from hdagen.pages.curves import Curve

ROBOT_FILE_WORDS = "the robot file's"


def name_residual(seen: ResidualTrace) -> str:
    """Name the quantity of a residual.

    Args:
        seen: the residual.

    Returns:
        The words, without the unit.

    """
    return {"A": "current beyond command", "N m": "missing torque", "rad": "missing angle"}[seen.unit]


def draw_points_and_fit(x: Array, y: Array, fit: Array, split: bool = False) -> list[Curve]:
    """Draw points, their means, and the fit's means.

    Args:
        x: abscissae (K,).
        y: the log (K,).
        fit: the model with the effect (K,).
        split: whether means are apart for each sign of x.

    Returns:
        The curves; the means are lines.

    """
    few = np.unique(np.linspace(0, len(x) - 1, min(len(x), REPORT.most_drawn_points)).round().astype(int))
    return [
        Curve("log", x[few], y[few], draw="points", color="grey", width=1.6),
        Curve("mean of the log", *average_in_bins(x, y, split), color="blue", dash="dashed"),
        Curve("model with the effect", *average_in_bins(x, fit, split), color="vermilion", dash="solid", width=2.4),
    ]


def average_in_bins(x: Array, y: Array, split: bool = False) -> tuple[Array, Array]:
    """Average points in bins of equal width.

    Args:
        x: abscissae (K,).
        y: ordinates (K,).
        split: bins grow from x = 0 to both sides, with a gap there.

    Returns:
        Mean x and mean y of each bin, y being NaN where a bin has few points.

    """
    if not len(x):
        return x, y
    low, high = float(x.min()), float(x.max())
    if high <= low:
        return np.array([low]), np.array([float(y.mean())])
    edges = np.linspace(low, high, REPORT.curve_bins + 1)
    if split and low < 0 < high:
        grown = np.linspace(0, 1, REPORT.curve_bins // 2 + 1) ** REPORT.bin_growth
        edges = np.unique(np.r_[low * grown, high * grown])
    number = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    count = np.bincount(number, minlength=len(edges) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.bincount(number, x, len(edges) - 1) / count
        mean = np.bincount(number, y, len(edges) - 1) / count
    mean[count < REPORT.fewest_points] = np.nan
    middle = np.where(count < REPORT.fewest_points, (edges[1:] + edges[:-1]) / 2, middle)
    if split and low < 0 < high:
        at = int(np.searchsorted(edges, 0.0))
        middle, mean = np.insert(middle, at, 0.0), np.insert(mean, at, np.nan)
    return middle, mean


def write_title(entry: str) -> str:
    """Write the title of an effect's picture.

    Args:
        entry: effect@joint.

    Returns:
        The title.

    """
    effect, _, joint = entry.partition("@")
    title = effect.replace("_", " ").capitalize()
    if joint == "0":
        return title
    return f"{title} of joint {joint}"
