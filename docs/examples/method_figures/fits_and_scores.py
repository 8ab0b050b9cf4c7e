"""Figures of what is fitted and scored: direct evidence, null model, likelihood, search and scores."""

from __future__ import annotations

import json

import numpy as np
from figure_style import BLUE, GREEN, GREY, ORANGE, RED, ROOT, Array, make_panels, mark_windows
from matplotlib.figure import Figure

DIAGNOSIS = ROOT / "hdagen" / "diagnosis"


def draw_direct_evidence() -> Figure:
    """Encoder difference over torque, with the torsion alone and with the delay of an encoder beside it."""
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 6.0, 400)
    speed, torque = np.cos(3.0 * time) + 0.6 * np.cos(7.1 * time), 4.0 * np.sin(2.1 * time) + 2.0 * np.sin(5.3 * time)
    difference = 1e-4 * torque + 4e-4 * speed + 5e-5 * rng.normal(size=len(time))
    loads = np.column_stack([torque, torque**3, np.ones_like(torque)])
    figure, axes = make_panels(2)
    fits = ((loads, "without the delay"), (np.column_stack([loads, speed]), "with the delay"))
    errors = []
    for panel, (columns, title) in zip(axes, fits, strict=True):
        left = difference - columns @ np.linalg.lstsq(columns, difference, rcond=None)[0]
        errors.append(float(np.sqrt(np.mean(left**2))))
        panel.plot(speed, 1e3 * left, ".", color=BLUE, ms=2)
        panel.set(title=title, xlabel="joint speed, rad/s", ylabel="difference left, mrad", ylim=(-0.9, 0.9))
    axes[1].text(0.05, 0.9, f"share left: {errors[1] / errors[0]:.2f} < 0.5", transform=axes[1].transAxes)
    return figure


def draw_null_model() -> Figure:
    """Multiple shooting: windows with their own initial states, and steps of residual torque within one."""
    time = np.linspace(0.0, 0.3, 151)
    angle = 0.4 * np.sin(14.0 * time)
    figure, (left, right) = make_panels(2)
    left.plot(time, angle, color=GREY, lw=2.5, label="measured")
    edges = np.arange(0.0, 0.3, 0.1)
    for k, edge in enumerate(edges):
        inside = (time >= edge) & (time <= edge + 0.1)
        bend = 22.0 * (time[inside] - edge - 0.04) ** 2 * (-1.0) ** k
        left.plot(time[inside], angle[inside] + bend, color=BLUE, label="model, own initial state" if not k else None)
    mark_windows(left, edges)
    left.set(xlabel="time, s", ylabel="angle, rad", title="windows of 0.1 s")
    left.legend(fontsize=8)
    inside = np.linspace(0.0, 0.1, 200)
    lacking = 0.8 + 0.5 * np.sin(45.0 * inside)
    middle = (np.arange(8) + 0.5) * 0.0125
    right.plot(inside, lacking, color=GREY, label="torque that the model lacks")
    right.stairs(0.8 + 0.5 * np.sin(45.0 * middle), np.linspace(0.0, 0.1, 9), color=ORANGE, label="residual torque d")
    right.set(
        xlabel="time in the window, s", ylabel="torque, units of 2 %", title="2 flexible joints: 8 steps at each port"
    )
    right.set_ylim(0.0, 2.1)
    right.legend(fontsize=8)
    return figure


def find_evidence(residual: Array, column: Array, width: float, sizes: Array) -> Array:
    """Log evidence of one parameter under a prior width, for sizes of residual torque that is a random walk."""
    rows = len(residual)
    steps = np.kron(np.eye(rows // 10), np.ones((10, 1)))
    found = []
    for size in sizes:
        covariance = np.eye(rows) + size**2 * steps @ steps.T + width**2 * np.outer(column, column)
        sign, logdet = np.linalg.slogdet(covariance)
        found.append(-0.5 * (residual @ np.linalg.solve(covariance, residual) + sign * logdet))
    return np.array(found)


def draw_likelihood() -> Figure:
    """Evidence over the size of the residual torque, and the weight of a window over its misfit."""
    rng = np.random.default_rng(2)
    column = np.repeat(np.sin(np.linspace(0.0, 12.0, 20)), 10)
    residual = 3.0 * column + np.repeat(0.7 * rng.normal(size=20), 10) + rng.normal(size=200)
    sizes = np.geomspace(1e-2, 1e2, 41)
    figure, (left, right) = make_panels(2)
    for width, color, label in ((0.05, ORANGE, "null model"), (3.0, BLUE, "effect is free")):
        evidence = find_evidence(residual, column, width, sizes)
        left.semilogx(sizes, evidence, color=color, label=label)
        left.plot(sizes[np.argmax(evidence)], evidence.max(), "o", color=color)
    highest = max(line.get_ydata().max() for line in left.get_lines())
    left.set(xlabel="size s of the residual torque", ylabel="log evidence, nats", ylim=(highest - 60, highest + 6))
    left.legend(loc="lower left")
    freedom = 150.0
    misfit = np.geomspace(50.0, 5000.0, 300)
    scale = np.maximum(misfit / (freedom * (1.0 + 3.0 * np.sqrt(2.0 / freedom))), 1.0)
    right.loglog(misfit / freedom, scale, color=BLUE)
    right.axvline(1.0 + 3.0 * np.sqrt(2.0 / freedom), color=GREY, ls=":")
    right.set(xlabel="χ² of a window by its degrees of freedom", ylabel="scale κ² of the window")
    right.set_title("150 degrees of freedom")
    return figure


def draw_search() -> Figure:
    """Schematic of a race: evidence of hypotheses by round, with those that stop on the way."""
    figure, (axes,) = make_panels(1, 2.9)
    courses = (
        ("null model", GREY, [0, 6, 8, 9]),
        ("A: leads", BLUE, [35, 80, 96, 99]),
        ("B: looks like A", GREEN, [42, 66, 88, 90]),
        ("C: too little in round 1", ORANGE, [12, 19]),
        ("D: below 1/3 of the gain", RED, [9, 24, 27]),
        ("A + E", "black", [None, None, None, 101, 128, 131]),
    )
    for label, color, values in courses:
        rounds = [k for k, value in enumerate(values) if value is not None]
        axes.plot(rounds, [values[k] for k in rounds], "o-", color=color, label=label, ms=4)
    axes.axvspan(3.0, 5.0, color=GREY, alpha=0.12)
    axes.text(4.0, 8.0, "one more effect\nbeside the leader", ha="center")
    axes.set(ylabel="log evidence above the null model", xlabel="schematic", xticks=range(6))
    axes.set_xticklabels(["screening", "round 1", "round 2", "round 3", "set, 1", "set, 2"])
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    return figure


def draw_scores() -> Figure:
    """Odds of something unknown, and the calibration of the leading probability."""
    figure, (left, right) = make_panels(2)
    share = np.linspace(0.02, 1.0, 200)
    for size, color in ((0.6, GREEN), (1.0, BLUE), (2.0, ORANGE)):
        odds = (size**2 * share / 0.64) ** 2
        left.plot(share, odds / (1.0 + odds), color=color, label=f"size z = {size:g}")
    left.axhline(0.5, color=GREY, lw=0.6, ls=":")
    left.set(xlabel="share ρ that the best hypothesis leaves", ylabel="probability of unknown", ylim=(0, 1.25))
    left.legend(loc="upper center", ncols=3, fontsize=7)
    frozen = json.loads((DIAGNOSIS / find_calibration()).read_text(encoding="utf-8"))
    p = np.linspace(0.501, 0.9999, 400)
    tempered = 1.0 / (1.0 + (1.0 / p - 1.0) ** (1.0 / frozen["temperature"]))
    right.plot(p, np.maximum((1.0 - frozen["lapse"]) * tempered, 0.5), color=BLUE)
    right.plot([0.5, 1.0], [0.5, 1.0], color=GREY, ls=":")
    right.axhline(0.9, color=GREEN, lw=0.8)
    right.text(0.51, 0.905, "sure from here", color=GREEN, fontsize=8)
    right.set(xlabel="probability before calibration", ylabel="after")
    right.set_title(f"temperature {frozen['temperature']:g}, lapse {frozen['lapse']:.3f}, {frozen['cases']} cases")
    return figure


def find_calibration() -> str:
    """Name the frozen calibration, below the folder of the diagnosis."""
    return next(DIAGNOSIS.rglob("calibration.json")).relative_to(DIAGNOSIS).as_posix()
