"""`hdagen demo`: the compiled arm on a circle, pushed; a log replayed; one page with the pictures."""

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
        help="build the arm, drive it around a circle, push it, replay a log, and write a page",
        description="Builds the dual-joint harmonic-drive arm, drives it around a circle under impedance and "
        "admittance control, pushes it, replays a log, and writes one page that opens offline. Exit code 1 if the tip "
        "misses the ideal mass-damper-spring motion by more than 10 % of its largest displacement.",
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
    from rich.table import Table

    from hdagen.demo.demo_runs import LARGEST_GAP_SHARE

    table = Table("", "what", "value", box=None, pad_edge=False)
    for one in shown.circle_runs:
        value = (
            f"{1e3 * one.gap.max():.2f} mm, {100 * one.gap_share:.1f} % of the ideal {1e3 * one.largest_ideal:.1f} mm"
        )
        mark = "missed"
        if one.meets_bar:
            mark = "ok"
        table.add_row(mark, f"{one.law}: largest gap", value)
    for replayed in shown.replays:
        origin = replayed.name
        if not replayed.is_measured:
            origin += " (simulated)"
        for channel in replayed.joints:
            table.add_row(
                "",
                f"replay of {origin}, {channel.name}",
                f"{1e3 * channel.rms_residual:.3f} m{channel.unit} rms,"
                f" {100 * channel.rms_residual / channel.motion_rms:.2g} % of the motion",
            )
    console.print(table)
    if all(not replayed.is_measured for replayed in shown.replays):
        console.print("No measured log: set HDAGEN_DATA to the folder that holds real/emps to see EMPS replayed too.")
    if not shown.meets_bar:
        console.print(
            f"The bar is missed: the gap must stay within {100 * LARGEST_GAP_SHARE:g} %, with no tick refused."
        )
    console.print(f"Open {out} in a browser.", soft_wrap=True)
