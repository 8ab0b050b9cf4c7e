"""Lanes of windows in vectors: what each lane alone would be, to rounding, and motors rest at the same steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import robots
from arms import ALL_EFFECTS, MIXED, SMALL
from compiled import Compiled, Floats

Builder = Callable[..., Compiled]
MEMORY = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
ROBOTS = {
    "flexible": ("paper", MEMORY),
    "rigid": ("emps", ()),
    "mixed": (MIXED, ALL_EFFECTS),
}
EDGES = np.array([[0, 60], [60, 100], [110, 150]], np.int32)  # the second goes on from the first, the third does not
ROWS, HELD, ROUNDING = 150, 1e-3, 1e-12  # s; of each column's largest value
FRICTIONS = 5.0  # torque of the motors, in multiples of their dry friction


@dataclass(frozen=True, eq=False)
class Lanes:
    """What a number of lanes read: begun (L, W, m), u (L, T, nu), c (L, nc), jump (L, T, nx)."""

    arm: Compiled
    begun: Floats
    u: Floats
    c: Floats
    jump: Floats

    def run(self, chosen: slice = slice(None), limit: Floats | float = 1e9, most: float = HELD) -> Floats:
        """States (L, R, nx) of the chosen lanes in one call."""
        begun, u, c, jump = (np.ascontiguousarray(a[chosen]) for a in (self.begun, self.u, self.c, self.jump))
        nx = len(self.arm.states)
        x = np.empty((len(c), int(np.diff(EDGES).sum()), nx))
        high = np.broadcast_to(limit, nx).copy()
        self.arm.module.windows(begun, None, EDGES, u, c, np.full(ROWS, HELD), jump, high, x, most, len(c))
        return x

    def alone(self, limit: Floats | float = 1e9, most: float = HELD) -> Floats:
        """The same, each lane in a call of its own."""
        return np.concatenate([self.run(slice(k, k + 1), limit, most) for k in range(len(self.c))])


def lanes(arm: Compiled, count: int, seed: int = 1) -> Lanes:
    """Lanes under torques about dry friction, so that motors slide, stick, stop and turn back, with parameters of their
    own and now and then a jump of a velocity."""
    rng, n = np.random.default_rng(seed), len(arm.manifest["robot"]["joints"])
    bound = np.array([slot["bound"] for slot in arm.manifest["state"]])
    moving = np.array(["velocity" in name for name in arm.states])
    t = HELD * np.arange(ROWS)
    u = np.zeros((count, ROWS, len(arm.manifest["input"])))
    size = np.array([FRICTIONS * number(arm, "coulomb_friction", j) for j in range(1, n + 1)])
    if arm.manifest["input"][0]["unit"] == "A":
        size /= [number(arm, "torque_constant", j) for j in range(1, n + 1)]
    phase = rng.uniform(0, 6, (count, 1, n))
    u[:, :, :n] = size * np.sin(2 * np.pi * rng.uniform(5, 12, (count, 1, n)) * t[:, None] + phase)
    u[1::4] *= 0.05  # these rest most of the time
    begun = (0.02 * bound * rng.uniform(-1, 1, (count, len(EDGES), len(bound))))[..., : mechanical(arm)]
    for j in (j for j in range(1, n + 1) if f"motor_position_{j}" in arm.states):  # springs that are not wound up
        motor, joint = (arm.states.index(f"{side}_position_{j}") for side in ("motor", "joint"))
        begun[..., motor] = number(arm, "ratio", j) * begun[..., joint]
    begun[::2, :, moving[: mechanical(arm)]] = 0.0
    jump = np.zeros((count, ROWS, len(bound)))
    jump[:, 20::37] = 0.01 * bound * moving * rng.uniform(-1, 1, (count, 4, len(bound)))
    p = arm.nominal * rng.uniform(0.98, 1.02, (count, len(arm.nominal)))
    for k, name in enumerate(arm.parameters):
        if name.startswith(("presliding_share", "hysteresis_torque")):
            p[:, k] = rng.uniform(0.0, 0.5, count)
    return Lanes(arm, begun, u, np.stack([arm("prepare", one)[0] for one in p]), jump)


def number(arm: Compiled, name: str, joint: int) -> float:
    """A parameter of a joint as the robot file gives it."""
    return float(arm.nominal[arm.parameters.index(f"{name}_{joint}")])


def mechanical(arm: Compiled) -> int:
    """How many states are positions and velocities."""
    return sum("position" in name or "velocity" in name for name in arm.states)


def speeds(arm: Compiled) -> list[int]:
    """The states whose sign is the direction of dry friction."""
    n = len(arm.manifest["robot"]["joints"])
    sides = ["motor" if j in arm.manifest["flexible"] else "joint" for j in range(1, n + 1)]
    return [arm.states.index(f"{side}_velocity_{j}") for j, side in enumerate(sides, 1)]


def off(many: Floats, one: Floats) -> float:
    """The worst difference, in multiples of each column's largest value."""
    size = np.abs(one).max(axis=(0, 1))
    return float((np.abs(many - one) / np.where(size == 0, 1.0, size)).max())


@pytest.mark.parametrize(
    ("profile", "count"),
    [("native", 2), ("native", 17), ("portable", 3)],  # the portable one has no vectors
)
@pytest.mark.parametrize("robot", ROBOTS)
def test_lanes_are_what_each_alone_would_be(build: Builder, robot: str, profile: str, count: int) -> None:
    """Also where a row is several steps, and where the number is no multiple of the width."""
    given = lanes(build(ROBOTS[robot][0], profile, ROBOTS[robot][1]), count)
    for most in (HELD, 0.4 * HELD):
        many, one = given.run(most=most), given.alone(most=most)
        assert np.isfinite(one).all() and not np.allclose(one[0], one[1])
        if profile == "portable":
            assert np.array_equal(many, one)
        assert off(many, one) < 1e-9  # rounding, as far as this motion makes it grow


@pytest.mark.parametrize("robot", ROBOTS)
def test_steps_are_the_scalar_ones(build: Builder, robot: str) -> None:
    """Every row against hda_step_exact from the row before, also those in which a motor gives way, stops or turns
    back."""
    arm = build(ROBOTS[robot][0], "native", ROBOTS[robot][1])
    assert arm.module.batch_width > 1
    given, slide = lanes(arm, 24), speeds(arm)
    given.jump[:] = 0.0
    rows = np.concatenate([np.arange(a, b) for a, b in EDGES])
    within = np.flatnonzero(~np.isin(rows + 1, EDGES))  # rows after which their window goes on
    rests = stops = slides = 0
    for x, u, c in zip(given.run(), given.u, given.c, strict=True):
        own, held = np.broadcast_to(c, (len(within), len(c))), np.full((len(within), 1), HELD)
        (step,) = arm("step_exact", x[within], u[rows[within]], own, held)
        found, before, after = x[within + 1], x[within][:, slide], x[within + 1][:, slide]
        event, rest = (np.sign(before) != np.sign(after)).any(1), (before == 0).any(1)
        assert np.array_equal(after == 0, step[:, slide] == 0)
        assert off(found[None], step[None]) < ROUNDING
        rests, stops, slides = rests + (rest & ~event).sum(), stops + event.sum(), slides + (~rest & ~event).sum()
    assert min(rests, stops) > 20 and slides > 500


def test_a_lane_that_flies_apart_stays_and_leaves_the_others_alone(build: Builder) -> None:
    arm = build("paper", "native", MEMORY)
    given = lanes(arm, 8)
    given.u[3, 30:] = 1e7  # within the first window; the next begins anew and flies apart at once
    limit = 100.0 * np.array([slot["bound"] for slot in arm.manifest["state"]])
    many, one = given.run(limit=limit), given.alone(limit=limit)
    assert (np.abs(many) <= limit).all()
    frozen = (many[:, 1:] == many[:, :-1]).all(2).sum(1)
    assert frozen[3] > 90 and (np.delete(frozen, 3) < 60).all()
    assert np.array_equal((many[3, 1:] == many[3, :-1]).all(1), (one[3, 1:] == one[3, :-1]).all(1))
    others = np.delete(np.arange(8), 3)
    assert off(many[others], one[others]) < 1e-9
    assert off(many[3:4, :31], one[3:4, :31]) < 1e-9
    given.begun[5, 1, 0] = np.nan  # a window of a lane that begins nowhere is none of the others' business
    holed, kept = given.run(limit=limit), np.delete(others, np.flatnonzero(others == 5))
    assert np.isnan(holed[5, 60:100, 0]).all() and np.array_equal(holed[kept], many[kept])


def test_a_model_with_the_stiff_step_goes_lane_by_lane(build: Builder) -> None:
    bristles = robots.effect("presliding_friction", 1, presliding_share=1.0, presliding_angle=0.02)
    arm = build(SMALL + bristles, "native")
    assert arm.module.batch_width == 1 and arm.manifest["stiff"]
    given = lanes(arm, 3)
    assert np.array_equal(given.run(), given.alone())


def test_without_jumps_is_with_jumps_of_nothing(build: Builder) -> None:
    arm = build("paper", "native")
    given = lanes(arm, 9)
    given.jump[:] = 0.0
    x = np.empty((9, int(np.diff(EDGES).sum()), len(arm.states)))
    limit = np.full(len(arm.states), 1e9)
    arm.module.windows(given.begun, None, EDGES, given.u, given.c, np.full(ROWS, HELD), None, limit, x, HELD, 9)
    assert np.array_equal(x, given.run())
