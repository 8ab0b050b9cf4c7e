"""`hdagen export c`: it compiles under the project's flags, for ARM too, and its flat library ticks as Python does."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import MEASUREMENT_CHANNELS, Controller
from hdagen.model_export import c_writer
from hdagen.model_export.corrected_robot import CorrectedRobot

TICKS = 300
Doubles = ctypes.POINTER(ctypes.c_double)


@pytest.fixture(scope="module")
def robot(build: Callable[..., Any]) -> CorrectedRobot:
    """The preset with another friction and payload than its file has."""
    file = Arm(build("paper").folder)
    corrected = file.with_parameters(file.p)
    corrected.parameters.update({"coulomb_friction_2": 0.06, "payload_mass_2": 0.3})
    return CorrectedRobot("paper", file, corrected)


@pytest.fixture(scope="module")
def folder(robot: CorrectedRobot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "c"
    c_writer.write(robot, out)
    return out


@pytest.fixture(scope="module")
def compiled(folder: Path) -> Path:
    """The folder in which CMake compiled everything, warnings being errors."""
    return _compile(folder, folder.with_name("out"))


def _compile(folder: Path, out: Path, *options: str) -> Path:
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not installed here")
    for command in (
        ["cmake", "-S", str(folder), "-B", str(out), "-DCMAKE_COMPILE_WARNING_AS_ERROR=ON", *options],
        ["cmake", "--build", str(out), "--parallel", "2"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
    return out


def _follow_motion(command: list[str]) -> float:
    """The largest error of the example, rad; the example says how each run ended."""
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout
    name, sentence, error = re.fullmatch(r"(.*): (.*) largest error ([\d.]+)\n", said).groups()  # type: ignore[union-attr]
    assert (name, sentence) == ("dual-joint harmonic-drive arm", "The torque is the controller's own.")
    return float(error)


# -- the example ------------------------------------------------------------------------------------------------------


def test_the_example_follows_its_motion_within_the_limits(compiled: Path) -> None:
    assert 0.0 < _follow_motion([str(compiled / "example_control")]) < 2e-3


@pytest.mark.parametrize("processor, prefix", [("aarch64", "aarch64-linux-gnu"), ("armv7", "arm-linux-gnueabihf")])
def test_the_toolchain_files_compile_for_arm(folder: Path, processor: str, prefix: str) -> None:
    if shutil.which(f"{prefix}-gcc") is None:
        pytest.skip(f"{prefix}-gcc is not installed here")
    options = ["--toolchain", str(folder / f"toolchain_{processor}.cmake"), "-DCMAKE_BUILD_TYPE=Debug"]
    out = _compile(folder, folder.with_name(processor), *options)
    header = (out / "example_control").read_bytes()[:20]
    assert header[4] == {"aarch64": 2, "armv7": 1}[processor]  # ELF: 64 or 32 bits
    assert int.from_bytes(header[18:20], "little") == {"aarch64": 183, "armv7": 40}[processor]  # ELF's numbers of ARM
    emulator = shutil.which({"aarch64": "qemu-aarch64", "armv7": "qemu-arm"}[processor])
    if emulator:
        assert _follow_motion([emulator, "-L", f"/usr/{prefix}", str(out / "example_control")]) < 2e-3


# -- the flat library -------------------------------------------------------------------------------------------------


class FlatController:
    """One controller of the flat library."""

    def __init__(self, library: Path, law: str, safe: int = 1, limits: np.ndarray | None = None) -> None:
        self.c = ctypes.CDLL(str(library))
        self.c.hda_flat_sentence.restype = ctypes.c_char_p
        self.memory = np.zeros(self.c.hda_flat_bytes() // 8 + 1)
        self.law = self.c.hda_flat_law(law.encode())
        self.joints = self.c.hda_flat_joints()
        p, gains = np.zeros(self.c.hda_flat_parameter_count()), np.zeros(self.c.hda_flat_gain_count(self.law))
        own = np.zeros(self.c.hda_flat_limit_count())
        self.c.hda_flat_parameters(_point(p))
        self.c.hda_flat_limits(_point(own))
        self.c.hda_flat_gains(self.law, _point(gains))
        limits = own if limits is None else limits
        call = self.c.hda_flat_configure
        self.configured = call(_point(self.memory), self.law, _point(p), _point(gains), safe, _point(limits))
        self.parameters, self.limits, self.gains = p, limits, gains
        self.torque = np.zeros(self.joints)

    def tick(self, now: float, channels: dict[str, np.ndarray], reference: np.ndarray) -> int:
        values = [_point(channels[name]) for name in MEASUREMENT_CHANNELS_IN_C]
        time = ctypes.c_double(now)
        return self.c.hda_flat_tick(_point(self.memory), time, time, *values, _point(reference), _point(self.torque))


MEASUREMENT_CHANNELS_IN_C = (
    *("motor_position", "motor_velocity", "joint_position"),
    *("joint_velocity", "motor_torque", "tip_force"),
)


def _point(values: np.ndarray) -> Any:
    return values.ctypes.data_as(Doubles)


@pytest.mark.parametrize("law", ["position", "impedance_cartesian", "admittance_joint"])
def test_the_flat_library_gives_the_bits_of_the_python_controller(
    compiled: Path, robot: CorrectedRobot, law: str
) -> None:
    assert set(MEASUREMENT_CHANNELS_IN_C) == set(MEASUREMENT_CHANNELS)
    flat, python = FlatController(compiled / "libhda_flat.so", law), Controller(robot.corrected, law, Guard(Safe.ZERO))
    assert flat.configured == 0
    assert flat.parameters.tobytes() == robot.corrected.p.tobytes() != robot.file.p.tobytes()
    assert list(flat.gains) == list(python.gains.values())
    random, reference = np.random.default_rng(5), np.zeros(len(python.reference_names))
    angle, statuses = np.array([0.3, 0.5]), set()
    for k in range(TICKS):
        angle = angle + random.normal(size=2) * 5e-4
        wobble = random.normal(size=(4, 2))
        channels = {
            "motor_position": 100.0 * angle + 1e-3 * wobble[0],
            "motor_velocity": wobble[1],
            "joint_position": angle,
            "joint_velocity": 0.01 * wobble[1],
            "motor_torque": 0.1 * wobble[2],
            "tip_force": 3.0 * wobble[3],
        }
        reference[:2] = [0.25, 0.1] if law == "impedance_cartesian" else angle + 0.01
        now = 1e-3 * (k + 1)
        if k == 200:
            channels["tip_force"] = np.full(2, np.nan)  # both go to the safe state, and stay there
        expected = python.tick(now, reference, **channels)
        assert flat.tick(now, channels, reference) == expected
        assert flat.torque.tobytes() == python.torque.tobytes()
        statuses.add(expected)
    assert {status for status in statuses if status < 0} and {status for status in statuses if status >= 0}
    fault = python.read_fault()
    assert fault is not None
    assert flat.c.hda_flat_read_fault(_point(flat.memory)) == fault.status
    assert flat.c.hda_flat_sentence(fault.status).decode() == fault.sentence


def test_the_flat_library_refuses_what_is_wrong(compiled: Path) -> None:
    library = compiled / "libhda_flat.so"
    good = FlatController(library, "position")
    assert good.c.hda_flat_wrench() == 2
    assert good.c.hda_flat_law(b"no law") == -1 and good.c.hda_flat_gain_count(99) == -1
    limits = good.limits.copy()
    limits[0] = -1.0  # a period
    assert FlatController(library, "position", limits=limits).configured < 0
    assert FlatController(library, "position", safe=0).configured < 0
    channels = {name: np.zeros(2) for name in MEASUREMENT_CHANNELS_IN_C}
    good.torque[:] = np.nan
    unconfigured = FlatController(library, "position", safe=0)
    assert unconfigured.tick(0.001, channels, np.zeros(6)) < 0
    assert (unconfigured.torque == 0).all()
    null = [None] * 6
    time = ctypes.c_double(0.001)
    assert good.c.hda_flat_tick(_point(good.memory), time, time, *null, _point(np.zeros(6)), _point(good.torque)) < 0
    assert np.isfinite(good.torque).all()


# -- the folder -------------------------------------------------------------------------------------------------------


def test_the_limits_of_the_robot_file_are_in_the_header(folder: Path, robot: CorrectedRobot) -> None:
    text = (folder / "hda_robot.h").read_text()
    drive = robot.file.robot["joints"][0]["drive"]
    limit = drive["torque_constant"]["nominal"] * drive["max_current"]
    assert f"#define HDA_ROBOT_TORQUE_LIMIT {limit}, {limit} /* N m */" in text
    described = json.loads((folder / "manifest.json").read_text())
    values = {q["name"]: q["value"] for q in described["parameters"]}
    assert values == dict(robot.corrected.parameters)
    assert not [path.name for path in folder.iterdir() if "python" in path.name or path.suffix == ".so"]


def test_a_robot_without_limits_says_what_to_state(build: Callable[..., Any], tmp_path: Path) -> None:
    arm = Arm(build("emps").folder)
    with pytest.raises(PlantError, match="torque_rate: the robot file does not state it for every joint"):
        c_writer.write(CorrectedRobot("emps", arm, arm), tmp_path / "c")
    assert list(tmp_path.iterdir()) == []


def test_only_an_earlier_export_is_replaced(folder: Path, robot: CorrectedRobot, tmp_path: Path) -> None:
    out = tmp_path / "c"
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    with pytest.raises(PlantError, match="is there and no C of an earlier export"):
        c_writer.write(robot, out)
    assert (out / "mine.txt").read_text() == "mine"
    (out / "hda_robot.h").write_text("")
    c_writer.write(robot, out)
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in folder.iterdir())
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
