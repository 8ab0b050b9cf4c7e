"""MATLAB's .mat (versions 4 to 7) read in a child process: a crafted file crashes or hangs the child, never the caller.

Run as a script this file is the child: it reads one .mat and writes its numeric arrays as .npz. The child has its own
limits of memory, time and output, sees no user site and no environment paths, and imports nothing of this package.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_MOST_MAT_BYTES = 2 << 30  # bytes of a file
_MOST_MEMORY_BYTES = 3 << 29  # bytes of address space beyond that of the libraries
_MOST_READING_SECONDS = 60.0
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_REFUSED_EXIT_CODE = 3  # the child's exit code where the reader refuses the file; the reason is on standard error
_MOST_VECTORS = 4096  # vectors of one matrix, or of one file


def read_mat(
    path: Path | str, seconds: float = _MOST_READING_SECONDS, memory: int = _MOST_MEMORY_BYTES
) -> dict[str, np.ndarray]:
    """Read the real numeric variables of a .mat file; other variables are left out.

    Args:
        path: The file, of MATLAB's versions 4 to 7.
        seconds: Time that reading may take, s.
        memory: Memory that reading may take, bytes.

    Returns:
        float64 vectors by name. A vector has its own name; fields of a struct are ``name.field``; a matrix gives its
        columns as ``name(:,1)``, …, or its rows as ``name(1,:)``, … where it is wider than tall.

    Raises:
        LogError: The file is damaged, too large, too slow to read, or of version 7.3.

    """
    from hdagen.log.data_table import LogError
    from hdagen.support.input_file import (
        InputFileError,
        check_file,  # not above: the child runs this file without the package
    )

    path = Path(path)
    try:
        check_file(path, _MOST_MAT_BYTES, "give the path of a .mat file")
        with path.open("rb") as file:
            head = file.read(1024)
    except InputFileError as error:
        raise LogError([str(error)]) from None
    except OSError as error:
        raise LogError([f"{path}: cannot be read ({error.strerror}); check that it may be read."]) from None
    if head.startswith((_HDF5_SIGNATURE, b"MATLAB 7.3")) or head[512:520] == _HDF5_SIGNATURE:
        raise LogError(
            [f"{path}: a MATLAB 7.3 (HDF5) file; possible are versions 4 to 7: in MATLAB save('log.mat', …, '-v7')."]
        )
    with tempfile.TemporaryDirectory(prefix="hdagen-mat-") as folder:
        out = Path(folder) / "arrays.npz"
        problem = _read_in_child(path, out, Path(folder) / "reason.txt", seconds, memory)
        if problem is None:
            try:
                with np.load(out, allow_pickle=False) as arrays:
                    names = [str(name) for name in arrays["names"]]
                    return {name: arrays[f"a{i}"] for i, name in enumerate(names)}
            except (OSError, ValueError, KeyError, EOFError, MemoryError):
                problem = "the reader's answer was incomplete"
    raise LogError([f"{path}: not a readable .mat file ({problem}): save it again with '-v7', or export it as CSV."])


def _read_in_child(path: Path, out: Path, reason: Path, seconds: float, memory: int) -> str | None:
    """Read ``path`` into ``out`` in a child process; return a phrase on the problem, if any."""
    command = [
        sys.executable,
        "-I",
        "-W",
        "ignore",
        str(Path(__file__).resolve()),
        str(path.resolve()),
        str(out),
        str(memory),
        str(seconds),
    ]
    kept = {key: os.environ[key] for key in ("PATH", "SYSTEMROOT", "LD_LIBRARY_PATH") if key in os.environ}
    with reason.open("wb") as errors:
        try:
            code = subprocess.run(
                command,
                check=False,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                timeout=seconds,
                env={**kept, "OPENBLAS_NUM_THREADS": "1", "TMPDIR": str(out.parent)},
                cwd=out.parent,
            ).returncode
        except subprocess.TimeoutExpired:
            return f"reading it took longer than {seconds:g} s"
    if code == 0:
        return None
    if code == _REFUSED_EXIT_CODE:
        with reason.open("rb") as errors:
            text = errors.read(2000).decode("utf-8", errors="replace")
        return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "no reason given")[:300]
    if code < 0:
        return f"the reader crashed with signal {-code}"
    return f"the reader crashed with exit code {code}"


def _limit_resources(memory: int, seconds: float) -> None:
    """Bound this process: address space, output, processor time; no core file."""
    try:
        import resource
    except ImportError:  # not a POSIX system: the parent's time limit still holds
        return
    used = 0
    if Path("/proc/self/statm").exists():
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    for what, wanted in (
        (resource.RLIMIT_AS, used + memory),
        (resource.RLIMIT_FSIZE, memory),
        (resource.RLIMIT_CPU, int(seconds) + 1),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(what)[1]
        soft = wanted
        if hard != resource.RLIM_INFINITY:
            soft = min(wanted, hard)
        resource.setrlimit(what, (soft, hard))


def _list_vectors(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """The real numeric vectors in a variable as loadmat gives it (structs as objects, singletons squeezed)."""
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames:
            yield from _list_vectors(f"{name}.{field}", getattr(value, field))
        return
    if not isinstance(value, (np.ndarray, np.generic, int, float)):
        return
    array = np.asarray(value)
    if array.dtype.kind not in "buif" or array.ndim > 2 or array.size == 0:
        return
    if array.ndim < 2:
        yield name, np.atleast_1d(array).astype(np.float64)
    elif min(array.shape) <= _MOST_VECTORS:
        pattern = "{}({},:)"
        if array.shape[0] >= array.shape[1]:
            array, pattern = array.T, "{}(:,{})"
        for i, vector in enumerate(array, start=1):
            yield pattern.format(name, i), np.ascontiguousarray(vector, dtype=np.float64)


def _run_as_child(path: str, out: str, memory: int, seconds: float) -> None:
    """Read ``path`` with scipy under limits and write ``out``: array i as a{i}, all names in ``names``."""
    import scipy.io

    _limit_resources(memory, seconds)
    try:
        variables = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False, appendmat=False)
        arrays = [
            pair
            for name, value in variables.items()
            if not name.startswith("__")
            for pair in _list_vectors(name, value)
        ]
        if len(arrays) > _MOST_VECTORS:
            raise ValueError(f"it holds {len(arrays)} vectors, more than {_MOST_VECTORS}")
        names = np.array([name[:200] for name, _ in arrays], dtype=str)
        np.savez(out, names=names, **{f"a{i}": array for i, (_, array) in enumerate(arrays)})  # type: ignore[arg-type]
    except MemoryError:
        sys.exit(_report_reason(f"it needs more than {memory >> 20} MB"))
    except Exception as error:  # whatever the reader meets in a damaged file becomes one line for the parent
        sys.exit(_report_reason(f"{type(error).__name__}: {error}"))


def _report_reason(reason: str) -> int:
    print(" ".join(reason.split())[:300].encode("ascii", "replace").decode(), file=sys.stderr)
    return _REFUSED_EXIT_CODE


if __name__ == "__main__":
    _run_as_child(sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4]))
