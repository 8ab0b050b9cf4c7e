"""Builds of other versions are refused by the number of their interface, before anything in them is called."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from gen.builder.build import hash_manifest
from gen.builder.compiler import find_compiler
from gen.c_code import headers
from hdagen.arm import build_loader
from hdagen.arm.compiled_arm import Arm, PlantError

BOUNDARY = ("hda_python.c", "hda_python.h", "hda_python_time.c", "hda_entry.h", "hda_abi.h")  # templates
KNOWN = {1: "e705fe6c659902a2", 2: "8a8c14362fea8c93"}


def list_keys(content: Any, path: str = "") -> set[str]:
    """Paths of the keys of a manifest; entries of a list count as one."""
    if isinstance(content, dict):
        return {f"{path}.{key}" for key in content}.union(*(list_keys(v, f"{path}.{k}") for k, v in content.items()))
    if isinstance(content, list):
        return set[str]().union(*(list_keys(entry, path) for entry in content))
    return set()


def test_the_number_changes_with_the_interface(build: Callable[..., Arm]) -> None:
    """If this fails: where a build of before would now be called or read wrongly, raise both INTERFACE by one and add
    the digest to KNOWN; where only text changed, put the new digest in the old one's place."""
    manifest = build("emps").manifest
    templates = resources.files("gen") / "templates"
    parts = [(templates / name).read_text() for name in BOUNDARY]
    parts += sorted(key for key in list_keys(manifest) if not key.startswith((".files", ".mpc")))
    parts += [json.dumps([f["name"], [name for name, _ in f["inputs"] + f["outputs"]]]) for f in manifest["functions"]]
    digest = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
    assert headers.INTERFACE == build_loader.INTERFACE == manifest["interface"] == build("emps").module.interface
    assert digest == KNOWN[headers.INTERFACE]


def copy_build(made: Arm, folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """A build that another generator would have made, with a seal that fits."""
    other = folder / made.folder.name
    shutil.copytree(made.folder, other)
    manifest = json.loads((other / "manifest.json").read_text())
    change(manifest)
    manifest["seal"] = hash_manifest(manifest)
    (other / "manifest.json").write_text(json.dumps(manifest))
    return other


@pytest.mark.parametrize(
    "found", [0, headers.INTERFACE - 1, headers.INTERFACE + 1, 1.5, str(headers.INTERFACE), True, None, [1]]
)
def test_another_manifest_is_refused(found: Any, build: Callable[..., Arm], tmp_path: Path) -> None:
    other = copy_build(build("emps"), tmp_path, lambda manifest: manifest.update(interface=found))
    possible = rf"manifest has the interface .*, possible is {headers.INTERFACE}, .* `hdagen build ROBOT`\."
    with pytest.raises(PlantError, match=possible):
        Arm(other)


def test_a_manifest_of_before_the_number_is_refused(build: Callable[..., Arm], tmp_path: Path) -> None:
    other = copy_build(build("emps"), tmp_path, lambda manifest: manifest.pop("interface"))
    with pytest.raises(PlantError, match="the manifest has the interface none, as of an older version"):
        Arm(other)


@pytest.mark.parametrize("stated", ["99", None])
def test_another_library_is_refused_before_it_is_called(
    stated: str | None, build: Callable[..., Arm], tmp_path: Path
) -> None:
    """One whose manifest says what is expected: compiled with another number, or as before there was one."""
    own = build("emps")
    source = (own.folder / "hda_python.c").read_text()
    if stated is None:
        lines = [line for line in source.splitlines() if '"interface"' not in line]
        source = "\n".join(lines).replace('"batch_width", width) < 0 ||', '"batch_width", width) < 0;')
    work = tmp_path / "made"
    shutil.copytree(own.folder, work)
    (work / "hda_python.c").write_text(source.replace("HDA_INTERFACE", stated or str(headers.INTERFACE)))
    sources = [path.name for path in work.glob("hda_*.c")]
    library = own.manifest["library"]
    command = [*find_compiler().command, "-O0", "-fPIC", "-shared", "-w", "-o", library, *sources, "-lm"]
    subprocess.run(command, cwd=work, check=True)
    digest = hashlib.sha256((work / library).read_bytes()).hexdigest()
    other = copy_build(own, tmp_path / "other", lambda manifest: manifest["files"].update({library: digest}))
    shutil.copy(work / library, other / library)
    with pytest.raises(PlantError, match=f"the library has the interface {stated or 'none, as of an older'}"):
        Arm(other)
