"""The page of a fleet: the missing effects of each machine, how far each gap shrinks, and common effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from hdagen.campaign.task import Status
from hdagen.fleet.fleet_diagnosis import STATUS_WORDS, MachineResult, summarize_fleet
from hdagen.fleet.fleet_statistics import Drift, find_drifts, find_outliers
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell

LEAST_PROBABILITY = 0.05  # probability from which an effect stands in the map
MOST_DRAWN_EFFECTS = 24  # effects in the map
MOST_MACHINES = 60  # machines in the map and in the bars; more are in the table alone
MOST_LISTED_NAMES = 20  # of machines with an effect; the table of machines, searched for the effect, shows all
MOST_DRAWN_DRIFTS, MOST_LISTED_DRIFTS, MOST_OUTLIERS = 6, 200, 200


def write_fleet_page(path: Path, fleet: Path, results: Sequence[MachineResult]) -> None:
    """Write the page, whole or not at all.

    Args:
        path: Where the page goes.
        fleet: Path of the fleet.toml.
        results: Results of all machines.

    Raises:
        OSError: The page cannot be written.

    """
    done = [one for one in results if one.row is not None]
    sections = [_build_machines_section(results)]
    if done:
        sections += [_build_outliers_section(done), _build_drift_section(done)]
        sections += [_build_gaps_section(done), _build_common_section(done)]
    sections.append(_build_logs_section(results))
    page.write_page(
        path,
        f"Diagnosis of a fleet: {fleet.name}",
        format_fleet_verdict(results),
        sections,
        f"    hdagen diagnose --fleet {fleet}",
    )


def format_fleet_verdict(results: Sequence[MachineResult]) -> str:
    """Sum a fleet up in one sentence.

    Args:
        results: Results of all machines.

    Returns:
        The sentence.

    """
    found = summarize_fleet(results)
    counts = found["counts"]
    done = STATUS_WORDS[Status.DONE]
    parts = [f"{counts[done]} of {len(results)} machines are {done}"]
    parts += [f"{count} {word}" for word, count in counts.items() if word != done and count]
    text = ", ".join(parts)
    if counts[done]:
        some = sum(bool(one.row["verdict"]) for one in results if one.row)
        text += f"; something is missing on {some}"
    effect, names = next(iter(found["effects"].items()), ("", []))
    if len(names) > 1:
        text += f", most often {describe_effect(effect)} ({len(names)})"
    return f"{text}."


def describe_effect(effect: str) -> str:
    """``coulomb_friction@2`` in words."""
    name, _, joint = effect.partition("@")
    place = f"joint {joint}"
    if joint == "0":
        place = "the whole arm"
    if name == "unknown":
        return f"an effect that is not known, at {place}"
    return f"{name.replace('_', ' ')} at {place}"


def build_machine_cells(one: MachineResult) -> list[TableCell]:
    """Build the row of a machine, below HEADINGS.

    Args:
        one: Result of the machine.

    Returns:
        Name, missing effects, probability, whether the verdict is sure, and the gap before and after.

    """
    if one.row is None:
        return [one.machine.name, one.status_word, None, None, None, None]
    verdict, gap = one.row["verdict"], one.row["gap"]
    what = " and ".join(describe_effect(effect) for effect in verdict) or "none above the size that counts"
    return [one.machine.name, what, one.row["probability"], bool(one.row["sure"]), gap["before"], gap["after"]]


HEADINGS = ("machine", "what is missing", "probability", "sure", "gap before", "gap after")


def _build_machines_section(results: Sequence[MachineResult]) -> page.Section:
    text = (
        "Each machine is diagnosed by itself. The gap is the replay error on held-out motion in multiples of the "
        "noise. A machine's name leads to its report. Click a heading to sort; search for a name, an effect or a date."
    )
    headings = (HEADINGS[0], "date", *HEADINGS[1:])
    rows = []
    for one in results:
        name, *figures = build_machine_cells(one)
        rows.append([name, one.machine.date, *figures])
    links = [_find_report(one) for one in results]
    table = figure.draw_table(
        "Machines", headings, rows, digits=3, links=links, sentences=(HEADINGS[1],), searchable=True
    )
    return page.Section("What is missing where", text, [table])


def _find_report(one: MachineResult) -> str:
    """Where the report of a machine lies, from the page's own folder."""
    if one.row is None:
        return ""
    return f"{quote(one.machine.name)}/report.html"


def _build_outliers_section(done: Sequence[MachineResult]) -> page.Section:
    found = find_outliers(done)
    text = (
        "A machine stands out where a parameter lies farther from the median of its kind than its own standard "
        "deviation and the scatter of the kind explain. Robot files of the same name are of one kind."
    )
    if not found:
        return page.Section("Machines that stand out", f"{text} None does.")
    rows: list[list[TableCell]] = [[one.machine.name, said] for one, said in found[:MOST_OUTLIERS]]
    links = [_find_report(one) for one, _ in found[:MOST_OUTLIERS]]
    table = figure.draw_table(
        "Stands out", ("machine", "by what"), rows, links=links, sentences=("by what",), searchable=True
    )
    return page.Section("Machines that stand out", text + _say_cut(len(found), MOST_OUTLIERS), [table])


def _build_drift_section(done: Sequence[MachineResult]) -> page.Section:
    """Parameters over the dates of logs, robot by robot."""
    undated = sum(one.machine.date is None for one in done)
    drifts = find_drifts(done)
    text = (
        "Logs with the same robot file are of one machine. A line is fitted to each parameter over the dates of the "
        "logs; a change is sure where chance would not give it in a list as long as this one."
    )
    if undated:
        text += f" {undated} of {len(done)} logs have no date in fleet.toml and are left out here."
    if not drifts:
        return page.Section("Drift", f"{text} No robot has logs of two dates.")
    rows: list[list[TableCell]] = [
        [
            f"{_shorten_robot(one.robot)}: {one.parameter}",
            len(one.days),
            one.days[-1],
            one.values[0],
            one.values[-1],
            30 * one.slope,
            30 * one.slope_std,
            one.unit,
            one.is_sure,
        ]
        for one in drifts[:MOST_LISTED_DRIFTS]
    ]
    headings = ("robot: parameter", "logs", "days", "first", "last", "change in 30 days", "± std", "unit", "sure")
    table = figure.draw_table("Drift of parameters", headings, rows, digits=3, searchable=True)
    drawn = [_draw_drift(one) for one in drifts[:MOST_DRAWN_DRIFTS] if one.is_sure]
    figures = [table]
    if drawn:
        figures.append(figure.place_in_column(drawn))
    return page.Section("Drift", text + _say_cut(len(drifts), MOST_LISTED_DRIFTS), figures)


def _draw_drift(one: Drift) -> str:
    days, values = np.array(one.days), np.array(one.values)
    weights = np.array(one.stds) ** -2
    line = np.average(values, weights=weights) + one.slope * (days - np.average(days, weights=weights))
    curves = [
        figure.Curve("estimates", days, values, draw="points"),
        figure.Curve("line", days[[0, -1]], line[[0, -1]]),
    ]
    title = f"{_shorten_robot(one.robot)}: {one.parameter}"
    unit = one.unit or "1"
    return figure.draw_plane(
        title, curves, x_label="time since the first log (d)", y_label=f"value ({unit})", equal=False
    )


def _shorten_robot(robot: str) -> str:
    return Path(robot).stem


def _say_cut(count: int, most: int) -> str:
    if count <= most:
        return ""
    return f" The first {most} of {count} are listed."


def _build_gaps_section(done: Sequence[MachineResult]) -> page.Section:
    groups = []
    for when, color in (("before", "orange"), ("after", "blue")):
        gaps = np.array([one.row["gap"][when] for one in done[:MOST_MACHINES] if one.row], float)
        groups.append(figure.DotGroup(when, gaps, color=color))
    chart = figure.draw_dots(
        "Gap on held-out motion",
        [one.machine.name for one in done[:MOST_MACHINES]],
        groups,
        value_label="replay error in multiples of noise",
        levels=[(1.0, "noise alone")],
        log=True,
    )
    return page.Section(
        "How far", f"{_say_first_machines(done)}Before and after what was found is added to the model.", [chart]
    )


def _build_common_section(done: Sequence[MachineResult]) -> page.Section:
    """Which effects several machines have: a map of the probability of each effect on each machine."""
    chances: dict[str, dict[int, float]] = {}  # by effect and number of the machine
    for k, one in enumerate(done[:MOST_MACHINES]):
        for cause in one.row["causes"] if one.row else ():
            chances.setdefault(f"{cause['effect']}@{cause['joint']}", {})[k] = cause["probability"]
    likely = [name for name, by_machine in chances.items() if max(by_machine.values()) >= LEAST_PROBABILITY]
    names = sorted(likely, key=lambda name: (-sum(chances[name].values()), name))
    if not names:
        return page.Section("What they have in common", "No effect is likely on any machine.")
    grid = np.full((len(names[:MOST_DRAWN_EFFECTS]), len(done[:MOST_MACHINES])), np.nan)
    for row, name in enumerate(names[:MOST_DRAWN_EFFECTS]):
        for k, probability in chances[name].items():
            grid[row, k] = probability
    chart = figure.draw_heat_map(
        "Probability of each effect",
        [one.machine.name for one in done[:MOST_MACHINES]],
        [describe_effect(name) for name in names[:MOST_DRAWN_EFFECTS]],
        grid,
        x_label="machine",
        y_label="effect",
        value_label="probability of being present",
    )
    rows: list[list[TableCell]] = [
        [describe_effect(effect), len(machines), _list_names(machines)]
        for effect, machines in summarize_fleet(done)["effects"].items()
    ]
    figures = [chart]
    if rows:
        figures.append(figure.draw_table("Named on", ("effect", "machines", "which"), rows, sentences=("which",)))
    text = (
        f"{_say_first_machines(done)}An effect on most machines of a kind is one that their model lacks; one on a"
        " single machine is that machine's own."
    )
    return page.Section("What they have in common", text, figures)


def _list_names(names: Sequence[str]) -> str:
    """Names of machines, the first of many."""
    text = ", ".join(names[:MOST_LISTED_NAMES])
    if len(names) > MOST_LISTED_NAMES:
        text += f" and {len(names) - MOST_LISTED_NAMES} more"
    return text


def _build_logs_section(results: Sequence[MachineResult]) -> page.Section:
    """The remarks on each log: reasons of refusal, repairs, warnings."""
    rows: list[list[TableCell]] = []
    links = []
    for one, row in zip(results, summarize_fleet(results)["machines"], strict=True):
        said = [*row["says"], *row.get("repaired", []), *row.get("warnings", [])]
        if said or one.row is None:
            rows.append([one.machine.name, one.status_word, " ".join(said)])
            links.append(_find_report(one))
    text = (
        "A log that is refused says what to record; what failed or was not run is tried again by the same command. "
        "What was repaired was repaired in memory alone."
    )
    if not rows:
        return page.Section("The logs", "All logs were used as they are.")
    columns = ("machine", "it is", "remarks")
    table = figure.draw_table("Remarks on logs", columns, rows, links=links, sentences=("remarks",), searchable=True)
    return page.Section("The logs", text, [table])


def _say_first_machines(done: Sequence[MachineResult]) -> str:
    if len(done) <= MOST_MACHINES:
        return ""
    return f"The first {MOST_MACHINES} machines. "
