"""The C of a finished build with a wrapper around it, for other programs: an FMU, or firmware.

A wrapper is a folder of `gen/templates`. The headers that it includes beside those, such as a table of values, stand in
the target folder before.
"""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from gen.builder import compiler
from gen.builder.build import OBJECT_FOLDER, BuildError, is_intact, lock_folder
from gen.builder.build_files import TEMPLATES
from gen.builder.ownership import find_other_writer

MODEL_SOURCES = ("hda_input.c", "hda_model.c", "hda_prepare.c", "hda_rodas.c", "hda_step.c")
CONTROL_SOURCES = (
    *("hda_control.c", "hda_guard.c", "hda_guard_calls.c"),
    *("hda_guard_config.c", "hda_laws.c", "hda_limit.c"),
)
FIRMWARE_FILES = (
    "hda_flat.c",
    "example_control.c",
    "CMakeLists.txt",
    "toolchain_aarch64.cmake",
    "toolchain_armv7.cmake",
)
WRAPPERS = {  # the folder of templates, its files, and the sources of a build that they need
    "firmware": ("firmware", FIRMWARE_FILES, (*MODEL_SOURCES, *CONTROL_SOURCES)),
    "fmi2": ("fmu", ("hda_fmi_model.c", "hda_fmi2.c"), MODEL_SOURCES),
    "fmi3": ("fmu", ("hda_fmi_model.c", "hda_fmi3.c", "hda_fmi3_absent.c"), MODEL_SOURCES),
}


def wrap_sources(kind: str, build: Path, folder: Path) -> list[str]:
    """Copy the C of a build and of a wrapper into a folder, with every header that it includes.

    Args:
        kind: A key of ``WRAPPERS``.
        build: The folder of an intact build of the portable profile.
        folder: Where the files go.

    Returns:
        The names of the C sources.

    Raises:
        BuildError: The build is damaged, another user may write it, or it is not portable.

    """
    if not is_intact(build, build.name.rpartition("-")[2]):
        raise BuildError(f"{build}: found no complete build of your own; build the robot again.")
    profile = json.loads((build / "manifest.json").read_text(encoding="utf-8"))["profile"]
    if profile != "portable":
        raise BuildError(f"{build}: found a build of profile {profile}, possible is portable; build that one.")
    place, own, model = WRAPPERS[kind]
    templates = {file.name: file for file in (TEMPLATES / place).iterdir()}
    left = [*own, *model]
    left += [part.name for name in model for part in build.glob(name.replace(".c", "_[0-9]*.c"))]
    copied: set[str] = set()
    while left:
        name = left.pop()
        if name in copied:
            continue
        copied.add(name)
        target = folder / name
        if name in templates:
            target.write_bytes(templates[name].read_bytes())
        elif not target.exists():
            shutil.copyfile(build / name, target)
        left += re.findall(r'^#include "(\w+\.h)"', target.read_text(encoding="utf-8"), re.MULTILINE)
    return sorted(name for name in copied if name.endswith(".c"))


def compile_wrapper(build: Path, folder: Path, sources: list[str], library: str) -> None:
    """Compile sources that `wrap_sources` copied into a shared library beside them.

    Args:
        build: The folder of the build, whose objects are taken where they are the same.
        folder: Where the sources lie, and where the library goes.
        sources: File names of the C sources.
        library: File name of the library.

    Raises:
        CompileError: There is no compiler, or it failed.

    """
    kept: Path | None = build.parent / OBJECT_FOLDER
    if find_other_writer(build.parent / OBJECT_FOLDER):
        kept = None
    with lock_folder(build.parent / ".lock"):
        compiler.compile_library(folder, sources, "portable", library, kept)
