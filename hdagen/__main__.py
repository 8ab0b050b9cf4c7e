"""Command line of hdagen: one module a command, which parses, calls and prints."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

from hdagen.cli.completion import add_completion_option
from hdagen.support.version import __version__

COMMANDS = (
    *("build", "check", "list", "describe", "robot", "doctor"),
    *("demo", "simulate", "replay", "diagnose", "adopt", "compare", "export", "excite"),
    *("mpc", "bench", "blind", "paper"),
)
DONE, BAR_MISSED, USAGE, UNUSABLE, UNFORESEEN_ERROR, OUT_OF_TIME, INTERRUPTED, OUTPUT_CLOSED = (
    0,
    1,
    2,
    3,
    4,
    7,
    130,
    141,
)
TRACEBACK_VARIABLE = "HDAGEN_TRACEBACK"  # environment variable: unforeseen errors show where they arose


class Parser(argparse.ArgumentParser):
    """A parser whose errors can be printed, whatever the arguments hold."""

    def error(self, message: str) -> NoReturn:
        """Print usage and the message; exit code 2."""
        from hdagen.support.messages import make_printable

        super().error(make_printable(message))

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is none of the choices, and suggest the nearest."""
        if action.choices is None or value in action.choices:
            return
        from hdagen.support.messages import join_names, show_value, suggest_name

        names = [str(name) for name in action.choices]
        meant, possible = suggest_name(str(value), names), f"possible are {join_names(names)}; choose one of these."
        if isinstance(action, argparse._SubParsersAction):
            raise argparse.ArgumentError(None, f"there is no command {show_value(value)}{meant}; {possible}")
        raise argparse.ArgumentError(action, f"found {show_value(value)}{meant}, {possible}")


def build_parser() -> argparse.ArgumentParser:
    """Build the parser, with the arguments of every command."""
    top = Parser(
        prog="hdagen",
        description="Robot arms with harmonic drives: a compiled model that simulates, controls and replays logs.",
        epilog=(
            "exit codes: 0 done, 1 a stated bar failed, 2 usage, configuration or no place to write, 3 data unusable,"
            f" 4 an error that hdagen did not foresee ({TRACEBACK_VARIABLE}=1 shows where), 5 a condition of `hdagen"
            " diagnose --fail-above` or `--fail-on` is met, 7 the time of `--within` was up too early, 130 interrupted,"
            " 141 nobody reads what is printed"
        ),
    )
    top.add_argument("--version", action="version", version=f"hdagen {__version__}")
    add_completion_option(top)
    commands = top.add_subparsers(dest="command", required=True, metavar=" | ".join(COMMANDS))
    for name in COMMANDS:
        importlib.import_module(f"hdagen.cli.{name}").add_parser(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; every error becomes a sentence.

    Args:
        arguments: Arguments of the command line; None: those of the process.

    Returns:
        The exit code.

    """
    try:
        try:
            return _run_command(arguments)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()  # here, where an error of a full device or a closed pipe can still be reported
    except KeyboardInterrupt:
        return _end_command(INTERRUPTED, "interrupted; what was finished is whole, nothing is half-written.")
    except BrokenPipeError:
        return _end_command(OUTPUT_CLOSED, "")
    except OSError as error:
        return _end_command(USAGE, _explain_os_error(error))
    except ImportError as error:
        if os.environ.get(TRACEBACK_VARIABLE):
            raise
        return _end_command(USAGE, f"a package cannot be loaded ({error}); `hdagen doctor` says what is missing.")
    except MemoryError:
        return _end_command(UNUSABLE, "there is not enough memory; give a shorter log, or fewer machines at a time.")
    except Exception as error:
        if os.environ.get(TRACEBACK_VARIABLE):
            raise
        first = (str(error).splitlines() or [""])[0][:300]
        return _end_command(
            UNFORESEEN_ERROR,
            f"hdagen met an error that it did not foresee ({type(error).__name__}: {first}); {TRACEBACK_VARIABLE}=1 in"
            " the environment shows where, which a report of it needs.",
        )


def _run_command(arguments: Sequence[str] | None) -> int:
    """Run a command; errors that it foresees go to standard error."""
    options = build_parser().parse_args(arguments)
    try:
        return int(importlib.import_module(f"hdagen.cli.{options.command}").run(options))
    except Exception as error:
        code = _judge_error(error)
        if code is None:
            raise
        print(error, file=sys.stderr)
        return code


def _judge_error(error: Exception) -> int | None:
    """The exit code of an error that commands foresee; None for any other error."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.diagnosis.stages.time_budget import TimeUpError

    if isinstance(error, TimeUpError):
        return OUT_OF_TIME
    if isinstance(error, PlantError):
        return USAGE
    if isinstance(error, OSError | MemoryError | ImportError):
        return None
    from hdagen.log.column_map import ColumnsError
    from hdagen.log.data_table import LogError

    if isinstance(error, ColumnsError):
        return USAGE
    if isinstance(error, LogError):
        return UNUSABLE
    return None


def _explain_os_error(error: OSError) -> str:
    """One sentence on an error of the system, with a cure."""
    place = "standard output"
    if error.filename is not None:
        place = str(error.filename)
    why = error.strerror or str(error)
    if error.errno in (errno.EMFILE, errno.ENFILE):
        return f"too many files are open ({why}); allow more by `ulimit -n`, or close other programs."
    if error.errno in (errno.EAGAIN, errno.ENOMEM):
        return f"no process or memory is to be had ({why}); close other programs, or allow more by `ulimit`."
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS):
        return f"{place}: cannot be written ({why}); make room or choose another place."
    return f"{place}: cannot be used ({why}); check that it is there and what you may do with it."


def _end_command(code: int, sentence: str) -> int:
    """Say why a command ends. Text that standard output does not take is thrown away: the interpreter would write it
    once more at its end, and complain."""
    with suppress(OSError, ValueError):
        if sentence:
            from hdagen.support.messages import make_printable

            print(make_printable(sentence), file=sys.stderr, flush=True)
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return code


if __name__ == "__main__":
    sys.exit(main())
