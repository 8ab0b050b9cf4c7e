"""The page's sections on the log's data, and on what the verdict changes for a controller."""

from __future__ import annotations

from typing import Any

from hdagen.diagnosis.report.effect_words import CHANNEL_UNITS, format_change, format_values, name_channel
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.log.column_map import COLUMN_UNITS
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section

DATA_LINES = (
    ("Not logged", "missing"),
    ("Warning", "warnings"),
    ("Noticed", "noticed"),
    ("Skew", "skews"),
    ("Note", "notes"),
)


def show_data(content: dict[str, Any]) -> Section:
    """Show rate, lost rows, repairs and missing channels of the log; noise, step and lag of every channel.

    Args:
        content: of diagnosis.json.

    Returns:
        The section of the page.

    """
    data = content["data"]
    said = [f"{data['duration']:.3g} s at {data['rate']:.5g} Hz; {_say_rows(data)}."]
    said += [f"Repaired: {one['what']}" for one in data.get("repaired", ())]
    for heading, key in DATA_LINES:
        said += [f"{heading}: {line}" for line in data.get(key, ())]
    figures = []
    if channels := data.get("channels"):
        rows = [_describe_channel(name, one, content) for name, one in channels.items()]
        columns = ["channel", "lowest", "highest", "noise", "step", "behind its command"]
        figures.append(draw_table("Channels", columns, rows))
    return Section("The data", "\n\n".join(said), figures)


def _say_rows(data: dict[str, Any]) -> str:
    """Lost rows, gaps, and the jitter of the stamps."""
    jitter = float(data.get("jitter", 0.0))
    even = "evenly stamped"
    if jitter >= REPORT.least_told_jitter:
        (value,), unit = format_values([jitter], "s", 2)
        even = f"stamps jitter by {value} {unit}, {100 * jitter * data['rate']:.2g} % of a period"
    return f"{data.get('dropped', 0)} rows dropped, {data.get('gaps', 0)} gaps, {even}"


def _describe_channel(name: str, one: dict[str, float], content: dict[str, Any]) -> list[str | float | None]:
    """A row of the table."""
    known = content["gap"]["by_channel"].get(name, {})
    quantity = name.rpartition("_")[0]
    units = COLUMN_UNITS.get(quantity) or COLUMN_UNITS.get(name) or {"": 1.0}
    base = known.get("unit") or CHANNEL_UNITS.get(quantity) or next(iter(units))
    lag = content["data"].get("lags", {}).get(name)
    late = None if lag is None else _write_size(lag, "s")
    noise = one["noise"] if one["noise"] > REPORT.least_noise_share * (one["high"] - one["low"]) else 0.0
    low, high, spread, step = (_write_size(value, base) for value in (one["low"], one["high"], noise, one["step"]))
    channel = name_channel(name, content.get("joints", ()))
    return [channel, low, high, spread if noise else None, step if one["step"] else None, late]


def _write_size(value: float, unit: str) -> str:
    """A number with its unit."""
    (text,), written = format_values([value], unit)
    return f"{text} {written}".rstrip()


def show_control(content: dict[str, Any]) -> list[Section]:
    """Show the effect of the verdict on a controller.

    Args:
        content: of diagnosis.json.

    Returns:
        The section of the page; none where it was not simulated.

    """
    control = content["control"]
    if control is None:
        return []
    title = "What it changes for a controller"
    if "refused" in control:
        return [Section(title, f"Not simulated: {control['refused']}")]
    tracking, force = control["tracking"], control["contact_force"]
    distance = format_change(tracking["before"], tracking["after"], "m", " to ")
    push = format_change(force["before"], force["after"], "N", " to ")
    text = (
        f"In simulation the machine is the model with the verdict, and the controller {control['law']} with its "
        f"default gains knows the robot file, or the verdict. The tip's rms distance from its path goes from "
        f"{distance}, the largest force at a stiff wall, 10 mm deep, from {push}. A disturbance "
        "observer makes up for much of what a model misses at the motors, so little may change here."
    )
    return [Section(title, text)]
