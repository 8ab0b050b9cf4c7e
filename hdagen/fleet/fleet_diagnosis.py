"""Many logs of many machines: those of a fleet.toml, each a task, kept where an earlier run finished it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.fleet.machine_task import make_machine_task
from hdagen.support.atomic_write import write_atomically
from hdagen.support.version import __version__

FLEET_SCHEMA = 2
STATUS_WORDS = {
    Status.DONE: "diagnosed",
    Status.REFUSED: "refused",  # its log cannot carry a diagnosis
    Status.FAILED: "failed",  # its robot file cannot be built, or the program broke; tried again the next time
    Status.NOT_RUN: "not run",  # interrupted before it was finished
}


@dataclass(frozen=True)
class MachineResult:
    """How the task of ``machine`` ended."""

    machine: FleetMachine
    outcome: Outcome

    @property
    def row(self) -> Mapping[str, Any] | None:
        """The result of a machine that is diagnosed, as `summarize_diagnosis` makes it."""
        if self.outcome.status is not Status.DONE:
            return None
        return self.outcome.row

    @property
    def status_word(self) -> str:
        """How it ended, in a word."""
        return STATUS_WORDS[self.outcome.status]


def diagnose_fleet(
    machines: Sequence[FleetMachine],
    out: Path,
    asked: ClusterRequest,
    say: Callable[[str], None],
    make_task: Callable[[FleetMachine], Task] = make_machine_task,
) -> tuple[list[MachineResult], bool]:
    """Diagnose the machines that an earlier run has not finished.

    Args:
        machines: The machines.
        out: Folder of the results, a folder in it for each machine.
        asked: Where diagnoses run.
        say: Hears how far the work is.
        make_task: Makes the task of a machine.

    Returns:
        Results in the order of the machines, and whether an interrupt stopped the work: finished machines are then
        complete, and the others are not run.

    Raises:
        PlantError: The folder is another run's, or no worker can take tasks; what is finished is kept.
        OSError: A result cannot be written.

    """
    store = ResultStore(out)
    with store.hold_lock(), open_cluster(asked, say) as runner:
        outcomes, interrupted = run_campaign([make_task(machine) for machine in machines], store, runner, say)
    return [MachineResult(machine, outcomes[machine.name]) for machine in machines], interrupted


def summarize_fleet(results: Sequence[MachineResult]) -> dict[str, Any]:
    """Sum a fleet up as fleet.json holds it; the same results give the same content.

    Args:
        results: Results of all machines.

    Returns:
        Counts, effects with their machines, and a row for each machine.

    """
    effects: dict[str, list[str]] = {}
    for one in results:
        for effect in one.row["verdict"] if one.row else ():
            effects.setdefault(effect, []).append(one.machine.name)
    ended = Counter(one.outcome.status for one in results)
    return {
        "schema": FLEET_SCHEMA,
        "version": __version__,
        "counts": {word: ended[status] for status, word in STATUS_WORDS.items()},
        "effects": dict(sorted(effects.items(), key=lambda item: (-len(item[1]), item[0]))),
        "machines": [_summarize_result(one) for one in results],
    }


def _summarize_result(one: MachineResult) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": one.machine.name,
        "robot": one.machine.robot,
        "log": str(one.machine.log),
        "date": one.machine.date,
        "status": one.status_word,
        "says": list(one.outcome.messages),
    }
    if one.row is None:
        return row
    shown = ("verdict", "sure", "probability", "gap", "repaired", "warnings")
    return row | {key: one.row[key] for key in shown} | {"folder": one.machine.name}


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON, whole or not at all.

    Args:
        path: Where the file goes.
        content: The content, whose numbers are finite.

    Raises:
        OSError: The file cannot be written.

    """
    write_atomically(path, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
