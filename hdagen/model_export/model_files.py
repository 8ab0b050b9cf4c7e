"""The files of a corrected model: all of them appear, or none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.support.atomic_write import open_atomically, write_atomically

_ANY_WRITE_BIT = 0o222


@contextmanager
def open_model_files(out: Path, files: Mapping[Path, bytes]) -> Iterator[Path]:
    """Write the files of a model, and keep them where the block ends without an error.

    Args:
        out: The model's main file.
        files: The content of each file, the main one among them.

    Yields:
        The main file as it can be read in the block; it gets its own name at the end.

    Raises:
        PlantError: A file cannot be written, is read-only, or is there although the main one is not.

    """
    beside = {path: content for path, content in files.items() if path != out}
    for path in files:
        _refuse_place(path, out)
    earlier = {path: path.read_bytes() if path.exists() else None for path in beside}
    try:
        for path, content in beside.items():
            write_atomically(path, content)
        with open_atomically(out) as file:
            file.write(files[out])
            file.flush()
            yield Path(file.name)
    except OSError as error:
        _put_back(earlier)
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    except BaseException:
        _put_back(earlier)
        raise


def _refuse_place(path: Path, out: Path) -> None:
    if path.exists() and not path.stat().st_mode & _ANY_WRITE_BIT:
        raise PlantError(f"{path}: is there and read-only; name another place by --out.")
    if path != out and path.exists() and not out.exists():
        raise PlantError(f"{path}: is there already and would be lost; move it, or name another place by --out.")
    if not path.absolute().parent.is_dir():
        raise PlantError(f"{path}: there is no folder {path.parent}; write the model beside the one that it corrects.")


def _put_back(earlier: Mapping[Path, bytes | None]) -> None:
    """Restore files as they were."""
    for path, content in earlier.items():
        if content is None:
            path.unlink(missing_ok=True)
        else:
            write_atomically(path, content)
