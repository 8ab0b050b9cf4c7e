"""A fleet: what its file may say, what is run again and what is kept, interrupts, the table, fleet.json and the page.

Machines are diagnosed by a program that stands in for `hdagen diagnose`: it does what the log's first word says, and
notes each call. A campaign runs the command itself on made logs.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from hostile_names import NAME, check_escaped

from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError
from hdagen.fleet import fleet_diagnosis, fleet_file, fleet_page
from hdagen.fleet.fleet_diagnosis import MachineResult, Status
from hdagen.fleet.fleet_file import FleetMachine

STAND_IN = """
import argparse, json, os, sys, time
from pathlib import Path
p = argparse.ArgumentParser()
for name in ("--out", "--hold-out", "--columns"):
    p.add_argument(name, type=Path)
p.add_argument("robot")
p.add_argument("log", type=Path)
o = p.parse_args()
with open(os.environ["CALLS"], "a") as file:
    file.write(f"{o.log.stem} {os.getpid()}\\n")
print("  0.1 s  screening", file=sys.stderr)
word, *rest = o.log.read_text().split()
if word == "sleep":
    time.sleep(60)
if word == "refuse":
    print(f"{o.log}: motor_position_1 stays at 0; record it.", file=sys.stderr)
    sys.exit(3)
if word == "fail":
    print("the build failed.", file=sys.stderr)
    sys.exit(2)
if word == "half":
    (o.out / "diagnosis.json").write_text('{"schema": 2, "verd')
    sys.exit(0)
chance = 0.9 if rest else 0.6
found = {
    "schema": 2, "verdict": rest, "sure": bool(rest),
    "gap": {"before": 8.0 if rest else 1.1, "after": 1.5 if rest else 1.1, "floor": 1.0, "shrink": 0.93},
    "causes": [{"effect": "stribeck_friction", "joint": 2, "probability": chance if rest else 0.01},
               {"effect": "payload", "joint": 2, "probability": 0.02}],
    "hypotheses": [{"effects": rest, "probability": chance}],
    "data": {"repaired": [{"what": "read as mA"}], "warnings": []},
}
(o.out / "diagnosis.json").write_text(json.dumps(found))
(o.out / "report.html").write_text("a report")
"""


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """The program that diagnoses; its calls are lines of ``calls`` beside it."""
    monkeypatch.setenv("CALLS", str(tmp_path / "calls"))
    (tmp_path / "stand_in.py").write_text(STAND_IN)
    return sys.executable, str(tmp_path / "stand_in.py")


@pytest.fixture
def calls(tmp_path: Path) -> Callable[[], list[str]]:
    """calls() -> the logs that were diagnosed since the last time, sorted."""

    def taken() -> list[str]:
        path = tmp_path / "calls"
        lines = path.read_text().splitlines() if path.exists() else []
        path.unlink(missing_ok=True)
        return sorted(line.split()[0] for line in lines)

    return taken


@pytest.fixture
def asked(tmp_path: Path) -> Callable[..., Path]:
    """asked(name="what the log says", …) -> a fleet.toml with a machine for each."""

    def written(**logs: str) -> Path:
        (tmp_path / "arm.toml").write_text("an arm")
        text = ""
        for name, says in logs.items():
            (tmp_path / f"{name}.csv").write_text(says)
            text += f'[[machine]]\nrobot = "arm.toml"\nlog = "{name}.csv"\n'
        (tmp_path / "fleet.toml").write_text(text)
        return tmp_path / "fleet.toml"

    return written


def ended(results: Sequence[MachineResult]) -> dict[str, str]:
    return {one.machine.name: one.status.value for one in results}


def silent(words: str) -> None:
    """Progress that nobody reads."""


FOUR = {
    "a": "find stribeck_friction@2",
    "b": "refuse",
    "c": "fail",
    "d": "find",
    "e": "find stribeck_friction@2",
    "f": "half",
}


def test_each_machine_ends_as_its_program_does(
    asked: Callable[..., Path], stand_in: tuple[str, ...], tmp_path: Path
) -> None:
    said: list[str] = []
    results, interrupted = fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(asked(**FOUR)), tmp_path / "out", 2, said.append, stand_in
    )
    assert not interrupted
    assert ended(results) == {
        "a": "diagnosed", "b": "refused", "c": "failed", "d": "diagnosed", "e": "diagnosed", "f": "failed"
    }  # fmt: skip
    by_name = {one.machine.name: one for one in results}
    assert by_name["b"].messages == (f"{tmp_path / 'b.csv'}: motor_position_1 stays at 0; record it.",)
    assert by_name["c"].messages == ("the build failed.",)
    assert "left no diagnosis.json that can be read" in by_name["f"].messages[0]
    assert by_name["a"].verdict_probability == 0.9 and by_name["b"].verdict_probability is None
    assert "6 of 6" in said[-1] and "left" in said[0]
    assert (tmp_path / "out" / "a" / "report.html").read_text() == "a report"
    assert "screening" in (tmp_path / "out" / "a" / "said.txt").read_text()


def test_what_is_finished_is_kept_until_its_files_change(
    asked: Callable[..., Path], stand_in: tuple[str, ...], calls: Callable[[], list[str]], tmp_path: Path
) -> None:
    def again() -> list[str]:
        calls()
        machines = fleet_file.read_fleet(tmp_path / "fleet.toml")
        results, _ = fleet_diagnosis.diagnose_fleet(machines, tmp_path / "out", 2, silent, stand_in)
        found = calls()
        assert [one.machine.name for one in results if not one.is_reused] == found
        return found

    asked(**FOUR)
    assert again() == ["a", "b", "c", "d", "e", "f"]
    assert again() == ["c", "f"]  # what failed is tried again, what was refused is refused for good
    (tmp_path / "a.csv").write_text("find payload@2")
    assert again() == ["a", "c", "f"]
    (tmp_path / "out" / "d" / "diagnosis.json").unlink()
    (tmp_path / "out" / "e" / "machine.json").write_text("{")
    assert again() == ["c", "d", "e", "f"]
    path = tmp_path / "out" / "d" / "diagnosis.json"
    told = json.loads(path.read_text())
    path.write_text(json.dumps(told | {"gap": told["gap"] | {"shrink": -math.inf}}))
    assert again() == ["c", "d", "f"]  # no number of a diagnosis is infinite
    (tmp_path / "arm.toml").write_text("another arm")
    assert again() == ["a", "b", "c", "d", "e", "f"]
    text = (tmp_path / "fleet.toml").read_text().replace('log = "a.csv"\n', 'log = "a.csv"\nhold_out = "d.csv"\n')
    (tmp_path / "fleet.toml").write_text(text)
    assert again() == ["a", "c", "f"]


def test_a_log_that_is_refused_now_leaves_no_older_diagnosis(
    asked: Callable[..., Path], stand_in: tuple[str, ...], tmp_path: Path
) -> None:
    fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(asked(a="find payload@2")), tmp_path / "out", 1, silent, stand_in
    )
    assert (tmp_path / "out" / "a" / "diagnosis.json").exists()
    results, _ = fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(asked(a="refuse")), tmp_path / "out", 1, silent, stand_in
    )
    assert ended(results) == {"a": "refused"}
    assert sorted(path.name for path in (tmp_path / "out" / "a").iterdir()) == ["machine.json", "said.txt"]


def test_the_hash_is_of_what_the_files_hold_and_not_of_where_they_lie(tmp_path: Path) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        for name, text in (("arm.toml", "arm"), ("log.csv", "log"), ("other.csv", "other"), ("columns.toml", "")):
            (tmp_path / folder / name).write_text(text)

    def machine(folder: str, **files: str) -> FleetMachine:
        place = tmp_path / folder
        other = {key: place / name for key, name in files.items() if key != "robot"}
        robot = files.get("robot", str(place / "arm.toml"))
        return FleetMachine("x", robot, other.get("log", place / "log.csv"), other.get("held"), other.get("columns"))

    first = machine("here").hash_inputs()
    assert machine("there").hash_inputs() == first
    differing = [
        machine("here", log="other.csv"),
        machine("here", held="other.csv"),
        machine("here", columns="columns.toml"),
        machine("here", robot="paper"),
    ]
    assert len({first, *(one.hash_inputs() for one in differing)}) == 5


def test_an_interrupt_keeps_what_is_finished_and_stops_the_rest(
    asked: Callable[..., Path], stand_in: tuple[str, ...], calls: Callable[[], list[str]], tmp_path: Path
) -> None:
    """By a real signal to the command; its children, in sessions of their own, end with it."""
    path = asked(a="find payload@2", b="sleep", c="find")
    program = (
        "import sys; from functools import partial; from hdagen.__main__ import main\n"
        "from hdagen.fleet import fleet_diagnosis as fleet\n"
        f"fleet.diagnose_fleet = partial(fleet.diagnose_fleet, command={stand_in!r})\n"
        f"sys.exit(main(['diagnose', '--fleet', {str(path)!r}, '--jobs', '1', '--out', {str(tmp_path / 'out')!r}]))"
    )
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 30
    while not ((tmp_path / "calls").exists() and "b " in (tmp_path / "calls").read_text()):
        assert time.monotonic() < deadline and child.poll() is None
        time.sleep(0.02)
    sleeper = int((tmp_path / "calls").read_text().split()[-1])
    child.send_signal(signal.SIGINT)
    printed, complained = child.communicate(timeout=30)
    assert child.returncode == 130, complained
    assert "what was finished is whole" in complained and "not run" in printed
    with pytest.raises(ProcessLookupError):
        os.kill(sleeper, 0)
    found = json.loads((tmp_path / "out" / "fleet.json").read_text())
    assert [one["status"] for one in found["machines"]] == ["diagnosed", "not run", "not run"]
    assert not (tmp_path / "out" / "b" / "machine.json").exists()
    calls()
    (tmp_path / "b.csv").write_text("find")
    results, interrupted = fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(path), tmp_path / "out", 1, silent, stand_in
    )
    assert not interrupted and calls() == ["b", "c"] and set(ended(results).values()) == {"diagnosed"}


def test_one_that_takes_too_long_is_stopped(
    asked: Callable[..., Path], stand_in: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet_diagnosis, "_LONGEST_MACHINE_DIAGNOSIS", 0.3)
    results, _ = fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(asked(a="sleep")), tmp_path / "out", 1, silent, stand_in
    )
    assert ended(results) == {"a": "failed"} and results[0].messages == ("it was stopped after 0.3 s.",)


def test_a_folder_that_cannot_be_made_fails_its_machine_alone(
    asked: Callable[..., Path], stand_in: tuple[str, ...], tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "a").write_text("a file")
    results, _ = fleet_diagnosis.diagnose_fleet(
        fleet_file.read_fleet(asked(a="find", b="find")), tmp_path / "out", 1, silent, stand_in
    )
    assert ended(results) == {"a": "failed", "b": "diagnosed"} and str(tmp_path / "out" / "a") in results[0].messages[0]


# -- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def command(stand_in: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., int]:
    """command(*arguments) -> exit code of hdagen diagnose --fleet, machines by the stand-in."""
    monkeypatch.setattr(fleet_diagnosis, "diagnose_fleet", partial(fleet_diagnosis.diagnose_fleet, command=stand_in))
    return lambda *arguments: main(["diagnose", "--fleet", *map(str, arguments), "--out", str(tmp_path / "out")])


def test_the_table_the_json_and_the_page_say_the_same(
    asked: Callable[..., Path],
    command: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    assert command(asked(**FOUR)) == 2  # something failed
    printed = capsys.readouterr().out
    page = (tmp_path / "out" / "fleet.html").read_text()
    said = "3 of 6 machines are diagnosed, 1 refused, 2 failed; something is missing on 2, most often stribeck friction"
    assert said in printed and said in page
    for words in (
        "none above the size that counts",
        "b, refused: ",
        "motor_position_1 stays at 0; record it.",
        "c, failed: the build failed.",
        "d, diagnosed: read as mA",
    ):
        assert words in page
    assert "refused: " in printed and "0.9" in printed
    content = json.loads((tmp_path / "out" / "fleet.json").read_text())
    assert content["counts"] == {"diagnosed": 3, "refused": 1, "failed": 2, "not run": 0}
    assert content["effects"] == {"stribeck_friction@2": ["a", "e"]}
    (first, *_) = content["machines"]
    assert first["verdict"] == ["stribeck_friction@2"] and first["gap"]["before"] == 8.0
    assert first["repaired"] == ["read as mA"] and first["folder"] == "a"
    before = (tmp_path / "out" / "fleet.json").read_bytes()
    assert command(tmp_path / "fleet.toml") == 2
    assert (tmp_path / "out" / "fleet.json").read_bytes() == before
    assert "kept" in capsys.readouterr().out


def test_the_exit_code_says_the_worst(asked: Callable[..., Path], command: Callable[..., int]) -> None:
    assert command(asked(a="find", b="find")) == 0
    assert command(asked(a="find", b="refuse")) == 3
    assert command(asked(b="refuse")) == 3  # nothing to draw a figure of


def test_names_of_machines_are_text_and_nothing_else(asked: Callable[..., Path], tmp_path: Path) -> None:
    path = asked(a="find")
    path.write_text(path.read_text() + 'name = "Prüfstand 3 - links"\n')
    (machine,) = fleet_file.read_fleet(path)
    found = {
        "verdict": ["unknown@0"],
        "sure": False,
        "gap": {"before": 3.0, "after": 2.0},
        "causes": [],
        "hypotheses": [],
    }
    machine = replace(machine, name=f"{machine.name} {NAME}", robot=NAME, log=Path(NAME.replace("/", "")))
    odd = MachineResult(machine, Status.REFUSED, messages=(f"{NAME} [bold]",))
    fleet_page.write_fleet_page(
        tmp_path / "page.html", Path(NAME), [odd, MachineResult(machine, Status.DIAGNOSED, diagnosis=found)]
    )
    page = (tmp_path / "page.html").read_text()
    check_escaped(page, 4)
    assert "Prüfstand 3 - links" in page
    assert "an effect that is not known, at the whole arm" in page


# -- the file ---------------------------------------------------------------------------------------------------------


def test_all_that_is_wrong_in_a_fleet_toml_is_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("")
    (tmp_path / "fleet.toml").write_text(
        'jobs = 2\n[[machine]]\nrobot = "paper"\nlog = "log.csv"\nholdout = "b.csv"\n[[machine]]\nrobot = 3\n'
        'log = "none.csv"\n[[machine]]\nlog = "log.csv"\nname = "../x"\n[[machine]]\nrobot = "no/arm.toml"\n'
        'log = "log.csv"\n'
        '[[machine]]\nrobot = "paper"\nlog = "log.csv"\n[[machine]]\nrobot = "paper"\nlog = "log.csv"\nname = "LOG"\n'
    )
    with pytest.raises(PlantError) as raised:
        fleet_file.read_fleet(tmp_path / "fleet.toml")
    said = str(raised.value).removeprefix(f"{tmp_path / 'fleet.toml'}: ").split(f"\n{tmp_path / 'fleet.toml'}: ")
    assert said == [
        "unknown key 'jobs'; possible is [[machine]], one a log.",
        "machine 1: unknown key 'holdout'; possible are robot, log, hold_out, columns, name.",
        "machine 2: robot = 3; it must be text in quotes.",
        f"machine 2: log = 'none.csv': {tmp_path / 'none.csv'}: cannot be read (there is no such file); give the path "
        "of a log.",
        "machine 3: robot is missing; state it.",
        "machine 3: name = '../x'; possible are up to 60 letters, digits, spaces, _ and -.",
        "machine 4: robot = 'no/arm.toml': there is no such file, and it is no preset's name.",
        "2 machines are named 'log'; tell them apart with name = \"…\".",
    ]


@pytest.mark.parametrize(
    "text", ["", "machine = 3", "[machine]\nlog = 1", "machine = []", "a = [", "\x00", "[[machine]]"]
)
def test_what_is_no_fleet_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "fleet.toml").write_text(text)
    with pytest.raises(PlantError, match=r"fleet\.toml: "):
        fleet_file.read_fleet(tmp_path / "fleet.toml")
    with pytest.raises(PlantError, match="cannot be read"):
        fleet_file.read_fleet(tmp_path / "none.toml")


def test_options_that_exclude_each_other_are_refused(
    asked: Callable[..., Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = str(asked(a="find"))
    for arguments, words in (
        ([], "give a robot file and a log, or --fleet"),
        (["paper"], "give a robot file and a log, or --fleet"),
        (["paper", "a.csv", "--jobs", "2"], "--jobs: goes with --fleet only"),
        (["paper", "--fleet", path], "robot stands in fleet.toml"),
        (["--fleet", path, "--columns", "c.toml"], "columns stands in fleet.toml"),
        (["--fleet", path, "--jobs", "0"], "--jobs 0"),
    ):
        assert main(["diagnose", *arguments]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.campaign
def test_made_logs_are_diagnosed_as_a_fleet(
    data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two machines, one with the robot file of another; then all of it again, kept."""
    case = data_dir / "made" / "single" / "case-005"
    if not case.is_dir():
        pytest.skip("there are no made logs")
    monkeypatch.setenv("HDAGEN_BUILD", str(tmp_path / "builds"))
    (tmp_path / "fleet.toml").write_text(
        f'[[machine]]\nname = "mine"\nrobot = "{case}/robot.toml"\nlog = "{case}/log.parquet"\n'
        f'hold_out = "{case}/hold_out.parquet"\n'
        f'[[machine]]\nname = "not mine"\nrobot = "emps"\nlog = "{case}/log.parquet"\n'
    )
    arguments = ["diagnose", "--fleet", str(tmp_path / "fleet.toml"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 3
    first, second = json.loads((tmp_path / "out" / "fleet.json").read_text())["machines"]
    assert first["status"] == "diagnosed" and first["gap"]["after"] < first["gap"]["before"]
    assert second["status"] == "refused" and "the robot 1" in second["says"][0]
    begun = time.monotonic()
    assert main(arguments) == 3 and time.monotonic() - begun < 5
    assert capsys.readouterr().out.count("kept") == 2
