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

from hdagen.bench.host_computer import describe_machine
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Task, TaskFolder
from hdagen.campaign.task_execution import measure_processor_seconds
from hdagen.fleet.fleet_file import read_fleet
from hdagen.fleet.machine_task import make_machine_task


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


def measure_overhead(tasks: Sequence[Task], jobs: int, folder: Path) -> dict[str, Any]:
    """Run tasks on workers of this machine, or in this process, and measure what they cost.

    Args:
        tasks: The tasks.
        jobs: Worker processes; 0 means this process.
        folder: Empty folder of the results.

    Returns:
        Counts, times in s, memory of this process in bytes when progress was told, the overhead, which is processor
        time outside tasks over that inside, and the hash of all results.

    Raises:
        PlantError: No further task can be run.

    """
    begun, used = time.monotonic(), measure_processor_seconds()
    store, asked = ResultStore(folder), ClusterRequest(jobs=max(jobs, 1))
    memory: list[int] = []

    def say_progress(words: str) -> None:
        print(words, file=sys.stderr)
        memory.append(_measure_memory())

    with _count_messages() as written, store.hold_lock(), open_cluster(asked, say_progress, jobs > 0) as runner:
        ready, greeting = time.monotonic(), written["count"]
        outcomes, _ = run_campaign(tasks, store, runner, say_progress)
        ended, sent = time.monotonic(), written["count"] - greeting
    total = measure_processor_seconds() - used
    inside = sum(one.processor_seconds for one in outcomes.values())
    return {
        "tasks": len(tasks),
        "ended": {status.value: count for status, count in Counter(one.status for one in outcomes.values()).items()},
        "jobs": jobs,
        "start_seconds": ready - begun,
        "run_seconds": ended - ready,
        "tasks_per_second": len(tasks) / (ended - ready),
        "processor_seconds_inside": inside,
        "processor_seconds_outside": total - inside,
        "outside_per_task": (total - inside) / len(tasks),
        "overhead": (total - inside) / inside if inside > 0 else None,
        "messages_per_task": sent / len(tasks),
        "memory": {"first": memory[0], "half": memory[len(memory) // 2], "last": memory[-1]},
        "results": hash_results(outcomes),
        "machine": describe_machine(),
    }


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
    given = parser.parse_args(arguments)
    if given.fleet is not None:
        tasks = [make_machine_task(machine) for machine in read_fleet(given.fleet)]
    else:
        tasks = [
            Task(f"sleep-{k}", sleep_for_task, {"seconds": given.seconds, "number": k}) for k in range(given.tasks)
        ]
    with tempfile.TemporaryDirectory(prefix="hdagen-overhead-") as place:
        print(json.dumps(measure_overhead(tasks, given.jobs, Path(place)), indent=1))
    return 0


if __name__ == "__main__":
    from hdagen.bench.campaign_overhead import main as run_here  # under the name that workers can import

    sys.exit(run_here())
