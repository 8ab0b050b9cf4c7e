"""Files that appear whole or not at all: written beside their place, synced, then renamed over it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(path: Path, content: bytes) -> Iterator[Path]:
    """A new file beside ``path`` that holds ``content`` and takes its place when the block ends without an error.

    What the block is given may be read and checked, and has the suffix of ``path``. Raises OSError; what stood at
    ``path`` is then unchanged, and nothing is left beside it.
    """
    temporary = path.with_name(f".{path.stem[:100]}.{secrets.token_hex(8)}{path.suffix}")
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        yield temporary
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
