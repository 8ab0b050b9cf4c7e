"""Command line: build, list, describe, check, mend, wrap, time, truth."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from gen.robot.value_reader import escape_control_characters

EXAMPLES = """examples:
  python -m gen build                          the preset `paper` into build/
  python -m gen build my_arm.toml --profile native
  python -m gen list
  python -m gen check my_arm.toml"""


NO_COMPILER = 6  # exit code: a build is wanted and no C compiler works
TRACEBACK_VARIABLE = "HDAGEN_TRACEBACK"  # environment variable: unforeseen errors show where they arose


def main(arguments: list[str] | None = None) -> int:
    """Run `python -m gen`.

    Args:
        arguments: The words after the program's name; None takes those of the command line.

    Returns:
        Exit code: 0 done; 2 a robot, an option, a compiler or a place to write that cannot be used; 4 an error that
        was not foreseen; 6 there is no C compiler; 130 interrupted; 141 nobody reads the output.

    """
    try:
        try:
            return _run_command(_make_parser().parse_args(arguments))
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # here, where a full device or a closed pipe can still be told
    except KeyboardInterrupt:
        return _end_with_code(130, "interrupted; nothing was left behind.")
    except BrokenPipeError:
        return _end_with_code(141, "")
    except OSError as error:
        place = error.filename or "standard output"
        return _end_with_code(
            2, f"{place}: cannot be used ({error.strerror or error}); make room, or choose another place."
        )
    except Exception as error:
        if os.environ.get(TRACEBACK_VARIABLE):
            raise
        found = f"{type(error).__name__}: {(str(error).splitlines() or [''])[0][:300]}"
        return _end_with_code(
            4,
            f"gen met an error that it did not foresee ({found}); {TRACEBACK_VARIABLE}=1 in the environment shows"
            " where.",
        )


def _end_with_code(code: int, sentence: str) -> int:
    """Print why a command ends; output that standard output does not take is thrown away."""
    if sentence:
        with suppress(OSError, ValueError):
            print(escape_control_characters(sentence), file=sys.stderr, flush=True)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


def _make_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = argparse.ArgumentParser(
        prog="python -m gen",
        description="Generates and compiles robot arms.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="build | list | describe | check | mend | wrap | time | truth"
    )
    build = commands.add_parser(
        "build",
        help="generate and compile a robot; prints the folder",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    build.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    build.add_argument(
        "--profile",
        choices=("portable", "native"),
        default="portable",
        help="portable: bit for bit the interpreter's; native: fastest on this processor",
    )
    build.add_argument("--out", type=Path, default=Path("build"), help="where the folder goes (default: build)")
    build.add_argument("--effects", default="", help="effects to add to the model, separated by commas, or all")
    build.add_argument("--mpc", default="", help="add a predictive controller: nodes=20,walls=2,space=tip (or joint)")
    build.add_argument("--progress", action="store_true", help="print each stage as a line to standard error")
    listed = commands.add_parser("list", help="list the builds")
    listed.add_argument("--out", type=Path, default=Path("build"))
    check = commands.add_parser("check", help="validate a robot and describe its build")
    check.add_argument("robot", help="a preset or a robot.toml")
    check.add_argument(
        "--profile", choices=("portable", "native"), default="portable", help="of the build that is spoken of"
    )
    check.add_argument("--out", type=Path, default=Path("build"), help="where its folder would go (default: build)")
    check.add_argument("--effects", default="", help="effects to add to the model, separated by commas, or all")
    timed = commands.add_parser("time", help="time every function beside CasADi's interpreter and C; prints JSON")
    timed.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    timed.add_argument("--rounds", type=int, default=60, help="turns of every contestant (default: 60)")
    timed.add_argument("--out", type=Path, default=Path("build"))
    _add_describe_and_mend(commands)
    _add_truth(commands)
    return parser


def _run_command(options: argparse.Namespace) -> int:
    """Run a command; problems that it foresees go to standard error."""
    from gen.builder.build import BuildError
    from gen.builder.compiler import CompileError, MissingCompilerError
    from gen.mpc.problem_structure import StructureError
    from gen.robot.description import RobotError

    try:
        runs = {
            "build": _build_robot,
            "list": _list_builds,
            "describe": _describe_robot,
            "check": _check_robot,
            "mend": _print_remedy,
            "wrap": _wrap_sources,
        }
        return (runs | {"time": _time_functions, "truth": _solve_problems})[options.command](options)
    except RobotError as error:
        for problem in error.problems:
            print(escape_control_characters(problem), file=sys.stderr)
        return 2
    except (BuildError, CompileError, StructureError) as error:
        print("\n".join(escape_control_characters(line) for line in str(error).split("\n")), file=sys.stderr)
        return NO_COMPILER if isinstance(error, MissingCompilerError) else 2


def _time_functions(options: argparse.Namespace) -> int:
    from gen.builder.function_timing import run_timing

    return run_timing(options)


def _read_effect_names(options: argparse.Namespace) -> tuple[str, ...]:
    names = {name.strip() for name in options.effects.split(",") if name.strip()}
    if "all" in names:  # but not the effect that changes the drive itself
        from gen.effects import ALL

        names = {effect.name for effect in ALL if effect.series_spring is None} | names - {"all"}
    return tuple(sorted(names))


def _build_robot(options: argparse.Namespace) -> int:
    from gen.builder.build import build_robot
    from gen.builder.build_progress import show_stages
    from gen.mpc.problem_structure import parse_structure

    structure = parse_structure(options.mpc)
    effects = _read_effect_names(options)
    with show_stages(options.progress) as on_stage:
        folder, made = build_robot(options.robot, options.profile, options.out, effects, structure, on_stage)
    outcome = "unchanged"
    if made:
        outcome = "built"
    print(f"{outcome} ({options.profile})", file=sys.stderr)
    print(folder)
    return 0


def _add_describe_and_mend(commands: Any) -> None:
    described = commands.add_parser("describe", help="print a robot's description, complete and checked, as JSON")
    described.add_argument("robot", help="a preset or a robot.toml")
    mended = commands.add_parser("mend", help="print the step and the smoothing that carry a robot, as JSON")
    mended.add_argument("robot", help="a preset or a robot.toml")
    wrapped = commands.add_parser("wrap", help="copy a build's C with a wrapper for other programs; prints its sources")
    wrapped.add_argument("kind", choices=("firmware", "fmi2", "fmi3"), help="the wrapper")
    wrapped.add_argument("build", type=Path, help="the folder of a build, portable")
    wrapped.add_argument("folder", type=Path, help="where the files go; it may hold the wrapper's headers")
    wrapped.add_argument("--library", default="", help="also compile them into a shared library of this name there")


def _add_truth(commands: Any) -> None:
    truth = commands.add_parser(
        "truth", help="converge predictive control problems (JSON on stdin) by IPOPT; prints JSON"
    )
    truth.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    truth.add_argument("--mpc", required=True, help="the controller's structure: nodes=20,walls=2,space=tip")


def _solve_problems(options: argparse.Namespace) -> int:
    import json

    from gen.builder.build import BuildError, assemble_library
    from gen.mpc.ipopt_solution import solve_problem
    from gen.mpc.problem_structure import StructureError, parse_structure
    from gen.robot.load_robot import load

    structure = parse_structure(options.mpc)
    if structure is None:
        raise StructureError("--mpc: give the controller's structure, as in nodes=20,walls=2,space=tip.")
    try:
        problems = json.load(sys.stdin)
    except (ValueError, RecursionError) as error:
        raise BuildError(f"standard input is no JSON ({error}); `hdagen mpc reference` gives it.") from None
    made, _, _ = assemble_library(options.robot, load(options.robot), ())
    print(json.dumps([solve_problem(made, structure, problem) for problem in problems]))
    return 0


def _list_builds(options: argparse.Namespace) -> int:
    from gen.builder.build import list_builds

    rows = list(list_builds(options.out))
    for name, contents, whole in rows:
        advice = "; `python -m gen build` makes it again"
        if whole:
            advice = ""
        print(f"{name:44} {contents}{advice}")
    if not rows:
        print(f"nothing is built in {options.out}; `python -m gen build` builds the preset `paper`.")
    return 0


def _describe_robot(options: argparse.Namespace) -> int:
    import json

    from gen.robot.description import describe_robot
    from gen.robot.load_robot import load

    print(json.dumps(describe_robot(load(options.robot))))
    return 0


def _print_remedy(options: argparse.Namespace) -> int:
    import json

    from gen.builder.build import assemble_library
    from gen.robot.load_robot import load

    step, widths = assemble_library(options.robot, load(options.robot), ())[2].find_remedy()
    print(json.dumps({"step": step, "friction_smoothing": widths}))
    return 0


def _wrap_sources(options: argparse.Namespace) -> int:
    from gen.builder.wrapped_sources import compile_wrapper, wrap_sources

    sources = wrap_sources(options.kind, options.build, options.folder)
    if options.library:
        compile_wrapper(options.build, options.folder, sources, options.library)
    print("\n".join(sources))
    return 0


def _check_robot(options: argparse.Namespace) -> int:
    from gen.builder.robot_check import report_robot

    lines, fits = report_robot(options.robot, _read_effect_names(options), options.profile, options.out)
    for line in lines:
        print(line)
    if not fits:
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
