"""Cases written to disk beside their labels, for developing a diagnosis: they are not sealed and no check."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hdagen.blind.case_tasks import write_case
from hdagen.blind.realities.cases import Case, draw_cases
from hdagen.blind.realities.population import Population
from hdagen.blind.subprocesses import ChildError
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Status, Task
from hdagen.support.atomic_write import write_atomically


def export_cases(
    out: Path,
    population: Population,
    count: int,
    seed: str,
    cluster: ClusterRequest,
    seconds: float,
    said: Callable[[str], None],
) -> Path:
    """Write cases with their logs and labels.

    Args:
        out: folder of all populations.
        population: that the cases are drawn from.
        count: how many cases.
        seed: the seed that the cases are drawn from.
        cluster: where cases are made.
        seconds: length of each log, s.
        said: called with a sentence about the progress.

    Returns:
        The folder of the population in ``out``: case-000 … with robot.toml, log.parquet and hold_out.parquet, and
        labels.json.

    Raises:
        ChildError: a case could not be simulated.

    """
    folder = out / population.name.replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {f"case-{index:03d}": case for index, case in enumerate(draw_cases(seed, population, count))}
    tasks = [
        Task(name, write_case, {"seed": seed, **asdict(population), "index": index, "seconds": seconds})
        for index, name in enumerate(drawn)
    ]
    store = ResultStore(folder)
    with store.hold_lock(), open_cluster(cluster, said) as runner:
        outcomes, interrupted = run_campaign(tasks, store, runner, said)
    labels = {name: _label_case(drawn[name], one.row) for name, one in outcomes.items() if one.status is Status.DONE}
    for name in labels:
        write_atomically(folder / name / "robot.toml", drawn[name].robot.toml().encode())
    write_atomically(folder / "labels.json", json.dumps(labels, indent=1).encode())
    if interrupted:
        raise KeyboardInterrupt
    for one in outcomes.values():
        if one.status is not Status.DONE:
            raise ChildError(one.messages[0])
    return folder


def _label_case(case: Case, told: Mapping[str, Any]) -> dict[str, object]:
    label = case.label()
    names = (*label["verdict"], *label.get("optional", []))
    return {**label, "snr": told["snr"], "parameters": {name: told["parameters"][name] for name in names}}
