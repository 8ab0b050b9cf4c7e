"""`hdagen demo`: a log diagnosed and proved in MuJoCo; the compiled arm pushed; one page with the pictures."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from hdagen.demo.demo_runs import DemoResult

DONE, BAR_MISSED = 0, 1
DEMO_EXAMPLE = """example:
  hdagen demo --out arm.html"""


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "demo",
        help="diagnose a log, prove the result in MuJoCo, push an arm around a circle, and write a page",
        description="Diagnoses a leg's log with a hidden effect, adopts the verdict, exports it to MuJoCo and proves "
        "it there; builds the dual-joint harmonic-drive arm, drives it around a circle under impedance and admittance "
        "control, and pushes it. Writes one page that opens offline. Exit code 1 if the diagnosis misses the effect, "
        "or the tip misses the ideal mass-damper-spring motion by more than 10 % of its largest displacement.",
        epilog=DEMO_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--out", type=Path, default=Path("hdagen-demo.html"), help="the page (default: hdagen-demo.html)")
    p.add_argument("--profile", choices=("portable", "native"), default="portable", help="how the arm is compiled")
    p.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Run the demo, write its page, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code: 1 where the tip misses the bar.

    """
    from rich.console import Console

    from hdagen.arm.build_loader import PlantError
    from hdagen.bench.host_computer import describe_machine
    from hdagen.demo import demo_page, demo_runs

    if options.out.is_dir() or not options.out.parent.is_dir():
        raise PlantError(f"--out {options.out}: give the path of a file in a folder that exists, such as arm.html.")
    machine = describe_machine()
    with _show_stages(Console(stderr=True)) as stage:
        shown = demo_runs.run_demo(options.profile, stage=stage)
        stage("writing the page")
        try:
            demo_page.write_demo_page(options.out, shown)
        except OSError as error:
            raise PlantError(f"{options.out}: {error.strerror}; choose another place with --out.") from None
    if options.json:
        print(json.dumps({"machine": machine, "page": str(options.out), **demo_runs.summarize_demo(shown)}, indent=1))
    else:
        _print_demo(Console(), shown, options.out)
    if shown.meets_bar:
        return DONE
    return BAR_MISSED


@contextmanager
def _show_stages(console: Console) -> Iterator[Callable[[str], None]]:
    """A function that shows each stage: by a spinner with the time on a terminal, elsewhere by a line."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    if not console.is_terminal:
        yield lambda words: console.print(words, highlight=False)
        return
    with Progress(
        SpinnerColumn(finished_text="·"), TextColumn("{task.description}"), TimeElapsedColumn(), console=console
    ) as bar:

        def stage(words: str) -> None:
            for task in bar.task_ids:
                bar.update(task, total=1, completed=1)
            bar.add_task(words, total=None)

        yield stage
        stage("done")


def _print_demo(console: Console, shown: DemoResult, out: Path) -> None:
    """A short table, and where the page is."""
    from rich.markup import escape
    from rich.table import Table

    from hdagen.demo.demo_page import OWN_ROBOT
    from hdagen.demo.demo_runs import LARGEST_GAP_SHARE
    from hdagen.demo.leg_diagnosis import HIDDEN_EFFECT, LEAST_CLOSED
    from hdagen.model_export.mujoco_machine import MUJOCO_MISSING

    table = Table("", "what", "value", box=None, pad_edge=False)
    leg = shown.leg
    gap, found = leg.content["gap"], ", ".join(leg.content["verdict"]) or "no effect"
    share = 100 * leg.content["hypotheses"][0]["probability"]
    table.add_row(_mark_bar(leg.meets_bar), "diagnosis of the leg's log", f"{found}, probability {share:.0f} %")
    table.add_row("", "gap on held-out motion", f"{gap['before']:.4g} to {gap['after']:.4g} times the noise")
    named, further = leg.split_changes()
    for change in named:
        words = f"{change.before or 0:.4g} to {change.after:.4g} {change.unit}"
        table.add_row("", f"adopted: {escape(change.where)}", words)
    table.add_row("", "adopted further", f"{len(further)} numbers that moved by less")
    if leg.proof is not None:
        first, second = leg.proof.gaps[:2]
        table.add_row("", "the same gap in MuJoCo", f"{first:.4g} to {second:.4g} times the noise")
    for one in shown.circle_runs:
        value = (
            f"{1e3 * one.gap.max():.2f} mm, {100 * one.gap_share:.1f} % of the ideal {1e3 * one.largest_ideal:.1f} mm"
        )
        table.add_row(_mark_bar(one.meets_bar), f"{one.law}: largest gap", value)
    console.print(table)
    if not all(one.meets_bar for one in shown.circle_runs):
        console.print(
            f"The bar is missed: the gap must stay within {100 * LARGEST_GAP_SHARE:g} %, with no tick refused."
        )
    if not shown.leg.meets_bar:
        console.print(
            f"The bar is missed: {HIDDEN_EFFECT} must be found, and close {100 * LEAST_CLOSED:g} % of the gap."
        )
    if shown.leg.proof is None:
        console.print(MUJOCO_MISSING, soft_wrap=True, markup=False)
    console.print(f"Open {out} in a browser. Your own robot: {OWN_ROBOT}", soft_wrap=True)


def _mark_bar(is_met: bool) -> str:
    return "ok" if is_met else "missed"
