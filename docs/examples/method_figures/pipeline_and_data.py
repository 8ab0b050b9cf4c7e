"""Figures of the pipeline and of its data: stages, replays, mistakes of logs, candidates, and what is held out."""

from __future__ import annotations

import numpy as np
from figure_style import BLUE, GREEN, GREY, ORANGE, RED, draw_flow, make_panels, mark_windows
from matplotlib.figure import Figure


def draw_pipeline() -> Figure:
    """The stages of a diagnosis and the data between them."""
    figure, (axes,) = make_panels(1, 3.6)
    boxes = [
        (0.10, 0.85, GREY, "robot.toml"),
        (0.10, 0.45, GREY, "logs,\nhold-out"),
        (0.30, 0.85, BLUE, "models\nnominal, full"),
        (0.30, 0.45, BLUE, "data quality,\ntraining data"),
        (0.30, 0.08, ORANGE, "hold-out\nno fit sees it"),
        (0.53, 0.85, BLUE, "null model"),
        (0.53, 0.45, BLUE, "direct\nevidence"),
        (0.72, 0.85, BLUE, "search"),
        (0.72, 0.45, BLUE, "scores"),
        (0.72, 0.08, ORANGE, "check on\nheld-out motion"),
        (0.92, 0.45, GREEN, "explanation"),
        (0.92, 0.08, GREEN, "diagnosis.json\nreport.html"),
    ]
    arrows = [(0, 2), (1, 3), (1, 4), (2, 5), (3, 5), (3, 6), (5, 7), (7, 8), (6, 9), (8, 9), (4, 9), (9, 10), (10, 11)]
    draw_flow(axes, boxes, arrows)
    return figure


def draw_prediction() -> Figure:
    """Windows of a replay that start anew, and a replay of the whole log."""
    time = np.linspace(0.0, 2.0, 401)
    measured = np.sin(2.5 * time) + 0.25 * np.sin(7.0 * time)
    drift = 0.05 * (np.exp(1.5 * time) - 1.0)
    figure, (axes,) = make_panels(1)
    axes.plot(time, measured, color=GREY, lw=2.5, label="measured")
    axes.plot(time, measured + drift, color=ORANGE, label="one window for the whole log")
    edges = np.arange(0.0, 2.0, 0.25)
    for k, edge in enumerate(edges):
        inside = (time >= edge) & (time < edge + 0.25)
        error = 3.5 * (time[inside] - edge) ** 2 * np.sign(np.cos(2.5 * edge) + 0.2)
        axes.plot(time[inside], measured[inside] + error, color=BLUE, label="windows of 0.25 s" if k == 0 else None)
        axes.plot(edge, measured[inside][0], "o", color=BLUE, ms=3)
    mark_windows(axes, edges)
    axes.set(xlabel="time, s", ylabel="joint angle, rad")
    axes.legend(loc="lower left")
    return figure


def draw_data_quality() -> Figure:
    """Three mistakes of a log, and the repair of each."""
    rng = np.random.default_rng(0)
    time = np.linspace(0.0, 1.0, 60)
    angle = np.sin(5.0 * time) + 0.01 * rng.normal(size=60)
    figure, (first, second, third) = make_panels(3, 2.4)
    bad = angle.copy()
    bad[[18, 41]] += [0.9, -1.1]
    first.plot(time, bad, "o", color=RED, ms=3, label="recorded")
    first.plot(np.delete(time, [18, 41]), np.delete(bad, [18, 41]), color=BLUE, label="used")
    first.set(title="outliers: rows left out", xlabel="time, s", ylabel="angle, rad")
    turns = 3.0 * time
    second.plot(time, (turns + 0.5) % 1.0 - 0.5, "o", color=RED, ms=3)
    second.plot(time, turns, color=BLUE)
    second.set(title="wrapped: unwrapped", xlabel="time, s", ylabel="angle, turns")
    frozen = angle.copy()
    frozen[25:40] = frozen[25]
    third.plot(time, frozen, "o", color=RED, ms=3)
    third.plot(np.r_[time[:26], np.nan, time[40:]], np.r_[angle[:26], np.nan, angle[40:]], color=BLUE)
    third.set(title="frozen: rows left out", xlabel="time, s", ylabel="angle, rad")
    first.legend(loc="lower left")
    return figure


def draw_candidate_models() -> Figure:
    """Prior of the size of an effect: spike while it is a nuisance effect, slab while it is free."""
    theta = np.linspace(-2.0, 2.0, 801)
    figure, (left, right) = make_panels(2)
    left.fill_between(theta, np.exp(-0.5 * theta**2), color=BLUE, alpha=0.25, label="slab: free, width 1")
    for width, color in ((0.05, ORANGE), (0.025, RED), (0.0125, GREEN)):
        inside = np.abs(theta) <= 3.0 * width
        density = np.exp(-0.5 * (theta[inside] / width) ** 2)
        left.plot(theta[inside], density, color=color, label=f"spike: {100 * width:g} %")
    left.axvspan(-0.3, 0.3, color=GREY, alpha=0.15, label="below 0.3: counts as none")
    left.set(xlabel="size θ, in usual sizes", ylabel="prior density (scaled)", ylim=(0.0, 1.9), yticks=[])
    left.legend(loc="upper left", fontsize=7)
    boxes = [
        (0.5, 0.95, GREY, "command"),
        (0.5, 0.72, BLUE, "input"),
        (0.5, 0.49, BLUE, "motor"),
        (0.5, 0.26, BLUE, "transmission"),
        (0.5, 0.03, BLUE, "link"),
        (0.9, 0.38, ORANGE, "sensor"),
        (0.1, 0.38, GREY, "each effect\nat amplitude 0"),
    ]
    draw_flow(right, boxes, [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5), (4, 5)])
    right.set(xlim=(0, 1), ylim=(0, 1))
    return figure


def draw_holdout_blocks() -> Figure:
    """Blocks that are held out of a log of 30 s, and seconds of a hold-out log."""
    figure, (axes,) = make_panels(1, 1.9)
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for k in range(6):
        begin = 5.0 * (k + (k * golden % 1.0) * 0.8)
        axes.barh(1.0, 5.0, left=5.0 * k, color="white", edgecolor=GREY, height=0.5)
        axes.barh(1.0, 1.0, left=begin, color=ORANGE, height=0.5)
    for second in range(30):
        axes.barh(0.0, 1.0, left=second, color=(GREEN, BLUE)[second % 2], edgecolor="white", height=0.5)
    axes.set(xlabel="time, s", yticks=[0.0, 1.0], yticklabels=["hold-out log", "one log alone"], xlim=(0, 30))
    axes.set_title("orange: held out · green: decides · blue: gap is reported", fontsize=9)
    return figure
