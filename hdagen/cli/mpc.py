"""`hdagen mpc`: the table of three controllers, the accuracy of the estimator, the page of a run, the keys of
controller.toml, the truth beside a tick."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.cli.cluster_options import add_cluster_options, count_job_slots, read_cluster_request, refuse_file_as_folder

if TYPE_CHECKING:
    from hdagen.campaign.cluster_request import ClusterRequest
    from hdagen.mpc.benchmark.law_comparison import RandomRun
    from hdagen.mpc.benchmark.sqp_convergence import LoopCosts

MPC_EXAMPLE = """examples:
  hdagen mpc table                 impedance, admittance and predictive control, free and against a wall
  hdagen mpc table --runs 100 --out runs   the same over random runs, kept in a folder
  hdagen simulate paper --controller mpc --out run.parquet && hdagen mpc explain run.parquet
  hdagen mpc header > mpc_settings.h   the configuration for C, as example_mpc.c includes it
  hdagen mpc sense                 innovations, delay and bias on a step of force, collisions and false alarms
  hdagen mpc reference             the plan beside IPOPT's of the whole nonlinear problem"""


MPC_TOPICS = ("table", "sense", "explain", "keys", "reference", "header")


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "mpc",
        help="predictive control: compare, explain a run, list keys, check against the whole problem",
        description="The predictive controller that keeps the admittance; see docs/guides/mpc.md.",
        epilog=MPC_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("what", nargs="?", choices=MPC_TOPICS)
    p.add_argument("--reference", action="store_true", help="the same as `reference`")
    p.add_argument(
        "log", nargs="?", type=Path, help="of `explain`: a log that `hdagen simulate --controller mpc` wrote"
    )
    p.add_argument("--robot", default="paper", help="of `header`: a preset or a robot.toml (default: paper)")
    p.add_argument(
        "--config", default=None, metavar="controller.toml", help="of `reference` and `header`; default: the defaults"
    )
    p.add_argument("--runs", type=int, default=0, help="of `table`: random runs besides (default: none)")
    p.add_argument("--profile", choices=("portable", "native"), default="native")
    p.add_argument(
        "--out",
        type=Path,
        default=None,
        help="of `explain`: the page (default: beside the log, .html); of `table`: a folder that "
        "keeps the random runs, so that the same command goes on after an interruption (default: none is kept)",
    )
    p.add_argument("--json", action="store_true", help="print the figures as JSON")
    add_cluster_options(p, "random runs of `table`", "the cores")


def run(options: argparse.Namespace) -> int:
    """Run the part of the command that is named.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: No part is named, or more than one.

    """
    from hdagen.arm.build_loader import PlantError

    asked = []
    if options.what:
        asked.append(options.what)
    if options.reference:
        asked.append("reference")
    if len(set(asked)) != 1:
        raise PlantError(
            f"hdagen mpc takes one of {', '.join(MPC_TOPICS)}, or --reference; found {' and '.join(asked) or 'none'}."
        )
    does = {
        "table": _print_comparison,
        "sense": _print_sensing,
        "explain": _explain_run,
        "keys": _print_keys,
        "reference": _print_reference,
    }
    return (does | {"header": _print_header})[asked[0]](options)


def _print_keys(options: argparse.Namespace) -> int:
    from hdagen.mpc.configuration_schema import CONFIGURATION_KEYS, format_key_table

    if options.json:
        print(json.dumps([asdict(key) for key in CONFIGURATION_KEYS], indent=1))
    else:
        print(format_key_table().rstrip("\n"))
    return 0


def _explain_run(options: argparse.Namespace) -> int:
    from hdagen.arm.build_loader import PlantError
    from hdagen.log.data_table import LogError
    from hdagen.mpc.explanation_page import format_record_verdict, write_record_page
    from hdagen.mpc.tick_record import read_record

    if options.log is None:
        raise PlantError(
            "hdagen mpc explain takes a log; `hdagen simulate --controller mpc --out run.parquet` writes one."
        )
    record = read_record(options.log)
    out = options.out or options.log.with_suffix(".html")
    if not os.path.isdir(out.absolute().parent) or os.path.isdir(out):
        raise PlantError(f"--out {out}: give the path of a file in a folder that exists, such as ticks.html.")
    try:
        write_record_page(out, options.log.name, record)
    except OSError as error:
        raise LogError(
            [f"{out}: the page could not be written ({error.strerror}); name another with --out."]
        ) from error
    said = format_record_verdict(record)
    if options.json:
        print(json.dumps({"sentence": said, "page": str(out)}, indent=1))
    else:
        print(f"{said}\n{out}")
    return 0


def _print_comparison(options: argparse.Namespace) -> int:
    from rich.console import Console

    from hdagen.mpc.benchmark.law_comparison import compare_controllers, format_comparison

    count = max(0, options.runs)
    if count and options.out:
        refuse_file_as_folder(options.out)
    asked = read_cluster_request(options, min(count_job_slots(1), max(count, 1)))
    with Console(stderr=True).status("starting") as status:
        found = compare_controllers(options.profile, status.update)
    runs = []
    if count:
        runs = _drive_random_runs(count, found.tuned.gains, options, asked)
    if options.json:
        rows = {
            "rows": [asdict(row) for row in found.rows],
            "free": found.free,
            "tuned": asdict(found.tuned),
            "runs": [asdict(one) for one in runs],
        }
        print(json.dumps(rows, indent=1))
    else:
        print("\n".join(format_comparison(found, runs)))
    return 0


def _drive_random_runs(
    count: int, tuned: Mapping[str, float], options: argparse.Namespace, asked: ClusterRequest
) -> list[RandomRun]:
    """The random runs that are finished; an interrupt leaves the others. Raises PlantError."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.mpc.benchmark.random_run_tasks import drive_runs_on_cluster

    def say(words: str) -> None:
        print(words, file=sys.stderr)

    with contextlib.ExitStack() as stack:
        folder = options.out or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hdagen-runs-")))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            runs, interrupted = drive_runs_on_cluster(count, tuned, options.profile, folder, asked, say)
        except OSError as error:
            raise PlantError(f"{error.filename}: {error.strerror}; name another folder with --out.") from None
    if interrupted and options.out:
        say(f"{len(runs)} of {count} random runs are kept in {options.out}; the same command goes on.")
    return runs


def _print_sensing(options: argparse.Namespace) -> int:
    from rich.console import Console

    from hdagen.mpc.benchmark.estimator_consistency import format_sensing, measure_sensing

    with Console(stderr=True).status("starting") as status:
        found = measure_sensing(options.profile, status.update)
    if options.json:
        print(json.dumps(asdict(found), indent=1))
    else:
        print("\n".join(format_sensing(found)))
    return 0


def _print_header(options: argparse.Namespace) -> int:
    from hdagen.arm.compiled_arm import load
    from hdagen.mpc.configuration import Configuration, read_configuration
    from hdagen.mpc.predictive_controller import MPC

    c = Configuration()
    if options.config:
        c = read_configuration(options.config)
    text = MPC(load(options.robot, options.profile, mpc=c), c).format_header()
    if options.json:
        print(json.dumps({"header": text}))
    else:
        print(text.rstrip("\n"))
    return 0


def _print_reference(options: argparse.Namespace) -> int:
    from rich.console import Console

    from hdagen.mpc.benchmark.ipopt_reference import compare_with_truth, format_truth_comparison
    from hdagen.mpc.benchmark.sqp_convergence import compare_loop_costs, format_loop_costs

    driven: tuple[LoopCosts, ...] = ()
    with Console(stderr=True).status("starting") as status:
        if options.config is None:
            driven = compare_loop_costs(options.profile, status.update)
        status.update("IPOPT")
        found = compare_with_truth(options.config, options.profile)
    if options.json:
        print(
            json.dumps({"loops": [asdict(loop) for loop in driven], "plans": [asdict(one) for one in found]}, indent=1)
        )
    else:
        if driven:
            print("\n".join(format_loop_costs(driven)))
        print("\n".join(format_truth_comparison(found)))
    return 0
