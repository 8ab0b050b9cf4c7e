"""From C files to a library: the only place of gen that starts other programs."""

from __future__ import annotations

import errno
import os
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Event

from gen.builder import object_cache
from gen.builder.build_progress import StageListener, ignore_stage
from gen.builder.deciding_text import collect_deciding_text

PROFILES = {
    "portable": ("-O2", "-ffp-contract=off"),
    "native": ("-O3", "-march=native", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math"),
}
COMPILER_TIMEOUT = 600.0  # s, that a compiler may take for one file
COMMON_FLAGS = ("-std=c99", "-g0", "-fPIC", "-fvisibility=hidden", "-Wall", "-Wextra", "-Wpedantic")
INSTRUCTION_SETS = """
ssse3 sse4_1 sse4_2 popcnt abm movbe adx f16c fma fma4 bmi1 bmi2 avx avx2 avx_vnni gfni vaes avx512f avx512cd avx512dq
avx512bw avx512vl avx512ifma avx512vbmi avx512_vbmi2 avx512_vnni avx512_bitalg avx512_vpopcntdq avx512_bf16 avx512_fp16
asimd asimdhp asimddp fphp sve sve2
"""  # the sets from which compilers choose under -march=native, as /proc/cpuinfo names them

STANDARD_HEADERS = ("fenv", "float", "limits", "math", "stddef", "stdint", "stdio", "stdlib", "string")

EXHAUSTED_ERRNOS = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)  # not the compiler's fault


class CompileError(Exception):
    """No compiler, or a compiler that failed; the sentence shows the command and its words."""


class MissingCompilerError(CompileError):
    """There is no C compiler that works."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its command, and the version that it prints."""

    command: tuple[str, ...]
    version: str


@cache
def find_compiler() -> Compiler:
    """Find the C compiler: the one named by $CC, else cc, gcc or clang, else the wheel of the `cc` extra.

    Returns:
        The compiler.

    Raises:
        MissingCompilerError: There is none that works.

    """
    named = os.environ.get("CC", "").strip()
    if named:
        try:
            command = tuple(shlex.split(named))
        except ValueError as error:
            said = f"$CC: found {named}, which is no command ({error}); correct or unset it."
            raise MissingCompilerError(said) from None
        version, why = _ask_version(command)
        if not version:
            said = f"$CC: found {named}, which is no C compiler that works ({why}); correct or unset it."
            raise MissingCompilerError(said)
        if os.sep in command[0]:  # it is called from other folders
            command = (os.path.abspath(command[0]), *command[1:])
        return Compiler(command, version)
    candidates = (("cc",), ("gcc",), ("clang",), (sys.executable, "-m", "ziglang", "cc"))
    for command in candidates:
        version, _ = _ask_version(command)
        if version:
            return Compiler(command, version)
    tried = ", ".join(shlex.join(command) for command in candidates)
    raise MissingCompilerError(
        f"no C compiler: tried {tried}. Install gcc or clang (Debian, Ubuntu: apt install gcc; Fedora: dnf install "
        "gcc; macOS: xcode-select --install), or the wheel with `pip install 'hdagen[cc]'`, or name one in $CC."
    )


def _ask_version(command: tuple[str, ...]) -> tuple[str, str]:
    """The version that a compiler prints, empty where the command is no compiler; then the reason follows."""
    if shutil.which(command[0]) is None:
        return "", "there is no such program"
    asked = shlex.join((*command, "--version"))
    try:
        done = subprocess.run(
            [*command, "--version"], capture_output=True, text=True, errors="replace", timeout=60, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        if isinstance(error, OSError) and error.errno in EXHAUSTED_ERRNOS:
            why = f"`{asked}` cannot be started ({error.strerror})"
            raise CompileError(f"{why}: allow more open files and processes by `ulimit`, or close others.") from None
        return "", f"`{asked}`: {error}"
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        words = ""
        if done.stderr.strip():
            words = f" and said {done.stderr.strip()[-1000:]}"
        return "", f"`{asked}` ended with code {done.returncode}{words}"
    return lines[0], ""


def cpu_flags() -> tuple[str, ...]:
    """List the instruction sets of this processor that a native library may use.

    Returns:
        Their names in /proc/cpuinfo, sorted; empty where that file does not name them.

    """
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return ()
    for line in text.splitlines():
        if line.startswith(("flags", "Features")):
            return tuple(sorted({*INSTRUCTION_SETS.split()} & {*line.split(":", 1)[1].split()}))
    return ()


def compiler_flags(profile: str) -> tuple[str, ...]:
    """List the compiler's flags.

    Args:
        profile: ``portable`` or ``native``.

    Returns:
        The flags of every profile, then its own.

    """
    return (*COMMON_FLAGS, *PROFILES[profile])


def compile_library(
    folder: Path,
    sources: list[str],
    profile: str,
    name: str,
    kept: Path | None,
    on_stage: StageListener = ignore_stage,
) -> None:
    """Compile sources, two at a time, the longest first, and link them into a library; the objects are removed.

    Args:
        folder: Where the sources lie, and where the library goes.
        sources: File names of the C sources.
        profile: ``portable`` or ``native``.
        name: File name of the library.
        kept: Folder of the objects that were compiled before for robots of the same structure; None keeps none.
        on_stage: Is told how many objects are there.

    Raises:
        CompileError: There is no compiler, or it failed.

    """
    made = [source.replace(".c", ".o") for source in sources]
    shared: tuple[str, ...] = ("-shared", "-Wl,-Bsymbolic")  # another library's functions never take its own's place
    if sys.platform == "darwin":
        shared = ("-dynamiclib", "-undefined", "dynamic_lookup")
    link = (*find_compiler().command, *shared, "-o", name, *made, "-lm")
    longest_first = sorted(sources, key=lambda source: -(folder / source).stat().st_size)
    pool, over = ThreadPoolExecutor(max_workers=2), Event()
    with _set_on_interrupt(over), _process_group() as group:
        try:
            headers = b""
            if kept is not None:
                headers = _preprocess_standard_headers(folder, profile, over, group)
            work = [
                pool.submit(_compile_object, folder, source, profile, kept, headers, over, group)
                for source in longest_first
            ]
            _await_objects(work, on_stage)
            on_stage("linking")
            _run_compiler(link, folder / name, over, group)
        finally:
            over.set()  # after an error nothing more is begun, and running compilers are ended
            pool.shutdown(cancel_futures=True)
    for o in made:
        (folder / o).unlink()


def _await_objects(work: list[Future[None]], on_stage: StageListener) -> None:
    """Wait for the objects of a library, and tell how many are there; the first failure is raised."""
    told = -1
    while told < len(work):
        ended = [one for one in work if one.done()]
        for one in ended:
            one.result()
        if len(ended) > told:
            told = len(ended)
            on_stage(f"compiling, {told} of {len(work)} objects")
        wait(work, timeout=0.1, return_when=FIRST_EXCEPTION)  # an interrupt just before a wait is heard only after it


@contextmanager
def _process_group() -> Iterator[int]:
    """The number of a process group for compilers and all that they start.

    The group is killed when the block ends, and when this process dies without a word: a shell in it waits for the end
    of a pipe that only this process holds.
    """
    watch = subprocess.Popen(("/bin/sh", "-c", "read -r end; kill -9 0"), stdin=subprocess.PIPE, process_group=0)
    with watch:
        try:
            yield watch.pid
        finally:
            if watch.poll() is None:
                os.killpg(watch.pid, signal.SIGKILL)


@contextmanager
def _set_on_interrupt(over: Event) -> Iterator[None]:
    """Let an interrupt set ``over`` at once, and raise it at the end of the block.

    Raised in the middle of work that threads share, it could leave a lock for which all the others wait.
    """
    heard = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or heard is not signal.default_int_handler:
        yield
        return
    came = []

    def hear(*_: object) -> None:
        came.append(True)
        over.set()

    signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, heard)
        if came:
            raise KeyboardInterrupt


def _preprocess_standard_headers(folder: Path, profile: str, over: Event, group: int) -> bytes:
    """Every declaration and macro of the standard headers; preprocessed once a process. Raises CompileError."""
    start = (*find_compiler().command, *compiler_flags(profile))
    if start not in _standard_headers:
        source, plain = folder / "headers.c", folder / "headers.i"
        source.write_text("".join(f"#include <{name}.h>\n" for name in STANDARD_HEADERS))
        _run_compiler((*start, "-E", "-P", "-dD", source.name, "-o", plain.name), plain, over, group)
        _standard_headers[start] = plain.read_bytes()
        source.unlink()
        plain.unlink()
    return _standard_headers[start]


_standard_headers = dict[tuple[str, ...], bytes]()  # by the compiler and its flags


def _compile_object(
    folder: Path, source: str, profile: str, kept: Path | None, headers: bytes, over: Event, group: int
) -> None:
    """Make the object of one source in folder: fetched, or compiled and then kept. Raises CompileError once it is all
    over."""
    compiler = find_compiler()
    start = (*compiler.command, *compiler_flags(profile))
    made = folder / source.replace(".c", ".o")
    compilation = (*start, "-c", source, "-o", made.name)
    if kept is None:
        _run_compiler(compilation, made, over, group)
        return
    processor = ""
    if profile == "native":
        processor = " ".join(cpu_flags())
    text = collect_deciding_text(folder, source)
    name = object_cache.hash_object(text, headers, start, f"{compiler.version} {processor}")
    content = object_cache.fetch_object(kept, name)
    if content is None:
        _run_compiler(compilation, made, over, group)
        object_cache.store_object(kept, name, made.read_bytes())
    else:
        made.write_bytes(content)


def plain_library(folder: Path, sources: list[str], name: str) -> None:
    """Compile a library of foreign C with -O2 and no further flags, to be timed against.

    Args:
        folder: Where the sources lie, and where the library goes.
        sources: File names of the C sources.
        name: File name of the library.

    Raises:
        CompileError: There is no compiler, or it failed.

    """
    command = (*find_compiler().command, "-O2", "-fPIC", "-shared", "-o", name, *sources, "-lm")
    with _process_group() as group:
        _run_compiler(command, folder / name, Event(), group)


def _run_compiler(command: tuple[str, ...], result: Path, over: Event, group: int) -> None:
    """Run a command of the process group ``group`` that makes ``result``. Raises CompileError."""
    try:
        code, words = _wait_for_end(command, result.parent, over, group)
    except subprocess.TimeoutExpired as error:
        raise CompileError(
            f"the compiler did not finish within {COMPILER_TIMEOUT:g} s: {shlex.join(command)}"
        ) from error
    except OSError as error:
        raise CompileError(f"the compiler could not be started ({error}): {shlex.join(command)}") from error
    if code:
        raise CompileError(f"the compiler failed with code {code}: {shlex.join(command)}\n{words or 'it said nothing'}")
    if not result.is_file():
        raise CompileError(f"the compiler ended without an error and without a {result.name}: {shlex.join(command)}")


def _wait_for_end(command: tuple[str, ...], folder: Path, over: Event, group: int) -> tuple[int, str]:
    """The code with which the command ended in the folder, and the end of its words.

    Once ``over`` is set, the command is ended (CompileError): the interrupt of a terminal does not reach a program that
    is being started just then.
    """
    until = time.monotonic() + COMPILER_TIMEOUT
    with subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        process_group=group,
    ) as child:
        try:
            while not over.is_set():
                try:
                    printed, said = child.communicate(timeout=0.1)
                    return child.returncode, (said or printed).strip()[-4000:]
                except subprocess.TimeoutExpired:
                    if time.monotonic() > until:
                        raise
        finally:
            child.terminate()
    raise CompileError(f"ended before it was done: {shlex.join(command)}")
