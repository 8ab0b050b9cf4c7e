"""Figures of what follows the fits: checks on held-out motion, long windows, explanation, and limits."""

from __future__ import annotations

import json

import numpy as np
from figure_style import BLUE, GREEN, GREY, ORANGE, RED, ROOT, draw_flow, make_panels
from matplotlib.figure import Figure


def draw_holdout_check() -> Figure:
    """Two statements about one joint: share that is left, against its thresholds."""
    figure, (axes,) = make_panels(1, 2.4)
    cases = (
        ("effect named, nothing remains", 0.12),
        ("effect named, and unknown@j", 0.48),
        ("effect withdrawn, unknown@j alone", 0.82),
    )
    for k, (label, share) in enumerate(cases):
        axes.barh(k, share, color=(GREEN, ORANGE, RED)[k], height=0.55)
        axes.text(share + 0.01, k, label, va="center", bbox={"fc": "white", "ec": "none", "pad": 1.5})
    for limit, label in ((1 / 3, "1/3"), (2 / 3, "2/3")):
        axes.axvline(limit, color=GREY, ls="--", lw=0.8)
        axes.text(limit, 2.55, label, ha="center", color=GREY)
    axes.set(xlim=(0, 1.25), ylim=(-0.5, 2.9), yticks=[], xlabel="left(j) = e_after / e_before, held-out motion")
    axes.set_xticks([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    return figure


def draw_long_horizon() -> Figure:
    """Velocity errors of a fast torque and of a lasting one, over a short and over a long window."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 0.25, 1e-3)
    walks = 0.52 * np.cumsum(rng.normal(size=(200, len(time))), axis=1) * 1e-2
    lasting = 0.5 * time
    rms = np.sqrt((walks**2).mean(0))
    figure, (left, right) = make_panels(2)
    for panel, end in ((left, 0.1), (right, 0.25)):
        inside = time <= end
        panel.plot(time[inside], rms[inside], color=ORANGE, label="fast torque (random), rms")
        panel.plot(time[inside], lasting[inside], color=BLUE, label="lasting torque (an effect)")
        panel.set(xlabel="time in the window, s", ylabel="error of speed", yticks=[], xlim=(0, end))
    left.set_title("0.1 s: the random torque hides the effect")
    right.set_title("0.25 s: the effect stands out")
    left.legend(fontsize=8)
    return figure


def draw_explanation() -> Figure:
    """Made residual torque over the angle of a motor turn and over speed, with the share that each explains."""
    rng = np.random.default_rng(4)
    speed, angle = rng.uniform(-2.0, 2.0, 500), rng.uniform(0.0, 2.0 * np.pi, 500)
    torque = 0.05 * np.sign(speed) + 0.008 * np.sin(2.0 * angle) + 0.015 * rng.normal(size=500)
    figure, axes = make_panels(2)
    panels = zip(axes, (speed, angle), ("joint speed, rad/s", "motor angle, rad"), strict=True)
    for panel, values, label in panels:
        edges = np.quantile(values, np.linspace(0.0, 1.0, 9))
        bins = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, 7)
        means = np.array([torque[bins == k].mean() for k in range(8)])
        share = np.var(means[bins]) / np.var(torque)
        panel.plot(values, torque, ".", color=GREY, ms=1.5)
        panel.stairs(means, edges, color=BLUE, lw=2, baseline=None)
        panel.set(xlabel=label, ylabel="residual torque, N m", title=f"8 bins explain {100 * share:.0f} %")
    return figure


def draw_blind_check() -> Figure:
    """Who knows the labels of a sealed check, and when."""
    figure, (axes,) = make_panels(1, 2.6)
    boxes = [
        (0.09, 0.75, GREY, "seed"),
        (0.30, 0.75, ORANGE, "parent process\nlabels, nonce"),
        (0.30, 0.20, ORANGE, "hash is printed"),
        (0.56, 0.75, BLUE, "MuJoCo reality\nrobot file, log"),
        (0.56, 0.20, BLUE, "hdagen diagnose\none process a case"),
        (0.83, 0.20, BLUE, "hold-out is made,\ngap is measured"),
        (0.83, 0.75, GREEN, "seal is opened,\nscores"),
    ]
    draw_flow(axes, boxes, [(0, 1), (1, 2), (1, 3), (3, 4), (4, 5), (5, 6)])
    return figure


def draw_real_machines() -> Figure:
    """Gaps of docs/real.json: before, after and the least of all fitted models."""
    cases = json.loads((ROOT / "docs" / "real.json").read_text(encoding="utf-8"))["cases"]
    figure, (axes,) = make_panels(1, 4.0)
    for k, case in enumerate(reversed(cases)):
        axes.plot([case["achievable"], case["before"]], [k, k], color=GREY, lw=0.8)
        for key, color, marker in (("before", RED, "o"), ("achievable", GREEN, "|"), ("after", BLUE, ".")):
            axes.semilogx(case[key], k, marker, color=color, ms=9, label=None if k else key)
    axes.set_yticks(range(len(cases)), [case["machine"] for case in reversed(cases)], fontsize=8)
    axes.set_xlabel("gap on held-out motion, multiples of the noise")
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.09), ncols=3)
    return figure


def draw_limits() -> Figure:
    """A delay and a first-order lag that look alike in a slow motion, and differ in a fast one."""
    figure, axes = make_panels(2)
    time = np.linspace(0.0, 0.5, 501)
    for panel, frequency in zip(axes, (1.5, 12.0), strict=True):
        rate = 2.0 * np.pi * frequency
        lagged = np.sin(rate * time - np.arctan(0.01 * rate)) / np.hypot(1.0, 0.01 * rate)
        panel.plot(time, np.sin(rate * time), color=GREY, label="command")
        panel.plot(time, np.sin(rate * (time - 0.01)), color=BLUE, label="delay of 10 ms")
        panel.plot(time, lagged, "--", color=RED, label="lag of 10 ms")
        panel.set(xlabel="time, s", ylabel="current, A", title=f"{frequency:g} Hz")
    axes[1].set_xlim(0.0, 0.2)
    axes[0].legend(fontsize=8)
    return figure
