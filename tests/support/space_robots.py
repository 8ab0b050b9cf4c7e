"""Texts of robot.toml with joints in space: chains of any kind with numbers drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from robots import NAMES

HALF = 0.70710678118654757
QUARTER_TURNS = ((1.0, 0.0, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), (HALF, -HALF, 0.0, 0.0), (HALF, 0.0, HALF, 0.0))


def random_unit(rng: np.random.Generator, length: int) -> list[float]:
    """A unit vector of any direction."""
    vector = rng.normal(size=length)
    return [float(entry) for entry in vector / np.linalg.norm(vector)]


def random_inertia(rng: np.random.Generator, size: float = 0.01) -> list[float]:
    """Six entries of an inertia that a body can have, kg m²."""
    spread = rng.normal(size=(3, 3))
    second: NDArray[np.float64] = size * (spread @ spread.T + 0.2 * np.eye(3))
    inertia = np.trace(second) * np.eye(3) - second
    return [float(inertia[i, k]) for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def chain(kinds: str, seed: int, aligned: bool = False, springs: Mapping[str, float] | None = None) -> str:
    """A chain such as "RPR" in space; ``aligned`` to the axes of its frames; rigid at ratio 1 without ``springs``."""
    rng = np.random.default_rng(seed)
    lines = [f'name = "space {kinds} {seed}"', f"gravity = {[float(g) for g in rng.uniform(-10, 10, 3)]}"]
    for number, kind in enumerate(kinds, 1):
        rotation: Sequence[float] = random_unit(rng, 4)
        axis = random_unit(rng, 3)
        if aligned:
            rotation = QUARTER_TURNS[rng.integers(4)]
            axis = [0.0, 0.0, 0.0]
            axis[rng.integers(3)] = float(rng.choice([-1.0, 1.0]))
        lines += ["", "[[joint]]", f'name = "axis_{number}"', f'type = "{NAMES[kind]}"']
        lines += [f"origin = {[float(x) for x in rng.uniform(-0.4, 0.4, 3)]}", f"rotation = {list(rotation)}"]
        lines += [f"axis = {axis}", f"mass = {rng.uniform(0.5, 3.0)}"]
        lines += [f"center_of_mass = {[float(x) for x in rng.uniform(-0.1, 0.1, 3)]}"]
        lines += [f"inertia = {random_inertia(rng)}", "[joint.drive]", f"viscous_friction = {rng.uniform(0.1, 0.5)}"]
        if springs is None:
            lines += ["ratio = 1.0", "rigid = true", f"motor_inertia = {rng.uniform(0.0, 0.1)}"]
        else:
            lines += [f"ratio = {rng.uniform(30.0, 120.0)}", f"motor_inertia = {rng.uniform(0.5e-4, 2e-4)}"]
            lines += [f"{name} = {value}" for name, value in springs.items()]
        lines += ["coulomb_friction = 0.0"]
    place = [float(x) for x in rng.uniform(-0.2, 0.2, 3)]
    return "\n".join([*lines, "", "[tip]", f"origin = {place}", f"rotation = {random_unit(rng, 4)}"]) + "\n"
