"""The page of `hdagen mpc explain`: predicted and real motion, limits that were active, how long the ticks took."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdagen.mpc.controller import RUNGS
from hdagen.mpc.layout import FAMILIES
from hdagen.pages import figure, page
from hdagen.pages.table import Cell
from hdagen.plant import Array

LINK = "ticks"
MOST = 4000  # rows that are drawn
COLORS = ("blue", "vermilion", "green", "purple", "orange", "grey", "ink")
UNITS = {"joint_position": "rad", "motor_speed": "rad/s", "joint_torque": "N m", "tip_speed": "m/s", "wall": "m"}


def write(path: Path, source: str, record: Mapping[str, Array]) -> None:
    """The page into ``path``, whole or not at all; OSError where it cannot be written."""
    sections = [_motion(record), _limits(record), _times(record)]
    page.write(path, f"Predictive control: {source}", verdict(record), sections, f"    hdagen mpc explain {source}")


def verdict(record: Mapping[str, Array]) -> str:
    """The sentence to take home."""
    whole = 1e6 * (record["prepare_time"] + record["tick_time"])
    missed = _missed(record)
    active = sum(record[f"active_{family}"] for family in FAMILIES)
    off = int((record["rung"] > 0).sum())
    return (
        f"Over {len(whole)} ticks the plan saw the tip {1e3 * record['ahead'][0]:.0f} ms ahead to within "
        f"{1e3 * np.nanmedian(missed):.2f} mm in the median; {np.mean(active):.1f} limits were active on "
        f"average, a tick "
        f"took {np.median(whole):.0f} µs in the median and {np.quantile(whole, 0.99):.0f} µs in all but one of "
        f"a hundred, "
        f"and {off} ticks were not on the plan."
    )


def _missed(record: Mapping[str, Array]) -> Array:
    return np.hypot(record["tip_x"] - record["predicted_x"], record["tip_y"] - record["predicted_y"])


def _thin(record: Mapping[str, Array]) -> tuple[Array, slice]:
    rows = slice(None, None, max(1, len(record["time"]) // MOST))
    return record["time"][rows], rows


def _motion(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin(record)
    panels = []
    for axis in "xy":
        series = [
            figure.Series("tip", record[f"tip_{axis}"][rows], "blue"),
            figure.Series("predicted", record[f"predicted_{axis}"][rows], "vermilion", "dashed"),
            figure.Series("path", record[f"path_{axis}"][rows], "ink", "dotted"),
        ]
        panels.append(figure.Panel(f"{axis} (m)", series))
    panels.append(
        figure.Panel("missed by (m)", [figure.Series("prediction", _missed(record)[rows], "green")], height=0.7)
    )
    force = [
        figure.Series(axis, record[f"tip_force_{axis}"][rows], color)
        for axis, color in zip("xy", ("green", "purple"), strict=True)
    ]
    panels.append(figure.Panel("force (N)", force, height=0.7))
    drawn = figure.panels("Predicted and real motion", time, panels, link=LINK)
    text = (
        f"Predicted is where the plan that was made {1e3 * record['ahead'][0]:.0f} ms before saw the tip. It "
        f"misses where "
        "a force came or went meanwhile, which no plan can know, and else by what the model does not know."
    )
    return page.Section("Motion", text, [drawn])


def _limits(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin(record)
    series = [
        figure.Series(family.replace("_", " "), record[f"active_{family}"][rows], color, width=1.2)
        for family, color in zip(FAMILIES, COLORS, strict=True)
        if record[f"active_{family}"].any()
    ]
    figures = []
    if series:
        panels = [
            figure.Panel("active rows", series),
            figure.Panel("rung", [figure.Series("rung", record["rung"][rows], "ink", draw="step")], height=0.5),
        ]
        figures.append(figure.panels("Active limits over time", time, panels, link=LINK))
    table: list[list[Cell]] = [
        [
            family.replace("_", " "),
            float(record[f"active_{family}"].mean()),
            float(record[f"violated_{family}"].max()),
            UNITS.get(family, ""),
        ]
        for family in FAMILIES
    ]
    columns = ("limit", "active rows, mean", "largest violation", "unit")
    figures.append(
        figure.table(
            "Limits",
            columns,
            table,
            digits=3,
            caption="Violations of the present state, margin included; motor torque and its rate are hard.",
        )
    )
    ladder = "; ".join(f"{int((record['rung'] == k).sum())} {words}" for k, words in enumerate(RUNGS))
    return page.Section("Limits", f"Rows of the plan that stand at their bound or beyond it. Ticks: {ladder}.", figures)


def _times(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin(record)
    panels = [
        figure.Panel(
            "time (s)",
            [
                figure.Series("preparation", record["prepare_time"][rows], "grey"),
                figure.Series("tick", record["tick_time"][rows], "blue"),
            ],
        ),
        figure.Panel(
            "iterations",
            [
                figure.Series("factorisations", record["factored"][rows], "orange"),
                figure.Series("interior point", record["interior"][rows], "vermilion"),
            ],
            height=0.7,
        ),
    ]
    drawn = figure.panels("Solve times", time, panels, link=LINK)
    share = float((record["interior"] > 0).mean())
    text = (
        "Time of the thread's processor. The active set alone was enough in "
        f"{100 * (1 - share):.0f} % of the ticks; the interior point did the others."
    )
    return page.Section("Solve times", text, [drawn])
