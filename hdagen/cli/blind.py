"""`hdagen blind`: how often `hdagen diagnose` is right on realities whose effects it cannot know."""

from __future__ import annotations

import argparse
import importlib.util
import json
import secrets
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.cli.cluster_options import add_cluster_options, read_cluster_request

if TYPE_CHECKING:
    from hdagen.blind.blind_report import Report
    from hdagen.blind.realities.population import Population
    from hdagen.campaign.cluster_request import ClusterRequest

BLIND_EXAMPLE = """example:
  hdagen blind --kind single --cases 200
  hdagen blind --kind background --cases 200 --calibrate background.json
  hdagen blind --kind task --cases 24 --write made-here
  hdagen blind --family maxwell --kind single --background 0.08 --cases 100
  hdagen blind --family joint --kind rough --cases 40
  hdagen blind --model panda.urdf --kind single --cases 16

exit codes: 0 done, 1 a stated bar failed, 2 usage or configuration; see docs/method/blind_check.md"""
DONE, BAR_MISSED, USAGE = 0, 1, 2
DEFAULT_JOBS = 2
LEAST_SECONDS, MOST_SECONDS = 2.0, 120.0  # of a log: holds and pushes need room


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    from hdagen.blind.realities.population import BACKGROUNDS, FAMILIES, KINDS

    p = commands.add_parser(
        "blind",
        help="check the diagnosis on data whose effect is withheld",
        description="Makes realities by another simulator, seals their labels, has them diagnosed by processes that "
        "know nothing, opens the seal, scores, and writes blind.json and blind.html.",
        epilog=BLIND_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--kind", choices=KINDS, required=True, help="what the realities have that the robot files lack")
    p.add_argument(
        "--family",
        choices=FAMILIES,
        help="which realities: arms in MuJoCo with hand-coded drives, arms of another simulator, or joints at joint "
        "scale (default: drivetrain; of kind joint: joint)",
    )
    p.add_argument(
        "--model",
        metavar="MODEL",
        help="a URDF, an MJCF or a robot.toml in space, whose links are scattered (kinds single and none)",
    )
    p.add_argument(
        "--background",
        type=float,
        choices=BACKGROUNDS,
        help="size of every other effect, in usual sizes (default: 0; kind background: 0.04; kind none: 0 and 0.04)",
    )
    p.add_argument("--cases", type=int, default=48, metavar="N", help="how many (default: 48)")
    p.add_argument(
        "--seed",
        metavar="S",
        help="any text, or - to read it from the standard input, where no other process sees it (default: drawn, and "
        "told at the end)",
    )
    p.add_argument(
        "--seconds",
        type=float,
        metavar="T",
        help="length of a log, s (default: 10; family joint: 15; kind joint: 24; a model: 20)",
    )
    p.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the results (default: blind- and family, kind, background)"
    )
    p.add_argument("--keep", action="store_true", help="keep every case's logs and page")
    p.add_argument("--keep-searches", action="store_true", help="keep logs and searches, to decide the cases again")
    p.add_argument("--calibrate", type=Path, metavar="FILE", help="also write the data that a calibration is fitted to")
    p.add_argument("--json", action="store_true", help="print blind.json, or where cases were written")
    add_cluster_options(p, "cases", "2")
    p.add_argument("--write", type=Path, metavar="DIR", help="only write cases with their labels: for developing")


def run(options: argparse.Namespace) -> int:
    """Check the diagnosis on sealed realities, write, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code: 1 where a bar is missed.

    """
    from hdagen.blind.realities.population import read_population

    if options.model is not None:
        options.model = str(Path(options.model).absolute())  # for the processes that make logs
    population = read_population(vars(options))
    if options.seconds is None:
        options.seconds = population.seconds
    problems = _find_conflicts(options, population)
    if problems:
        print("\n".join(problems), file=sys.stderr)
        return USAGE
    from hdagen.blind.label_seal import SealError
    from hdagen.blind.sealed_check import BlindError
    from hdagen.blind.subprocesses import ChildError
    from hdagen.diagnosis.decision.calibration import CalibrationError
    from hdagen.model_import.model_file import ModelError

    cluster = read_cluster_request(options, DEFAULT_JOBS)
    seed = _choose_seed(options.seed)
    try:
        if options.write is not None:
            from hdagen.blind.case_export import export_cases

            folder = export_cases(
                options.write, population, options.cases, seed, cluster, options.seconds, _make_progress()
            )
            if options.json:
                print(json.dumps({"written": str(folder), "labels": "labels.json", "seed": seed}))
            else:
                print(f"written: {folder}, with labels.json; seed {seed}")
            return DONE
        return _run_check(options, seed, cluster)
    except (BlindError, CalibrationError, ChildError, ModelError, SealError) as error:
        print(error, file=sys.stderr)
        return USAGE
    except OSError as error:
        print(
            f"{error.filename}: cannot be written ({error.strerror}), and nothing is half-written; make room or name "
            f"another folder, and give --seed {seed} to go on.",
            file=sys.stderr,
        )
        return USAGE


def _find_conflicts(options: argparse.Namespace, population: Population) -> list[str]:
    from hdagen.blind.realities.population import FRICTION_KIND, KINDS_OF_FAMILY, MAXWELL, MODEL

    problems = [
        f"{name} {value}: possible is a whole number from 1 on."
        for name, value in (("--cases", options.cases),)
        if value < 1
    ]
    if not LEAST_SECONDS <= options.seconds <= MOST_SECONDS:
        problems.append(f"--seconds {options.seconds:g}: possible is {LEAST_SECONDS:g} to {MOST_SECONDS:g} s.")
    if options.write is not None and (options.out is not None or options.calibrate is not None or options.keep):
        problems.append("--write makes cases and checks nothing: leave out --out, --keep and --calibrate.")
    if options.write is not None and options.keep_searches:
        problems.append("--write makes cases and searches nothing: leave out --keep-searches.")
    if population.kind not in (possible := KINDS_OF_FAMILY[population.family]):
        problems.append(
            f"--family {population.family} has no kind {population.kind}; possible are {', '.join(possible)}."
        )
    if population.kind == FRICTION_KIND and population.background is not None:
        problems.append(f"--kind {FRICTION_KIND} draws its own background: leave out --background.")
    if options.model and options.family:
        problems.append(f"--model is a family of its own: leave out --family {options.family}.")
    if population.family == MODEL and population.background is not None:
        problems.append("--model has no background: leave out --background.")
    if population.family != MAXWELL and importlib.util.find_spec("mujoco") is None:
        problems.append("MuJoCo is not installed, which makes the realities: pip install 'hdagen[mujoco]'.")
    return problems


def _choose_seed(given: str | None) -> str:
    if given is None:
        return secrets.token_hex(16)
    if given == "-":
        return sys.stdin.readline().strip()
    return given


def _make_progress() -> Callable[[str], None]:
    """A function that writes progress to standard error: on one line of a terminal, elsewhere a line each."""

    def write_line(words: str) -> None:
        print(words, file=sys.stderr, flush=True)

    def rewrite_line(words: str) -> None:
        end = "\n"
        if " left" in words:
            end = ""
        print(f"\r\033[K{words}", end=end, file=sys.stderr, flush=True)

    if sys.stderr.isatty():
        return rewrite_line
    return write_line


def _run_check(options: argparse.Namespace, seed: str, cluster: ClusterRequest) -> int:
    from hdagen.blind import blind_page, calibrate
    from hdagen.blind.blind_report import make_report, render_report
    from hdagen.blind.label_seal import hash_seed
    from hdagen.blind.realities.population import read_population
    from hdagen.blind.sealed_check import BlindError, Check, run_check
    from hdagen.diagnosis.decision import calibration
    from hdagen.support.atomic_write import write_atomically

    if options.calibrate is None and hash_seed(seed) in calibration.read().seeds:
        raise BlindError("this seed was calibrated on, so a check with it proves nothing; take another --seed.")
    asked = Check(
        options.kind,
        options.cases,
        seed,
        cluster,
        options.seconds,
        options.out or Path(f"blind-{read_population(vars(options)).name.replace(' ', '-')}"),
        options.keep,
        family=options.family,
        background=options.background,
        model=options.model or "",
        keep_searches=options.keep_searches,
    )
    rows, closed = run_check(asked, _make_progress())
    found = make_report(asked, closed, rows)
    write_atomically(asked.out / "blind.json", render_report(found).encode())
    blind_page.write_page(asked.out / "blind.html", found)
    if options.calibrate is not None:
        write_atomically(
            options.calibrate, calibrate.render_calibration_data(rows, asked.kind, hash_seed(seed)).encode()
        )
    if options.json:
        print(render_report(found), end="")
    else:
        _print_report(found)
    if all(met for _, _, met in found.bars):
        return DONE
    return BAR_MISSED


def _print_report(found: Report) -> None:
    from rich.console import Console
    from rich.table import Table

    from hdagen.blind.labels import FIGURE_LABELS, format_figure

    console = Console(highlight=False)
    limits = {}
    for bar, _, met in found.bars:
        bound, verdict = "at least", "missed"
        if bar.most:
            bound = "at most"
        if met:
            verdict = "met"
        limits[bar.figure] = f"{bound} {bar.value:g}: {verdict}"
    title = f"blind check: {found.asked.population.name}, {found.asked.count} cases"
    table = Table("", "value (95 % interval)", title=title, title_justify="left")
    table.add_column("cases", justify="right")
    table.add_column("bar")
    for name, words in FIGURE_LABELS.items():
        if name in found.summary:
            figure = found.summary[name]
            table.add_row(words, format_figure(name, figure), str(figure.count), limits.get(name, ""))
    console.print(table)
    if found.lines:
        console.print(_build_parameter_table(found))
    console.print(f"written: {found.asked.out / 'blind.json'} and {found.asked.out / 'blind.html'}", soft_wrap=True)


def _build_parameter_table(found: Report) -> Any:
    """The table of orders, time constants and shapes."""
    from rich.table import Table

    table = Table("effect", "quantity", title="true against found, of effects named right", title_justify="left")
    for heading in ("cases", "error, median", "within 2 std"):
        table.add_column(heading, justify="right")
    for line in found.lines:
        inside = ""
        if line.within.count:
            inside = f"{100 * line.within.value:.0f} %"
        error = f"{100 * line.error.value:.2g} %"
        table.add_row(line.compared.effect, line.compared.words, str(line.error.count), error, inside)
    return table
