"""`hdagen diagnose`: which unmodelled effect makes model and log differ, and how far the gap shrinks with it."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.cli.cluster_options import (
    add_cluster_options,
    count_job_slots,
    list_given_options,
    read_cluster_request,
)
from hdagen.cli.diagnosis_progress import show_progress
from hdagen.cli.failure_conditions import (
    CONDITION_MET,
    add_failure_options,
    check_failure_options,
    find_met_conditions,
)

if TYPE_CHECKING:
    from rich.table import Table

    from hdagen.fleet.fleet_diagnosis import MachineResult
    from hdagen.pages.number_table import TableCell

DIAGNOSE_EXAMPLE = """example:
  hdagen diagnose robot.toml log.parquet
  hdagen diagnose robot.toml log.parquet --hold-out other.parquet --out diagnosis-log
  hdagen diagnose robot.toml monday.parquet tuesday.parquet
  hdagen diagnose --fleet fleet.toml
  hdagen diagnose robot.toml log.parquet --fail-above 2.5 --fail-on payload@2
  hdagen diagnose robot.toml log.parquet --within 20

writes diagnosis.json and report.html; `hdagen replay --with` and `hdagen adopt` take the former. With --fleet: a folder
for each [[machine]] of fleet.toml, fleet.json and fleet.html.
exit codes: 0 done, 2 usage or configuration, 3 data unusable, 5 a condition of --fail-above or --fail-on is met; then
standard error says which; 7 the time of --within was up before there was anything to state. How it decides:
docs/method/index.md"""
DONE, USAGE, UNUSABLE = 0, 2, 3
THREADS_PER_DIAGNOSIS = 2  # that one diagnosis keeps busy


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "diagnose",
        help="say which unmodelled effect makes model and log differ",
        description="Fits every effect on every joint to a log and says which is missing in the model, how probable "
        "that is, and how far the gap shrinks on motion that the fit did not see.",
        epilog=DIAGNOSE_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", nargs="?", help="a preset or a robot.toml")
    p.add_argument("logs", nargs="*", type=Path, metavar="LOG", help=".csv, .parquet or .mat; several of one machine")
    p.add_argument("--columns", type=Path, metavar="columns.toml", help="names, units and signs of a foreign log")
    p.add_argument("--hold-out", nargs="+", type=Path, metavar="LOG", help="other motions of the same machine")
    p.add_argument("--out", type=Path, metavar="DIR", help="default: ./diagnosis-<log or fleet>")
    p.add_argument(
        "--within",
        type=float,
        metavar="SECONDS",
        help="state the best so far when the time is up: never sure, with a list of what was not tried",
    )
    p.add_argument(
        "--keep-searches", action="store_true", help="also write searches.npz, from which it can be decided again"
    )
    p.add_argument("--fleet", type=Path, metavar="fleet.toml", help="many logs, a [[machine]] with robot and log each")
    add_failure_options(p)
    add_cluster_options(p, "machines of a fleet", "half the cores")
    p.add_argument("-v", "--verbose", action="store_true", help="print every step of the search")
    p.add_argument("--json", action="store_true", help="print diagnosis.json or fleet.json, with where the page is")


def run(options: argparse.Namespace) -> int:
    """Diagnose, write, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    """
    _check_options(options)
    if options.fleet:
        return _diagnose_fleet(options)
    return _diagnose_machine(options)


def _check_options(options: argparse.Namespace) -> None:
    """Refuse options that do not go together. Raises PlantError."""
    from hdagen.arm.build_loader import PlantError

    problems = []
    if options.keep_searches and (options.within is not None or options.fleet is not None):
        problems.append("--keep-searches: goes with one whole diagnosis; leave out --within and --fleet.")
    if options.fleet is None:
        if options.robot is None or not options.logs:
            problems.append("give a robot file and a log, or --fleet fleet.toml.")
        problems += [f"{name}: goes with --fleet only." for name in list_given_options(options)]
    else:
        if options.within is not None:
            problems.append("--within: is the time of one diagnosis; leave it out with --fleet.")
        given = [name for name in ("robot", "columns", "hold_out") if getattr(options, name) is not None]
        if given:
            problems.append(f"--fleet: {', '.join(given)} stands in fleet.toml, by machine; leave it out here.")
    if problems:
        raise PlantError("\n".join(problems))


@contextmanager
def _make_folder(out: Path) -> Iterator[Path]:
    """``out``, made before the work; where that fails with nothing written, it is taken away again. Raises
    PlantError, also where it cannot be written into."""
    from hdagen.arm.build_loader import PlantError

    new = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise PlantError(f"--out {out}: cannot be made ({error.strerror}); name another folder.") from None
    try:
        yield out
    except OSError as error:
        raise PlantError(
            f"--out {out}: cannot be written into ({error.strerror}), and nothing is half-written; make room or name "
            "another folder."
        ) from None
    finally:
        if new and not any(out.iterdir()):
            out.rmdir()


def _diagnose_machine(options: argparse.Namespace) -> int:
    from hdagen.arm.joint_names import read_joint_names
    from hdagen.diagnosis.pipeline import diagnose
    from hdagen.diagnosis.report.sentences import write_verdict
    from hdagen.diagnosis.stages.stage import Stage
    from hdagen.diagnosis.stages.time_budget import TimeBudget
    from hdagen.log.measured_log import check_log_file, read
    from hdagen.support.heap_memory import tune_malloc

    budget = TimeBudget(options.within)
    for path in (*options.logs, *(options.hold_out or ())):
        check_log_file(path)
    check_failure_options(options, [options.robot])
    with _make_folder(options.out or Path(f"diagnosis-{options.logs[0].stem}")) as out:
        read_one = partial(read, columns=options.columns, holes=True, names=read_joint_names(options.robot))
        logs, held = (list(map(read_one, paths)) for paths in (options.logs, options.hold_out or ()))
        tune_malloc()
        with show_progress(options.verbose) as progress:
            found = diagnose(options.robot, logs, held, on_stage=progress, budget=budget)
            progress(Stage.REPORT)
            found.save(out, options.columns)
            if options.keep_searches:
                found.save_searches(out)
    said = write_verdict(found.content)
    if options.json:
        beside = {"sentence": said, "left_out": list(found.failures), "page": str(out / "report.html")}
        print(json.dumps(found.content | beside, indent=1))
    else:
        print(said)
        for failure in found.failures:
            print(failure)
        print(out / "report.html")
    return _judge_conditions(list(find_met_conditions(options, found.content)))


def _judge_conditions(met: Sequence[str]) -> int:
    """Print the conditions that are met, in sentences; return the exit code."""
    for sentence in met:
        print(sentence, file=sys.stderr)
    if met:
        return CONDITION_MET
    return DONE


def _diagnose_fleet(options: argparse.Namespace) -> int:
    """Diagnose all machines, write table and page; those finished before an interrupt are written, too."""
    from hdagen.campaign.task import Status
    from hdagen.fleet import fleet_diagnosis, fleet_file, fleet_page

    asked = read_cluster_request(options, count_job_slots(THREADS_PER_DIAGNOSIS))
    machines = fleet_file.read_fleet(options.fleet)
    check_failure_options(options, [machine.robot for machine in machines])
    with _make_folder(options.out or Path(f"diagnosis-{options.fleet.stem}")) as out:
        begun = time.monotonic()
        results, interrupted = fleet_diagnosis.diagnose_fleet(
            machines, out, asked, lambda words: print(f"{time.monotonic() - begun:5.0f} s  {words}", file=sys.stderr)
        )
        fleet_diagnosis.write_json(out / "fleet.json", fleet_diagnosis.summarize_fleet(results))
        fleet_page.write_fleet_page(out / "fleet.html", options.fleet, results)
    if options.json:
        print(json.dumps(fleet_diagnosis.summarize_fleet(results) | {"page": str(out / "fleet.html")}, indent=1))
    else:
        _print_fleet(results, out)
    if interrupted:
        raise KeyboardInterrupt
    ended = {one.outcome.status for one in results}
    if Status.FAILED in ended:
        return USAGE
    if Status.REFUSED in ended:
        return UNUSABLE
    found = ((one.machine.name, one.row) for one in results if one.row)
    met = [f"{name}: {words}" for name, content in found for words in find_met_conditions(options, content)]
    return _judge_conditions(met)


def _print_fleet(results: Sequence[MachineResult], out: Path) -> None:
    from rich.console import Console

    from hdagen.fleet import fleet_page

    console = Console(highlight=False)
    if not sys.stdout.isatty():  # a file has no width that a table must keep to
        console = Console(highlight=False, width=160)
    console.print(_build_fleet_table(results))
    console.print(fleet_page.format_fleet_verdict(results), markup=False, soft_wrap=True)
    console.print(out / "fleet.html", soft_wrap=True)


def _build_fleet_table(results: Sequence[MachineResult]) -> Table:
    from rich.markup import escape
    from rich.table import Table

    from hdagen.fleet.fleet_page import HEADINGS, build_machine_cells

    table = Table()
    for heading in HEADINGS[:2]:
        table.add_column(heading, overflow="fold")
    for heading in (*HEADINGS[2:], "s"):
        table.add_column(heading, justify="right", overflow="fold")
    for one in results:
        name, missing, *figures = map(_format_cell, build_machine_cells(one))
        if one.outcome.messages:
            missing += f": {one.outcome.messages[0]}"
        took = ""
        if one.outcome.is_reused:
            took = "kept"
        elif one.outcome.seconds:
            took = f"{one.outcome.seconds:.0f}"
        table.add_row(escape(name), escape(missing), *figures, took)
    return table


def _format_cell(cell: TableCell) -> str:
    if cell is None:
        return ""
    if cell is True:
        return "yes"
    if cell is False:
        return "no"
    if isinstance(cell, str):
        return cell
    return f"{cell:.3g}"
