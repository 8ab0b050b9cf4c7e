"""Whether two checkouts say the same, to the bit: `python tests/support/compare_checkouts.py OLD NEW CASES.toml --out
DIR`.

CASES.toml has a `[[case]]` for each log: name, robot, log = [paths], and, where there are any, hold_out = [paths] and
columns. Each checkout diagnoses every case and replays its first log with the diagnosis; both simulate every
controller. Then the numbers of diagnosis.json and of every table are compared. A key that has another name in the newer
schema is looked up under that name. Prints a line for each case, and each difference; exits 1 where there is one.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow.parquet

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.task import Status, Task, TaskFolder

RENAMED = {  # key of schema 1 -> key of schema 2
    "alone": "direct_evidence",
    "doubted": "doubts",
    "tolerated": "nuisance_effects",
    "unseen": "undetectable",
    "ladder": "ranking",
    "uncalibrated": "uncalibrated_probability",
    "present_from": "present_size",
    "sure_below": "most_doubt",
    "tolerated_share": "nuisance_width",
}
CHANGED = {"schema"}  # keys whose values are meant to differ
TIMES = {"prepare_time", "tick_time"}  # columns of a clock, which differ from run to run
SETTINGS = {"settings"}  # keys that only the newer schema has
CONTROLLERS = ("position", "impedance_cartesian", "impedance_joint", "admittance_cartesian", "admittance_joint", "mpc")


def run_command(checkout: Path, arguments: Sequence[str]) -> str:
    """Standard output of `hdagen` with ``arguments`` in a checkout; PlantError where it fails."""
    environment = os.environ | {"PYTHONPATH": str(checkout), "HDAGEN_BUILD": str(checkout / "build")}
    command = [sys.executable, "-m", "hdagen", *arguments]
    done = subprocess.run(
        command, cwd=checkout, env=environment | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise PlantError(f"{checkout}: hdagen {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout


def diagnose_case(checkout: Path, case: dict[str, Any], folder: Path) -> None:
    """Write diagnosis.json and predicted.parquet of a case into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    robot, columns = case["robot"], ["--columns", case["columns"]] if "columns" in case else []
    hold_out = ["--hold-out", *case["hold_out"]] if case.get("hold_out") else []
    if not (folder / "diagnosis.json").exists():
        run_command(checkout, ["diagnose", robot, *case["log"], *columns, *hold_out, "--out", str(folder)])
    said = ["--with", str(folder / "diagnosis.json"), "--out", str(folder / "predicted.parquet")]
    run_command(checkout, ["replay", robot, case["log"][0], *columns, *said])


def simulate_all(checkout: Path, folder: Path) -> None:
    """Write a table of half a second of every controller into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in CONTROLLERS:
        out = ["--out", str(folder / f"{name}.parquet")]
        run_command(checkout, ["simulate", "paper", "--controller", name, "--seconds", "0.5", *out])


def work_in_checkout(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Diagnose a case in a checkout, or simulate where there is none."""
    checkout, out, case = Path(parameters["checkout"]), Path(parameters["out"]), parameters["case"]
    if case is None:
        simulate_all(checkout, out)
    else:
        diagnose_case(checkout, case, out)
    return {}


def walk_values(content: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number, word and truth of a JSON document with its path."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from walk_values(value, f"{path}.{key}" if path else key)
    elif isinstance(content, list):
        for index, value in enumerate(content):
            yield from walk_values(value, f"{path}[{index}]")
    else:
        yield path, content


def rename_keys(content: Any) -> Any:
    """A document of schema 1 with the keys of schema 2."""
    if isinstance(content, dict):
        return {RENAMED.get(key, key): rename_keys(value) for key, value in content.items()}
    if isinstance(content, list):
        return [rename_keys(value) for value in content]
    return content


def compare_documents(old: Path, new: Path) -> list[str]:
    """A line for each value that differs between two diagnosis.json."""
    first = dict(walk_values(rename_keys(json.loads(old.read_text(encoding="utf-8")))))
    second = dict(walk_values(json.loads(new.read_text(encoding="utf-8"))))
    skipped = CHANGED | SETTINGS
    paths = [path for path in dict.fromkeys([*first, *second]) if path.split(".")[0] not in skipped]
    absent = object()
    pairs = [(path, first.get(path, absent), second.get(path, absent)) for path in paths]
    return [f"{path}: {was!r} -> {now!r}" for path, was, now in pairs if was != now]


def compare_tables(old: Path, new: Path) -> list[str]:
    """A line for each column that differs between two tables."""
    first, second = pyarrow.parquet.read_table(old), pyarrow.parquet.read_table(new)
    if first.column_names != second.column_names:
        return [f"columns: {first.column_names} -> {second.column_names}"]
    measured = [name for name in first.column_names if name not in TIMES]
    return [
        f"column {name}"
        for name in measured
        if first[name].to_numpy().tobytes() != second[name].to_numpy().tobytes()  # NaN is the same as NaN
    ]


def compare_folders(old: Path, new: Path) -> list[str]:
    """A line for each difference between what two checkouts wrote."""
    found: list[str] = []
    for path in sorted(old.glob("*.parquet")):
        found += [f"{path.name}: {line}" for line in compare_tables(path, new / path.name)]
    if (old / "diagnosis.json").exists():
        found += compare_documents(old / "diagnosis.json", new / "diagnosis.json")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    cases = tomllib.loads(given.cases.read_text(encoding="utf-8"))["case"]
    out = given.out.resolve()
    sides = {"old": given.old.resolve(), "new": given.new.resolve()}
    works = {"simulate": None, **{case["name"]: case for case in cases}}
    tasks = [
        Task(f"{side} {name}", work_in_checkout, {"checkout": str(tree), "case": case, "out": str(out / side / name)})
        for name, case in works.items()
        for side, tree in sides.items()
    ]
    with open_cluster(ClusterRequest(jobs=given.jobs), print) as runner, closing(runner.run_tasks(tasks)) as ended:
        for task, outcome in ended:
            if outcome.status is not Status.DONE:
                raise SystemExit(f"{task.name}: {' '.join(outcome.messages)}")
    differences = 0
    for name in works:
        found = compare_folders(out / "old" / name, out / "new" / name)
        differences += len(found)
        print(f"{name}: {'the same' if not found else f'{len(found)} differences'}")
        for line in found[:40]:
            print(f"  {line}")
    print(f"{len(cases)} logs and {len(CONTROLLERS)} controllers: {differences} differences")
    return int(differences > 0)


if __name__ == "__main__":
    from compare_checkouts import main as run_here  # by the name that workers can import

    sys.exit(run_here())
