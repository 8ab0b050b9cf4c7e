"""FMU: the compiled arm as a unit for co-simulation, FMI 3.0 or 2.0, with its sources and a library for this machine.

A communication step holds the inputs, as a row of a log does: the same steps as `hdagen.simulate` makes, to the bit.
"""

from __future__ import annotations

import hashlib
import platform
import re
import sys
import tempfile
import zipfile
from io import BytesIO
from pathlib import Path

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.generator import run_generator
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.export_formats import Exported, list_parameter_changes
from hdagen.model_export.fmu_description import describe_model, describe_sources
from hdagen.model_export.fmu_variables import list_variables, write_table
from hdagen.support.atomic_write import write_atomically

FMI_VERSIONS = ("3.0", "2.0")
PROPOSED_PERIOD = 1e-3  # s, of communication steps
ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip file can hold: equal content is equal bytes
SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib")}  # by sys.platform: FMI's name, ending
PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64", "i686": "x86"}


def write(robot: CorrectedRobot, out: Path, fmi: str = FMI_VERSIONS[0]) -> Exported:
    """Write a robot as an FMU.

    Args:
        robot: The robot.
        out: The file.
        fmi: The version of the interface, "3.0" or "2.0".

    Returns:
        The file, and the parameters that the verdict changed.

    Raises:
        PlantError: There is no such version, the sources cannot be compiled, or the file cannot be written.

    """
    if fmi not in FMI_VERSIONS:
        raise PlantError(f"--fmi {fmi}: possible are {' and '.join(FMI_VERSIONS)}.")
    arm = robot.corrected
    identifier = f"hda_{re.sub(r'[^a-z0-9]+', '_', arm.robot['name'].lower()).strip('_')}"
    variables, token = list_variables(arm), _make_token(arm, fmi)
    place, ending = _find_binary_place(fmi)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "hda_fmi_table.h").write_text(write_table(arm, variables, token), encoding="utf-8")
        library = f"{identifier}{ending}"
        done = run_generator("wrap", f"fmi{fmi[0]}", f"--library={library}", "--", str(arm.folder), str(folder))
        if done.code:
            raise PlantError("\n".join(done.messages))
        files = {f"binaries/{place}/{library}": (folder / library).read_bytes()}
        files |= {f"sources/{path.name}": path.read_bytes() for path in folder.glob("*.[ch]")}
    sources = list(done.lines)
    name = arm.robot["name"]
    files["modelDescription.xml"] = describe_model(fmi, identifier, name, token, PROPOSED_PERIOD, variables, sources)
    if fmi == "3.0":
        files["sources/buildDescription.xml"] = describe_sources(identifier, sources)
    try:
        write_atomically(out, _pack_files(files))
    except OSError as error:
        raise PlantError(f"{out}: cannot be written ({error.strerror}); make room or name another place.") from None
    return Exported((out,), tuple(list_parameter_changes(robot)), {}, robot.notes)


def _make_token(arm: Arm, fmi: str) -> str:
    """A token of the build, its parameters and the version, in the form of a GUID."""
    digest = hashlib.sha256(f"{arm.manifest['build']} {fmi} {arm.stable_step!r}".encode() + arm.p.tobytes()).hexdigest()
    return "{" + "-".join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32])) + "}"


def _find_binary_place(fmi: str) -> tuple[str, str]:
    """The folder of this machine's library in an FMU, and the library's ending."""
    if sys.platform not in SYSTEMS or platform.machine().lower() not in PROCESSORS:
        raise PlantError(f"{sys.platform} on {platform.machine()}: an FMU names no such machine; export on another.")
    (system, ending), processor = SYSTEMS[sys.platform], PROCESSORS[platform.machine().lower()]
    if fmi == "3.0":
        return f"{processor}-{system}", ending
    bits = "32" if processor == "x86" else "64"
    if processor == "aarch64" and system == "linux":
        return "aarch64-linux", ending  # FMI 2.0 names none: the name of FMI 3.0, which tools look for
    return f"{system}{bits}", ending


def _pack_files(files: dict[str, bytes]) -> bytes:
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, ZIP_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name])
    return packed.getvalue()
