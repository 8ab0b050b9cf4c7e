"""The guard's C compiled into a folder and mirrored in ctypes, and an arm that ticks it, for the tests of the guard."""

from __future__ import annotations

import ctypes as ct
import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
TEMPLATES = ROOT / "gen" / "templates"
HARNESS = ROOT / "tests" / "support" / "guard_harness.c"
SOURCES = tuple(TEMPLATES / f"{name}.c" for name in ("hda_limit", "hda_guard", "hda_guard_calls", "hda_guard_config"))
HEADER = (TEMPLATES / "hda_guard.h").read_text(encoding="ascii")
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Wstrict-prototypes"]
STRICT = ["-std=c99", "-O2", "-ffp-contract=off", *WARNINGS, "-Werror"]

SENTENCES = {
    name: (int(code), words) for name, code, words in re.findall(r'HDA_STATUS\((\w+), (-?\d+), "(.*)"\)', HEADER)
}
CODE = {name: code for name, (code, _) in SENTENCES.items()}
NAME = {code: name for name, code in CODE.items()}
ZERO, DAMPING, HOLD = (int(x) for x in re.findall(r"HDA_SAFE_(?:ZERO|DAMPING|HOLD) = (\d)", HEADER))
VERSION = int(re.search(r"HDA_GUARD_VERSION (\w+)u", HEADER)[1], 16)  # type: ignore[index]
REFERENCE_MAX = int(re.search(r"HDA_REFERENCE_MAX (\d+)", HEADER)[1])  # type: ignore[index]
NEVER, UNLIMITED = 2**31 - 1, 1e100
TICKS_MAX = 1_000_000
DOUBLE_P = ct.POINTER(ct.c_double)


def run(command: Sequence[str | Path]) -> str:
    """What the command prints; its complaint as an error."""
    done = subprocess.run([str(x) for x in command], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}"
    return done.stdout


def sizes(folder: Path, joints: int) -> Path:
    """The generated header that tells the guard its number of joints; its folder goes on the include path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "hda_sizes.h").write_text(f"#define HDA_N {joints}\n", encoding="ascii")
    return folder


def structures(n: int) -> tuple[Any, Any, Any, Any]:
    """ctypes of hda_measurement, hda_guard_config, hda_fault, hda_guard for n joints."""
    d, i, u = ct.c_double, ct.c_int32, ct.c_uint32
    joints, force_map, references = d * n, d * (2 * n), d * REFERENCE_MAX

    def structure(name: str, *fields: tuple[str, Any]) -> Any:
        return type(name, (ct.Structure,), {"_fields_": [(f, kind) for names, kind in fields for f in names.split()]})

    measurement = structure(
        "Measurement",
        ("stamp", d),
        ("motor_position motor_velocity joint_position joint_velocity motor_torque", joints),
        ("tip_force", d * 2),
    )
    config = structure(
        "Config",
        ("version size", u),
        ("safe stale_stamp_ticks stale_bits_ticks joints", i),
        ("period period_min period_max watchdog force_limit", d),
        ("torque_limit torque_rate motor_jump joint_jump safe_damping safe_stiffness", joints),
    )
    fault = structure(
        "Fault",
        ("code index further reference_count", i),
        ("now", d),
        ("raw sent", joints),
        ("measurement", measurement),
        ("reference", references),
    )
    guard = structure(
        "Guard",
        ("version size", u),
        ("config", config),
        ("safe_bound open latched trust level started known map_known", i),
        ("repeated_stamps repeated_bits safe_ticks reference_count", i),
        ("now tick_time sent_time elapsed", d),
        ("sent target hold velocity", joints),
        ("force_map", force_map),
        ("reference", references),
        ("measured", measurement),
        ("fault", fault),
    )
    return measurement, config, fault, guard


class Library:
    """The guard for n joints, compiled strictly, and its structures."""

    def __init__(self, folder: Path, n: int) -> None:
        self.n = n
        path = folder / f"guard_{n}.so"
        include: list[str | Path] = ["-I", sizes(folder / f"sizes_{n}", n), "-I", TEMPLATES]
        run(["gcc", *STRICT, "-fPIC", "-shared", *include, *SOURCES, HARNESS, "-o", path])
        self.c = ct.CDLL(str(path))
        self.Measurement, self.Config, self.Fault, self.Guard = structures(n)
        self.c.hda_limit.restype = ct.c_double
        self.c.hda_limit.argtypes = [ct.c_double] * 4
        self.c.hda_length.restype = ct.c_double
        self.c.hda_length.argtypes = [ct.c_double] * 2
        self.c.hda_status_sentence.restype = ct.c_char_p
        self.c.hda_guard_begin.argtypes = [ct.c_void_p, ct.c_double, ct.c_void_p, DOUBLE_P, ct.c_int]
        self.c.hda_guard_end.argtypes = [ct.c_void_p, DOUBLE_P, DOUBLE_P, DOUBLE_P]
        for timed in (self.c.hda_guard_watchdog, self.c.hda_guard_recover):
            timed.argtypes = [ct.c_void_p, ct.c_double, ct.c_void_p]

    def config(self, **changes: Any) -> Any:
        """A legal configuration: 1 kHz, 0.3 N m, 30 N m/s, no force limit, safe is zero; with changes."""
        rows: dict[str, Any] = {
            "version": VERSION,
            "size": ct.sizeof(self.Config),
            "joints": self.n,
            "safe": ZERO,
            "stale_stamp_ticks": 3,
            "stale_bits_ticks": NEVER,
            "period": 1e-3,
            "period_min": 0.5e-3,
            "period_max": 2e-3,
            "watchdog": 5e-3,
            "force_limit": UNLIMITED,
            "torque_limit": 0.3,
            "torque_rate": 30.0,
            "motor_jump": 0.5,
            "joint_jump": 0.01,
            "safe_damping": 0.01,
            "safe_stiffness": 2.0,
        }
        config = self.Config()
        for name, value in {**rows, **changes}.items():
            if isinstance(getattr(config, name), ct.Array):
                getattr(config, name)[:] = np.broadcast_to(value, self.n).tolist()
            else:
                setattr(config, name, value)
        return config

    def arm(self, **changes: Any) -> Arm:
        """An arm at rest whose guard has the configuration with these changes."""
        arm = Arm(self)
        assert arm.configure(**changes) == CODE["HDA_FINE"]
        return arm

    def run(self, guard: Any, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Many ticks in C; rows as in guard_harness.c. Returns torque (ticks, n), counted time (ticks,), status."""
        rows = np.ascontiguousarray(rows, dtype=float)
        torque, counted = np.empty((len(rows), self.n)), np.empty(len(rows))
        status = np.empty(len(rows), dtype=np.int32)
        pointers = [x.ctypes.data_as(ct.c_void_p) for x in (rows, torque, counted, status)]
        self.c.harness_run(ct.byref(guard), ct.c_int64(len(rows)), *pointers)
        return torque, counted, status


def doubles(values: Any) -> Any:
    """A C array of the values; None stays the null pointer."""
    if values is None:
        return None
    flat = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    return (ct.c_double * flat.size)(*flat)


@dataclass
class Tick:
    """What one tick answered: names of the statuses and the torque, N m."""

    begin: str
    end: str
    torque: np.ndarray


@dataclass
class Arm:
    """One guard and the measurements that go into it; every tick is 1 ms later and, unless told, in order."""

    library: Library
    now: float = 100.0
    guard: Any = field(init=False)
    measurement: Any = field(init=False)

    def __post_init__(self) -> None:
        self.guard = self.library.Guard()
        self.measurement = self.library.Measurement()

    def configure(self, **changes: Any) -> int:
        """The code of hda_guard_configure."""
        return self.library.c.hda_guard_configure(ct.byref(self.guard), ct.byref(self.library.config(**changes)))

    def measure(self, **changes: Any) -> Any:
        """Sets channels of the measurement: the whole one, or {joint from 0: value}."""
        for name, value in changes.items():
            if name == "stamp":
                self.measurement.stamp = value
                continue
            channel = getattr(self.measurement, name)
            if isinstance(value, dict):
                for j, x in value.items():
                    channel[j] = x
            else:
                channel[:] = np.broadcast_to(value, len(channel)).tolist()
        return self.measurement

    def begin(self, now: float | None = None, reference: Any = (0.0,), count: int | None = None, **changes: Any) -> str:
        """Opens a tick 1 ms later than the last, with a stamp to match."""
        self.now += 1e-3
        self.measure(**{"stamp": self.now, **changes})
        given = doubles(reference)
        count = (0 if given is None else len(given)) if count is None else count
        at = self.now if now is None else now
        return NAME[self.library.c.hda_guard_begin(ct.byref(self.guard), at, ct.byref(self.measurement), given, count)]

    def end(self, raw: Any = 0.0, force_map: Any = None) -> tuple[str, np.ndarray]:
        """Closes the tick. What is written starts as NaN, so that an entry left out shows."""
        n = self.library.n
        out = doubles(np.full(n, np.nan))
        raw = None if raw is None else doubles(np.broadcast_to(raw, n))
        code = self.library.c.hda_guard_end(ct.byref(self.guard), raw, doubles(force_map), out)
        return NAME[code], np.array(out)

    def tick(self, raw: Any = 0.0, force_map: Any = None, **changes: Any) -> Tick:
        """A whole tick."""
        begin = self.begin(**changes)
        end, torque = self.end(raw, force_map)
        return Tick(begin, end, torque)

    def ticks(self, count: int, raw: Any = 0.0, force_map: Any = None, **changes: Any) -> Tick:
        """The last of several ticks."""
        for _ in range(count):
            last = self.tick(raw, force_map, **changes)
        return last

    def watchdog(self, now: float) -> tuple[str, np.ndarray]:
        """What the watchdog answers and writes."""
        out = doubles(np.full(self.library.n, np.nan))
        return NAME[self.library.c.hda_guard_watchdog(ct.byref(self.guard), now, out)], np.array(out)

    def read(self) -> tuple[str, Any]:
        """The fault record, which this clears."""
        fault = self.library.Fault()
        return NAME[self.library.c.hda_guard_read(ct.byref(self.guard), ct.byref(fault))], fault

    def recover(self, after: float = 1e-4, now: float | None = None, **changes: Any) -> str:
        """Asks to leave the safe state, `after` seconds after the last tick."""
        self.measure(**{"stamp": self.now + after, **changes})
        at = self.now + after if now is None else now
        return NAME[self.library.c.hda_guard_recover(ct.byref(self.guard), at, ct.byref(self.measurement))]

    def fail(self, raw: Any = 0.0) -> Tick:
        """A tick whose controller answers NaN."""
        return self.tick(raw=np.where(np.arange(self.library.n) == 0, np.nan, raw))
