"""The page of a fleet: what is missing on which machine, how far each gap shrinks, and what several have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from hdagen.fleet import Result, Status, summary
from hdagen.pages import figure, page
from hdagen.pages.table import Cell

LIKELY = 0.05  # probability from which an effect stands in the map
SHOWN = 24  # effects in the map
CELLS = 60  # machines in the map and in the bars; more are in the table alone


def write(path: Path, fleet: Path, results: Sequence[Result]) -> None:
    """The page into ``path``, whole or not at all; OSError where it cannot be written."""
    done = [one for one in results if one.diagnosis is not None]
    sections = [_machines(results)]
    if done:
        sections += [_gaps(done), _common(done)]
    sections.append(_logs(results))
    page.write(
        path,
        f"Diagnosis of a fleet: {fleet.name}",
        sentence(results),
        sections,
        f"    hdagen diagnose --fleet {fleet}",
    )


def sentence(results: Sequence[Result]) -> str:
    """What to take home."""
    found = summary(results)
    counts = found["counts"]
    what = f"{counts[Status.DIAGNOSED.value]} of {len(results)} machines are diagnosed"
    others = [f"{counts[s.value]} {s.value}" for s in Status if s is not Status.DIAGNOSED and counts[s.value]]
    some = sum(bool(one.diagnosis["verdict"]) for one in results if one.diagnosis)
    missing = f"; something is missing on {some}" if counts[Status.DIAGNOSED.value] else ""
    effect, names = next(iter(found["effects"].items()), ("", []))
    most = f", most often {spoken(effect)} ({len(names)})" if len(names) > 1 else ""
    return f"{', '.join([what, *others])}{missing}{most}."


def spoken(effect: str) -> str:
    """``coulomb_friction@2`` in words."""
    name, _, joint = effect.partition("@")
    at = f"joint {joint}" if joint != "0" else "the whole arm"
    return f"an effect that is not known, at {at}" if name == "unknown" else f"{name.replace('_', ' ')} at {at}"


def cells(one: Result) -> list[Cell]:
    """Name, what is missing, probability, sure, gap before and after: a row of the tables."""
    if one.diagnosis is None:
        return [one.machine.name, one.status.value, None, None, None, None]
    verdict, gap = one.diagnosis["verdict"], one.diagnosis["gap"]
    what = " and ".join(spoken(effect) for effect in verdict) or "none above the size that counts"
    return [one.machine.name, what, one.probability, bool(one.diagnosis["sure"]), gap["before"], gap["after"]]


HEADINGS = ("machine", "what is missing", "probability", "sure", "gap before", "gap after")


def _machines(results: Sequence[Result]) -> page.Section:
    text = (
        "Each machine is diagnosed by itself. The gap is the replay error on held-out motion in multiples of the "
        "noise. The report of a machine lies in the folder of its name, as report.html."
    )
    table = figure.table("Machines", HEADINGS, [cells(one) for one in results], digits=3)
    return page.Section("What is missing where", text, [table])


def _gaps(done: Sequence[Result]) -> page.Section:
    shown = [one.diagnosis["gap"] for one in done[:CELLS] if one.diagnosis]
    chart = figure.bars(
        "Gap on held-out motion",
        [one.machine.name for one in done[:CELLS]],
        [
            figure.Bars(when, [gap[when] if gap[when] is not None else math.nan for gap in shown], color=color)
            for when, color in (("before", "orange"), ("after", "blue"))
        ],
        value_label="replay error in multiples of noise",
        levels=[(1.0, "noise alone")],
        log=True,
    )
    return page.Section("How far", f"{_first(done)}Before and after what was found is added to the model.", [chart])


def _common(done: Sequence[Result]) -> page.Section:
    """Which effects several machines have: a map of the probability of each effect on each machine."""
    chances = [
        {f"{c['effect']}@{c['joint']}": c["probability"] for c in one.diagnosis["causes"]}
        for one in done[:CELLS]
        if one.diagnosis
    ]
    highest = {name: max(c.get(name, 0.0) for c in chances) for c in chances for name in c}
    names = sorted(
        (n for n, p in highest.items() if p >= LIKELY), key=lambda n: (-sum(c.get(n, 0.0) for c in chances), n)
    )
    if not names:
        return page.Section("What they have in common", "No effect is likely on any machine.")
    grid = [[c.get(name, math.nan) for c in chances] for name in names[:SHOWN]]
    chart = figure.heat(
        "Probability of each effect",
        [one.machine.name for one in done[:CELLS]],
        [spoken(name) for name in names[:SHOWN]],
        grid,
        x_label="machine",
        y_label="effect",
        value_label="probability of being present",
    )
    rows: list[list[Cell]] = [
        [spoken(effect), len(machines), ", ".join(machines)] for effect, machines in summary(done)["effects"].items()
    ]
    table = figure.table("Named on", ("effect", "machines", "which"), rows)
    text = (
        f"{_first(done)}An effect on most machines of a kind is one that their model lacks; one on a single machine is "
        "that machine's own."
    )
    return page.Section("What they have in common", text, [chart, table] if rows else [chart])


def _logs(results: Sequence[Result]) -> page.Section:
    """What was said of each log: why it is refused, what was repaired, what to look at."""
    parts = []
    for one, row in zip(results, summary(results)["machines"], strict=True):
        said = [*row["says"], *row.get("repaired", []), *row.get("warnings", [])]
        if said or one.diagnosis is None:
            parts.append(f"{one.machine.name}, {one.status.value}: {' '.join(said)}".removesuffix(": "))
    text = (
        "A log that is refused says what to record; what failed or was not run is tried again by the same command. "
        "What was repaired was repaired in memory alone."
    )
    return page.Section("The logs", "\n\n".join([text, *parts] if parts else ["All logs were used as they are."]))


def _first(done: Sequence[Result]) -> str:
    return f"The first {CELLS} machines. " if len(done) > CELLS else ""
