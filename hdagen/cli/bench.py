"""`hdagen bench`: times, sizes and errors against the bars; exit code 1 if one is missed."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table

    from hdagen.bench.benchmark import BenchRequirement, BenchResult

ROBOT = "paper"  # of which the bars are
BENCH_EXAMPLE = """example:
  hdagen bench --quick
  hdagen bench panda
  hdagen bench robot.toml --json
ratios hold within a run; on a machine that does other things the spread says so"""


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "bench",
        help="time every compiled function and loop beside CasADi, against the bars",
        description="Times of a compiled robot beside CasADi's own in the same run, and sizes and errors of `paper`. "
        "A rigid arm is timed beside MuJoCo and Pinocchio where these are installed.",
        epilog=BENCH_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        "robot",
        nargs="?",
        default=ROBOT,
        help=f"a preset or a robot.toml (default: {ROBOT}; bars are of it and of panda)",
    )
    p.add_argument("--quick", action="store_true", help="a tenth of the rounds; the tails say little then")
    p.add_argument(
        "--mpc",
        action="store_true",
        help="the predictive controller's solvers on a closed loop, against its bars; of an arm in space its growth "
        "with the joints",
    )
    p.add_argument("--runs", type=int, default=None, help="of --mpc: random runs (default: 20)")
    p.add_argument("--json", action="store_true", help="print everything as JSON")


def run(options: argparse.Namespace) -> int:
    """Measure, print, judge.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code: 1 where a bar is missed.

    """
    from rich.console import Console

    from hdagen.bench.benchmark import run_bench

    if options.mpc and options.robot != ROBOT:
        return _run_growth(options)
    if options.mpc:
        return _run_predictive(options)
    rounds = 300
    if options.quick:
        rounds = 30
    with Console(stderr=True).status("starting") as status:
        found = run_bench(rounds, status.update, options.robot)
    if options.json:
        print(json.dumps(asdict(found), indent=1))
    else:
        _print_bench(found)
    return int(any(bar.met is False for bar in found.bars))


def _run_predictive(options: argparse.Namespace) -> int:
    """Measure the predictive controller, print, judge."""
    from rich.console import Console

    from hdagen.bench.host_computer import describe_machine
    from hdagen.mpc.benchmark.requirements import RANDOM_RUNS, format_mpc_bench, run_mpc_bench

    machine = describe_machine()
    runs = RANDOM_RUNS
    if options.runs is not None:
        runs = max(0, options.runs)
    with Console(stderr=True).status("starting") as status:
        found = run_mpc_bench("native", options.quick, runs, status.update)
    if options.json:
        print(json.dumps({"machine": machine, **asdict(found)}, indent=1))
    else:
        print("\n".join(format_mpc_bench(found)))
    return int(any(not bar.is_met for bar in found.bars))


def _run_growth(options: argparse.Namespace) -> int:
    """Measure the predictive controller of an arm in space by its joints, and print; there are no bars."""
    from rich.console import Console

    from hdagen.bench.host_computer import describe_machine
    from hdagen.mpc.benchmark.growth_in_space import format_growth, measure_growth

    machine = describe_machine()
    with Console(stderr=True).status("starting") as status:
        found = measure_growth(options.robot, "native", status.update)
    if options.json:
        print(json.dumps({"machine": machine, "sizes": [asdict(size) for size in found]}, indent=1))
    else:
        print("\n".join(format_growth(found)))
    return 0


def _print_bench(found: BenchResult) -> None:
    from rich.console import Console

    console = Console()
    if not sys.stdout.isatty():  # a file has no width that a table must keep to
        console = Console(width=130)
    console.print(", ".join(f"{key}: {value}" for key, value in found.machine.items()))
    console.print(_build_times_table(found))
    if found.bars:
        console.print(_build_bars_table(found.bars))
    if found.is_noisy:
        console.print("The ratios vary much: this machine does other things; on an idle one they are steadier.")
    if found.absent:
        console.print(f"not installed, so that nothing is compared with: {', '.join(found.absent)}")
    missed = [bar.name for bar in found.bars if bar.met is False]
    if missed:
        console.print(f"missed: {', '.join(missed)}")
    elif found.bars:
        console.print("every bar is met")
    else:
        console.print(f"bars are of {ROBOT} and panda alone")


def _build_times_table(found: BenchResult) -> Table:
    from rich.table import Table

    title = "native profile, ns a call: in a row beside the others in the same run, then single calls; of loops a step"
    table = Table(title=f"{title}\nshare: of p99.9 in a period of 1 ms")
    table.add_column("function or loop", no_wrap=True)
    for name in ("in a row", "portable", "CasADi C", "interpreter", "median", "p99", "p99.9", "largest", "share"):
        table.add_column(name, justify="right")
    for t in found.timings:
        against = {who: f"{ns:.0f}" for who, ns in t.against.items()}
        others = [against.get(who, "") for who in ("portable", "casadi_c", "interpreter")]
        single = [f"{ns:.0f}" for ns in (t.median, t.p99, t.p999, t.largest)]
        table.add_row(t.name, f"{t.row:.0f}", *others, *single, f"{t.share:.3%}")
    return table


def _build_bars_table(bars: tuple[BenchRequirement, ...]) -> Table:
    from rich.table import Table

    table = Table(title="bars: median over rounds, with the range from 10 to 90 %")
    for name in ("bar", "asked", "reached", "range", ""):
        table.add_column(name, no_wrap=True)
    for bar in bars:
        sign = {"least": "≥", "most": "≤"}[bar.bound]
        low, high = bar.spread
        reached = (f"{bar.reached:.3g}", f"{low:.3g} to {high:.3g}")
        table.add_row(bar.name, f"{sign} {bar.bar:g} {bar.unit}", *reached, _format_judgement(bar))
    return table


def _format_judgement(bar: BenchRequirement) -> str:
    if bar.met is None:
        return "not judged here"
    if bar.met:
        return "met"
    over = bar.bar / bar.reached
    if bar.bound == "most":
        over = bar.reached / bar.bar
    return f"missed by {over - 1:.0%}"
