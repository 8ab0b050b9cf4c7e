"""`hdagen --print-completion`: the script with which a shell completes commands, options and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")
FILE_ARGUMENTS = ("robot", "config")  # arguments that may be files and are read as text


class PrintCompletion(argparse.Action):
    """Prints the completion script of a shell, and ends the program. Only then `shtab` is imported."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Print and exit."""
        import shtab

        for action in list_actions(parser):
            if action.type is Path or action.dest in FILE_ARGUMENTS:
                action.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, str(values)))
        parser.exit()


def add_completion_option(parser: argparse.ArgumentParser) -> None:
    """Add the option to a program's parser.

    Args:
        parser: The parser.

    """
    parser.add_argument(
        "--print-completion",
        action=PrintCompletion,
        choices=SHELLS,
        metavar="SHELL",
        help=f"print the completion script of a shell ({', '.join(SHELLS)})",
    )


def list_actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """List the arguments of a parser and of all its commands.

    Args:
        parser: The parser.

    Yields:
        Each argument.

    """
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from list_actions(command)
        else:
            yield action
