"""Files that come from outside, opened and parsed in one way: what is no regular file, too large, no text or no TOML or
JSON ends in one sentence that can be printed."""

from __future__ import annotations

import json
import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from hdagen.names import printable, shown_path

# 64 parts of one key, which take time with the square of their number: no file has a use for them
_PART = r"""(?:[\w-]{1,200}+|"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{64}}")


class InputFileError(Exception):
    """A file that cannot be used; one sentence: where, what was found, what to do."""


def check_file(path: Path, largest: int, remedy: str) -> int:
    """The size of a regular file of at most ``largest`` bytes, which is not opened. Raises InputFileError, whose
    sentence ends in ``remedy``."""
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise _refused(path, _why(error), remedy) from None
    if not stat.S_ISREG(found.st_mode):
        what = "is a folder" if stat.S_ISDIR(found.st_mode) else "is no regular file (a pipe, a device or a socket)"
        raise _refused(path, what, remedy)
    if found.st_size > largest:
        raise _refused(path, f"found {found.st_size} bytes, possible are at most {largest}", remedy)
    return found.st_size


def read_bytes(path: Path, largest: int, remedy: str) -> bytes:
    """What a regular file of at most ``largest`` bytes holds. Raises InputFileError, whose sentence ends in
    ``remedy``."""
    try:
        check_file(path, largest, remedy)  # before it is opened: a pipe without a writer would wait
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise _refused(path, _why(error), remedy) from None
    if len(content) > largest:  # one that grows, or does not tell its size
        raise _refused(path, f"found more than {largest} bytes", remedy)
    return content


def read_toml(path: Path, largest: int, remedy: str) -> dict[str, Any]:
    """The tables of a TOML file of at most ``largest`` bytes. Raises InputFileError, whose sentence ends in
    ``remedy``."""
    text = _text(path, largest, remedy)
    if found := _LONG_KEY.search(text):
        raise _refused(
            path, f"found a key of more than 64 parts in line {text.count(chr(10), 0, found.end()) + 1}", remedy
        )
    try:
        return tomllib.loads(text)
    except ValueError as error:
        raise _refused(path, f"cannot be read as TOML ({_unparsed(error)})", remedy) from None
    except RecursionError:
        raise _refused(path, "cannot be read as TOML (it is nested too deeply)", remedy) from None


def read_json(path: Path, largest: int, remedy: str) -> Any:
    """What a JSON file of at most ``largest`` bytes holds; NaN and infinities are let through. Raises InputFileError,
    whose sentence ends in ``remedy``."""
    try:
        return json.loads(_text(path, largest, remedy))
    except ValueError as error:
        raise _refused(path, f"cannot be read as JSON ({_unparsed(error)})", remedy) from None
    except RecursionError:
        raise _refused(path, "cannot be read as JSON (it is nested too deeply)", remedy) from None


def _text(path: Path, largest: int, remedy: str) -> str:
    content = read_bytes(path, largest, remedy)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _refused(path, f"cannot be read as UTF-8 (byte {error.start + 1} is none)", remedy) from None


def _why(error: OSError | ValueError) -> str:
    if isinstance(error, FileNotFoundError):
        return "cannot be read (there is no such file)"
    return f"cannot be read ({printable(getattr(error, 'strerror', None) or error)})"


def _unparsed(error: ValueError) -> str:
    """Why a text is no TOML or JSON."""
    if "set_int_max_str_digits" in str(error):
        return "it holds a number of thousands of digits"
    return printable(error)[:300]


def _refused(path: Path, why: str, remedy: str) -> InputFileError:
    return InputFileError(f"{shown_path(path)}: {why}; {remedy}.")
