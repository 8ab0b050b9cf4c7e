"""A campaign in this process and on workers of this machine: outcomes, resume, kills, limits, the table."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import trivial_tasks as trivial
from distributed.client import ClosedClientError
from distributed.comm.core import CommClosedError

from hdagen.arm.build_loader import PlantError
from hdagen.campaign import worker_admission
from hdagen.campaign.campaign_progress import CampaignProgress, format_duration, format_rate
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.installation import describe_installation, explain_difference
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status, Task, TaskFile
from hdagen.campaign.task_runner import DaskRunner, InProcessRunner, TaskRunner
from hdagen.campaign.worker_admission import Admission

SAID: list[str] = []


@pytest.fixture(scope="module")
def workers() -> Iterator[TaskRunner]:
    """Two worker processes that all tests here share."""
    with open_cluster(ClusterRequest(jobs=2), SAID.append) as runner:
        yield runner


@pytest.fixture(params=["here", "workers"])
def runner(request: pytest.FixtureRequest) -> TaskRunner:
    """Each way to run tasks on this machine."""
    if request.param == "here":
        return InProcessRunner()
    found: TaskRunner = request.getfixturevalue("workers")
    return found


@pytest.fixture
def store(tmp_path: Path) -> ResultStore:
    """An empty folder of results."""
    (tmp_path / "out").mkdir()
    return ResultStore(tmp_path / "out")


def squares(count: int, **more: float) -> list[Task]:
    return [Task(f"square {k}", trivial.write_square, {"number": k, **more}) for k in range(count)]


def silent(words: str) -> None:
    """Progress that nobody reads."""


def rows_of(store: ResultStore) -> dict[str, dict[str, object]]:
    return {row["task"]: row for row in pq.read_table(store.folder / "results.parquet").to_pylist()}


def test_every_task_leaves_its_files_and_one_row(runner: TaskRunner, store: ResultStore, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("1,2")
    log = {"log.csv": TaskFile(tmp_path / "log.csv", "monday.csv")}
    broken = [Task(how, trivial.break_down, {"how": how}, log) for how in ("refused", "plant", "other")]
    gone = Task("gone", trivial.copy_files, {}, {"log.csv": TaskFile(tmp_path / "none", "none")})
    found, interrupted = run_campaign([*squares(5), *broken, gone], store, runner, silent)
    assert not interrupted
    for k in range(5):
        assert (store.folder / f"square {k}" / "square.txt").read_text() == str(k * k)
        assert found[f"square {k}"].row["square"] == k * k
    assert (found["refused"].status, found["refused"].messages) == (Status.REFUSED, ("the log is empty; record one.",))
    assert (found["plant"].status, found["plant"].messages) == (Status.FAILED, ("monday.csv: cannot be built.",))
    assert found["other"].messages[0].startswith("ValueError: nobody thought of this (trivial_tasks.py, line")
    assert found["gone"].messages == (f"{tmp_path / 'none'}: No such file or directory.",)
    rows = rows_of(store)
    assert [row["status"] for row in rows.values()] == ["done"] * 5 + ["refused", "failed", "failed", "failed"]
    assert rows["square 3"]["square"] == 9.0 and rows["other"]["square"] is None
    assert {path.name for path in store.folder.iterdir() if path.is_dir()} == {f"square {k}" for k in range(5)} | {
        "refused", "plant", "other", "gone"
    }  # fmt: skip


def test_a_second_run_does_what_is_missing_and_says_how_much(
    runner: TaskRunner, store: ResultStore, tmp_path: Path
) -> None:
    said: list[str] = []
    run_campaign(squares(3), store, runner, said.append)
    assert not any("before" in words for words in said)
    found, _ = run_campaign(squares(5), store, runner, said.append)
    assert "3 of 5 were finished before and are kept, 2 are left." in said
    assert [one.is_reused for one in found.values()] == [True] * 3 + [False] * 2
    (store.folder / "square 1" / "square.txt").unlink()
    changed = [replace(one, parameters={"number": 7}) if one.name == "square 2" else one for one in squares(5)]
    found, _ = run_campaign(changed, store, runner, silent)
    assert [one.is_reused for one in found.values()] == [True, False, False, True, True]
    assert [row["square"] for row in rows_of(store).values()] == [0, 1, 49, 9, 16]


def test_a_table_that_is_half_is_made_again_from_the_files(store: ResultStore) -> None:
    run_campaign(squares(3), store, InProcessRunner(), silent)
    whole = (store.folder / "results.parquet").read_bytes()
    (store.folder / "results.parquet").write_bytes(whole[: len(whole) // 2])
    said: list[str] = []
    run_campaign(squares(3), store, InProcessRunner(), said.append)
    table = store.folder / "results.parquet"
    assert said == [
        f"{table}: is broken; it is made again from the results of the tasks, which are kept.",
        "3 of 3 were finished before and are kept, 0 are left.",
    ]
    assert [row["square"] for row in rows_of(store).values()] == [0, 1, 4]


def test_the_dashboard_is_told_by_its_address_or_by_what_it_lacks(workers: TaskRunner) -> None:
    """Without bokeh, Dask serves no dashboard."""
    (said,) = [words for words in SAID if words.startswith("dashboard: ")]
    if importlib.util.find_spec("bokeh"):
        assert said.startswith("dashboard: http://127.0.0.1:")
    else:
        assert said.startswith("dashboard: none, as bokeh is not installed; `pip install bokeh`")


def test_two_runs_in_one_folder_are_refused(store: ResultStore) -> None:
    with store.hold_lock(), pytest.raises(PlantError, match="another run works in this folder"), store.hold_lock():
        pass
    with store.hold_lock():  # the first one has ended
        pass


def test_a_task_that_ends_its_worker_three_times_is_refused_and_no_other_is(
    workers: TaskRunner, store: ResultStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killer = Task("killer", trivial.end_worker)
    found, _ = run_campaign([*squares(3), killer, *squares(40)[3:]], store, workers, silent)
    assert found["killer"].status is Status.REFUSED
    assert "it ended its worker process 3 times" in found["killer"].messages[0]
    assert all(one.status is Status.DONE for name, one in found.items() if name != "killer")
    again, _ = run_campaign([killer], store, workers, silent)
    assert again["killer"].is_reused


def test_a_task_that_takes_too_long_is_stopped_and_the_rest_goes_on(workers: TaskRunner, store: ResultStore) -> None:
    slow = Task("slow", trivial.write_square, {"number": 1, "seconds": 60.0}, longest_seconds=0.5)
    found, _ = run_campaign([slow, *squares(4)], store, workers, silent)
    assert (found["slow"].status, found["slow"].messages) == (Status.FAILED, ("it was stopped after 0.5 s.",))
    assert sum(one.status is Status.DONE for one in found.values()) == 4
    assert not (store.folder / "slow" / "task.json").exists()  # it is tried again


def test_memory_is_limited_by_task(store: ResultStore) -> None:
    request = ClusterRequest(jobs=1, memory="600 MB")
    greedy = Task("greedy", trivial.take_memory, {"bytes": 1_000_000_000})
    with open_cluster(request, silent, needs_processes=True) as runner:
        found, _ = run_campaign([greedy, *squares(2)], store, runner, silent)
    assert found["greedy"].status is Status.REFUSED
    assert "needed more than 600 MB of memory" in found["greedy"].messages[0]
    assert found["square 1"].status is Status.DONE


def test_nothing_but_the_tasks_own_inputs_leaves_this_process(
    workers: TaskRunner, store: ResultStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every byte that the client serializes for the cluster is looked at."""
    from distributed import core, protocol
    from distributed.protocol.core import dumps

    sent: list[bytes] = []

    def note(*arguments: object, **more: object) -> list[bytes]:
        frames: list[bytes] = dumps(*arguments, **more)
        sent.extend(bytes(frame) for frame in frames)
        return frames

    monkeypatch.setattr(protocol, "dumps", note)
    assert core is not None
    secret = "the name of a task stays here"
    (tmp_path / "log.csv").write_text("a word of the log")
    files = {"log.csv": TaskFile(tmp_path / "log.csv", "label of the log")}
    run_campaign([Task(secret, trivial.copy_files, {"note": "a parameter"}, files)], store, workers, silent)
    all_sent = b"\0".join(sent)
    for word in ("a word of the log", "label of the log", "a parameter"):
        assert word.encode() in all_sent
    assert secret.encode() not in all_sent and str(tmp_path).encode() not in all_sent


def test_the_scheduler_forgets_tasks_that_have_ended(store: ResultStore) -> None:
    """All tasks are one group and one span, which Dask keeps for good; with one worker each would be one of its own."""
    with open_cluster(ClusterRequest(jobs=1), silent, needs_processes=True) as runner:
        run_campaign(squares(12), store, runner, silent)
        scheduler = runner._client.cluster.scheduler  # type: ignore[attr-defined]
        assert len(scheduler.task_groups) == len(scheduler.extensions["spans"].spans) == 1
        assert len(scheduler.tasks) <= 2


class StubClient:
    """A client whose scheduler is lost when the first task is sent; each of its answers is taken once."""

    def __init__(self, *answers: object) -> None:
        self.status = "running"
        self.answers = list(answers)

    def nthreads(self) -> dict[str, int]:
        return {"tls://a:1": 1}

    def run(self, *_: object, **__: object) -> dict[str, object]:
        return {"tls://a:1": self.answers.pop(0)}

    def submit(self, *_: object, **__: object) -> None:
        self.status = "closed"
        raise ClosedClientError("Client is closed. Can't send update-graph message.")


def test_a_scheduler_that_is_lost_while_a_task_is_sent_is_one_sentence() -> None:
    runner = DaskRunner(StubClient(""), silent)  # type: ignore[arg-type]
    with pytest.raises(PlantError, match="the cluster's scheduler is gone; what is finished is kept"):
        list(runner.run_tasks(squares(1)))


def test_a_worker_that_leaves_while_it_is_asked_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_admission, "LONELY_LOOK_INTERVAL", 0.0)
    admission = Admission(StubClient(CommClosedError("Stream is closed"), ""), silent)  # type: ignore[arg-type]
    admission.look_for_workers()
    assert not admission.admitted and not admission.refused
    admission.look_for_workers()
    assert admission.admitted == {"tls://a:1"}


# -- parts ------------------------------------------------------------------------------------------------------------


def test_one_job_imports_no_engine(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; import trivial_tasks as t\n"
        "from hdagen.campaign.cluster import open_cluster\n"
        "from hdagen.campaign.cluster_request import ClusterRequest\nfrom hdagen.campaign.task import Task\n"
        "with open_cluster(ClusterRequest(jobs=1), print) as runner:\n"
        "    print([o.row['square'] for _, o in runner.run_tasks([Task('a', t.write_square, {'number': 3})])])\n"
        "print({'distributed', 'dask', 'tornado'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": ":".join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[9]\nset()\n"


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"jobs": 0}, ["--jobs 0: possible is a whole number from 1 on."]),
        ({"memory": "much"}, ["--memory 'much': possible is a size such as '2 GB' or 500MB."]),
        ({"is_insecure": True}, ["--insecure: goes with --scheduler or --scheduler-file only."]),
        ({"scheduler": "10.0.0.1"}, ["--scheduler: found '10.0.0.1', possible is an address"]),
        ({"scheduler": "tcp://10.0.0.1:8786"}, ["whoever reaches such a scheduler runs programs on its workers"]),
        ({"scheduler": "tls://10.0.0.1:8786"}, ["give --tls-ca, --tls-cert and --tls-key"]),
        ({"scheduler": "tls://10.0.0.1:8786", "tls_ca": Path("none.pem")}, ["--tls-ca none.pem: there is no", "give"]),
        ({"scheduler_file": Path("none.json")}, ["none.json: cannot be read"]),
        ({"scheduler": "tls://a:1", "scheduler_file": Path("b")}, ["give one of them"]),
    ],
)
def test_a_place_that_cannot_be_used_is_refused(changes: dict[str, object], words: list[str]) -> None:
    problems = list(ClusterRequest(**changes).list_problems())  # type: ignore[arg-type]
    assert len(problems) == len(words)
    assert all(word in problem for word, problem in zip(words, problems, strict=True)), problems


def test_sizes_of_memory_are_read() -> None:
    sizes = {"2 GB": 2e9, "500MB": 5e8, "1.5GiB": 1.5 * 2**30, "64 kB": 64e3}
    assert {text: ClusterRequest(memory=text).count_memory_bytes() for text in sizes} == sizes


def test_a_difference_of_installations_is_named() -> None:
    here = describe_installation()
    assert explain_difference(here, dict(here)) == ""
    other = here | {"numpy": "1.0", "code": "0"}
    said = explain_difference(here, other)
    assert "another state of hdagen's code" in said and f"numpy 1.0 where this command has {here['numpy']}" in said
    assert "hdagen None" in explain_difference(here, {})


def test_progress_tells_rate_and_time_left() -> None:
    now, said = [0.0], list[str]()
    progress = CampaignProgress(100, said.append, lambda: now[0])
    for k in range(100):
        now[0] += 30.0
        progress.note_end(f"task {k}", Outcome(Status.DONE))
    assert said[9] == "task 9: done; 10 of 100, 2/min, about 45 min left"
    assert said[-1].startswith("task 99: done; 100 of 100") and len(said) == 100
    quick = CampaignProgress(1000, said.append, lambda: now[0])
    for k in range(999):
        now[0] += 0.01
        quick.note_end(f"task {k}", Outcome(Status.DONE if k != 500 else Status.FAILED))
    assert 100 + 8 <= len(said) <= 100 + 13 and any("task 500: failed" in words for words in said)
    assert format_rate(0.001) == "3.6/h" and format_duration(7200) == "2.0 h"


def test_a_result_that_json_cannot_hold_is_no_finished_task(store: ResultStore) -> None:
    task = squares(1)[0]
    with pytest.raises(ValueError, match="JSON"):
        store.keep_outcome(task, "", Outcome(Status.DONE, {"square": float("nan")}))
    assert store.find_finished(task) is None
    with pytest.raises(OSError, match="name"):
        store.keep_outcome(task, "", Outcome(Status.DONE, {}, files={"../x": b""}))


def test_columns_of_mixed_kinds_become_text(store: ResultStore, make_rows: Callable[..., None]) -> None:
    make_rows(a={"value": 1, "kind": "x", "list": [1]}, b={"value": 2.5, "kind": 3}, c={"is_good": True})
    rows = rows_of(store)
    assert [row["value"] for row in rows.values()] == [1.0, 2.5, None]
    assert [row["kind"] for row in rows.values()] == ['"x"', "3", None]
    assert rows["a"]["list"] == json.dumps([1]) and rows["c"]["is_good"] is True


@pytest.fixture
def make_rows(store: ResultStore) -> Callable[..., None]:
    """make_rows(name=row, …): a table of these rows."""
    return lambda **rows: store.write_table({name: Outcome(Status.DONE, row) for name, row in rows.items()})
