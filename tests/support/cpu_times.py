"""Processor time of tests: `pytest --cpu-times FILE` adds a line a test to FILE, and `cpu_times.py FILE` sums them up.

Unlike durations, processor time hardly depends on what else a machine does. Time of child processes counts, compilers
among them.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest


def measure_times() -> tuple[float, float]:
    """Processor time of this process and of its children that have ended, s."""
    times = os.times()
    return times.user + times.system, times.children_user + times.children_system


class CpuTimes:
    """The plugin; each worker of xdist writes its own lines."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.fixtures: dict[str, float] = {}

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, bool | None, bool | None]:
        """Write the times of a test with the fixtures that were made for it."""
        self.fixtures = {}
        own, children = measure_times()
        done = yield
        own_after, children_after = measure_times()
        line = {"test": item.nodeid, "own": own_after - own, "children": children_after - children}
        with self.file.open("a") as file:
            file.write(json.dumps(line | {"fixtures": self.fixtures}) + "\n")
        return done

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Generator[None, object, object]:
        """Keep the time of a fixture."""
        begun = sum(measure_times())
        made = yield
        self.fixtures[fixturedef.argname] = sum(measure_times()) - begun
        return made


def main(file: Path, count: int = 40) -> None:
    """Print the sum, and the files, tests and fixtures that take most."""
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    own, children = sum(line["own"] for line in lines), sum(line["children"] for line in lines)
    print(f"{len(lines)} tests: {own + children:.0f} s, {children:.0f} s of it in child processes")
    files: Counter[str] = Counter()
    tests: Counter[str] = Counter()
    fixtures: Counter[str] = Counter()
    for line in lines:
        made = sum(line["fixtures"].values())
        files[line["test"].partition("::")[0]] += line["own"] + line["children"]
        tests[line["test"]] += line["own"] + line["children"] - made
        fixtures.update({f"{name} for {line['test']}": seconds for name, seconds in line["fixtures"].items()})
    for title, counter in (("files", files), ("tests without their fixtures", tests), ("fixtures", fixtures)):
        print(f"\n{title}")
        for name, seconds in counter.most_common(count):
            if seconds >= 0.05:
                print(f"{seconds:8.1f} s  {name}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
