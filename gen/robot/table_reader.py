"""Collects the problems of a robot.toml while its tables are read key by key against the table in
`gen.robot.schema`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gen.robot.schema import SUBTABLES, TABLE, TITLES, Key, Need, keys, span
from gen.robot.value_reader import Unfit, named, nearest, read, shown

MOST = 100  # problems that are listed


def path(place: str, name: str) -> str:
    """Write the full name of a key, as in joint[2].drive.ratio.

    Args:
        place: The table's full name; empty at the top of the file.
        name: The key.

    Returns:
        The full name.

    """
    if not place:
        return named(name)
    return f"{place}.{named(name)}"


class Reading:
    """The problems found so far in the file called ``label``, and the tolerance that its plain numbers have."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.tolerance: float = keys("")["tolerance"].default
        self.problems: list[str] = []

    def add(self, place: str, sentence: str) -> None:
        """Add a problem; beyond MOST one sentence says that there are more.

        Args:
            place: Full name of the key or table; empty for the file as a whole.
            sentence: The problem, without a full stop.

        """
        if len(self.problems) < MOST:
            where = ", ".join(part for part in (self.label, place) if part)
            self.problems.append(f"{where}: {sentence}.")
        elif len(self.problems) == MOST:
            self.problems.append(f"{self.label}: found more than {MOST} problems; correct these first.")

    def table(self, raw: Any, table: str, place: str) -> dict[str, Any]:
        """Read one table; values that do not fit are added as problems.

        Keys that depend on others are the caller's to check (`Need`).

        Args:
            raw: The table as parsed.
            table: Its name in `TABLE`.
            place: Its full name in the file.

        Returns:
            The values that fit, by key, with plain defaults filled in.

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
        """Read one value, or add the reason why it does not fit.

        Args:
            key: The key.
            entry: The value as parsed.
            place: Full name of the table.
            values: The table's values, to which this one is added.

        """
        try:
            values[key.name] = read(key, entry, self.tolerance)
        except Unfit as problem:
            self.add(path(place, key.name), str(problem))

    def missing(self, key: Key, place: str) -> None:
        """Add that a key is missing.

        Args:
            key: The key.
            place: Full name of the table.

        """
        fits = " ".join(part for part in (key.kind.value, span(key)) if part)
        self.add(path(place, key.name), f"found nothing, required is {fits}; add it ({key.meaning})")

    def unknown(self, name: str, place: str, possible: Iterable[str]) -> None:
        """Add that a key does not belong here.

        Args:
            name: The key found.
            place: Full name of the table.
            possible: The keys possible.

        """
        homes = [TITLES[key.table] for key in TABLE if key.name == name]
        hint = f"correct or remove it{self.hint(name, possible)}"
        if homes:
            hint = f"move it to {homes[0]}"
        self.add(path(place, name), f"found an unknown key, possible are {', '.join(possible)}; {hint}")

    def hint(self, word: str, possible: Iterable[str]) -> str:
        """Suggest the most similar of the possible words, unless the list of problems is full.

        Args:
            word: The word found.
            possible: The words possible.

        Returns:
            The end of a sentence; empty where none is similar.

        """
        if len(self.problems) < MOST:
            return nearest(word, possible)
        return ""
