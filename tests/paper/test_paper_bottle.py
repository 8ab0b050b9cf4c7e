"""The bottle: held by friction below sliding, stopped by it after, never pulling, with its energy accounted for."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.paper.prototype.bottle import (
    BOTTLE_DAMPING,
    BOTTLE_FRICTION,
    BOTTLE_MASS,
    BOTTLE_RADIUS,
    BOTTLE_STIFFNESS,
    GRAVITY,
    Bottle,
)

SLIDES = BOTTLE_FRICTION * BOTTLE_MASS * GRAVITY
STILL = np.zeros(2)


def pressed(bottle: Bottle, depth: float, ticks: int) -> None:
    """The tip held at that depth of the bottle as it first stood, from the left."""
    tip = np.array(bottle.at) - [BOTTLE_RADIUS - depth, 0.0]
    for _ in range(ticks):
        bottle(tip, STILL)


def test_below_sliding_it_stands_and_pushes_back_as_a_spring() -> None:
    bottle = Bottle((0.3, 0.1))
    depth = 0.9 * SLIDES / BOTTLE_STIFFNESS
    pressed(bottle, depth, 200)
    assert np.allclose(bottle.force[-1], [-BOTTLE_STIFFNESS * depth, 0.0]) and np.array_equal(bottle.p, bottle.at)


def test_above_it_slides_until_the_wall_bears_less() -> None:
    bottle = Bottle((0.3, 0.1))
    pressed(bottle, 2 * SLIDES / BOTTLE_STIFFNESS, 3000)
    assert bottle.p[0] > 0.3 and bottle.p[1] == pytest.approx(0.1) and np.array_equal(bottle.v, STILL)
    assert np.linalg.norm(bottle.force[-1]) <= SLIDES + 1e-9


def test_let_go_it_stops_as_dry_friction_says() -> None:
    bottle = Bottle((0.0, 0.0))
    bottle.v = np.array([0.3, 0.4])
    far = np.array([1.0, 1.0])
    for _ in range(400):
        assert np.array_equal(bottle(far, STILL), STILL)
    assert np.array_equal(bottle.v, STILL)
    way = 0.5**2 / (2 * BOTTLE_FRICTION * GRAVITY)
    assert np.linalg.norm(bottle.p) == pytest.approx(way, rel=2e-3)
    assert np.allclose(bottle.p / np.linalg.norm(bottle.p), [0.6, 0.8])


def test_work_on_it_is_lost_in_sliding_or_in_its_wall() -> None:
    """A tip that pushes through it at constant speed: what it puts in never comes back but from the spring."""
    bottle, speed = Bottle((0.0, 0.0)), np.array([0.1, 0.0])
    work = 0.0
    for k in range(2500):
        force = bottle(np.array([-BOTTLE_RADIUS - 0.01, 0.0]) + speed * k * 1e-3, speed)
        work -= float(force @ speed) * 1e-3
        assert float(force @ (np.array([-1.0, 0.0]))) >= 0, "it never pulls"
    slid = float(np.linalg.norm(bottle.p))
    stored = 0.5 * BOTTLE_STIFFNESS * max(bottle.depth[-1], 0.0) ** 2 + 0.5 * BOTTLE_MASS * float(bottle.v @ bottle.v)
    assert slid > 0.2
    assert work >= SLIDES * slid + stored - 1e-6
    assert work - SLIDES * slid - stored < 0.02 * work, f"the dashpot of {BOTTLE_DAMPING} N s/m takes little"
