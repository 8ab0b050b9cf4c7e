"""Windows that each begin anew, in one call: bit for bit the rollouts that they are; held at their limit; refused where
edges are wrong."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from compiled import EXACT, Compiled

Builder = Callable[..., Compiled]
MEMORY = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")


def motion(arm: Compiled, rows: int) -> np.ndarray:
    u = np.zeros((rows, len(arm.manifest["input"])))
    t = 1e-3 * np.arange(rows)
    u[:, :2] = np.stack([2.0 * np.sin(9 * t), 1.5 * np.cos(7 * t)], 1)
    return u


@pytest.mark.parametrize("profile", ["portable", "native"])
@pytest.mark.parametrize("lanes", [1, 9])
def test_windows_begin_with_a_memory_that_is_given(build: Builder, profile: str, lanes: int) -> None:
    """As if a jump in their first row had put it there."""
    arm, rng = build("paper", profile, effects=MEMORY), np.random.default_rng(2)
    amplitudes = {f"{name}_{j}": 0.5 for name in ("presliding_share", "hysteresis_torque") for j in (1, 2)}
    c = np.tile(arm.prepare(**amplitudes), (lanes, 1))
    u, dt, edges = np.tile(motion(arm, 60), (lanes, 1, 1)), np.full(60, 1e-3), np.array([[0, 30], [30, 59]], np.int32)
    nx = len(arm.states)
    begun, memory = np.zeros((lanes, 2, 8)), 0.01 * rng.normal(size=(lanes, 2, nx - 8))
    jump, limit, found = np.zeros((lanes, 60, nx)), np.full(nx, 1e9), []
    cut = edges.copy()
    cut[0, 1] -= 1  # no window goes on from the one before
    jump[:, cut[:, 0], 8:] = memory
    for own, added in ((memory, None), (np.zeros_like(memory), jump), (None, jump)):
        x = np.empty((lanes, 58, nx))
        arm.module.windows(begun, own, cut, u, c, dt, added, limit, x, 5e-4, lanes)
        found.append(x)
    assert np.array_equal(found[0], found[1])
    if profile == "portable":
        assert np.array_equal(found[0], found[2])
    else:  # without memories the windows of the last lane run one after the other, and no vector holds them
        np.testing.assert_allclose(found[0], found[2], rtol=1e-10, atol=1e-13)
    x = np.empty((lanes, 59, nx))
    arm.module.windows(begun, memory, edges, u, c, dt, None, limit, x, 5e-4, lanes)
    assert np.array_equal(x[:, 30, 8:], memory[:, 1])  # not what the window before left


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_windows_are_the_rollouts_that_they_stand_for(build: Builder, profile: str) -> None:
    arm = build("paper", profile, effects=MEMORY)
    c = arm.prepare(**{f"{name}_{j}": 0.5 for name in ("presliding_share", "hysteresis_torque") for j in (1, 2)})
    u, dt, rng = motion(arm, 120), np.full(120, 1e-3), np.random.default_rng(1)
    edges = np.array([[0, 40], [40, 70], [80, 120]], np.int32)  # the second goes on from the first, the third does not
    begun = 0.1 * arm.random(rng, 3, share=0.1)[:, :8]
    begun[:, :2] = 100.0 * begun[:, 2:4]
    jump = np.zeros((120, len(arm.states)))
    jump[[10, 95], 6] = 0.01
    x = np.empty((110, len(arm.states)))
    limit, begun = np.full(len(arm.states), 1e9), np.ascontiguousarray(begun)
    arm.module.windows(begun, None, edges, u, c, dt, jump, limit, x, 5e-4, 1)
    at, hidden = 0, np.zeros(len(arm.states) - 8)
    for w, (first, end) in enumerate(edges):
        state = np.concatenate([begun[w], hidden if w == 1 else np.zeros(len(arm.states) - 8)])
        for k in range(first, end):
            state = state + jump[k]
            assert np.array_equal(x[at], state)
            state = arm.rollout(state, u[k : k + 1], c, 1e-3, 5e-4, kind=EXACT)[1]
            at += 1
        hidden = state[8:]
    assert at == 110


def test_a_window_stays_where_it_reaches_its_limit(build: Builder) -> None:
    arm = build("paper")
    u, limit = motion(arm, 50), np.full(len(arm.states), 1e9)
    limit[4] = 0.1  # rad/s of motor 1
    x = np.empty((50, len(arm.states)))
    edges = np.array([[0, 50]], np.int32)
    arm.module.windows(np.zeros((1, 8)), None, edges, u, arm.prepare(), np.full(50, 1e-3), None, limit, x, 5e-4, 1)
    assert np.abs(x[:, 4]).max() <= 0.1
    assert np.array_equal(x[-1], x[-2]) and np.abs(x[-1, 4]) > 0


@pytest.mark.parametrize("edges", [[[0, 0]], [[0, 51]], [[-1, 5]], [[5, 10], [8, 12]], [[10, 5]]])
def test_edges_that_are_none_are_refused(build: Builder, edges: list[list[int]]) -> None:
    arm = build("paper")
    rows = max(sum(max(e - f, 0) for f, e in edges), 1)
    with pytest.raises(ValueError, match="edges must be rows"):
        arm.module.windows(
            np.zeros((len(edges), 8)),
            None,
            np.array(edges, np.int32),
            motion(arm, 50),
            arm.prepare(),
            np.full(50, 1e-3),
            np.zeros((50, len(arm.states))),
            np.full(len(arm.states), 1e9),
            np.empty((rows, len(arm.states))),
            5e-4,
            1,
        )


@pytest.mark.parametrize(
    "count, words", [(0, "count at least 1"), (2, "begun must have 16"), (2**60, "larger than any")]
)
def test_a_number_of_lanes_that_is_none_is_refused(build: Builder, count: int, words: str) -> None:
    arm = build("paper")
    held, limit, x = np.full(50, 1e-3), np.full(8, 1e9), np.empty((50, 8))
    begun, edges = np.zeros((1, 8)), np.array([[0, 50]], np.int32)
    given = (begun, None, edges, motion(arm, 50), arm.prepare(), held, None, limit, x)
    with pytest.raises(ValueError, match=words):
        arm.module.windows(*given, 5e-4, count)
