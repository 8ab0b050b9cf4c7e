"""Commands and builds that are killed time after time, each series of kills a task.

    python tests/support/kill_campaign.py --kills 30 --jobs 2 --out DIR

DIR keeps the series and a table of them, results.parquet; an interrupted campaign goes on by the same command.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from arms import SMALL
from kept_builds import find_builds
from stub_compiler import stub_compiler

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.installation import describe_installation
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status, Task, TaskFile, TaskFolder

ROOT = Path(__file__).parents[2]
ROOMS = ("support", "cli", "diagnosis/report")  # whose modules the programs import
PATHS = os.pathsep.join((str(ROOT), *(str(ROOT / "tests" / room) for room in ROOMS)))
COMMANDS = ("adopt", "diagnose", "fleet", "paper", "blind")  # of kill_commands.py, which imports half of the project
BUILD = "build"
LONGEST_BUILDS = 600  # s of kills of builds
LEAST_KILLS = 20  # kills from which on some must have come while files were written


def make_series(names: tuple[str, ...], kills: int, seed: int = 1) -> list[Task]:
    """A task for each series: the command's name, and the program with its own content as a file."""
    tasks = []
    for name in names:
        program = Path(__file__).with_name("kill_builds.py" if name == BUILD else "kill_commands.py")
        files = {"program.py": TaskFile(program, program.name)}
        parameters = {"name": name, "kills": kills, "seed": seed, "code": describe_installation()["code"]}
        tasks.append(Task(name, kill_time_after_time, parameters, files))
    return tasks


def kill_time_after_time(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """A series of kills in a process of its own; leaves what was found in kills.json."""
    place, name = folder.out.parent / "place", parameters["name"]
    place.mkdir()
    own = {"PYTHONPATH": PATHS, "OMP_NUM_THREADS": "1", "HDAGEN_BUILD": str(find_builds())}
    given = [name, str(place), str(parameters["kills"]), str(parameters["seed"])]
    if name == BUILD:
        (place / "robot.toml").write_text(SMALL)
        own["CC"] = str(stub_compiler(place))
        given = [str(place / "robot.toml"), str(place / "build"), *given[2:], str(LONGEST_BUILDS)]
    program = ROOT / "tests" / "support" / folder.labels["program.py"]
    done = subprocess.run(
        [sys.executable, str(program), *given], env=os.environ | own, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise PlantError(f"{program.name} {name}: {done.stderr.strip()[-800:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    (folder.out / "kills.json").write_text(json.dumps(found, indent=1))
    return found | {"faults": [*list_faults(name, found, parameters["kills"])]}


def list_faults(name: str, found: Mapping[str, Any], kills: int) -> Iterator[str]:
    """What a series found that must not be, a sentence each."""
    if found["kills"] != kills:
        yield f"{name}: {found['kills']} kills of {kills} were made."
    if name == BUILD:
        yield from (f"{name}: {found[key]} {key}." for key in ("broken", "uncleaned", "failed") if found[key])
        if found["leftovers"] <= kills / 10:
            yield f"{name}: too few kills came in mid-build to show anything ({found['leftovers']})."
        return
    yield from (f"{name}: half-written: {path}." for path in found["broken"])
    yield from (f"{name}: a part is left: {path}." for path in found["parts"])
    if found["orphans"]:
        yield f"{name}: {found['orphans']} kills left processes."
    if found["code"] and (name, found["code"]) != ("blind", 1):  # 1: a bar that two cases cannot meet
        yield f"{name}: the run to the end has exit code {found['code']}."
    if not found["files"]:
        yield f"{name}: the run to the end left no file."
    if not found["left"] and kills >= LEAST_KILLS:
        yield f"{name}: no kill came while a file was written."


def run_kills(tasks: list[Task], folder: Path, jobs: int = 1) -> Mapping[str, Outcome]:
    """Outcomes of the series, by name; those that an earlier call finished are kept."""
    store = ResultStore(folder)
    with store.hold_lock(), open_cluster(ClusterRequest(jobs=jobs), say) as runner:
        return run_campaign(tasks, store, runner, say)[0]


def list_all_faults(outcomes: Mapping[str, Outcome]) -> list[str]:
    """What must not be, of all series."""
    faults: list[str] = []
    for name, one in outcomes.items():
        faults += one.row.get("faults", [])
        faults += [f"{name}: {words}" for words in one.messages]
    return faults


def say(words: str) -> None:
    """A sentence on the campaign, on standard error."""
    print(words, file=sys.stderr, flush=True)


def main() -> int:
    """A campaign; exit code 1 where something must not be, 130 where it was interrupted."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", default=[*COMMANDS, BUILD], help="(default: all)")
    parser.add_argument("--kills", type=int, default=30, help="of each series (default: 30)")
    parser.add_argument("--jobs", type=int, default=1, help="series at the same time (default: 1)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keeps what is finished (default: nothing is kept)")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hdagen-kills-") as place:
        folder = given.out or Path(place)
        folder.mkdir(parents=True, exist_ok=True)
        outcomes = run_kills(make_series(tuple(given.names), given.kills), folder, given.jobs)
    faults = list_all_faults(outcomes)
    print(json.dumps({"kills": sum(one.row.get("kills", 0) for one in outcomes.values()), "faults": faults}, indent=1))
    if any(one.status is Status.NOT_RUN for one in outcomes.values()):
        return 130
    return int(bool(faults))


if __name__ == "__main__":
    from kill_campaign import main as run_here  # by the name that workers can import

    sys.exit(run_here())
