"""The page of a fleet: the missing effects of each machine, how far each gap shrinks, and common effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import numpy as np

from hdagen.fleet.fleet_diagnosis import MachineResult, Status, summarize_fleet
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell

LEAST_PROBABILITY = 0.05  # probability from which an effect stands in the map
MOST_DRAWN_EFFECTS = 24  # effects in the map
MOST_MACHINES = 60  # machines in the map and in the bars; more are in the table alone


def write_fleet_page(path: Path, fleet: Path, results: Sequence[MachineResult]) -> None:
    """Write the page, whole or not at all.

    Args:
        path: Where the page goes.
        fleet: Path of the fleet.toml.
        results: Results of all machines.

    Raises:
        OSError: The page cannot be written.

    """
    done = [one for one in results if one.diagnosis is not None]
    sections = [_build_machines_section(results)]
    if done:
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
    parts = [f"{counts[Status.DIAGNOSED.value]} of {len(results)} machines are diagnosed"]
    parts += [f"{counts[s.value]} {s.value}" for s in Status if s is not Status.DIAGNOSED and counts[s.value]]
    text = ", ".join(parts)
    if counts[Status.DIAGNOSED.value]:
        some = sum(bool(one.diagnosis["verdict"]) for one in results if one.diagnosis)
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
    if one.diagnosis is None:
        return [one.machine.name, one.status.value, None, None, None, None]
    verdict, gap = one.diagnosis["verdict"], one.diagnosis["gap"]
    what = " and ".join(describe_effect(effect) for effect in verdict) or "none above the size that counts"
    return [one.machine.name, what, one.verdict_probability, bool(one.diagnosis["sure"]), gap["before"], gap["after"]]


HEADINGS = ("machine", "what is missing", "probability", "sure", "gap before", "gap after")


def _build_machines_section(results: Sequence[MachineResult]) -> page.Section:
    text = (
        "Each machine is diagnosed by itself. The gap is the replay error on held-out motion in multiples of the "
        "noise. The name of a machine leads to its report."
    )
    pages = [f"{quote(one.machine.name, safe='')}/report.html" if one.diagnosis else None for one in results]
    cells = [build_machine_cells(one) for one in results]
    table = figure.draw_table("Machines", HEADINGS, cells, digits=3, links=pages)
    return page.Section("What is missing where", text, [table])


def _build_gaps_section(done: Sequence[MachineResult]) -> page.Section:
    groups = []
    for when, color in (("before", "orange"), ("after", "blue")):
        gaps = np.array([one.diagnosis["gap"][when] for one in done[:MOST_MACHINES] if one.diagnosis], float)
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
        for cause in one.diagnosis["causes"] if one.diagnosis else ():
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
        [describe_effect(effect), len(machines), ", ".join(machines)]
        for effect, machines in summarize_fleet(done)["effects"].items()
    ]
    figures = [chart]
    if rows:
        figures.append(figure.draw_table("Named on", ("effect", "machines", "which"), rows))
    text = (
        f"{_say_first_machines(done)}An effect on most machines of a kind is one that their model lacks; one on a"
        " single machine is that machine's own."
    )
    return page.Section("What they have in common", text, figures)


def _build_logs_section(results: Sequence[MachineResult]) -> page.Section:
    """The remarks on each log: reasons of refusal, repairs, warnings."""
    parts = []
    for one, row in zip(results, summarize_fleet(results)["machines"], strict=True):
        said = [*row["says"], *row.get("repaired", []), *row.get("warnings", [])]
        if said or one.diagnosis is None:
            parts.append(f"{one.machine.name}, {one.status.value}: {' '.join(said)}".removesuffix(": "))
    text = (
        "A log that is refused says what to record; what failed or was not run is tried again by the same command. "
        "What was repaired was repaired in memory alone."
    )
    if not parts:
        return page.Section("The logs", "All logs were used as they are.")
    return page.Section("The logs", "\n\n".join([text, *parts]))


def _say_first_machines(done: Sequence[MachineResult]) -> str:
    if len(done) <= MOST_MACHINES:
        return ""
    return f"The first {MOST_MACHINES} machines. "
