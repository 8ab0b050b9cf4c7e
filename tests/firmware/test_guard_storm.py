"""The guard under storms of hostile ticks, under a force limit, under the sanitizers: always a legal torque."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from guard_library import CODE, DAMPING, HARNESS, HOLD, SOURCES, TEMPLATES, ZERO, Arm, Library, run, sizes

LIMIT, RATE, PERIOD_MIN, PERIOD = 0.3, 30.0, 0.5e-3, 1e-3  # Library.config
EDGES = np.array(
    [math.nan, -math.nan, math.inf, -math.inf, 5e-324, -5e-324, -0.0, 1e308, -1e308, 1.7976931348623157e308]
)


@pytest.fixture(scope="module", params=[1, 2, 6])
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library(tmp_path_factory.mktemp("guard"), request.param)


# Whatever came in, over 1e5 ticks.


def stream(library: Library, ticks: int, hostile: float, random: np.random.Generator) -> np.ndarray:
    """Rows of harness_run: a 1 kHz loop with jitter; each input is with this probability any bits or an edge."""
    n = library.n
    now = 1e3 + np.cumsum(random.uniform(0.6e-3, 1.8e-3, ticks))
    position = np.cumsum(random.normal(size=(ticks, n)) * 1e-3, axis=0)
    rest = random.normal(size=(ticks, 4 * n + 4))
    raw = 0.2 * np.sin(20.0 * now[:, None] + np.arange(n)) + random.normal(size=(ticks, n)) * 0.02
    force_map = np.broadcast_to(random.normal(size=2 * n) * 30.0, (ticks, 2 * n))
    rows = np.concatenate([now[:, None], now[:, None], position, rest, raw, force_map], axis=1)
    rows[:, 2 + 2 * n : 2 + 3 * n] = position * 1e-2  # joint position
    struck = random.random(rows.shape) < hostile
    wild = random.integers(0, 2**64, rows.shape, dtype=np.uint64).view(np.float64)
    wild = np.where(random.random(rows.shape) < 0.5, random.choice(EDGES, rows.shape), wild)
    return np.where(struck, wild, rows)


def rounding(torque: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Half a unit in the last place of last ± step, and as much again for the subtraction in the check."""
    return np.spacing(np.maximum(abs(torque), abs(before)) + RATE * PERIOD)


@pytest.mark.parametrize("safe", [ZERO, DAMPING, HOLD])
def test_1e5_ticks_are_legal_and_safe_is_reached_in_time(library: Library, safe: int) -> None:
    random = np.random.default_rng(11 + safe)
    legal_ticks = refused = recovered_late = 0
    for chunk in range(140):
        arm = library.arm(safe=safe, force_limit=[1e100, 5.0][chunk % 2])
        bound = arm.guard.safe_bound
        rows = stream(library, 250, [0.0, 2e-4, 5e-2][chunk % 3], random)
        torque, counted, status = library.run(arm.guard, rows)
        before = np.vstack([np.zeros(library.n), torque[:-1]])
        assert np.isfinite(torque).all() and (abs(torque) <= LIMIT).all()
        assert ((counted >= PERIOD_MIN) & (counted <= PERIOD)).all()
        assert (abs(torque - before) <= RATE * counted[:, None] + rounding(torque, before)).all()
        legal_ticks += len(torque)
        bad = np.flatnonzero(status < 0)
        refused += len(bad)
        if bad.size:
            assert (status[bad[0] :] < 0).all(), "only recover ends the latch"
            if safe == ZERO and len(torque) > bad[0] + bound:
                assert (torque[bad[0] + bound - 1 :] == 0.0).all()
                recovered_late += 1
    assert legal_ticks == 35_000 and legal_ticks > refused > 5_000, (
        "with three safe states 105,000 ticks, of both sorts"
    )
    assert safe != ZERO or recovered_late > 30


@pytest.mark.parametrize("safe", [DAMPING, HOLD])
def test_safe_is_reached_in_time_under_any_bits(library: Library, safe: int) -> None:
    """From the latch on any bits in every input: after the stated ticks the torque is the safe law's own, each tick."""
    random = np.random.default_rng(17)
    for _ in range(20):
        arm = library.arm(safe=safe)
        library.run(arm.guard, stream(library, 60, 0.0, random))
        arm.now = 2e3
        arm.fail()
        rows = stream(library, arm.guard.safe_bound - 1, 0.02, random)
        rows[:, 0] += 1e3
        library.run(arm.guard, rows)
        for row in stream(library, 20, 0.02, random):
            torque, _, _ = library.run(arm.guard, row[None])
            assert np.array_equal(torque[0], np.array(arm.guard.target))


# The force limit: |force_map torque|, the whole vector scaled; a fault where it cannot be kept.


def forced(library: Library, limit: float, **changes: Any) -> Arm:
    """An arm whose force limit acts, and whose rate reaches any torque in a tick unless told."""
    return library.arm(**{"force_limit": limit, "torque_limit": 10.0, "torque_rate": 1e5, **changes})


def test_the_force_limit_scales_the_whole_vector(library: Library) -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        arm, force_map, raw = (
            forced(library, 5.0),
            random.normal(size=(2, library.n)) * 30.0,
            random.normal(size=library.n) * 50.0,
        )
        force = float(np.linalg.norm(force_map @ raw))
        tick = arm.tick(raw=raw, force_map=force_map)
        share = min(1.0, 5.0 / force)
        assert np.allclose(tick.torque, raw * share, rtol=1e-12)
        assert tick.end == ("HDA_FORCE_LIMITED" if share < 1.0 else "HDA_FINE")


def test_the_force_limit_outlives_the_torque_and_rate_limits_after_it(library: Library) -> None:
    """Cutting single joints would raise the force again; the torque sent stays under it, and legal in rate."""
    random, raised = np.random.default_rng(5), 0
    for _ in range(100):
        arm, force_map = (
            forced(library, 5.0, torque_limit=0.3, torque_rate=30.0),
            random.normal(size=(2, library.n)) * 30.0,
        )
        before = np.zeros(library.n)
        for _ in range(25):
            raw = random.normal(size=library.n) * 0.5
            tick = arm.tick(raw=raw, force_map=force_map)
            raw *= min(1.0, 5.0 / float(np.linalg.norm(force_map @ raw)))
            plain = np.clip(np.clip(raw, -0.3, 0.3), before - 0.03, before + 0.03)
            slack = 8 * np.finfo(float).eps * (abs(force_map) @ abs(tick.torque)).max()
            assert np.linalg.norm(force_map @ tick.torque) <= 5.0 + slack and CODE[tick.end] >= 0
            assert (abs(tick.torque - before) <= 0.03 + 1e-15).all()
            raised += bool(np.linalg.norm(force_map @ plain) > 5.0 + 1e-9)
            before = tick.torque
    assert library.n == 1 or raised > 15, "cutting single joints never raised the force: nothing was tested"


def test_a_force_that_cannot_fall_in_time_is_a_fault_and_heads_to_safe(library: Library) -> None:
    arm = forced(library, 5.0, torque_rate=30.0, torque_limit=0.3)
    ones = np.ones((2, library.n))
    arm.ticks(20, raw=0.2 / library.n, force_map=ones)
    before = np.array(arm.guard.sent)
    tick = arm.tick(raw=0.2 / library.n, force_map=1e4 * ones)
    assert tick.end == "HDA_FAULT_FORCE"
    assert list(arm.read()[1].raw) == [0.2 / library.n] * library.n
    assert np.allclose(tick.torque, before - np.minimum(0.03, before))


def test_a_force_limit_needs_its_map(library: Library) -> None:
    cases = {None: "HDA_FAULT_CALL", math.nan: "HDA_FAULT_RESULT_FINITE", 1e308: "HDA_FAULT_RESULT_FINITE"}
    for value, name in cases.items():
        arm = forced(library, 5.0, safe=DAMPING)
        force_map = None if value is None else np.full((2, library.n), value)
        assert arm.tick(raw=8.0, force_map=force_map, motor_velocity=1.0).end == name
        if value != 1e308:
            assert (arm.ticks(50, motor_velocity=1.0).torque == 0.0).all(), "no map was ever known: no force is allowed"


def test_the_safe_torque_keeps_the_force_limit_too(library: Library) -> None:
    arm = forced(library, 5.0, safe=DAMPING, safe_damping=1.0)
    force_map = np.full((2, library.n), 30.0)
    arm.tick(raw=0.0, force_map=force_map)
    arm.fail()
    torque = arm.ticks(200, raw=0.0, motor_velocity=-3.0).torque
    assert math.isclose(np.linalg.norm(force_map @ torque), 5.0, rel_tol=1e-9)


def test_the_way_up_and_to_zero_keeps_the_force_limit_although_one_joint_is_slow(library: Library) -> None:
    if library.n == 1:
        pytest.skip("one joint has nothing to cancel")
    rate = np.where(np.arange(library.n) == 1, 3.0, 30.0)
    arm = forced(library, 5.0, torque_rate=rate, torque_limit=0.3)
    force_map = np.zeros((2, library.n))
    force_map[0, :2] = 100.0, -100.0  # the forces of joints 1 and 2 cancel
    for _ in range(110):
        assert np.linalg.norm(force_map @ arm.tick(raw=0.3, force_map=force_map).torque) <= 5.0
    assert (np.array(arm.guard.sent) == 0.3).all(), "at the pace of the slow joint, without a standstill"
    arm.fail()
    for _ in range(arm.guard.safe_bound):
        torque = arm.tick(force_map=force_map).torque
        assert np.linalg.norm(force_map @ torque) <= 5.0
    assert (torque == 0.0).all()


def test_with_a_force_limit_the_torque_limit_keeps_the_direction(library: Library) -> None:
    """Cut joint by joint the torque would settle elsewhere, or swing between what the two limits leave."""
    if library.n == 1:
        pytest.skip("one joint has one direction")
    arm = forced(library, 5.0, torque_limit=np.where(np.arange(library.n) == 1, 0.1, 0.3), torque_rate=30.0)
    force_map = np.zeros((2, library.n))
    force_map[0, :2] = 100.0, -100.0
    arm.ticks(50, raw=0.3, force_map=force_map)
    for _ in range(20):
        tick = arm.tick(raw=0.3, force_map=force_map)
        assert tick.end == "HDA_TORQUE_LIMITED" and np.allclose(tick.torque, 0.1, rtol=1e-12)


def test_the_safe_laws_force_is_limited_before_its_torque(library: Library) -> None:
    if library.n == 1:
        pytest.skip("one joint has one direction")
    rate = np.where(np.arange(library.n) == 1, 3.0, 30.0)
    arm = forced(library, 5.0, safe=DAMPING, safe_damping=1.0, torque_rate=rate, torque_limit=0.3)
    force_map = np.zeros((2, library.n))
    force_map[0, :2] = 100.0, -100.0
    arm.tick(force_map=force_map)
    arm.fail()
    velocity = np.zeros(library.n)
    for velocity[:2] in ((-3.0, -1.0), (0.3, 0.3), (-0.3, -0.3), (3.0, 1.0)):
        for _ in range(400):
            torque = arm.tick(force_map=force_map, motor_velocity=velocity).torque
            assert np.linalg.norm(force_map @ torque) <= 5.0 + 1e-12
    assert np.allclose(torque[:2], (-0.075, -0.025), rtol=1e-9)


def test_a_lower_force_limit_than_is_sent_is_refused(library: Library) -> None:
    arm = forced(library, 5.0)
    arm.tick(raw=0.1, force_map=np.full((2, library.n), 20.0))
    assert arm.configure(torque_limit=10.0, force_limit=1.0) == CODE["HDA_CONFIG_SENT"]
    assert arm.configure(torque_limit=10.0, force_limit=100.0) == CODE["HDA_FINE"]


# The sanitizers, and the storm in C: watchdog, recover, read, configure and null pointers in any order.


@pytest.mark.parametrize("n", [1, 2, 6])
def test_the_sanitizers_find_nothing_in_a_storm(tmp_path: Path, n: int) -> None:
    include: list[str | Path] = ["-I", sizes(tmp_path, n), "-I", TEMPLATES]
    flags = ["-std=c99", "-g", "-O1", "-DGUARD_STORM", "-fsanitize=address,undefined,float-cast-overflow"]
    run(["gcc", *flags, "-fno-sanitize-recover=all", *include, *SOURCES, HARNESS, "-o", tmp_path / "storm"])
    counts = dict(re.findall(r"(\w+) (\d+)", run([tmp_path / "storm", "200000"])))
    assert all(int(counts[kind]) > 500 for kind in ("fine", "degraded", "refused", "recovered", "configured"))


def test_valgrind_finds_no_memory_that_was_not_written(tmp_path: Path) -> None:
    if shutil.which("valgrind") is None:
        pytest.skip("valgrind is not installed; apt-get install valgrind")
    include: list[str | Path] = ["-I", sizes(tmp_path, 2), "-I", TEMPLATES]
    run(["gcc", "-std=c99", "-g", "-O2", "-DGUARD_STORM", *include, *SOURCES, HARNESS, "-o", tmp_path / "storm"])
    run(["valgrind", "-q", "--error-exitcode=9", tmp_path / "storm", "5000"])
