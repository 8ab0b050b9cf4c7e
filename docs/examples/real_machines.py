"""What `hdagen diagnose` says of real machines, beside what is known of them from elsewhere.

    python docs/examples/real_machines.py DATA [--out DIR] [--only NAME …] [--jobs J] [--json FILE]

DATA is the folder of the recorded sets, one folder each; the pages of the examples say where they come from. Converts
every log of a case as its page does, writes DIR/manifest.json, diagnoses each case by the command, in a process of its
own, and prints a table. `named`: the verdict has one name of each part of the known answer, and none that is known to
be wrong. `closed`: (before - after) / (before - achievable), where a tenth or more can be closed; `half`: after is at
most half of before, where achievable is. FILE gets the same as JSON; docs/real.json is such a file.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recorded_machines import CASES, FRICTIONS, Case, Recording
from rich import box
from rich.console import Console
from rich.table import Table

from hdagen.arm.build_loader import PlantError
from hdagen.bench.host_computer import describe_machine
from hdagen.campaign.campaign_run import run_arriving_tasks
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Status, Task, TaskFile, TaskFolder
from hdagen.log import read, write

EXAMPLES = Path(__file__).resolve().parent
CLOSABLE = 0.9  # of before, below which achievable leaves something to close
LEAST_CLOSED, MOST_AFTER = 0.60, 1.02  # median over the cases; after over before, in each
WIDTH = 120  # of the printed table
LONGEST = len("load_dependent_friction@1")


# -- from recorded files to a diagnosis -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Inputs:
    """What the command gets of a case: ``robot`` a preset's name or a path."""

    robot: str
    logs: tuple[Path, ...]
    hold_out: tuple[Path, ...]


class DiagnosisFailed(RuntimeError):
    """`hdagen diagnose` ended with an error; the text is what it said."""


def convert(case: Case, data: Path, out: Path) -> Inputs:
    """The logs of a case as Parquet in ``out``. FileNotFoundError where a recording is not under ``data``."""
    out.mkdir(parents=True, exist_ok=True)
    logs, held = (
        tuple(
            _converted(recording, path, out / f"{role}_{k}.parquet")
            for k, (recording, path) in enumerate(
                ((one, path) for one in recordings for path in _sources(one, data)), start=1
            )
        )
        for role, recordings in (("log", case.logs), ("hold_out", case.hold_out))
    )
    robot = str(EXAMPLES / case.robot) if case.robot.endswith(".toml") else case.robot
    return Inputs(robot, logs, held)


def _sources(recording: Recording, data: Path) -> list[Path]:
    files = sorted(data.glob(recording.pattern))
    if not files:
        raise FileNotFoundError(f"no recorded logs: nothing matches {data / recording.pattern}")
    return files


def _converted(recording: Recording, source: Path, out: Path) -> Path:
    converter = EXAMPLES / recording.converter
    if converter.suffix == ".toml":
        write(read(source, converter, recording.joints), out)
    else:
        more = [recording.argument] if recording.argument else []
        subprocess.run([sys.executable, "-W", "error", converter, source, *more, out], check=True)
    return out


def make_case_task(case: Case, inputs: Inputs) -> Task:
    """The task that diagnoses a case."""
    robot = Path(inputs.robot)
    paths = [*inputs.logs, *inputs.hold_out]
    if robot.is_file():
        paths.append(robot)
    parameters = {
        "robot": robot.name,
        "logs": [path.name for path in inputs.logs],
        "hold_out": [path.name for path in inputs.hold_out],
    }
    return Task(case.name, diagnose_recordings, parameters, {path.name: TaskFile(path, path.name) for path in paths})


def diagnose_recordings(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Leaves what the command writes of a case, and returns its verdict. Raises PlantError."""
    logs, held = (tuple(map(Path, parameters[key])) for key in ("logs", "hold_out"))
    try:
        found = diagnose(Inputs(parameters["robot"], logs, held), folder.out, folder.out.parent)
    except DiagnosisFailed as failure:
        raise PlantError(str(failure)) from None
    return {"verdict": found["verdict"]}


def diagnose(inputs: Inputs, out: Path, folder: Path | None = None) -> dict[str, Any]:
    """The content of diagnosis.json, which stands in ``out``; paths start at ``folder``. Raises DiagnosisFailed."""
    held: list[str | Path] = ["--hold-out", *inputs.hold_out] if inputs.hold_out else []
    command: list[str | Path] = [
        sys.executable,
        "-m",
        "hdagen",
        "diagnose",
        inputs.robot,
        *inputs.logs,
        *held,
        "--out",
        out,
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise DiagnosisFailed(done.stderr)
    return json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))


# -- what it says, and how good that is -------------------------------------------------------------------------------


def is_named(case: Case, verdict: Sequence[str]) -> bool:
    """Whether a verdict has one name of each part of the answer, and none of those that are wrong."""
    said = {*verdict, *(entry.split("@")[0] for entry in verdict)}
    return all(said & {*part} for part in case.answer) and not said & {*case.wrong}


def describe_answer(case: Case) -> str:
    """The answer in words."""
    parts = ["any friction" if part == FRICTIONS else " or ".join(part) for part in case.answer]
    return " and ".join(parts) or f"not {' or '.join(case.wrong)}"


def summarize(case: Case, found: Mapping[str, Any]) -> dict[str, Any]:
    """What the table says of a case, and the sizes of what the verdict names, from its diagnosis."""
    gap, verdict = found["gap"], found["verdict"]
    before, after, achievable = (gap[key] for key in ("before", "after", "achievable"))
    return {
        "name": case.name,
        "machine": case.machine,
        "page": Path(case.logs[0].converter).parts[0],
        "answer": describe_answer(case),
        "verdict": verdict,
        "sure": found["sure"],
        "before": before,
        "after": after,
        "achievable": achievable,
        "closed": (before - after) / (before - achievable) if achievable < CLOSABLE * before else None,
        "named": is_named(case, verdict),
        "halved": after <= before / 2 if achievable <= before / 2 else None,
        "sizes": {
            f"{cause['effect']}@{cause['joint']}": cause["parameters"]
            for cause in found["causes"]
            if f"{cause['effect']}@{cause['joint']}" in verdict
        },
        "where": found["where"],
    }


def judge(rows: Sequence[Mapping[str, Any]], asked: int) -> list[dict[str, Any]]:
    """The bars over all ``asked`` cases, of which those that ended have a row."""
    halved = [row["halved"] for row in rows if row["halved"] is not None]
    closed = [row["closed"] for row in rows if row["closed"] is not None]
    worst = [row["after"] / row["before"] for row in rows]
    return [
        {"name": "known answer named", "reached": sum(row["named"] for row in rows), "asked": asked, "bound": "least"},
        {"name": "gap halved where it can be", "reached": sum(halved), "asked": len(halved), "bound": "least"},
        {
            "name": "closed of what can be, median",
            "reached": statistics.median(closed) if closed else 0.0,
            "asked": LEAST_CLOSED,
            "bound": "least",
        },
        {"name": "after / before, largest", "reached": max(worst, default=0.0), "asked": MOST_AFTER, "bound": "most"},
    ]


def print_table(rows: Sequence[Mapping[str, Any]], bars: Sequence[Mapping[str, Any]]) -> None:
    """A row a case and a line a bar, on the standard output."""
    table = Table(box=box.SIMPLE_HEAD, padding=0, show_edge=False)
    table.add_column("machine", max_width=24)
    table.add_column("known answer", min_width=LONGEST)
    table.add_column("verdict", min_width=LONGEST)
    for head in ("sure", "before", "after", "achiev.", "closed", "named", "half"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        numbers = [_number(row[key]) for key in ("before", "after", "achievable")]
        closed = "" if row["closed"] is None else f"{row['closed']:.2f}"
        judged = (_word(row[key]) for key in ("named", "halved"))
        verdict = "\n".join(row["verdict"]) or "none"
        table.add_row(row["machine"], row["answer"], verdict, _word(row["sure"]), *numbers, closed, *judged)
    Console(width=WIDTH, highlight=False, markup=False).print(table)
    for bar in bars:
        met = bar["reached"] >= bar["asked"] if bar["bound"] == "least" else bar["reached"] <= bar["asked"]
        print(
            f"{bar['name']}: {bar['reached']:.3g}, at {bar['bound']} {bar['asked']:.3g}: {'met' if met else 'missed'}"
        )


def _number(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _word(holds: bool | None) -> str:
    return "" if holds is None else "yes" if holds else "no"


# -- the command ------------------------------------------------------------------------------------------------------


def main() -> int:
    """Convert, diagnose, print; 1 where a diagnosis failed."""
    options = _options()
    cases = [case for case in CASES if not options.only or case.name in options.only]
    try:
        inputs = {case.name: convert(case, options.data, options.out / case.name) for case in cases}
    except FileNotFoundError as error:
        print(f"{error}; give the folder that holds the sets.", file=sys.stderr)
        return 2
    manifest = {
        case.name: {
            "robot": one.robot,
            "logs": [str(path) for path in one.logs],
            "hold_out": [str(path) for path in one.hold_out],
            "answer": case.answer,
            "wrong": case.wrong,
        }
        for case, one in ((case, inputs[case.name]) for case in cases)
    }
    (options.out / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")

    rows = diagnose_cases(cases, inputs, options)
    bars = judge(rows, len(cases))
    print_table(rows, bars)
    if options.json:
        content = {"machine": describe_machine(), "bars": bars, "cases": rows}
        options.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0 if len(rows) == len(cases) else 1


def diagnose_cases(
    cases: Sequence[Case], inputs: Mapping[str, Inputs], options: argparse.Namespace
) -> list[dict[str, Any]]:
    """Rows of the cases that ended well, each diagnosed anew; the others are said on standard error."""
    tasks, ended = [make_case_task(case, inputs[case.name]) for case in cases], set()
    store, jobs = ResultStore(options.out), ClusterRequest(jobs=options.jobs)
    with store.hold_lock(), open_cluster(jobs, print_progress) as runner:
        for task, outcome in run_arriving_tasks(tasks, len(tasks), store, runner, print_progress):
            if outcome.status is Status.DONE:
                ended.add(task.name)
            else:
                print_progress(f"{task.name}: {' '.join(outcome.messages)}")
    files = {case: options.out / case.name / "diagnosis.json" for case in cases if case.name in ended}
    return [summarize(case, json.loads(file.read_text(encoding="utf-8"))) for case, file in files.items()]


def print_progress(words: str) -> None:
    """Say how far the work is, on standard error."""
    print(words, file=sys.stderr)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Diagnose real machines and compare with what is known of them.")
    parser.add_argument("data", type=Path, metavar="DATA", help="the folder of the recorded sets")
    parser.add_argument("--out", type=Path, metavar="DIR", default=Path("real"), help="default: ./real")
    names = [case.name for case in CASES]
    parser.add_argument("--only", nargs="+", metavar="NAME", choices=names, help=f"of {', '.join(names)}")
    parser.add_argument("--jobs", type=int, metavar="J", default=1, help="diagnoses at the same time, default 1")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table as JSON, too")
    return parser.parse_args()


if __name__ == "__main__":
    from real_machines import main as run_here  # by the name that workers can import

    sys.exit(run_here())
