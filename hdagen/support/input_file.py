"""Files that come from outside, opened and parsed in one way.

A file that is not regular, too large, no text, or no TOML or JSON ends in one sentence that can be printed.
"""

from __future__ import annotations

import json
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from hdagen.support.messages import make_printable, show_path

# 64 parts of one key, which take time with the square of their number: no file has a use for them
_KEY_PART = r"""(?:[\w-]{1,200}+|"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_KEY_PART}\.[ \t]*+){{64}}")


class InputFileError(Exception):
    """A file that cannot be used; one sentence gives the file, the finding and the remedy."""


def check_file(path: Path, largest: int, remedy: str) -> int:
    """Check that a path is a regular file of a bounded size, without opening it.

    Args:
        path: The file.
        largest: Its size at most, bytes.
        remedy: The end of the sentence where the file is refused.

    Returns:
        The size of the file, bytes.

    Raises:
        InputFileError: The file is missing, not regular or too large.

    """
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise _make_input_file_error(path, _describe_read_error(error), remedy) from None
    if stat.S_ISDIR(found.st_mode):
        raise _make_input_file_error(path, "is a folder", remedy)
    if not stat.S_ISREG(found.st_mode):
        raise _make_input_file_error(path, "is no regular file (a pipe, a device or a socket)", remedy)
    if found.st_size > largest:
        raise _make_input_file_error(path, f"found {found.st_size} bytes, possible are at most {largest}", remedy)
    return found.st_size


def read_bytes(path: Path, largest: int, remedy: str) -> bytes:
    """Read a regular file of a bounded size.

    Args:
        path: The file.
        largest: Its size at most, bytes.
        remedy: The end of the sentence where the file is refused.

    Returns:
        The content.

    Raises:
        InputFileError: The file cannot be read, or is too large.

    """
    try:
        check_file(path, largest, remedy)  # before it is opened: a pipe without a writer would wait
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise _make_input_file_error(path, _describe_read_error(error), remedy) from None
    if len(content) > largest:  # one that grows, or does not tell its size
        raise _make_input_file_error(path, f"found more than {largest} bytes", remedy)
    return content


def read_toml(path: Path, largest: int, remedy: str) -> dict[str, Any]:
    """Read a TOML file of a bounded size.

    Args:
        path: The file.
        largest: Its size at most, bytes.
        remedy: The end of the sentence where the file is refused.

    Returns:
        The tables of the file.

    Raises:
        InputFileError: The file cannot be read, is too large, or is no TOML.

    """
    text = _read_text(path, largest, remedy)
    if found := _LONG_KEY.search(text):
        raise _make_input_file_error(
            path, f"found a key of more than 64 parts in line {text.count(chr(10), 0, found.end()) + 1}", remedy
        )
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise _make_input_file_error(path, f"cannot be read as TOML ({_describe_parse_error(error)})", remedy) from None
    except RecursionError:
        raise _make_input_file_error(path, "cannot be read as TOML (it is nested too deeply)", remedy) from None


def read_json(path: Path, largest: int, remedy: str) -> Any:
    """Read a JSON file of a bounded size; NaN and infinities are let through.

    Args:
        path: The file.
        largest: Its size at most, bytes.
        remedy: The end of the sentence where the file is refused.

    Returns:
        The value that the file holds.

    Raises:
        InputFileError: The file cannot be read, is too large, or is no JSON.

    """
    try:
        return json.loads(_read_text(path, largest, remedy))
    except ValueError as error:
        raise _make_input_file_error(path, f"cannot be read as JSON ({_describe_parse_error(error)})", remedy) from None
    except RecursionError:
        raise _make_input_file_error(path, "cannot be read as JSON (it is nested too deeply)", remedy) from None


def _read_text(path: Path, largest: int, remedy: str) -> str:
    content = read_bytes(path, largest, remedy)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _make_input_file_error(
            path, f"cannot be read as UTF-8 (byte {error.start + 1} is none)", remedy
        ) from None


def _describe_read_error(error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError):
        return "cannot be read (there is no such file)"
    return f"cannot be read ({make_printable(getattr(error, 'strerror', None) or error)})"


def _describe_parse_error(error: ValueError) -> str:
    """Say why a text is no TOML or JSON."""
    if "set_int_max_str_digits" in str(error):
        return "it holds a number of thousands of digits"
    return make_printable(error)[:300]


def _make_input_file_error(path: Path, why: str, remedy: str) -> InputFileError:
    return InputFileError(f"{show_path(path)}: {why}; {remedy}.")
