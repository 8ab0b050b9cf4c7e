"""A cluster of separate processes that share no folder: a scheduler and workers with homes and caches of their own."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random

import pyarrow.parquet as pq
import pytest
import trivial_tasks as trivial
from clusters import ROOT, Site, await_true, open_site, start_client, write_certificates
from replayed import FLEXIBLE
from trivial_tasks import make_stand_in

from hdagen.__main__ import main
from hdagen.arm.build_loader import PlantError
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Status, Task, TaskFile
from hdagen.fleet import fleet_diagnosis, fleet_file


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A cluster with two workers."""
    with open_site(tmp_path_factory.mktemp("site"), ["east", "west"]) as found:
        yield found


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    """An empty folder of results."""
    (tmp_path / "out").mkdir()
    return ResultStore(tmp_path / "out")


def silent(words: str) -> None:
    """Progress that nobody reads."""


def squares(count: int) -> list[Task]:
    return [Task(f"square {k}", trivial.write_square, {"number": k, "seconds": 0.05}) for k in range(count)]


def test_a_fleet_runs_on_workers_that_share_no_folder(site: Site, tmp_path: Path) -> None:
    """The command itself: the same files and rows as in this process, by workers that never see this folder."""
    (tmp_path / "arm.toml").write_text("an arm")
    text = ""
    for name, says in {"a": "find payload@2", "b": "refuse", "c": "find", "d": "find stribeck_friction@2"}.items():
        (tmp_path / f"{name}.csv").write_text(says)
        text += f'[[machine]]\nrobot = "arm.toml"\nlog = "{name}.csv"\n'
    (tmp_path / "fleet.toml").write_text(text)
    machines = fleet_file.read_fleet(tmp_path / "fleet.toml")
    found = {}
    for name, asked in {"here": replace(site.ask(), scheduler=None, tls_ca=None, tls_cert=None, tls_key=None),
                        "there": site.ask()}.items():  # fmt: skip
        (tmp_path / name).mkdir()
        results, _ = fleet_diagnosis.diagnose_fleet(machines, tmp_path / name, asked, silent, make_stand_in)
        found[name] = fleet_diagnosis.summarize_fleet(results)
        files = (path for path in (tmp_path / name).rglob("*") if path.suffix in (".json", ".html"))
        contents = {str(path.relative_to(tmp_path / name)): path.read_bytes() for path in files}
        found[f"{name} files"] = {key: value for key, value in contents.items() if not key.endswith("task.json")}
    assert found["here"] == found["there"] and found["here files"] == found["there files"]
    assert found["there"]["counts"] == {"diagnosed": 3, "refused": 1, "failed": 0, "not run": 0}


def test_the_schedulers_own_file_stands_for_its_address(site: Site, store: ResultStore) -> None:
    said: list[str] = []
    with open_cluster(site.ask(scheduler=None, scheduler_file=site.folder / "scheduler.json"), said.append) as runner:
        found, _ = run_campaign(squares(2), store, runner, silent)
    assert [one.row["square"] for one in found.values()] == [0, 1]
    (dashboard,) = [words for words in said if words.startswith("dashboard")]
    assert dashboard.startswith("dashboard, if the scheduler's computer has bokeh: http://127.0.0.1:")


def test_tasks_touch_the_workers_own_folders_alone(site: Site, store: ResultStore, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("1,2")
    files = {"log.csv": TaskFile(tmp_path / "log.csv", "log.csv")}
    tasks = [Task(f"copy {k}", trivial.copy_files, {"k": k}, files) for k in range(8)]
    with open_cluster(site.ask(), silent) as runner:
        found, _ = run_campaign(tasks, store, runner, silent)
    homes = {str(one.row["home"]) for one in found.values()}
    assert homes == {str(site.folder / name / "work") for name in ("east", "west")}
    assert all(str(one.row["place"]).startswith(str(site.folder)) for one in found.values())
    assert (store.folder / "copy 3" / "log.csv").read_text() == "1,2"
    left = [path for name in ("east", "west") for path in (site.folder / name).rglob("hdagen-task-*")]
    assert left == []


def test_a_robot_is_built_by_a_worker_or_travels_to_one_without_a_compiler(
    site: Site, store: ResultStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """West has no compiler: it gets the build that this machine made, and computes the same bits."""
    monkeypatch.setenv("HDAGEN_BUILD", str(tmp_path / "builds"))
    (tmp_path / "robot.toml").write_text(FLEXIBLE)
    files = {"robot.toml": TaskFile(tmp_path / "robot.toml", "robot.toml")}
    said: list[str] = []
    site.kill("west")
    site.start_worker("bare", PATH=str(Path(sys.executable).parent), CC="/nowhere/cc")
    try:
        tasks = [Task(f"load {k}", trivial.load_robot, {"k": k}, files) for k in range(4)]
        with open_cluster(site.ask(), said.append) as runner:
            await_true(lambda: "Registered" in site.log("bare"))
            found, _ = run_campaign(tasks, store, runner, said.append)
            again, _ = run_campaign([replace(one, name=f"{one.name} again") for one in tasks], store, runner, silent)
    finally:
        site.kill("bare")
        site.start_worker("west")
    every = {**found, **again}
    assert {one.status for one in every.values()} == {Status.DONE}, every
    folders = {str(one.row["folder"]) for one in every.values()}
    assert len(folders) == 2 and {Path(folder).parents[3].name for folder in folders} == {"east", "bare"}
    assert len({json.dumps(one.row["state"]) for one in every.values()}) == 1
    sent = [words for words in said if "has no compiler; it gets the build" in words]
    assert len(sent) == 1  # once for all tasks
    assert len(list((site.folder / "bare" / "home" / "cache" / "hdagen").glob("[!.]*"))) == 1


def test_workers_that_differ_or_lack_the_package_say_so_and_take_no_task(
    site: Site, store: ResultStore, tmp_path: Path
) -> None:
    other, empty = tmp_path / "other", tmp_path / "empty"
    for package in ("gen", "hdagen"):
        shutil.copytree(ROOT / package, other / package, ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "hdagen" / "fleet" / "machine_task.py").open("a") as file:
        file.write("# another state\n")
    (empty / "hdagen").mkdir(parents=True)
    (empty / "hdagen" / "__init__.py").write_text("raise ImportError('none here')\n")
    site.start_worker("other", PYTHONPATH=str(other))
    site.start_worker("empty", PYTHONPATH=str(empty))
    said: list[str] = []
    try:
        await_true(lambda: all("Registered" in site.log(name) for name in ("other", "empty")))
        with open_cluster(site.ask(), said.append) as runner:
            found, _ = run_campaign(squares(12), store, runner, said.append)
        site.kill("east")
        site.kill("west")
        with (
            open_cluster(site.ask(), silent) as runner,
            pytest.raises(PlantError, match="no worker of the cluster can take tasks"),
        ):
            run_campaign(squares(13), store, runner, silent)
    finally:
        site.kill("other")
        site.kill("empty")
        for name in {"east", "west"} - site.processes.keys():
            site.start_worker(name)
    assert {one.status for one in found.values()} == {Status.DONE}
    refusals = sorted(words.partition("takes no task: ")[2] for words in said if "takes no task" in words)
    assert len(refusals) == 2
    assert refusals[0] == "another state of hdagen's code."
    assert "cannot load hdagen" in refusals[1] and "install the same hdagen there" in refusals[1]


def test_a_full_disk_at_one_worker_sends_its_tasks_elsewhere(site: Site, store: ResultStore) -> None:
    full = site.folder / "west" / "work" / "full"
    full.write_text("")
    said: list[str] = []
    try:
        with open_cluster(site.ask(), said.append) as runner:
            await_true(lambda: all("Registered" in site.log(name) for name in ("east", "west")))
            tasks = [Task(f"disk {k}", trivial.find_full_disk, {"k": k}) for k in range(10)]
            found, _ = run_campaign(tasks, store, runner, said.append)
    finally:
        full.unlink()
    assert {one.status for one in found.values()} == {Status.DONE}
    assert sum("takes no task: " in words and "No space left" in words for words in said) == 1


def test_an_address_that_nobody_answers_is_one_sentence(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hdagen.campaign.cluster.ANSWER_SECONDS", 1.0)
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        free = f"tls://127.0.0.1:{held.getsockname()[1]}"
    (tmp_path / "log.csv").write_text("time\n0\n")
    (tmp_path / "fleet.toml").write_text('[[machine]]\nrobot = "paper"\nlog = "log.csv"\n')
    command = ["diagnose", "--fleet", str(tmp_path / "fleet.toml"), "--out", str(tmp_path / "out")]
    assert main([*command, *site.options()[2:], "--scheduler", free]) == 2
    complained = capsys.readouterr().err
    assert complained.count("\n") == 1 and f"{free}: no scheduler answers within 1 s" in complained
    assert main([*command, "--scheduler", free]) == 2
    assert "give --tls-ca, --tls-cert and --tls-key" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_client_without_the_certificate_is_refused(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hdagen.campaign.cluster.ANSWER_SECONDS", 2.0)
    write_certificates(tmp_path)
    mine = {"tls_ca": tmp_path / "cert.pem", "tls_cert": tmp_path / "cert.pem", "tls_key": tmp_path / "key.pem"}
    for changes in (mine, {"scheduler": site.address.replace("tls", "tcp"), "is_insecure": True}):
        with (
            pytest.raises(PlantError, match="does not take this certificate") as raised,
            open_cluster(replace(site.ask(), **changes), silent),
        ):
            pass
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "victim, kills",
    [("scheduler", 1), *(pytest.param(v, 20, marks=pytest.mark.campaign) for v in ("one", "scheduler", "client"))],
)
def test_a_kill_loses_nothing_and_does_nothing_twice(tmp_path: Path, victim: str, kills: int) -> None:
    """kill -9 of a worker, the scheduler or the client in mid-run, time after time; then a last run to the end."""
    count, random, calls, out = 20 + 10 * kills, Random(1), tmp_path / "calls", tmp_path / "out"
    out.mkdir()
    with open_site(tmp_path / "site", ["one", "two"]) as site:
        port = int(site.address.rpartition(":")[2])
        for _ in range(kills):
            before = count_finished(out)
            client = start_client(site, out, count, calls)
            await_true(lambda before=before, client=client: count_finished(out) > before or client.poll() is not None)
            time.sleep(random.uniform(0.0, 0.3))
            if victim == "client":
                os.killpg(client.pid, signal.SIGKILL)
                client.wait()
            else:
                site.kill(victim)
                assert client.wait(timeout=600) == {"scheduler": 2, "one": 0}[victim]
            check_nothing_is_half(out)
            if victim == "scheduler":
                for name in ("one", "two"):
                    site.kill(name)
                site.start_scheduler(port)
                site.start_worker("two")
            if victim != "client":
                site.start_worker("one")
            if victim == "one":
                count += 10
        assert start_client(site, out, count, calls).wait(timeout=600) == 0, (tmp_path / "site/client.log").read_text()
    rows = pq.read_table(out / "results.parquet").to_pylist()
    assert [(row["task"], row["square"], row["status"]) for row in rows] == [
        (f"square {k}", k * k, "done") for k in range(count)
    ]
    ran = Counter(line.split()[0] for line in calls.read_text().splitlines())
    assert set(ran) == {str(k) for k in range(count)}
    assert sum(ran.values()) - count <= 2 * kills  # nothing but what a worker had in hand is done again


def count_finished(out: Path) -> int:
    return len(list(out.glob("*/task.json")))


def check_nothing_is_half(out: Path) -> None:
    for path in out.glob("*/task.json"):
        assert json.loads(path.read_text())["files"] == ["square.txt"] and (path.parent / "square.txt").exists()
    if (out / "results.parquet").exists():
        pq.read_table(out / "results.parquet")


def test_a_killed_worker_costs_nothing(site: Site, store: ResultStore) -> None:
    killed: list[str] = []

    def kill(words: str) -> None:
        if "done" in words and not killed:
            killed.append("east")
            site.kill("east")

    try:
        with open_cluster(site.ask(), silent) as runner:
            found, _ = run_campaign(squares(20), store, runner, kill)
    finally:
        if killed:
            site.start_worker("east")
    assert killed and {one.status for one in found.values()} == {Status.DONE}
