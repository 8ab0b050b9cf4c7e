"""A check: cases are made, diagnosed by processes that do not know the truth, measured on held-out motion, and only
then scored against their labels.

Seeds and labels stay in the memory of this process and of the children that make logs.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hdagen.blind import label_seal
from hdagen.blind.case_tasks import make_diagnosis_task, make_gap_task, replay_gap
from hdagen.blind.realities.cases import Case, draw_cases
from hdagen.blind.realities.population import Population, read_population
from hdagen.blind.scores import Row, score_case
from hdagen.blind.subprocesses import HDAGEN_COMMAND, ChildError, request_log
from hdagen.campaign.campaign_run import run_arriving_tasks
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import TASK_FILE, ResultStore
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.campaign.task_runner import TaskRunner
from hdagen.support.atomic_write import is_partial_file, write_atomically
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.version import __version__

_LARGEST_JSON = 10_000_000  # bytes of a JSON file
_TRUE_FILE = "true.json"  # the truth, in a folder that only this process uses


class BlindError(Exception):
    """A check cannot be run; the message is a sentence."""


@dataclass(frozen=True)
class Check:
    """The request for a check. ``kind``, ``family``, ``background`` and ``model`` state the population that its cases
    are drawn from (no family: the one that the kind usually belongs to). ``cluster``: where cases are diagnosed;
    ``seconds``: length of each log; ``out``: folder of the results; ``keep``: logs and pages of the cases stay there;
    ``keep_searches``: logs and searches stay there, so that the cases can be decided again;
    ``program``: command that runs as ``hdagen`` (tests give another one; none: each worker's own)."""

    kind: str
    count: int
    seed: str
    cluster: ClusterRequest
    seconds: float
    out: Path
    keep: bool = False
    program: tuple[str, ...] = ()
    family: str | None = None
    background: float | None = None
    model: str = ""
    keep_searches: bool = False

    @property
    def population(self) -> Population:
        """The population that the cases are drawn from."""
        stated = {"kind": self.kind, "family": self.family, "background": self.background, "model": self.model}
        return read_population(stated)


def run_check(asked: Check, said: Callable[[str], None]) -> tuple[list[Row], label_seal.Seal]:
    """Run a check; finished cases stay in ``out``/cases and are not run again with the same seed.

    Args:
        asked: the request.
        said: called with a sentence about the progress.

    Returns:
        The scored rows in the order of the cases, and the seal that was verified.

    Raises:
        BlindError: the folder holds another check, or a result cannot be read.
        ChildError: a case could not be simulated.
        seal.SealError: the labels changed between sealing and scoring.

    """
    drawn = draw_cases(asked.seed, asked.population, asked.count)
    labels = {case.name: case.label() for case in drawn}
    closed = label_seal.seal_labels(labels, asked.seed)
    _claim_folder(asked, closed)
    said(f"sealed: {closed.count} labels, SHA-256 {closed.digest}")
    store = ResultStore(asked.out / "cases")
    store.folder.mkdir(exist_ok=True)
    with store.hold_lock(), open_cluster(asked.cluster, said, needs_processes=True) as runner:
        told = _diagnose_cases(asked, drawn, store, runner, said)
        _measure_cases(asked, drawn, told, store, runner, said)
    for case in drawn:
        _discard_logs(asked, case)
    label_seal.verify_seal(labels, asked.seed, closed)
    said(f"opened: the {closed.count} labels are those that were sealed; the seed was {asked.seed}")
    return [_score_case(asked, case, labels[case.name], told[case.name]) for case in drawn], closed


def _claim_folder(asked: Check, closed: label_seal.Seal) -> None:
    """Make the folder this check's; raise BlindError where it holds anything else."""
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / "seal.json"
    mine = {
        "seal": closed.digest,
        **asdict(asked.population),
        "cases": asked.count,
        "seconds": asked.seconds,
        "version": __version__,
    }
    if path.exists():
        try:
            found = read_json(path, _LARGEST_JSON, "name another folder")
        except InputFileError:
            found = None
        if found != mine:
            raise BlindError(
                f"{asked.out}: holds another check (other seed, population, number or length of cases, or version); "
                "name another folder with --out, or give the seed it was started with to go on."
            )
        return
    if not all(map(is_partial_file, asked.out.iterdir())):
        raise BlindError(f"{asked.out}: is not empty and holds no check; name another folder with --out.")
    write_atomically(path, json.dumps(mine, indent=1).encode())


def _diagnose_cases(
    asked: Check, drawn: Sequence[Case], store: ResultStore, runner: TaskRunner, said: Callable[[str], None]
) -> dict[str, dict[str, Any]]:
    """Make the log of each case as its turn comes and have it diagnosed; return the truth of each, which no file
    holds."""
    told: dict[str, dict[str, Any]] = {}
    outcomes: dict[str, Outcome] = {}

    def make_tasks() -> Iterator[Task]:
        for index, case in enumerate(drawn):
            folder = asked.out / "cases" / case.name
            folder.mkdir(parents=True, exist_ok=True)
            log = {"motion": "log", "out": str((folder / "log.parquet").absolute())}
            told[case.name] = request_log(_describe_case(asked, index) | log)
            if (folder / "result.json").exists():
                continue
            write_atomically(folder / "robot.toml", case.robot.toml().encode())
            task = make_diagnosis_task(folder, f"{case.name}/out", asked.program, asked.keep_searches)
            kept = store.find_finished(task)
            if kept is None:
                yield task
                continue
            outcomes[task.name] = kept
            if kept.status is not Status.DONE:
                _write_result(asked, case, _describe_failure(kept))

    names = {f"{case.name}/out": case for case in drawn}
    for task, outcome in run_arriving_tasks(make_tasks(), _count_open_cases(asked, drawn), store, runner, said):
        outcomes[task.name] = outcome
        if outcome.status is not Status.DONE:
            _write_result(asked, names[task.name], _describe_failure(outcome))
    store.write_table(outcomes)
    return told


def _count_open_cases(asked: Check, drawn: Sequence[Case]) -> int:
    """How many cases have no result yet."""
    return sum(not (asked.out / "cases" / case.name / "result.json").exists() for case in drawn)


def _measure_cases(
    asked: Check,
    drawn: Sequence[Case],
    told: Mapping[str, Mapping[str, Any]],
    store: ResultStore,
    runner: TaskRunner,
    said: Callable[[str], None],
) -> None:
    """Measure the gaps of the diagnosed cases on hold-outs, which are made only now; write their result.json."""
    found: dict[str, dict[str, Any]] = {}

    def make_tasks() -> Iterator[Task]:
        for index, case in enumerate(drawn):
            folder = asked.out / "cases" / case.name
            if (folder / "result.json").exists():
                continue
            held = {"motion": "hold_out", "out": str((folder / "hold_out.parquet").absolute())}
            request_log(_describe_case(asked, index) | held | {"truth": told[case.name]["parameters"]})
            found[case.name] = dict(read_json(folder / "out" / TASK_FILE, _LARGEST_JSON, "check again")["row"])
            try:
                found[case.name] |= _measure_true_gap(asked, folder, case)
            except ChildError as error:
                _write_result(asked, case, {"failed": str(error)})
                continue
            yield make_gap_task(folder, f"{case.name}/gap", case.robot.noise(), asked.program)

    names = {f"{case.name}/gap": case for case in drawn}
    for task, outcome in run_arriving_tasks(make_tasks(), _count_open_cases(asked, drawn), store, runner, said):
        case = names[task.name]
        result = _describe_failure(outcome)
        if outcome.status is Status.DONE:
            result = found[case.name] | dict(outcome.row)
        _write_result(asked, case, result)


def _describe_case(asked: Check, index: int) -> dict[str, Any]:
    """A case for the child that makes its logs."""
    return {"seed": asked.seed, **asdict(asked.population), "index": index, "seconds": asked.seconds}


def _describe_failure(outcome: Outcome) -> dict[str, Any]:
    return {"failed": " ".join(outcome.messages)}


def _write_result(asked: Check, case: Case, result: Mapping[str, Any]) -> None:
    write_atomically(asked.out / "cases" / case.name / "result.json", json.dumps(result, indent=1).encode())


def _measure_true_gap(asked: Check, folder: Path, case: Case) -> dict[str, Any]:
    """The replay's gap with the truth, where a file can state it; in this process, for no other may know. Raises
    ChildError."""
    true = case.true_diagnosis()
    if true is None:
        return {}
    with TemporaryDirectory(prefix="hdagen-truth-") as own:
        place = Path(own)
        for name in ("robot.toml", "hold_out.parquet"):
            shutil.copyfile(folder / name, place / name)
        (place / _TRUE_FILE).write_text(json.dumps(true), encoding="utf-8")
        program = asked.program or HDAGEN_COMMAND
        return {"after_true": replay_gap(program, place, "after_true", ["--with", _TRUE_FILE], case.robot.noise())}


def _discard_logs(asked: Check, case: Case) -> None:
    """Remove logs and page of a case, where they are not kept."""
    folder = asked.out / "cases" / case.name
    if asked.keep:
        return
    for path in [*folder.glob("*.parquet"), *(folder / "out").glob("*.html")]:
        if path.name != "log.parquet" or not asked.keep_searches:
            path.unlink()


def _score_case(asked: Check, case: Case, label: Mapping[str, Any], told: Mapping[str, Any]) -> Row:
    folder = asked.out / "cases" / case.name
    try:
        result, said = read_json(folder / "result.json", _LARGEST_JSON, "remove it, and check again"), None
    except InputFileError as error:
        raise BlindError(str(error)) from None
    with suppress(InputFileError):
        said = read_json(folder / "out" / "diagnosis.json", _LARGEST_JSON, "check again")
    return score_case(case.name, label, told, result, said)
