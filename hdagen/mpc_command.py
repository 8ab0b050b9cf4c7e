"""`hdagen mpc`: the table of three controllers, what the estimator feels, the page of a run, the keys of
controller.toml, the truth beside a tick."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.mpc.comparison import Comparison, RandomRun

EXAMPLE = """examples:
  hdagen mpc table                 impedance, admittance and predictive control, free and against a wall
  hdagen mpc table --runs 100      the same over random runs
  hdagen simulate paper --controller mpc --out run.parquet && hdagen mpc explain run.parquet
  hdagen mpc header > mpc_settings.h   the configuration for C, as example_mpc.c includes it
  hdagen mpc sense                 innovations, delay and bias on a step of force, collisions and false alarms
  hdagen mpc reference             the plan beside IPOPT's of the whole nonlinear problem"""


def add_parser(commands: Any) -> None:
    """The command's arguments."""
    p = commands.add_parser(
        "mpc",
        help="predictive control: compare, explain a run, list keys, check against the whole problem",
        description="The predictive controller that keeps the admittance; see docs/mpc.md.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("what", choices=("table", "sense", "explain", "keys", "reference", "header"))
    p.add_argument(
        "log", nargs="?", type=Path, help="of `explain`: a log that `hdagen simulate --controller mpc` wrote"
    )
    p.add_argument("--robot", default="paper", help="of `header`: a preset or a robot.toml (default: paper)")
    p.add_argument(
        "--config", default=None, metavar="controller.toml", help="of `reference` and `header`; default: the defaults"
    )
    p.add_argument("--runs", type=int, default=0, help="of `table`: random runs besides (default: none)")
    p.add_argument("--profile", choices=("portable", "native"), default="native")
    p.add_argument("--out", type=Path, default=None, help="of `explain`: the page (default: beside the log, .html)")
    p.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Do what was asked."""
    what = {"table": _table, "sense": _sense, "explain": _explain, "keys": _keys, "reference": _reference}
    return (what | {"header": _header})[options.what](options)


def _keys(_: argparse.Namespace) -> int:
    from hdagen.mpc.keys import documented

    print(documented(), end="")
    return 0


def _explain(options: argparse.Namespace) -> int:
    from hdagen.log import LogError
    from hdagen.mpc.explain import verdict, write
    from hdagen.mpc.record import read
    from hdagen.plant import PlantError

    if options.log is None:
        raise PlantError(
            "hdagen mpc explain takes a log; `hdagen simulate --controller mpc --out run.parquet` writes one."
        )
    record = read(options.log)
    out = options.out or options.log.with_suffix(".html")
    try:
        write(out, options.log.name, record)
    except OSError as error:
        raise LogError(
            [f"{out}: the page could not be written ({error.strerror}); name another with --out."]
        ) from error
    print(verdict(record))
    print(out)
    return 0


def _table(options: argparse.Namespace) -> int:
    from rich.console import Console

    from hdagen.mpc.comparison import compare, random_runs

    with Console(stderr=True).status("starting") as status:
        found = compare(options.profile, status.update)
        runs = []
        for one in random_runs(options.runs, found.tuned.gains, options.profile) if options.runs > 0 else ():
            runs.append(one)
            status.update(f"random run {len(runs)} of {options.runs}")
    if options.json:
        rows = {
            "rows": [asdict(row) for row in found.rows],
            "tuned": asdict(found.tuned),
            "runs": [asdict(one) for one in runs],
        }
        print(json.dumps(rows, indent=1))
    else:
        _print(found)
        if runs:
            _print_runs(runs)
    return 0


def _sense(options: argparse.Namespace) -> int:
    from rich.console import Console

    from hdagen.mpc.sensing import lines, measure

    with Console(stderr=True).status("starting") as status:
        found = measure(options.profile, status.update)
    print(json.dumps(asdict(found), indent=1) if options.json else "\n".join(lines(found)))
    return 0


def _print(found: Comparison) -> None:
    import sys

    from rich.console import Console
    from rich.table import Table

    from hdagen.mpc.tuned import METHOD

    console = Console(width=None if sys.stdout.isatty() else 150)
    table = Table(title="the tip against the ideal admittance motion (mm), and what was broken")
    for name in ("course", "controller"):
        table.add_column(name, no_wrap=True)
    for name in ("median", "free", "largest", "after release", "contact (N)", "refused"):
        table.add_column(name, justify="right")
    table.add_column("largest violation of each limit")
    for row in found.rows:
        o = row.outcome
        broken = ", ".join(f"{name} {value:.3g}" for name, value in o.violated.items() if value > 0) or "none"
        cells = [f"{1e3 * value:.3f}" for value in (o.distance, o.free_distance, o.largest, o.released)]
        table.add_row(row.course, row.controller, *cells, f"{o.contact:.1f}", str(o.refused), broken)
    console.print(table)
    gains = ", ".join(f"{name} {value:.1f}" for name, value in found.tuned.gains.items())
    console.print(f"admittance: inner loop tuned by {METHOD}: {gains} after {found.tuned.evaluations} runs")


def _print_runs(runs: list[RandomRun]) -> None:
    import numpy as np

    legal, kept = sum(one.legal for one in runs), sum(one.kept for one in runs)
    print(f"random runs: {len(runs)}; inputs legal in {legal}, soft limits kept to what is allowed in {kept}")
    for name in runs[0].predictive.violated:
        print(f"  largest excess of {name}: {max(one.predictive.violated[name] for one in runs):.3g}")
    ours = np.array([one.free.distance for one in runs])
    theirs = np.array([one.admittance.distance for one in runs])
    where = f"mpc {1e3 * np.median(ours):.3f} mm, admittance {1e3 * np.median(theirs):.3f} mm"
    print(f"median distance where no limit is near: {where}; largest ratio of a run {np.max(ours / theirs):.2f}")


def _header(options: argparse.Namespace) -> int:
    from hdagen.mpc.configuration import Configuration, read
    from hdagen.mpc.controller import MPC
    from hdagen.plant import load

    c = read(options.config) if options.config else Configuration()
    print(MPC(load(options.robot, options.profile, mpc=c), c).header(), end="")
    return 0


def _reference(options: argparse.Namespace) -> int:
    from hdagen.mpc.truth import against_truth

    print(json.dumps(against_truth(options.config, options.profile), indent=1))
    return 0
