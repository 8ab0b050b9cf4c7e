"""The stack that docs/project/safety.md states is what gcc reserves, along the deepest chain of calls."""

from __future__ import annotations

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from compilers import compiler, said
from mpc_arms import built

SAFETY = (Path(__file__).parents[2] / "docs" / "project" / "safety.md").read_text(encoding="utf-8")
STATED = {
    name: int(limit)
    for names, limit in re.findall(r"^\| ((?:`hda_\w+`(?:, )?)+) \| (\d+) \|", SAFETY, re.MULTILINE)
    for name in re.findall(r"`(\w+)`", names)
}
POINTED_AT = re.compile(
    r"hda_(position|impedance|admittance)\w*_(tick|start)|\w*qdldl\w*"
)  # what is called through pointers: laws, OSQP's linear solver


class Calls:
    """Bytes that each function reserves, and whom it calls, by gcc's call graphs."""

    def __init__(self, graphs: Iterator[str]) -> None:
        self.own: dict[str, int] = {}
        self.calls: dict[str, set[str]] = {}
        for text in graphs:
            for name, words in re.findall(r'^node: { title: "([^"]+)" label: "([^"]+)"', text, re.MULTILINE):
                if reserved := re.search(r"(\d+) bytes \((\S+)\)", words):
                    assert reserved[2] in ("static", "dynamic,bounded"), f"{name}: {reserved[2]}"
                    self.own[name] = int(reserved[1])
            for name, to in re.findall(r'^edge: { sourcename: "([^"]+)" targetname: "([^"]+)"', text, re.MULTILINE):
                self.calls.setdefault(name, set()).add(to)
        self.calls["__indirect_call"] = {name for name in self.own if POINTED_AT.fullmatch(name.rpartition(":")[2])}

    def deepest(self, name: str, above: tuple[str, ...] = ()) -> int:
        """Bytes from entering a function on; AssertionError where it may come to call itself."""
        assert name not in above, f"{name} calls itself"
        below = (self.deepest(other, (*above, name)) for other in self.calls.get(name, ()))
        return self.own.get(name, 0) + max(below, default=0)


def measured(sources: list[Path], out: Path) -> Calls:
    command = [*compiler("gcc"), "-std=c99", "-ffp-contract=off", "-fcallgraph-info=su", "-c"]
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda source: said([*command, source, "-o", out / f"{source.stem}.o"]), sources))
    return Calls(path.read_text() for path in out.glob("*.ci"))


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> Calls:
    """Of the two-joint arm with its predictive controller."""
    folder = built()[0].folder
    sources = sorted(path for path in folder.glob("hda_*.c") if not path.name.startswith("hda_python"))
    return measured(sources, tmp_path_factory.mktemp("stack"))


def test_no_function_takes_more_than_is_stated_or_half_of_it(calls: Calls) -> None:
    deepest = {name: calls.deepest(name) for name in STATED}
    most = {limit: max(deepest[name] for name in STATED if STATED[name] == limit) for limit in STATED.values()}
    assert {name: deepest[name] for name, limit in STATED.items() if deepest[name] > limit} == {}
    assert {limit: found for limit, found in most.items() if found < limit / 2} == {}


def test_every_function_that_a_control_loop_calls_is_stated(calls: Calls) -> None:
    folder = built()[0].folder
    headers = ("hda_guard.h", "hda_control.h", "hda_mpc.h")
    declared = {
        name
        for header in headers
        for name in re.findall(r"^HDA_API .*?(hda_\w+)\(", (folder / header).read_text(), re.MULTILINE)
    }
    assert {"hda_guard_end", "hda_controller_tick", "hda_mpc_prepare"} <= declared <= set(calls.own)
    assert declared - set(STATED) == set()


def test_the_bank_of_filters_of_six_joints_takes_what_is_stated(tmp_path: Path) -> None:
    """Six flexible drives, by their sizes alone."""
    folder = built()[0].folder
    for name in ("hda_filters.c", *(path.name for path in folder.glob("*.h"))):
        (tmp_path / name).write_text((folder / name).read_text())
    six = {"N": 6, "NX": 24, "MECHANICAL": 24, "NU": 8, "NP": 111, "POSITION": 6, "SLIDE": "{12, 13, 14, 15, 16, 17}"}
    sizes = (folder / "hda_sizes.h").read_text()
    for name, value in six.items():
        sizes = re.sub(rf"^#define HDA_{name} .*$", f"#define HDA_{name} {value}", sizes, flags=re.MULTILINE)
    (tmp_path / "hda_sizes.h").write_text(sizes)
    (stated,) = re.findall(r"(\d+) kB for six joints", SAFETY)
    found = measured([tmp_path / "hda_filters.c"], tmp_path).deepest("hda_filter")
    assert int(stated) * 500 < found <= int(stated) * 1000
