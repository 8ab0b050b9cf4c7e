"""A fleet: what its file may say, what is run again and what is kept, interrupts, the table, fleet.json and the page.

Machines are diagnosed by a stand-in: it does what the log's first word says, and notes each call. A campaign runs the
command itself on made logs.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import trivial_tasks
from hostile_names import NAME, check_escaped
from trivial_tasks import make_stand_in

from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status
from hdagen.fleet import fleet_diagnosis, fleet_file, fleet_page
from hdagen.fleet.fleet_diagnosis import MachineResult
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.fleet.machine_task import make_machine_task, summarize_diagnosis

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _calls_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is diagnosed notes a line in a file."""
    monkeypatch.setenv("CALLS", str(tmp_path / "calls"))


HERE = ClusterRequest(jobs=1)


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


def silent(words: str) -> None:
    """Progress that nobody reads."""


def ended(results: Sequence[MachineResult]) -> dict[str, str]:
    return {one.machine.name: one.status_word for one in results}


def run(fleet: Path, out: Path, say: Callable[[str], None] = silent) -> list[MachineResult]:
    """Results of a fleet by the stand-in, in this process."""
    out.mkdir(exist_ok=True)
    machines = fleet_file.read_fleet(fleet)
    results, interrupted = fleet_diagnosis.diagnose_fleet(machines, out, HERE, say, make_stand_in)
    assert not interrupted
    return results


FOUR = {
    "a": "find stribeck_friction@2",
    "b": "refuse",
    "c": "fail",
    "d": "find",
    "e": "find stribeck_friction@2",
}


def test_each_machine_ends_as_its_task_does(asked: Callable[..., Path], tmp_path: Path) -> None:
    said: list[str] = []
    results = run(asked(**FOUR), tmp_path / "out", said.append)
    assert ended(results) == {"a": "diagnosed", "b": "refused", "c": "failed", "d": "diagnosed", "e": "diagnosed"}
    by_name = {one.machine.name: one for one in results}
    assert by_name["b"].outcome.messages == (f"{tmp_path / 'b.csv'}: motor_position_1 stays at 0; record it.",)
    assert by_name["c"].outcome.messages == ("the build failed.",)
    assert by_name["a"].row and by_name["a"].row["probability"] == 0.9 and by_name["b"].row is None
    assert "5 of 5" in said[-1] and "left" in said[0]
    assert (tmp_path / "out" / "a" / "report.html").read_text() == "<html>a report</html>"
    assert pq.read_table(tmp_path / "out" / "results.parquet").column("task").to_pylist() == list("abcde")


def test_what_is_finished_is_kept_until_its_files_change(
    asked: Callable[..., Path], calls: Callable[[], list[str]], tmp_path: Path
) -> None:
    def again() -> list[str]:
        calls()
        results = run(tmp_path / "fleet.toml", tmp_path / "out")
        found = calls()
        assert [one.machine.name for one in results if not one.outcome.is_reused] == found
        return found

    asked(**FOUR)
    assert again() == ["a", "b", "c", "d", "e"]
    assert again() == ["c"]  # what failed is tried again, what was refused is refused for good
    (tmp_path / "a.csv").write_text("find payload@2")
    assert again() == ["a", "c"]
    (tmp_path / "out" / "d" / "diagnosis.json").unlink()
    (tmp_path / "out" / "e" / "task.json").write_text("{")
    assert again() == ["c", "d", "e"]
    (tmp_path / "arm.toml").write_text("another arm")
    assert again() == ["a", "b", "c", "d", "e"]
    text = (tmp_path / "fleet.toml").read_text().replace('log = "a.csv"\n', 'log = "a.csv"\nhold_out = "d.csv"\n')
    (tmp_path / "fleet.toml").write_text(text)
    assert again() == ["a", "c"]


def test_a_log_that_is_refused_now_leaves_no_older_diagnosis(asked: Callable[..., Path], tmp_path: Path) -> None:
    run(asked(a="find payload@2"), tmp_path / "out")
    assert (tmp_path / "out" / "a" / "diagnosis.json").exists()
    assert ended(run(asked(a="refuse"), tmp_path / "out")) == {"a": "refused"}
    assert sorted(path.name for path in (tmp_path / "out" / "a").iterdir()) == ["task.json"]


def test_the_hash_is_of_what_the_files_hold_and_not_of_where_they_lie(tmp_path: Path) -> None:
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        for name, text in (("arm.toml", "arm"), ("log.csv", "log"), ("other.csv", "other"), ("columns.toml", "")):
            (tmp_path / folder / name).write_text(text)

    def hash_task(machine: FleetMachine) -> str:
        return make_machine_task(machine).hash_inputs()

    def machine(folder: str, **files: str) -> FleetMachine:
        place = tmp_path / folder
        other = {key: place / name for key, name in files.items() if key != "robot"}
        robot = files.get("robot", str(place / "arm.toml"))
        return FleetMachine("x", robot, other.get("log", place / "log.csv"), other.get("held"), other.get("columns"))

    first = hash_task(machine("here"))
    assert hash_task(machine("there")) == first
    differing = [
        machine("here", log="other.csv"),
        machine("here", held="other.csv"),
        machine("here", columns="columns.toml"),
        machine("here", robot="paper"),
    ]
    assert len({first, *map(hash_task, differing)}) == 5


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupt_keeps_what_is_finished_and_stops_the_rest(
    asked: Callable[..., Path], calls: Callable[[], list[str]], tmp_path: Path, jobs: int
) -> None:
    """By a real signal to the command, in this process and with workers, which end with it."""
    path = asked(a="find payload@2", b="sleep", c="sleep", d="find")
    command = [sys.executable, trivial_tasks.__file__, "diagnose", "--fleet", str(path), "--jobs", str(jobs)]
    command += ["--out", str(tmp_path / "out")]
    child = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(ROOT), str(Path(trivial_tasks.__file__).parent)))},
    )
    deadline = time.monotonic() + 60
    while not ((tmp_path / "calls").exists() and set("abc"[: 1 + jobs]) <= set((tmp_path / "calls").read_text())):
        assert time.monotonic() < deadline and child.poll() is None
        time.sleep(0.02)
    sleeper = int((tmp_path / "calls").read_text().split()[-1])
    time.sleep(0.5)
    os.killpg(child.pid, signal.SIGINT)  # as a terminal does
    printed, complained = child.communicate(timeout=60)
    assert child.returncode == 130, complained
    assert "what was finished is whole" in complained and "not run" in printed and "Traceback" not in complained
    with pytest.raises(ProcessLookupError):
        os.kill(sleeper, 0)
    found = json.loads((tmp_path / "out" / "fleet.json").read_text())
    assert [one["status"] for one in found["machines"]] == ["diagnosed", "not run", "not run", "not run"]
    assert not (tmp_path / "out" / "b").exists()
    calls()
    (tmp_path / "b.csv").write_text("find")
    (tmp_path / "c.csv").write_text("find")
    said: list[str] = []
    results = run(path, tmp_path / "out", said.append)
    assert said[0] == "1 of 4 were finished before and are kept, 3 are left."
    assert calls() == ["b", "c", "d"] and set(ended(results).values()) == {"diagnosed"}


def test_a_folder_that_cannot_be_made_ends_the_run_with_its_name(asked: Callable[..., Path], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "b").write_text("a file")
    with pytest.raises(OSError, match="exists") as raised:
        run(asked(a="find", b="find"), tmp_path / "out")
    assert raised.value.filename == str(tmp_path / "out" / "b")
    assert pq.read_table(tmp_path / "out" / "results.parquet").column("status").to_pylist() == ["done", "not run"]


# -- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., int]:
    """command(*arguments) -> exit code of hdagen diagnose --fleet, machines by the stand-in, in this process."""
    by_stand_in = partial(fleet_diagnosis.diagnose_fleet, make_task=make_stand_in)
    monkeypatch.setattr(fleet_diagnosis, "diagnose_fleet", by_stand_in)
    more = ["--jobs", "1", "--out", str(tmp_path / "out")]
    return lambda *arguments: main(["diagnose", "--fleet", *map(str, arguments), *more])


def test_the_table_the_json_and_the_page_say_the_same(
    asked: Callable[..., Path],
    command: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    assert command(asked(**FOUR)) == 2  # something failed
    printed = capsys.readouterr().out
    page = (tmp_path / "out" / "fleet.html").read_text()
    said = "3 of 5 machines are diagnosed, 1 refused, 1 failed; something is missing on 2, most often stribeck friction"
    assert said in printed and said in page
    for words in (
        "none above the size that counts",
        "motor_position_1 stays at 0; record it.",
        "the build failed.",
        "read as mA",
    ):
        assert words in page
    assert "refused: " in printed and "0.9" in printed
    content = json.loads((tmp_path / "out" / "fleet.json").read_text())
    assert content["counts"] == {"diagnosed": 3, "refused": 1, "failed": 1, "not run": 0}
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
    found = {**trivial_tasks.make_diagnosis(["unknown@0"]), "gap": {"before": 3.0, "after": 2.0}}
    machine = replace(machine, name=f"{machine.name} {NAME}", robot=NAME, log=Path(NAME.replace("/", "")))
    odd = MachineResult(machine, Outcome(Status.REFUSED, messages=(f"{NAME} [bold]",)))
    row = summarize_diagnosis(found)
    row["parameters"] = {NAME: [1.0, 0.1, NAME]}
    dated = [
        MachineResult(
            replace(machine, date=date), Outcome(Status.DONE, row | {"parameters": {NAME: [value, 0.1, NAME]}})
        )
        for date, value in (("2026-01-01", 1.0), ("2026-02-01", 9.0))
    ]
    fleet_page.write_fleet_page(tmp_path / "page.html", Path(NAME), [odd, *dated])
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
        "machine 1: unknown key 'holdout'; possible are robot, log, hold_out, columns, name, date.",
        "machine 2: robot = 3; it must be text in quotes.",
        f"machine 2: log = 'none.csv': {tmp_path / 'none.csv'}: cannot be read (there is no such file); give the path "
        "of a log.",
        "machine 3: robot is missing; state it.",
        "machine 3: name = '../x'; possible are up to 60 letters, digits, spaces, _ and -.",
        "machine 4: robot = 'no/arm.toml': there is no such file, and it is no preset's name.",
        "2 machines are named 'log'; tell them apart with name = \"…\".",
    ]


def test_three_wrong_lines_of_ten_thousand_machines_are_said_before_anything_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log.csv").write_text("")
    lines = [
        f'[[machine]]\nname = "{k}"\nrobot = "paper"\nlog = "log.csv"\ndate = 2026-01-05' for k in range(1, 10_001)
    ]
    lines[17] = lines[17].replace("log.csv", "none.csv")
    lines[5000] = lines[5000].replace("2026-01-05", '"yesterday"')
    lines[9999] = lines[9999].replace("paper", "No such")
    (tmp_path / "fleet.toml").write_text("\n".join(lines))
    assert main(["diagnose", "--fleet", str(tmp_path / "fleet.toml"), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert [line.partition(": machine ")[2].split(":")[0] for line in said] == ["18", "5001", "10000"]
    assert "date = 'yesterday'; possible is ISO 8601" in said[1]
    assert not (tmp_path / "out").exists()


def test_a_second_command_in_the_same_folder_is_one_sentence(
    asked: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").mkdir()
    with ResultStore(tmp_path / "out").hold_lock():
        assert main(["diagnose", "--fleet", str(asked(a="find")), "--out", str(tmp_path / "out")]) == 2
    complained = capsys.readouterr().err
    assert complained.count("\n") == 1 and "another run works in this folder; wait for its end" in complained
    assert list((tmp_path / "out").iterdir()) == []


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
