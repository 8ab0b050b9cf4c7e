"""A compiler that compiles nothing, so that tests of builds take no time: it writes what it is asked for."""

from __future__ import annotations

from pathlib import Path

SCRIPT = """#!/bin/sh
case "$*" in *--version*) echo "{version}"; exit 0;; esac
echo "$*" >> {log}
{pause}
words="$*"
while [ $# -gt 0 ]; do
    if [ "$1" = -o ]; then echo "$words" > "$2"; fi
    shift
done
"""


def stub_compiler(folder: Path, sleep: float = 0.0, version: str = "stub 1.0") -> Path:
    """The script, made in ``folder``. It takes ``sleep`` seconds a file; ``folder``/commands lists its commands."""
    script = folder / "stubcc"
    pause = f"sleep {sleep}" if sleep else ":"  # a process less
    script.write_text(SCRIPT.format(version=version, log=folder / "commands", pause=pause))
    script.chmod(0o755)
    return script
