"""From C files to a library: the only place of gen that starts other programs."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PROFILES = {
    "portable": ("-O2", "-ffp-contract=off"),
    "native": ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"),
}
COMMON = ("-std=c99", "-fPIC", "-fvisibility=hidden", "-Wall", "-Wextra", "-Wpedantic")
VECTOR_FLAGS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "avx512vl", "avx512bw", "asimd", "sve")


class CompileError(Exception):
    """No compiler, or a compiler that failed; the sentence shows the command and its words."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: the command and what it says of itself."""

    command: tuple[str, ...]
    version: str


@cache
def find() -> Compiler:
    """The compiler named by $CC, else cc, gcc, clang, else the wheel of the `cc` extra."""
    named = os.environ.get("CC")
    candidates = [tuple(shlex.split(named))] if named else [("cc",), ("gcc",), ("clang",), (sys.executable, "-m", "ziglang", "cc")]
    for command in candidates:
        if not command or shutil.which(command[0]) is None:
            continue
        try:
            asked = subprocess.run([*command, "--version"], capture_output=True, text=True, timeout=60, check=False)
        except OSError:
            continue
        if asked.returncode == 0 and asked.stdout.strip():
            return Compiler(command, asked.stdout.strip().splitlines()[0])
    tried = ", ".join(shlex.join(command) for command in candidates)
    raise CompileError(
        f"no C compiler: tried {tried}. Install gcc or clang (Debian, Ubuntu: apt install gcc; macOS: xcode-select --install; "
        "Fedora: dnf install gcc), or the wheel with `pip install 'hdagen[cc]'`, or name one in $CC."
    )


def cpu_flags() -> tuple[str, ...]:
    """The vector instructions of this processor that a native library may use."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return ()
    for line in text.splitlines():
        if line.startswith(("flags", "Features")):
            have = set(line.split(":", 1)[1].split())
            return tuple(flag for flag in VECTOR_FLAGS if flag in have)
    return ()


def flags(profile: str) -> tuple[str, ...]:
    """The flags of a profile."""
    return (*COMMON, *PROFILES[profile])


def library(folder: Path, sources: list[str], profile: str, name: str) -> None:
    """Compile the sources in folder, two at a time, and link them into folder/name; objects are removed."""
    compiler = find()
    objects = [source.removesuffix(".c") + ".o" for source in sources]
    with ThreadPoolExecutor(max_workers=2) as pool:
        jobs = [(*compiler.command, *flags(profile), "-c", source, "-o", o) for source, o in zip(sources, objects, strict=True)]
        for done in [pool.submit(_run, job, folder) for job in jobs]:
            done.result()
    shared = ("-dynamiclib", "-undefined", "dynamic_lookup") if sys.platform == "darwin" else ("-shared",)
    _run((*compiler.command, *shared, "-o", name, *objects, "-lm"), folder)
    for o in objects:
        (folder / o).unlink()


def _run(command: tuple[str, ...], folder: Path) -> None:
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)
    except subprocess.TimeoutExpired as error:
        raise CompileError(f"the compiler did not finish within 600 s: {shlex.join(command)}") from error
    except OSError as error:
        raise CompileError(f"the compiler could not be started ({error}): {shlex.join(command)}") from error
    if done.returncode:
        words = (done.stderr or done.stdout).strip()[-4000:] or "it said nothing"
        raise CompileError(f"the compiler failed with code {done.returncode}: {shlex.join(command)}\n{words}")
