"""The page of `hdagen mpc explain`: predicted and real motion, limits that were active, how long the ticks took."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.mpc.compiled_settings import LIMIT_FAMILIES
from hdagen.mpc.predictive_controller import RUNGS
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell

TICKS_LINK = "ticks"
MOST_DRAWN_ROWS = 4000  # rows that are drawn
TIME_STRETCHES = 240  # of time, in which active rows are averaged
FAMILY_UNITS = {"joint_position": "rad", "motor_speed": "rad/s", "joint_torque": "N m", "tip_speed": "m/s", "wall": "m"}


def write_record_page(path: Path, source: str, record: Mapping[str, Array]) -> None:
    """Write the page of a run, whole or not at all.

    Args:
        path: Where the page goes.
        source: Name of the log.
        record: The controller's record of the log, by column.

    Raises:
        OSError: The page cannot be written.

    """
    sections = [_build_motion_section(record), _build_limits_section(record), _build_times_section(record)]
    page.write_page(
        path,
        f"Predictive control: {source}",
        format_record_verdict(record),
        sections,
        f"    hdagen mpc explain {shlex.quote(source)}",
    )


def format_record_verdict(record: Mapping[str, Array]) -> str:
    """Sum a run up in one sentence.

    Args:
        record: The controller's record of the log, by column.

    Returns:
        The sentence.

    """
    whole = 1e6 * (record["prepare_time"] + record["tick_time"])
    missed = _prediction_error(record)
    active = sum(record[f"active_{family}"] for family in LIMIT_FAMILIES)
    off = int((record["rung"] > 0).sum())
    return (
        f"Over {len(whole)} ticks the plan saw the tip {1e3 * record['ahead'][0]:.0f} ms ahead to within "
        f"{1e3 * np.nanmedian(missed):.2f} mm in the median; {np.mean(active):.1f} limits were active on "
        f"average, a tick "
        f"took {np.median(whole):.0f} µs in the median and {np.quantile(whole, 0.99):.0f} µs in all but one of "
        f"a hundred, "
        f"and {off} ticks were not on the plan."
    )


def _prediction_error(record: Mapping[str, Array]) -> Array:
    return _find_distance(record, "predicted")


def _list_axes(record: Mapping[str, Array]) -> str:
    return "xyz" if "tip_z" in record else "xy"


def _find_distance(record: Mapping[str, Array], other: str) -> Array:
    """Distance of the tip from another way, m."""
    apart = [record[f"tip_{axis}"] - record[f"{other}_{axis}"] for axis in _list_axes(record)]
    return np.asarray(np.linalg.norm(apart, axis=0))


def _thin_rows(record: Mapping[str, Array]) -> tuple[Array, slice]:
    rows = slice(None, None, max(1, len(record["time"]) // MOST_DRAWN_ROWS))
    return record["time"][rows], rows


def _build_motion_section(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin_rows(record)
    shown = (("target", "vermilion", "dashed", 1.4), ("path", "ink", "dotted", 1.4), ("tip", "blue", "solid", 2.0))
    axes = _list_axes(record)
    titles = {"y": "The tip in the plane" if axes == "xy" else "The tip from above", "z": "The tip from the side"}
    planes = [
        figure.draw_plane(
            titles[up],
            [
                figure.Curve(
                    name, record[f"{name}_x"][rows], record[f"{name}_{up}"][rows], time, color, dash, width=width
                )
                for name, color, dash, width in shown
            ],
            x_label="x (m)",
            y_label=f"{up} (m)",
            caption="The target is the path and, on it, what the force moves mass, damper and spring by; where the tip "
            "leaves it, a limit holds.",
            link=TICKS_LINK,
        )
        for up in axes[1:]
    ]
    panels = []
    for axis in axes:
        series = [
            figure.Series(name, record[f"{name}_{axis}"][rows], color, dash, width=width)
            for name, color, dash, width in (*shown, ("predicted", "green", "solid", 1.0))
        ]
        panels.append(figure.Panel(f"{axis} (m)", series))
    off = _find_distance(record, "target")
    apart = [
        figure.Series("prediction missed", _prediction_error(record)[rows], "green", "solid", width=1.2),
        figure.Series("off the target", off[rows], "vermilion", "dashed", width=1.4),
    ]
    panels.append(figure.Panel("distance (m)", apart, height=0.7))
    if "turn_off" in record:
        turned = figure.Series("off the target", record["turn_off"][rows], "vermilion", "dashed", width=1.4)
        panels.append(figure.Panel("turn (rad)", [turned], height=0.7))
    force = [
        figure.Series(axis, record[f"tip_force_{axis}"][rows], color)
        for axis, color in zip(axes, ("orange", "purple", "green"), strict=False)
    ]
    panels.append(figure.Panel("force (N)", force, height=0.7))
    drawn = figure.draw_panels("Predicted and real motion", time, panels, link=TICKS_LINK)
    text = (
        f"Predicted is where the plan that was made {1e3 * record['ahead'][0]:.0f} ms before saw the tip. It "
        f"misses where "
        "a force came or went meanwhile, which no plan can know, and else by what the model does not know."
    )
    return page.Section("Motion", text, [*planes, drawn])


def _draw_active_limits(record: Mapping[str, Array]) -> str:
    """How many rows of each family were active, over stretches of time."""
    count = min(TIME_STRETCHES, len(record["time"]))
    parts = np.array_split(np.arange(len(record["time"])), count)
    edges = np.append(record["time"][[part[0] for part in parts]], record["time"][-1] + 1e-9)
    means = []
    for family in LIMIT_FAMILIES:
        active = record[f"active_{family}"]
        means.append([float(active[part].mean()) for part in parts])
    return figure.draw_heat_map(
        "Active limits over time",
        edges,
        [family.replace("_", " ") for family in LIMIT_FAMILIES],
        means,
        x_label="time (s)",
        y_label="limit",
        value_label="active rows",
        caption="Rows of the plan at their bound or beyond it, of all its nodes, as the mean over a stretch of time.",
    )


def _build_limits_section(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin_rows(record)
    figures = [_draw_active_limits(record)]
    if record["rung"].any():
        rung = figure.Series("rung", record["rung"][rows], "ink", draw="step")
        figures.append(
            figure.draw_panels("Rung of the ladder", time, [figure.Panel("rung", [rung], height=0.6)], link=TICKS_LINK)
        )
    table: list[list[TableCell]] = [
        [
            family.replace("_", " "),
            float(record[f"active_{family}"].mean()),
            float(record[f"violated_{family}"].max()),
            FAMILY_UNITS.get(family, ""),
        ]
        for family in LIMIT_FAMILIES
    ]
    columns = ("limit", "active rows, mean", "largest violation", "unit")
    figures.append(
        figure.draw_table(
            "How often and how far",
            columns,
            table,
            digits=3,
            caption="How far the arm was beyond the bound that the controller keeps: the limit less its margin "
            "(and less limits.sudden); motor torque and its rate are hard.",
        )
    )
    ladder = "; ".join(f"{int((record['rung'] == k).sum())} {words}" for k, words in enumerate(RUNGS))
    return page.Section("Limits", f"Rows of the plan that stand at their bound or beyond it. Ticks: {ladder}.", figures)


def _build_times_section(record: Mapping[str, Array]) -> page.Section:
    time, rows = _thin_rows(record)
    panels = [
        figure.Panel(
            "time (s)",
            [
                figure.Series("after the measurement", record["tick_time"][rows], "blue", "solid", width=1.2),
                figure.Series("before it", record["prepare_time"][rows], "orange", "solid", width=1.2),
            ],
        ),
        figure.Panel(
            "iterations",
            [
                figure.Series("factorisations", record["factored"][rows], "green", "solid", width=1.2),
                figure.Series("interior point", record["interior"][rows], "vermilion", "solid", width=1.2),
            ],
            height=0.7,
        ),
    ]
    drawn = figure.draw_panels("Times and iterations over time", time, panels, link=TICKS_LINK)
    share = float((record["interior"] > 0).mean())
    text = (
        "Time of the thread's processor. The active set alone was enough in "
        f"{100 * (1 - share):.0f} % of the ticks; the interior point did the others."
    )
    return page.Section("Solve times", text, [_draw_tick_times(record), drawn])


def _draw_tick_times(record: Mapping[str, Array]) -> str:
    """The share of the ticks that take longer than a time."""
    parts = {"whole tick": "ink", "after the measurement": "blue", "before it": "orange"}
    before, after = record["prepare_time"], record["tick_time"]
    curves = []
    for (name, color), times in zip(parts.items(), (before + after, after, before), strict=True):
        taken = np.sort(times[times > 0])
        curves.append(figure.Curve(name, taken, 1.0 - np.arange(len(taken)) / max(1, len(taken)), color=color))
    return figure.draw_plane(
        "How many ticks take longer",
        curves,
        x_label="time (s)",
        y_label="share of ticks",
        equal=False,
        log_x=True,
        log_y=True,
    )
