"""What `paper` costs, in instructions that a processor executes: as much as it did, by callgrind.

The portable profile is the same on every processor. What the C library's sines and exponentials take is not counted:
they choose their code by the processor.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from compiled import Compiled

from gen.builder.compiler import compile_library, compiler_flags, find_compiler
from gen.builder.wrapped_sources import MODEL_SOURCES

COMPILER = "12.2.0"  # of gcc, with which the counts were stored
STORED = {"rhs": 333, "rhs_exact": 325, "step": 1641, "step_exact": 19994, "rhs_jacobian": 2332}  # a call
MOST = 1.03  # times as many
CALLS = 200
MODEL = "model.so"
ARGUMENTS = {
    "rhs": "x, u, c, out",
    "rhs_exact": "x, u, sliding, c, out",
    "step": "x, u, c, &h, out",
    "step_exact": "x, u, c, &h, out",
    "rhs_jacobian": "x, u, c, out, out + 1000, out + 2000",
}
PROGRAM = """#include "hda.h"
#include <stdlib.h>
#include <string.h>
static double p[] = {%s}, c[10000], out[10000];
int main(int count, char **words) {
    const double x[] = {30.0, -20.0, 0.29, -0.21, 40.0, 30.0, 0.5, 0.4}, u[20] = {1.0, -0.5};
    const double sliding[] = {1.0, 1.0}, h = 5e-4;
    (void)count;
    hda_prepare(p, c);
    for (int k = atoi(words[2]); k > 0; k--) {
%s    }
    (void)sliding;
    (void)h;
    return 0;
}
"""


def program(compiled: Compiled, folder: Path) -> Path:
    """A program that calls a function of the model as often as it is told."""
    parts = [part.name for name in MODEL_SOURCES for part in compiled.folder.glob(name.replace(".c", "_[0-9]*.c"))]
    for source in [*MODEL_SOURCES, *parts, *(path.name for path in compiled.folder.glob("*.h"))]:
        shutil.copyfile(compiled.folder / source, folder / source)
    compile_library(folder, [*MODEL_SOURCES, *parts], "portable", MODEL, None)
    calls = "".join(
        f'        if (strcmp(words[1], "{name}") == 0) hda_{name}({arguments});\n'
        for name, arguments in ARGUMENTS.items()
    )
    (folder / "calls.c").write_text(PROGRAM % (", ".join(map(repr, map(float, compiled.nominal))), calls))
    command = [*find_compiler().command, *compiler_flags("portable"), "calls.c", MODEL, "-Wl,-rpath,.", "-lm"]
    subprocess.run([*command, "-o", "calls"], cwd=folder, check=True)
    return folder / "calls"


def count_instructions(calls: Path, name: str, times: int) -> int:
    """Instructions of the model's own functions."""
    found, folder = calls.with_name("callgrind.out"), calls.parent
    command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={found}", str(calls), name, str(times)]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    annotated = ["callgrind_annotate", "--threshold=100", "--auto=no", str(found)]
    listed = subprocess.run(annotated, check=True, capture_output=True, text=True).stdout
    own = re.findall(rf"^\s*([\d,]+) .*{MODEL}\]$", listed, re.MULTILINE)
    return sum(int(count.replace(",", "")) for count in own)


def test_paper_takes_no_more_instructions_than_it_did(build: Callable[..., Compiled], tmp_path: Path) -> None:
    if shutil.which("valgrind") is None or shutil.which("callgrind_annotate") is None:
        pytest.skip("valgrind is not installed; apt-get install valgrind")
    if COMPILER not in find_compiler().version:
        pytest.skip(f"the counts are those of gcc {COMPILER}, and here is {find_compiler().version}")
    calls = program(build("paper"), tmp_path)
    found = {
        name: (count_instructions(calls, name, CALLS) - count_instructions(calls, name, 0)) / CALLS for name in STORED
    }
    assert all(count > 0 for count in found.values())
    assert {name: count for name, count in found.items() if count > MOST * STORED[name]} == {}, found
