"""Inertias that no body can have are taken to a possible one near them, and possible ones are left alone."""

from __future__ import annotations

import numpy as np
import pytest
import space_robots
from uncompiled import load_uncompiled

from hdagen.adoption.link_inertia import ENTRIES, make_inertias_possible
from hdagen.arm.compiled_arm import Arm


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    robot = tmp_path_factory.mktemp("robot") / "robot.toml"
    robot.write_text(space_robots.chain("RR", 3))
    return load_uncompiled(robot)


def set_inertia(arm: Arm, joint: int, inertia: np.ndarray) -> Arm:
    changed = arm.with_parameters(arm.p)
    for entry in ENTRIES:
        row, column = ("xyz".index(letter) for letter in entry)
        changed.p[changed.parameters.index(f"inertia_{entry}_{joint}")] = inertia[row, column]
    return changed


def read_inertia(values: dict[str, float], joint: int) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = (values[f"inertia_{entry}_{joint}"] for entry in ENTRIES)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_possible_inertias_stay(arm: Arm) -> None:
    assert make_inertias_possible(arm) == ({}, [])


def test_impossible_ones_become_possible_and_stay_near(arm: Arm) -> None:
    rng = np.random.default_rng(4)
    own = [arm.parameters.described[f"inertia_{entry}_2"] for entry in ENTRIES]
    largest = max(q.nominal for q in own)
    near = 0
    for _ in range(400):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        moments = largest * rng.uniform(0.3, 1.0, 2)
        third = moments.sum() * rng.uniform(1.02, 1.5)  # above the sum of the others
        inertia = turn @ np.diag([*moments, third]) @ turn.T
        changed, notes = make_inertias_possible(set_inertia(arm, 2, inertia))
        found = read_inertia(changed, 2)
        made = np.linalg.eigvalsh(found)
        assert made[0] > 0 and made[2] < made[0] + made[1] and len(changed) == 6 and "axis_2 (2)" in notes[0]
        assert make_inertias_possible(set_inertia(arm, 2, found)) == ({}, [])
        if all(q.low < changed[q.name] < q.high for q in own):  # no bound is in the way
            assert np.abs(found - inertia).max() <= third - moments.sum() + 0.01 * third
            near += 1
    assert near > 50


def test_what_becomes_possible_keeps_the_bounds(arm: Arm) -> None:
    described = arm.parameters.described
    own = [described[f"inertia_{entry}_2"] for entry in ENTRIES]
    at_an_end = read_inertia({q.name: q.high for q in own}, 2)  # products so large that no body has them
    changed, notes = make_inertias_possible(set_inertia(arm, 2, at_an_end))
    assert changed and notes
    assert all(described[name].low <= value <= described[name].high for name, value in changed.items())
    within = arm.with_parameters(arm.p)
    within.parameters.update(changed)
    assert make_inertias_possible(within) == ({}, [])


def test_the_plane_has_none() -> None:
    assert make_inertias_possible(load_uncompiled("paper")) == ({}, [])
