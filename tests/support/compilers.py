"""The ways in which C of ours is compiled to be stormed: two compilers, with and without sanitizers, 64 and 32 bit."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import pytest

STRICT = ("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
SANITIZED = ("-O0", "-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
NARROW = ("-O2", "-m32", "-msse2", "-mfpmath=sse")
COMPILERS = {
    "gcc": ("gcc", "-O2"),
    "gcc sanitized": ("gcc", *SANITIZED),
    "gcc 32 bit": ("gcc", *NARROW),
    "clang": ("clang", "-O2"),
    "clang sanitized": ("clang", *SANITIZED),
    "clang 32 bit": ("clang", *NARROW),
}


@cache
def _why_not(name: str) -> str:
    """Why that compiler cannot make a program here; empty where it can."""
    program, *flags = COMPILERS[name]
    if shutil.which(program) is None:
        return f"{program} is not installed here"
    with tempfile.TemporaryDirectory() as folder:
        main = Path(folder) / "main.c"
        main.write_text("#include <fenv.h>\n#include <stdint.h>\nint main(void) { return fegetround() == 77; }\n")
        command = [program, *flags, str(main), "-lm", "-o", str(main.with_suffix(""))]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
    more = "; apt-get install gcc-multilib" if "-m32" in flags else ""
    return f"{' '.join(command[:-4])} makes no program here{more}" if made.returncode else ""


def compiler(name: str) -> list[str]:
    """The command of COMPILERS; skips where it is not to be had."""
    why = _why_not(name)
    if why:
        pytest.skip(why)
    return list(COMPILERS[name])


def said(command: Sequence[str | Path]) -> str:
    """What a program prints; its complaint as an error."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}"
    return done.stdout


def compiled(name: str, harness: Path, sources: Sequence[Path], include: Sequence[Path], folder: Path) -> Path:
    """A program of a harness and sources, two compiled at a time; a warning in one that is not OSQP's is an error.

    Objects of the sources stay in ``folder`` for another harness; the names of those of one build differ.
    """
    command, label = [*compiler(name), *(f"-I{one}" for one in include)], name.replace(" ", "-")
    out = folder / f"{label}-{harness.stem}"
    objects = [folder / f"{label}-{source.stem}.o" for source in (harness, *sources)]

    def make(source: Path, made: Path) -> None:
        if made.exists():
            return
        strict = ("-std=c99", "-ffp-contract=off") if source.name.startswith("hda_osqp_") else STRICT
        said([*command, *strict, "-fno-builtin-malloc", "-c", source, "-o", made])

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(make, (harness, *sources), objects))
    said([*command, *objects, "-lm", "-o", out])
    return out
