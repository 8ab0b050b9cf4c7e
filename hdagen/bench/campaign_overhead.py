"""What the engine of campaigns costs: `python -m hdagen.bench.campaign_overhead`, with tasks that sleep, or a fleet.

Processor time outside tasks is that of this process, which holds client and scheduler, and of the workers, less what
each task took; start and end of all processes are counted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hdagen.arm.build_loader import PlantError
from hdagen.bench.host_computer import describe_machine
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status, Task, TaskFolder
from hdagen.campaign.task_execution import measure_processor_seconds
from hdagen.campaign.task_runner import InProcessRunner
from hdagen.fleet.fleet_file import read_fleet
from hdagen.fleet.machine_task import make_machine_task
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json

CALLS_FILE = "calls.json"
_MOST_CALLS_BYTES = 10_000_000


def sleep_for_task(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Sleep, as a task that costs nothing.

    Args:
        folder: Stays empty.
        parameters: ``seconds`` of sleep.

    Returns:
        The parameters.

    """
    time.sleep(parameters["seconds"])
    return dict(parameters)


def measure_overhead(tasks: Sequence[Task], jobs: int, folder: Path) -> tuple[dict[str, Any], Mapping[str, Outcome]]:
    """Run tasks on workers of this machine, or in this process, and measure what they cost.

    A folder of an interrupted measurement is taken up: figures are sums over all calls that were not killed.

    Args:
        tasks: The tasks.
        jobs: Worker processes; 0 means this process.
        folder: Folder of the results, empty or that of an earlier call.

    Returns:
        The figures: counts, times in s, memory of this process in bytes when progress was told, the overhead, which is
        processor time outside tasks over that inside, and the hash of all results; and the outcomes.

    Raises:
        PlantError: No further task can be run, or the folder is that of another measurement.

    """
    calls = _read_calls(folder, jobs)
    begun, used = time.monotonic(), measure_processor_seconds()
    store, asked = ResultStore(folder), ClusterRequest(jobs=max(jobs, 1))
    memory: list[int] = [_measure_memory()]

    def say_progress(words: str) -> None:
        print(words, file=sys.stderr)
        memory.append(_measure_memory())

    with _count_messages() as written, store.hold_lock(), open_cluster(asked, say_progress, jobs > 0) as runner:
        ready, greeting = time.monotonic(), written["count"]
        outcomes, _ = run_campaign(tasks, store, runner, say_progress)
        ended, sent = time.monotonic(), written["count"] - greeting
    worked = [one for one in outcomes.values() if not one.is_reused and one.status is not Status.NOT_RUN]
    inside = sum(one.processor_seconds for one in worked)
    call = {
        "jobs": jobs,
        "tasks": len(worked),
        "start_seconds": ready - begun,
        "run_seconds": ended - ready,
        "processor_seconds_inside": inside,
        "processor_seconds_outside": measure_processor_seconds() - used - inside,
        "messages": sent,
        "memory": {"first": memory[0], "half": memory[len(memory) // 2], "most": max(memory), "last": memory[-1]},
    }
    if worked:
        calls.append(call)
        write_atomically(folder / CALLS_FILE, (json.dumps(calls, indent=1) + "\n").encode())
    ends = Counter(one.status.value for one in outcomes.values())
    return {"ended": dict(ends), **_sum_calls(calls), "results": hash_results(outcomes)}, outcomes


def _read_calls(folder: Path, jobs: int) -> list[dict[str, Any]]:
    """What earlier calls into this folder measured. Raises PlantError where they had other workers."""
    if not (folder / CALLS_FILE).exists():
        return []
    try:
        calls: list[dict[str, Any]] = read_json(folder / CALLS_FILE, _MOST_CALLS_BYTES, "remove it to begin again")
    except InputFileError as error:
        raise PlantError(error) from None
    if any(call["jobs"] != jobs for call in calls):
        raise PlantError(f"{folder}: it was begun with --jobs {calls[0]['jobs']}; give that number or another --out.")
    return calls


def _sum_calls(calls: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of one or more calls together."""
    names = ("tasks", "start_seconds", "run_seconds", "processor_seconds_inside", "processor_seconds_outside")
    total = {name: sum(call[name] for call in calls) for name in (*names, "messages")}
    inside, outside, count = (total[name] for name in ("processor_seconds_inside", names[-1], "tasks"))
    return {
        **total,
        "calls": len(calls),
        "tasks_per_second": count / total["run_seconds"] if count else None,
        "outside_per_task": outside / count if count else None,
        "messages_per_task": total["messages"] / count if count else None,
        "overhead": outside / inside if inside > 0 else None,
        "memory": [call["memory"] for call in calls],
        "machine": describe_machine(),
    }


def compare_with_one_process(
    tasks: Sequence[Task], outcomes: Mapping[str, Outcome], folder: Path
) -> dict[str, Sequence[str] | int]:
    """Run tasks in this process, and compare what came of them.

    Args:
        tasks: Some of the tasks.
        outcomes: What came of all tasks before, by their names.
        folder: Folder of these results, empty or that of an earlier call.

    Returns:
        The count of compared tasks, and the names of those with another status, row or message.

    Raises:
        PlantError: No further task can be run.

    """
    store = ResultStore(folder)
    with store.hold_lock():
        alone, _ = run_campaign(tasks, store, InProcessRunner(), lambda words: print(words, file=sys.stderr))
    ended = {name: one for name, one in alone.items() if one.status is not Status.NOT_RUN}
    differ = [name for name, one in ended.items() if hash_results({"": one}) != hash_results({"": outcomes[name]})]
    return {"compared": len(ended), "differ": differ}


def hash_results(outcomes: Mapping[str, Outcome]) -> str:
    """Hash what came of all tasks, without their times.

    Args:
        outcomes: By the tasks' names.

    Returns:
        SHA-256, hexadecimal: the same where every status, row and message is the same to the bit.

    """
    rows = {name: [one.status.value, dict(one.row), list(one.messages)] for name, one in outcomes.items()}
    return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()


@contextmanager
def _count_messages() -> Iterator[dict[str, int]]:
    """The messages that client, scheduler and supervisors, which live in this process, write to connections."""
    from distributed.comm.tcp import TCP

    written = {"count": 0}
    write: Any = TCP.write  # without types

    async def count_write(comm: TCP, *arguments: Any, **options: Any) -> Any:
        written["count"] += 1
        return await write(comm, *arguments, **options)

    with patch.object(TCP, "write", count_write):
        yield written


def _measure_memory() -> int:
    """Resident memory of this process, bytes."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the measurement and print it as JSON.

    Args:
        arguments: Of the command line; None: those of the process.

    Returns:
        The exit code.

    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tasks", type=int, default=10_000, metavar="N", help="tasks that sleep (default: 10000)")
    parser.add_argument("--seconds", type=float, default=0.01, metavar="T", help="sleep of each, s (default: 0.01)")
    parser.add_argument("--fleet", type=Path, metavar="fleet.toml", help="the machines of a fleet in their place")
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="J", help="worker processes, 0: this process (default: 2)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="keeps results here; the same command goes on later")
    parser.add_argument(
        "--compare-every", type=int, default=0, metavar="N", help="do each N-th task in this process, too, and compare"
    )
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="hdagen-overhead-") as place:
        try:
            found = _measure_as_asked(given, given.out or Path(place))
        except (PlantError, OSError) as error:
            print(error, file=sys.stderr)
            return 2
    print(json.dumps(found, indent=1))
    if Status.NOT_RUN.value in found["ended"]:
        return 130
    return int(bool(found.get("differ")))


def _measure_as_asked(given: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The figures that a command line asks for. Raises PlantError, OSError."""
    if given.fleet is not None:
        tasks = [make_machine_task(machine) for machine in read_fleet(given.fleet)]
    else:
        tasks = [
            Task(f"sleep-{k}", sleep_for_task, {"seconds": given.seconds, "number": k}) for k in range(given.tasks)
        ]
    for name in ("campaign", "one_process"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    found, outcomes = measure_overhead(tasks, given.jobs, folder / "campaign")
    if given.compare_every > 0 and Status.NOT_RUN.value not in found["ended"]:
        found |= compare_with_one_process(tasks[:: given.compare_every], outcomes, folder / "one_process")
    return found


if __name__ == "__main__":
    from hdagen.bench.campaign_overhead import main as run_here  # under the name that workers can import

    sys.exit(run_here())
