"""Reads and parses a robot.toml: a file that is not regular, too large, no UTF-8 or no TOML ends in a sentence."""

from __future__ import annotations

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from gen.presets import find_presets
from gen.robot.description import RobotError
from gen.robot.value_reader import show_value, suggest_nearest

LARGEST = 1_000_000  # bytes of a file
# 64 parts of one key, which take time with the square of their number: no robot has a use for them
_PART = r"""(?:[\w-]{1,200}+|"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{64}}")


def read_robot(file: Path, label: str) -> bytes:
    """Read a robot file.

    Args:
        file: The file.
        label: Its name in errors.

    Returns:
        The content.

    Raises:
        RobotError: The file is missing, not regular, too large or unreadable.

    """
    possible = f"possible is a robot.toml or one of {', '.join(find_presets())}"
    try:
        if not stat.S_ISREG(file.stat().st_mode):  # a pipe without a writer would wait
            raise RobotError([f"{label}: found no regular file, {possible}; correct the name."])
        with file.open("rb") as stream:
            raw = stream.read(LARGEST + 1)
    except (FileNotFoundError, ValueError):  # a zero byte is in no name
        meant = suggest_nearest(label, find_presets())
        raise RobotError([f"{label}: found no such file{meant}, {possible}; correct the name."]) from None
    except OSError as problem:
        why = f"found a file that cannot be read ({problem.strerror})"
        raise RobotError([f"{label}: {why}, {possible}; check name and rights."]) from None
    if len(raw) > LARGEST:
        raise RobotError([f"{label}: found more than {LARGEST} bytes, {possible}, which is far smaller; name one."])
    return raw


def parse_robot(raw: bytes, label: str) -> dict[str, Any]:
    """Parse a robot file.

    Args:
        raw: Its content.
        label: Its name in errors.

    Returns:
        The tables.

    Raises:
        RobotError: The content is no UTF-8 or no TOML, or a key has more than 64 parts.

    """
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise RobotError([f"{label}: found text in UTF-16, possible is UTF-8; save the file as UTF-8."])
    try:
        text = raw.decode("utf-8-sig")
        if found := _LONG_KEY.search(text):
            line = text.count("\n", 0, found.end()) + 1
            raise RobotError([f"{label}: found a key of more than 64 parts in line {line}; correct it there."])
        return tomllib.loads(text)
    except UnicodeDecodeError as problem:
        where = f"the first at byte {problem.start}"
        raise RobotError(
            [f"{label}: found bytes that are not UTF-8 ({where}), possible is UTF-8; save it so."]
        ) from None
    except (ValueError, RecursionError) as problem:
        why = show_value(str(problem))[1:-1]
        if isinstance(problem, RecursionError):
            why = "too deeply nested"
        raise RobotError(
            [f"{label}: found text that is not TOML ({why}), possible is TOML; correct it there."]
        ) from None
