"""Files that appear whole or not at all: written beside their place, synced, then renamed over it."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_PARTIAL_NAME_PATTERN = re.compile(r"\..*\.part-[0-9a-f]{16}(\.\w*)?")  # the name of a file that is being written


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file whole or not at all.

    Args:
        path: The file, in a folder that exists.
        content: The bytes of the file.

    Raises:
        OSError: The file cannot be written; an earlier file is unchanged, and nothing is left beside it.

    """
    with open_atomically(path) as file:
        file.write(content)


@contextmanager
def open_atomically(path: Path) -> Iterator[BinaryIO]:
    """Open a new file beside a path, and rename it over the path when the block ends without an error.

    The new file has the name ``file.name``, with the suffix of ``path``, and may be read there once it is flushed. It
    is locked until it is complete. A file of this kind without a lock was left by a process that was killed; it is
    removed.

    Args:
        path: The file, in a folder that exists.

    Yields:
        The new file, to be written.

    Raises:
        OSError: The file cannot be written, or the path is no regular file; an earlier file is unchanged, and nothing
            is left beside it.

    """
    if path.is_dir():
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    folder = path.absolute().parent
    _remove_abandoned(folder)
    handle = os.open(folder, os.O_RDONLY)  # before anything is written, so that a rename is not followed by an error
    try:
        with _create_partial_file(path) as file:
            try:
                yield file
                file.flush()
                os.fsync(file.fileno())
                os.replace(file.name, path)
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise
        os.fsync(handle)  # the rename itself must reach the disk
    except OSError as error:
        if error.filename is None or is_partial_file(Path(error.filename)):
            error.filename = str(path)
        raise
    finally:
        os.close(handle)


def is_partial_file(path: Path) -> bool:
    """Tell whether a path is a file half-written by `open_atomically`.

    Args:
        path: The path, of which only the name counts.

    Returns:
        Whether the name is one that `open_atomically` gives until its file is complete.

    """
    return _PARTIAL_NAME_PATTERN.fullmatch(path.name) is not None


def _create_partial_file(path: Path) -> BinaryIO:
    """Create a new, locked file; if another process removed it before it was locked, create it again."""
    while True:
        name = path.with_name(f".{path.stem[:40]}.part-{secrets.token_hex(8)}{path.suffix[:20]}")
        file = name.open("xb")
        if not _try_lock(file.fileno()) or os.fstat(file.fileno()).st_nlink:
            return file
        file.close()


def _remove_abandoned(folder: Path) -> None:
    """Remove the half-written files in a folder that killed processes of this user left: those without a lock."""
    with suppress(OSError):  # a folder that cannot be listed
        for part in filter(is_partial_file, folder.iterdir()):
            with suppress(OSError):  # another process was faster
                handle = os.open(part, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
                try:
                    found = os.fstat(handle)
                    if stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and _try_lock(handle):
                        part.unlink()
                finally:
                    os.close(handle)


def _try_lock(handle: int) -> bool:
    """Lock an open file; False where another process has the lock, or the disk knows no locks."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
