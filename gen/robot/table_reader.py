"""Collects the problems of a robot.toml while its tables are read key by key against the table in
`gen.robot.schema`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gen.robot.schema import SUBTABLES, TABLE, TITLES, Key, KeyNeed, describe_form, describe_range, keys_of
from gen.robot.value_reader import InvalidValueError, quote_key, read_entry, show_value, suggest_nearest

MOST_PROBLEMS = 100  # problems that are listed


def key_path(place: str, name: str) -> str:
    """Write the full name of a key, as in joint[2].drive.ratio.

    Args:
        place: The table's full name; empty at the top of the file.
        name: The key.

    Returns:
        The full name.

    """
    if not place:
        return quote_key(name)
    return f"{place}.{quote_key(name)}"


class RobotFileReader:
    """The problems found so far in the file called ``label``, and the tolerance that its plain numbers have."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.tolerance: float = keys_of("")["tolerance"].default
        self.problems: list[str] = []

    def add_problem(self, place: str, sentence: str) -> None:
        """Add a problem; beyond MOST one sentence says that there are more.

        Args:
            place: Full name of the key or table; empty for the file as a whole.
            sentence: The problem, without a full stop.

        """
        if len(self.problems) < MOST_PROBLEMS:
            where = ", ".join(part for part in (self.label, place) if part)
            self.problems.append(f"{where}: {sentence}.")
        elif len(self.problems) == MOST_PROBLEMS:
            self.problems.append(f"{self.label}: found more than {MOST_PROBLEMS} problems; correct these first.")

    def read_table(self, raw: Any, table: str, place: str) -> dict[str, Any]:
        """Read one table; values that do not fit are added as problems.

        Keys that depend on others are the caller's to check (`KeyNeed`).

        Args:
            raw: The table as parsed.
            table: Its name in `TABLE`.
            place: Its full name in the file.

        Returns:
            The values that fit, by key, with plain defaults filled in.

        """
        if not isinstance(raw, Mapping):
            self.add_problem(
                place, f"found {show_value(raw)}, possible is a table; write {TITLES[table]} and its keys below"
            )
            return {}
        known, values = keys_of(table), dict[str, Any]()
        for name, key in known.items():
            if name in raw or key.default is not None:
                self.read_value(key, raw.get(name, key.default), place, values)
            elif key.need is KeyNeed.YES:
                self.add_missing(key, place)
        inner = SUBTABLES.get(table, ())
        for name in raw:
            if name not in known and name not in inner:
                self.add_unknown(name, place, (*known, *inner))
        return values

    def read_value(self, key: Key, entry: Any, place: str, values: dict[str, Any]) -> None:
        """Read one value, or add the reason why it does not fit.

        Args:
            key: The key.
            entry: The value as parsed.
            place: Full name of the table.
            values: The table's values, to which this one is added.

        """
        try:
            values[key.name] = read_entry(key, entry, self.tolerance)
        except InvalidValueError as problem:
            self.add_problem(key_path(place, key.name), str(problem))

    def add_missing(self, key: Key, place: str) -> None:
        """Add that a key is missing.

        Args:
            key: The key.
            place: Full name of the table.

        """
        fits = " ".join(part for part in (describe_form(key), describe_range(key)) if part)
        self.add_problem(key_path(place, key.name), f"found nothing, required is {fits}; add it ({key.meaning})")

    def add_unknown(self, name: str, place: str, possible: Iterable[str]) -> None:
        """Add that a key does not belong here.

        Args:
            name: The key found.
            place: Full name of the table.
            possible: The keys possible.

        """
        homes = [TITLES[key.table] for key in TABLE if key.name == name]
        hint = f"correct or remove it{self.suggest(name, possible)}"
        if homes:
            hint = f"move it to {homes[0]}"
        self.add_problem(key_path(place, name), f"found an unknown key, possible are {', '.join(possible)}; {hint}")

    def suggest(self, word: str, possible: Iterable[str]) -> str:
        """Suggest the most similar of the possible words, unless the list of problems is full.

        Args:
            word: The word found.
            possible: The words possible.

        Returns:
            The end of a sentence; empty where none is similar.

        """
        if len(self.problems) < MOST_PROBLEMS:
            return suggest_nearest(word, possible)
        return ""
