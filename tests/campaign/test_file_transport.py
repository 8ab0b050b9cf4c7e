"""A content that several tasks use travels once to each worker, and again to one that lacks it."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest
import trivial_tasks as trivial
from distributed import protocol
from distributed.protocol.core import dumps

from hdagen.campaign import file_transport
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.file_transport import KeptContents, ReceivedFiles, SentFiles
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Status, Task, TaskFile
from hdagen.campaign.task_runner import TaskRunner

WORDS = b"words of a robot file that many logs share"


def silent(words: str) -> None:
    """Progress that nobody reads."""


def make_files(*contents: bytes) -> dict[str, dict[str, Any]]:
    """The files of a payload."""
    return {
        f"file {k}": {"label": f"label {k}", "sha256": hashlib.sha256(one).hexdigest(), "content": one}
        for k, one in enumerate(contents)
    }


@pytest.fixture
def workers() -> Iterator[TaskRunner]:
    """Two worker processes that have received nothing yet."""
    with open_cluster(ClusterRequest(jobs=2), silent) as runner:
        yield runner


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Every frame that the client serializes for the cluster."""
    frames: list[bytes] = []

    def note(*arguments: object, **more: object) -> list[bytes]:
        made: list[bytes] = dumps(*arguments, **more)
        frames.extend(bytes(frame) for frame in made)
        return made

    monkeypatch.setattr(protocol, "dumps", note)
    return frames


def make_tasks(folder: Path, count: int, note: str) -> list[Task]:
    """Tasks that share a robot file and have a log each."""
    (folder / "robot.toml").write_bytes(WORDS)
    tasks = []
    for k in range(count):
        (folder / f"{k}.csv").write_text(f"log {k} of {note}")
        files = {"robot.toml": folder / "robot.toml", "log.csv": folder / f"{k}.csv"}
        named = {name: TaskFile(path, name) for name, path in files.items()}
        tasks.append(Task(f"{note} {k}", trivial.hash_files, {"k": k}, named))
    return tasks


def test_a_content_travels_once_to_each_worker_and_again_where_it_is_lost(
    workers: TaskRunner, sent: list[bytes], tmp_path: Path
) -> None:
    """Frames are counted of client and scheduler, which live in this process: each content passes both."""
    (tmp_path / "out").mkdir()
    store = ResultStore(tmp_path / "out")
    found, _ = run_campaign(make_tasks(tmp_path, 10, "first"), store, workers, silent)
    assert {one.status for one in found.values()} == {Status.DONE}
    folders = {Path(str(one.row["place"])).parents[1] for one in found.values()}
    assert len(folders) == 2 and b"\0".join(sent).count(WORDS) == 2 * len(folders)
    assert all(b"\0".join(sent).count(f"log {k} of first".encode()) == 2 for k in range(10))
    for folder in folders:
        shutil.rmtree(folder / "hdagen-received")
    found, _ = run_campaign(make_tasks(tmp_path, 10, "second"), store, workers, silent)
    assert b"\0".join(sent).count(WORDS) == 4 * len(folders)
    for k in range(10):
        words = {"robot.toml": WORDS, "log.csv": f"log {k} of second".encode()}
        hashes = {name: hashlib.sha256(content).hexdigest() for name, content in words.items()}
        assert (found[f"second {k}"].status, found[f"second {k}"].row["hashes"]) == (Status.DONE, hashes)


def test_both_sides_keep_the_same_contents_within_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Contents of many lengths, some longer than the limit: none is asked for, and the folder stays below the limit."""
    monkeypatch.setattr(file_transport, "MOST_KEPT_BYTES", 1000)
    chance, sending, receiving = Random(1), SentFiles(), ReceivedFiles(tmp_path / "received")
    pool = [bytes([k]) * (1 + 37 * k) for k in range(40)]
    left_out = 0
    for _ in range(400):
        files = make_files(*chance.choices(pool[:8] + pool[::5], k=3))
        payload = sending.leave_out_kept(files, "a")
        left_out += sum(one["content"] is None for one in payload.values())
        assert receiving.fill_in_kept(payload) == (files, [])
        assert sum(path.stat().st_size for path in (tmp_path / "received").iterdir()) <= 1000
    assert 200 < left_out < 1200


def test_a_worker_asks_for_what_it_lacks_or_has_in_another_form(tmp_path: Path) -> None:
    sending, files = SentFiles(), make_files(b"one", b"two", b"three")
    hashes = [one["sha256"] for one in files.values()]
    receiving = ReceivedFiles(tmp_path)
    assert receiving.fill_in_kept(sending.leave_out_kept(files, "a"))[1] == []
    (tmp_path / hashes[0]).unlink()
    (tmp_path / hashes[2]).write_bytes(b"thr")
    again = sending.leave_out_kept(files, "a")
    assert all(one["content"] is None for one in again.values())
    assert receiving.fill_in_kept(again)[1] == [hashes[0], hashes[2]]
    sending.forget_contents("a", [hashes[0], hashes[2]])
    assert receiving.fill_in_kept(sending.leave_out_kept(files, "a")) == (files, [])
    sending.forget_worker("a")
    assert all(one["content"] is not None for one in sending.leave_out_kept(files, "a").values())


def test_the_content_that_was_used_longest_ago_goes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_transport, "MOST_KEPT_BYTES", 10)
    kept = KeptContents()
    assert kept.note_use("a", 4) == kept.note_use("b", 4) == kept.note_use("a", 4) == []
    assert kept.note_use("c", 4) == ["b"]
    assert kept.note_use("too long", 11) == ["too long"]
    assert "a" in kept and "c" in kept and "b" not in kept and "too long" not in kept
