"""Whether this computer has everything that builds and diagnoses need, with the cure where it has not."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from hdagen.arm.build_loader import PlantError, find_build_folder, refuse_other_writers
from hdagen.arm.generator import run_generator
from hdagen.arm.preset_files import find_preset_files

OLDEST_PYTHON = (3, 11)
OPTIONAL_PACKAGES = {
    "mujoco": ("mujoco", "`hdagen blind`, and `hdagen export` with --into or --prove"),
    "matplotlib": ("paper", "`hdagen paper`"),
}
_REQUIREMENT_PATTERN = re.compile(r"([A-Za-z0-9._-]+)\s*\(?([^;)]*)\)?\s*(;.*)?")
_BOUND_PATTERN = re.compile(r"(==|>=|<)\s*([0-9.]+)")


@dataclass(frozen=True)
class InstallationFinding:
    """One thing that was looked at.

    Attributes:
        subject: The thing.
        is_good: Whether it is as it must be.
        is_needed: Whether hdagen cannot do without it.
        found: What was found, as a phrase; where it is not good, with the cure.

    """

    subject: str
    is_good: bool
    is_needed: bool
    found: str


def check_installation() -> Iterator[InstallationFinding]:
    """Look at everything that builds and diagnoses need.

    Yields:
        A finding for each thing, as it is looked at.

    """
    yield _check_python()
    yield _check_generator()
    yield _check_compiler()
    yield _check_build_folder()
    yield from _check_dependencies()
    for package, (extra, user) in OPTIONAL_PACKAGES.items():
        yield _check_optional_package(package, extra, user)


def _check_python() -> InstallationFinding:
    version = ".".join(map(str, sys.version_info[:3]))
    oldest = ".".join(map(str, OLDEST_PYTHON))
    if sys.version_info < OLDEST_PYTHON:
        return InstallationFinding("Python", False, True, f"{version} is too old; install {oldest} or newer.")
    return InstallationFinding("Python", True, True, version)


def _check_generator() -> InstallationFinding:
    """The package `gen`, which is installed beside hdagen."""
    presets = find_preset_files()
    if presets:
        return InstallationFinding("generator", True, True, f"gen, with {len(presets)} presets")
    return InstallationFinding(
        "generator", False, True, "the package gen is not beside hdagen; install hdagen again: pip install hdagen."
    )


def _check_compiler() -> InstallationFinding:
    """Let the generator compile a small library, as a build does."""
    done = run_generator(module="gen.builder.compiler_check")
    if done.code == 0 and done.lines:
        return InstallationFinding("C compiler", True, True, done.lines[-1])
    words = " ".join(done.messages) or f"the check ended with code {done.code} and said nothing; start it again."
    return InstallationFinding("C compiler", False, True, words)


def _check_build_folder() -> InstallationFinding:
    try:
        folder = find_build_folder()
        refuse_other_writers(folder)
    except PlantError as error:
        return InstallationFinding("builds folder", False, True, str(error).replace("\n", " "))
    place = Path(os.path.abspath(folder))
    while not place.exists():  # it will be made there
        place = place.parent
    if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
        return InstallationFinding("builds folder", True, True, f"{folder} can be written by you alone")
    cure = "name a folder of your own in $HDAGEN_BUILD"
    return InstallationFinding("builds folder", False, True, f"{folder}: {place} cannot be written; {cure}.")


def _check_dependencies() -> Iterator[InstallationFinding]:
    try:
        required = metadata.requires("hdagen") or []
    except metadata.PackageNotFoundError:
        cure = "install it, for instance by pip install -e . in its folder"
        why = f"hdagen is not installed as a package, so what it needs is not known; {cure}."
        yield InstallationFinding("dependencies", False, True, why)
        return
    for requirement in required:
        match = _REQUIREMENT_PATTERN.fullmatch(requirement)
        if match and "extra" not in (match[3] or ""):
            yield _check_dependency(match[1], match[2].strip())


def _check_dependency(package: str, bounds: str) -> InstallationFinding:
    version = _find_version(package)
    cure = f"pip install '{package}{bounds}'"
    if version is None:
        return InstallationFinding(package, False, True, f"not installed; {cure}")
    if not is_within_bounds(version, bounds):
        return InstallationFinding(package, False, True, f"{version} is not {bounds}; {cure}")
    return InstallationFinding(package, True, True, version)


def _check_optional_package(package: str, extra: str, user: str) -> InstallationFinding:
    version = _find_version(package)
    if version is None:
        why = f"not installed; for {user}: pip install 'hdagen[{extra}]'"
        return InstallationFinding(package, False, False, why)
    return InstallationFinding(package, True, False, version)


def _find_version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def is_within_bounds(version: str, bounds: str) -> bool:
    """Tell whether a version is within the bounds of a requirement.

    Args:
        version: The version, of which the numbers at its begin count.
        bounds: The bounds, such as ">=1.13,<2"; only `==`, `>=` and `<` are used in this project.

    Returns:
        Whether it is within all of them.

    """
    found = _split_version(version)
    for sign, bound in _BOUND_PATTERN.findall(bounds):
        length = max(len(found), len(_split_version(bound)))
        here, there = (_split_version(text, length) for text in (version, bound))
        if not {"==": here == there, ">=": here >= there, "<": here < there}[sign]:
            return False
    return True


def _split_version(version: str, length: int = 0) -> tuple[int, ...]:
    """The numbers of a version, with zeros up to a length."""
    leading = re.match(r"[0-9]+(\.[0-9]+)*", version)
    numbers = tuple(map(int, leading[0].split("."))) if leading else ()
    return numbers + (0,) * (length - len(numbers))
