"""Compiled objects that are kept: robots of the same structure give the same C, for numbers are parameters, not text.

An object is found by the hash of the text that decides it, of the standard headers, the compiler and the flags. It
holds a hash of itself, so that a damaged one is made again. The folder that holds them lies beside the builds, which
lock it; an object that another user may write is not taken.
"""

from __future__ import annotations

import hashlib
import secrets
from contextlib import suppress
from pathlib import Path

from gen.builder.ownership import find_other_writer

MOST_OBJECTS = 512  # objects that are kept, those used last
PARTIAL_OBJECT_PREFIX = ".part-"  # begins the name of one that is being written


def hash_object(text: bytes, headers: bytes, command: tuple[str, ...], version: str) -> str:
    """Name an object by everything that decides its content.

    Args:
        text: The source with the headers of the build that it includes (`collect_deciding_text`).
        headers: The preprocessed standard headers.
        command: The compiler and its flags.
        version: The compiler's version, and the processor where it counts.

    Returns:
        The hash by which the object is found.

    """
    digest = hashlib.sha256()
    for part in (text, headers, "\0".join(command).encode(), version.encode()):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()[:32]


def fetch_object(kept: Path, name: str) -> bytes | None:
    """Fetch an object; damaged ones are removed, and those of another user are passed over.

    Args:
        kept: The folder of kept objects.
        name: The object's hash (`key`).

    Returns:
        The object, or None where there is none that is whole.

    """
    for path in kept.glob(f"{name}-*.o"):
        try:
            if find_other_writer(path):
                continue
            content = path.read_bytes()
        except OSError:
            continue
        if path.stem == f"{name}-{_hash_content(content)}":
            with suppress(OSError):  # another process has just thrown it away
                path.touch(exist_ok=True)
            return content
        path.unlink(missing_ok=True)
    return None


def store_object(kept: Path, name: str, content: bytes) -> None:
    """Put an object away, whole or not at all, and throw away those beyond MOST_OBJECTS that were not used for longest.

    Args:
        kept: The folder of kept objects.
        name: The object's hash (`key`).
        content: The object.

    """
    kept.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = kept / f"{name}-{_hash_content(content)}.o"
    part = kept / f"{PARTIAL_OBJECT_PREFIX}{secrets.token_hex(8)}"
    try:
        part.write_bytes(content)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    for old in sorted(kept.glob("*.o"), key=_modified_at)[:-MOST_OBJECTS]:
        old.unlink(missing_ok=True)


def discard_parts(kept: Path) -> None:
    """Remove the files that a killed process left half-written, while nobody else writes.

    Args:
        kept: The folder of kept objects.

    """
    for part in kept.glob(f"{PARTIAL_OBJECT_PREFIX}*"):
        part.unlink(missing_ok=True)


def _modified_at(path: Path) -> float:
    """When the object was made or used; one that another thread has just thrown away counts as new."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return float("inf")


def _hash_content(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
