"""Draw the figures of docs/method: one SVG for each page, from small made data or as a schematic.

    python docs/examples/method_figures.py [NAME ...]

writes docs/images/method/NAME.svg, all of them when no name is given. Nothing is simulated with a robot model. The only
measured numbers are those of docs/real.json (figure real_machines) and of calibration.json (figure scores).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs" / "images" / "method"
DIAGNOSIS = ROOT / "hdagen" / "diagnosis"
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


# -- pipeline and data ------------------------------------------------------------------------------------------------


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


# -- fits -------------------------------------------------------------------------------------------------------------


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
    edges = np.arange(0.0, 0.3, 0.05)
    for k, edge in enumerate(edges):
        inside = (time >= edge) & (time <= edge + 0.05)
        bend = 90.0 * (time[inside] - edge - 0.02) ** 2 * (-1.0) ** k
        left.plot(time[inside], angle[inside] + bend, color=BLUE, label="model, own initial state" if not k else None)
    mark_windows(left, edges)
    left.set(xlabel="time, s", ylabel="angle, rad", title="windows of 0.05 s")
    left.legend(fontsize=8)
    inside = np.linspace(0.0, 0.05, 200)
    lacking = 0.8 + 0.5 * np.sin(90.0 * inside)
    middle = (np.arange(4) + 0.5) * 0.0125
    right.plot(inside, lacking, color=GREY, label="torque that the model lacks")
    right.stairs(0.8 + 0.5 * np.sin(90.0 * middle), np.linspace(0.0, 0.05, 5), color=ORANGE, label="residual torque d")
    right.set(
        xlabel="time in the window, s", ylabel="torque, units of 2 %", title="2 flexible joints: 4 steps at each port"
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


# -- check and explanation --------------------------------------------------------------------------------------------


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
    walks = 0.4 * np.cumsum(rng.normal(size=(200, len(time))), axis=1) * 1e-2
    lasting = 0.5 * time
    rms = np.sqrt((walks**2).mean(0))
    figure, (left, right) = make_panels(2)
    for panel, end in ((left, 0.05), (right, 0.25)):
        inside = time <= end
        panel.plot(time[inside], rms[inside], color=ORANGE, label="fast torque (random), rms")
        panel.plot(time[inside], lasting[inside], color=BLUE, label="lasting torque (an effect)")
        panel.set(xlabel="time in the window, s", ylabel="error of speed", yticks=[], xlim=(0, end))
    left.set_title("0.05 s: the random torque hides the effect")
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


FIGURES: dict[str, Callable[[], Figure]] = {
    "pipeline": draw_pipeline,
    "prediction": draw_prediction,
    "data_quality": draw_data_quality,
    "candidate_models": draw_candidate_models,
    "holdout_blocks": draw_holdout_blocks,
    "direct_evidence": draw_direct_evidence,
    "null_model": draw_null_model,
    "likelihood": draw_likelihood,
    "search": draw_search,
    "scores": draw_scores,
    "holdout_check": draw_holdout_check,
    "long_horizon": draw_long_horizon,
    "explanation": draw_explanation,
    "blind_check": draw_blind_check,
    "real_machines": draw_real_machines,
    "limits": draw_limits,
}


def main() -> None:
    """Write the figures that the command names, or all."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name in sys.argv[1:] or FIGURES:
            figure = FIGURES[name]()
            figure.savefig(IMAGES / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)
            print(f"docs/images/method/{name}.svg")


if __name__ == "__main__":
    main()
