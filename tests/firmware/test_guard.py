"""The run-time contract of a control tick, line by line: one test a line, named by it."""

from __future__ import annotations

import ctypes as ct
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from guard_library import (
    CODE,
    DAMPING,
    HEADER,
    HOLD,
    NAME,
    NEVER,
    REFERENCE_MAX,
    SENTENCES,
    SOURCES,
    STRICT,
    TEMPLATES,
    ZERO,
    Arm,
    Library,
    run,
    sizes,
)

NAN, INF = math.nan, math.inf
PAYLOADS = np.array([0x7FF0000000000001, 0x7FF4DEADBEEF0000, 0xFFF8000000000001, 0x7FFFFFFFFFFFFFFF], dtype=np.uint64)
NOT_FINITE = [*PAYLOADS.view(np.float64).tolist(), INF, -INF]
FINITE_BUT_HOSTILE = [5e-324, -5e-324, 2.2e-308, -0.0, 1e308, -1e308, 1.7976931348623157e308]
CHANNELS = ("motor_position", "motor_velocity", "joint_position", "joint_velocity", "motor_torque", "tip_force")
LIMIT, STEP = 0.3, 0.03  # N m, N m in a tick of 1 ms: Library.config


@pytest.fixture(scope="module", params=[1, 2, 6])
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(tmp_path_factory.mktemp("guard"), request.param)


def legal(torque: np.ndarray, before: np.ndarray, limit: float = LIMIT, step: float = STEP) -> bool:
    """Finite, whole, within torque and rate."""
    return bool(
        np.isfinite(torque).all() and (abs(torque) <= limit).all() and (abs(torque - before) <= step + 1e-16).all()
    )


def sent(arm: Arm) -> np.ndarray:
    """The torque sent last."""
    return np.array(arm.guard.sent)


# A control tick always writes a whole, legal torque vector, whatever came in.


@pytest.mark.parametrize("value", NOT_FINITE + FINITE_BUT_HOSTILE)
def test_a_tick_writes_a_whole_legal_vector_whatever_came_in(library: Library, value: float) -> None:
    n = library.n
    places = [(name, {j: value}) for name in CHANNELS for j in range(2 if name == "tip_force" else n)]
    cases: list[dict[str, Any]] = [{"stamp": value}, {"now": value}, *({name: place} for name, place in places)]
    cases += [{"reference": np.where(np.arange(5) == k, value, 0.0)} for k in range(5)]
    cases += [{"raw": np.where(np.arange(n) == j, value, 0.1)} for j in range(n)]
    for case in cases:
        arm = library.arm(safe=HOLD)
        arm.ticks(8, raw=1.0)
        before = sent(arm)
        tick = arm.tick(**{"raw": 1.0, **case})
        assert legal(tick.torque, before), case
        if not math.isfinite(value):
            assert CODE[tick.end] < 0 and (abs(tick.torque) < abs(before)).all(), case


@pytest.mark.parametrize("value", NOT_FINITE)
def test_each_input_that_is_not_finite_is_named_by_its_number(library: Library, value: float) -> None:
    n, number = library.n, 1  # the stamp is number 1, and its fault one of time
    for name in CHANNELS:
        for j in range(2 if name == "tip_force" else n):
            number += 1
            arm = library.arm()
            arm.tick()
            assert arm.tick(**{name: {j: value}}).begin == "HDA_FAULT_INPUT_FINITE"
            assert arm.read()[1].index == number
    arm = library.arm()
    arm.tick()
    assert arm.tick(reference=[0.0, 0.0, value]).begin == "HDA_FAULT_INPUT_FINITE"
    assert arm.read()[1].index == number + 3


# Status 0 fine, positive degraded, negative refused and the output is safe.


def test_status_0_is_fine_and_the_torque_is_the_controllers_own_bits(library: Library) -> None:
    arm = library.arm()
    raw = np.linspace(0.001, 0.01, library.n)
    tick = arm.tick(raw=raw)
    assert (tick.begin, tick.end) == ("HDA_FINE", "HDA_FINE")
    assert tick.torque.tobytes() == raw.tobytes()


def test_positive_is_degraded_and_says_by_what(library: Library) -> None:
    arm = library.arm()
    assert arm.tick(raw=0.1).end == "HDA_RATE_LIMITED"
    assert arm.tick(raw=0.4).end == "HDA_TORQUE_LIMITED"
    repeated = arm.tick(raw=0.1, stamp=arm.now)
    assert (repeated.begin, repeated.end) == ("HDA_MEASUREMENT_REPEATED",) * 2


def test_negative_is_refused_and_the_output_heads_to_safe(library: Library) -> None:
    arm = library.arm()
    arm.ticks(20, raw=1.0)
    before = sent(arm)
    assert (before == LIMIT).all()
    tick = arm.tick(raw=1.0, now=NAN)
    assert (tick.begin, tick.end) == ("HDA_FAULT_TIME_FINITE",) * 2
    assert np.allclose(tick.torque, before - STEP / 2, rtol=1e-12), "without a clock a tick counts as period_min"


# Faults are sticky until read; the first fault's inputs are kept.


def test_faults_are_sticky_until_read_and_the_latch_outlives_the_read(library: Library) -> None:
    arm = library.arm()
    arm.tick()
    assert arm.fail().end == "HDA_FAULT_RESULT_FINITE"
    for _ in range(5):
        tick = arm.tick(raw=0.01)
        assert (tick.begin, tick.end) == ("HDA_FAULT_RESULT_FINITE",) * 2
    assert arm.read()[0] == "HDA_FAULT_RESULT_FINITE"
    assert arm.tick().end == "HDA_LATCHED"
    assert arm.read()[0] == "HDA_FINE"
    assert arm.tick(motor_torque={0: NAN}).end == "HDA_FAULT_INPUT_FINITE", "a new fault is news again"


def test_the_first_faults_inputs_are_kept(library: Library) -> None:
    arm = library.arm()
    arm.tick(raw=0.02)
    for k, channel in enumerate(CHANNELS[1:]):
        arm.measure(**{channel: 0.001 * (k + 1)})
    tick = arm.tick(reference=[7.0, 8.0, 9.0], motor_position={0: 0.3}, joint_position={0: 5.0})
    at, measured = arm.now, bytes(arm.measurement)
    assert tick.end == "HDA_FAULT_JOINT_JUMP"
    arm.tick(motor_position={0: NAN}, reference=[1.0])
    arm.tick(now=NAN)
    peeked = arm.library.c.hda_guard_read(ct.byref(arm.guard), None)
    name, fault = arm.read()
    assert name == NAME[peeked] == "HDA_FAULT_JOINT_JUMP"
    assert (fault.index, fault.further, fault.now) == (1, 2, at)
    assert bytes(fault.measurement) == measured
    assert fault.reference[: fault.reference_count] == [7.0, 8.0, 9.0]
    assert np.array_equal(fault.sent, np.full(library.n, 0.015)), (
        "the torque before: 0.02 limited by the first tick's rate"
    )


def test_the_record_of_a_bad_result_holds_the_controllers_torque(library: Library) -> None:
    arm = library.arm()
    raw = np.full(library.n, 0.02)
    raw[-1] = -INF
    arm.tick(raw=raw)
    assert list(arm.read()[1].raw) == raw.tolist()


# The order of the checks: each is violated together with all later ones, and is the one that is named.

VIOLATIONS: list[
    tuple[str, Callable[[float], dict[str, Any]]]
] = [  # what goes into the tick, by the time of the last one
    ("HDA_FAULT_CALL", lambda last: {"count": -1}),
    ("HDA_FAULT_TIME_FINITE", lambda last: {"now": NAN}),
    ("HDA_FAULT_TIME_BACKWARD", lambda last: {"now": last}),
    ("HDA_FAULT_PERIOD_SHORT", lambda last: {"now": last + 0.4e-3}),
    ("HDA_FAULT_PERIOD_LONG", lambda last: {"now": last + 2.1e-3}),
    ("HDA_FAULT_STAMP_BACKWARD", lambda last: {"stamp": last - 1e-3}),
    ("HDA_FAULT_INPUT_FINITE", lambda last: {"reference": [NAN]}),
    ("HDA_FAULT_MOTOR_JUMP", lambda last: {"motor_position": {0: 0.6}}),
    ("HDA_FAULT_JOINT_JUMP", lambda last: {"joint_position": {0: 0.02}}),
    ("HDA_FAULT_STALE_STAMP", lambda last: {"stamp": last}),
    ("HDA_FAULT_RESULT_FINITE", lambda last: {"raw": NAN}),
    ("HDA_TORQUE_LIMITED", lambda last: {"raw": 1e6}),
]


def violated(arm: Arm, first: int) -> dict[str, Any]:
    """Inputs that violate this check and every later one; where two need the same input the earlier one has it."""
    inputs: dict[str, Any] = {}
    for _, violation in reversed(VIOLATIONS[first:]):
        inputs.update(violation(arm.now))
    return inputs


@pytest.mark.parametrize("place", range(len(VIOLATIONS)))
def test_the_checks_stand_in_the_contracts_order(library: Library, place: int) -> None:
    arm = library.arm(stale_stamp_ticks=1)
    arm.ticks(3)
    assert arm.tick(**violated(arm, place)).end == VIOLATIONS[place][0]


def test_version_and_latch_come_before_every_other_check(library: Library) -> None:
    arm = library.arm()
    arm.ticks(3)
    arm.fail()
    for place in range(len(VIOLATIONS)):
        assert arm.tick(**violated(arm, place)).begin == "HDA_FAULT_RESULT_FINITE", (
            "the latch's own fault, not a new one"
        )
        arm.tick(motor_position=0.0, joint_position=0.0)
    arm.read()
    assert arm.tick(raw=1e6).begin == "HDA_LATCHED"
    arm.guard.version += 1
    assert arm.tick(**violated(arm, 0)).begin == "HDA_FAULT_CONTEXT"


def test_begin_and_end_must_alternate(library: Library) -> None:
    arm = library.arm()
    arm.tick(raw=0.01)
    assert arm.end(0.02)[0] == "HDA_FAULT_SEQUENCE"
    assert (sent(arm) == 0.01).all(), "an end without its begin has no time of its own: the same torque again"
    arm = library.arm()
    arm.begin()
    assert arm.begin() == "HDA_FAULT_SEQUENCE"


def test_stale_needs_its_configured_count_of_ticks(library: Library) -> None:
    arm = library.arm(stale_stamp_ticks=3)
    arm.tick()
    seen = [arm.tick(stamp=100.001).end for _ in range(3)]
    assert seen == ["HDA_MEASUREMENT_REPEATED"] * 2 + ["HDA_FAULT_STALE_STAMP"]
    arm = library.arm(stale_bits_ticks=4)
    assert [arm.tick().end for _ in range(5)] == ["HDA_FINE"] * 4 + ["HDA_FAULT_STALE_BITS"]
    arm = library.arm(stale_bits_ticks=4)
    assert {arm.tick(tip_force={0: (-1) ** k * 5e-324}).end for k in range(50)} == {"HDA_FINE"}, "one bit is news"
    arm = library.arm(stale_stamp_ticks=NEVER)
    arm.ticks(2)
    arm.guard.repeated_stamps = arm.guard.repeated_bits = NEVER - 3  # as after 24 days
    assert arm.ticks(9, stamp=arm.now).end == "HDA_MEASUREMENT_REPEATED", "never is never"


# Never joint by joint.


def test_a_fault_of_one_joint_turns_the_whole_vector_to_safe(library: Library) -> None:
    for j in range(library.n):
        for case in ({"raw": np.where(np.arange(library.n) == j, NAN, 1.0)}, {"motor_position": {j: 9.0}, "raw": 1.0}):
            arm = library.arm()
            arm.ticks(5, raw=1.0)
            before = sent(arm)
            tick = arm.tick(**case)
            assert np.allclose(tick.torque, before - STEP, rtol=1e-12)


# No allocation, printing, locking, unbounded loop; one context, no hidden state. Compiles clean.


def test_no_allocation_printing_locking_or_hidden_state(tmp_path: Path) -> None:
    for source in SOURCES:
        out = tmp_path / f"{source.stem}.o"
        run(["gcc", *STRICT, "-I", sizes(tmp_path, 2), "-I", TEMPLATES, "-c", source, "-o", out])
        symbols = [line.split()[-2:] for line in run(["nm", out]).splitlines()]
        outside = {name for kind, name in symbols if kind == "U" and not name.startswith("hda_")}
        assert outside <= {"memcpy", "memcmp", "memset", "bcmp", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
        assert all(name.startswith("hda_") for kind, name in symbols if kind == "T")
        assert not [name for kind, name in symbols if kind in "dDbBC"], "writable memory outside the context"


def test_every_loop_is_bounded_by_a_size(library: Library) -> None:
    for source in SOURCES:
        text = source.read_text(encoding="ascii")
        assert not re.search(
            r"\b(while|goto|do|malloc|alloca)\b\s*[({;]?", re.sub(r"/\*.*?\*/|\"[^\"]*\"", "", text, flags=re.DOTALL)
        )
        bounds = {b.strip() for b in re.findall(r"for \(int \w = 0; (?:[^;]*&& )?\w < ([^;]+);", text)}
        assert len(re.findall(r"\bfor\b \(", text)) == len(re.findall(r"for \(int \w = 0;", text))
        assert bounds <= {"HDA_N", "HDA_TIP", "count", "4"}
    arm = library.arm()
    for count in (-1, REFERENCE_MAX + 1, 2**31 - 1, -(2**31)):
        assert arm.begin(count=count) == "HDA_FAULT_CALL", "the count of references is a size too"
        arm.end()


@pytest.mark.parametrize("compiler", ["gcc", "clang-14"])
@pytest.mark.parametrize("n", [1, 2, 6])
def test_it_compiles_clean_as_c99(tmp_path: Path, compiler: str, n: int) -> None:
    try:
        run([compiler, "--version"])
    except FileNotFoundError:
        pytest.skip(f"{compiler} is not installed")
    for source in SOURCES:
        run([compiler, *STRICT, "-I", sizes(tmp_path, n), "-I", TEMPLATES, "-c", source, "-o", tmp_path / "out.o"])


def test_fast_math_and_a_wrong_number_of_joints_do_not_compile(tmp_path: Path) -> None:
    for flag, n in (("-ffast-math", 2), ("-O1", 0), ("-O1", 13)):
        with pytest.raises(AssertionError, match="error"):
            run(["gcc", flag, "-I", sizes(tmp_path, n), "-I", TEMPLATES, "-c", SOURCES[1], "-o", tmp_path / "out.o"])


def test_every_status_has_one_sentence(library: Library) -> None:
    entries = re.findall(r"^\s+HDA_STATUS\(\w+,", HEADER, flags=re.MULTILINE)
    assert len(entries) == len(SENTENCES) == len(NAME)
    for code, words in SENTENCES.values():
        assert library.c.hda_status_sentence(code).decode() == words
        assert words.endswith(".") and len(words) > 20
    assert b"not a status" in library.c.hda_status_sentence(12345)


def test_the_mirror_of_the_structures_is_the_compilers(library: Library) -> None:
    layout = (ct.c_int64 * 8)()
    library.c.harness_layout(layout)
    lib = library
    expected = [
        (lib.Config, lib.Config.safe_stiffness),
        (lib.Measurement, lib.Measurement.tip_force),
        (lib.Fault, lib.Fault.reference),
        (lib.Guard, lib.Guard.fault),
    ]
    assert list(layout) == [x for kind, last in expected for x in (ct.sizeof(kind), last.offset)]
    assert (ZERO, DAMPING, HOLD) == (1, 2, 3)
