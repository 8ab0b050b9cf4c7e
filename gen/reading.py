"""What is wrong with a robot.toml, gathered while its tables are read key by key against the table in `gen.schema`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gen.entry import Unfit, named, nearest, read, shown
from gen.schema import SUBTABLES, TABLE, TITLES, Key, Need, keys, span

MOST = 100  # problems that are listed


def path(place: str, name: str) -> str:
    """The key ``name`` within ``place``, as in joint[2].drive.ratio."""
    return f"{place}.{named(name)}" if place else named(name)


class Reading:
    """The problems found so far in the file called ``label``, and the tolerance that its plain numbers have."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.tolerance: float = keys("")["tolerance"].default
        self.problems: list[str] = []

    def add(self, place: str, sentence: str) -> None:
        """Add a problem at ``place``; "" is the file as a whole."""
        if len(self.problems) < MOST:
            self.problems.append(f"{self.label}{', ' if place else ''}{place}: {sentence}.")
        elif len(self.problems) == MOST:
            self.problems.append(f"{self.label}: found more than {MOST} problems; correct these first.")

    def table(self, raw: Any, table: str, place: str) -> dict[str, Any]:
        """What fits of one table, by key, with plain defaults filled in; everything else is added as a problem.

        What depends on other keys is the caller's to check (`Need`).
        """
        if not isinstance(raw, Mapping):
            self.add(place, f"found {shown(raw)}, possible is a table; write {TITLES[table]} and its keys below")
            return {}
        known, values = keys(table), dict[str, Any]()
        for name, key in known.items():
            if name in raw or key.default is not None:
                self.value(key, raw.get(name, key.default), place, values)
            elif key.need is Need.YES:
                self.missing(key, place)
        inner = SUBTABLES.get(table, ())
        for name in raw:
            if name not in known and name not in inner:
                self.unknown(name, place, (*known, *inner))
        return values

    def value(self, key: Key, entry: Any, place: str, values: dict[str, Any]) -> None:
        """Put one entry into ``values``, or add why it does not fit."""
        try:
            values[key.name] = read(key, entry, self.tolerance)
        except Unfit as problem:
            self.add(path(place, key.name), str(problem))

    def missing(self, key: Key, place: str) -> None:
        """Add that ``key`` is not there."""
        fits = " ".join(part for part in (key.kind.value, span(key)) if part)
        self.add(path(place, key.name), f"found nothing, required is {fits}; add it ({key.meaning})")

    def unknown(self, name: str, place: str, possible: Iterable[str]) -> None:
        """Add that ``name`` is no key here."""
        homes = [TITLES[key.table] for key in TABLE if key.name == name]
        hint = f"move it to {homes[0]}" if homes else f"correct or remove it{self.hint(name, possible)}"
        self.add(path(place, name), f"found an unknown key, possible are {', '.join(possible)}; {hint}")

    def hint(self, word: str, possible: Iterable[str]) -> str:
        """The most similar of ``possible`` as the end of a sentence; empty if none is."""
        return nearest(word, possible) if len(self.problems) < MOST else ""
