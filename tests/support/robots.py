"""Texts of robot.toml for tests: chains of any kind with numbers drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

SPRINGS = {
    "flexspline_stiffness": 9743.94,
    "flexspline_stiffening": 0.0831,
    "wave_generator_stiffness": 2.5517,
    "wave_generator_stiffening": 27.027,
    "torsional_damping": 6.0,
}
LINEAR = {  # as good as one linear spring: the flexspline stiffens by 4e-8 at 200 N m
    "flexspline_stiffness": 9000.0,
    "flexspline_stiffening": 1e-6,
    "wave_generator_stiffness": 1e9,
    "wave_generator_stiffening": 0.001,
    "torsional_damping": 5.0,
    "law_torque": 200.0,
}
NAMES = {"R": "revolute", "P": "prismatic"}


def chain(kinds: str, seed: int, springs: Mapping[str, float] | None = None, friction: float = 0.0) -> str:
    """A chain such as "RPR" with random links and drives; rigid without ``springs``; ``friction`` of each motor."""
    rng = np.random.default_rng(seed)
    lines = [f'name = "chain {kinds} {seed}"', "gravity = [1.3, -9.6]"]
    for kind in kinds:
        lines += [
            "",
            "[[joint]]",
            f'type = "{NAMES[kind]}"',
            f"length = {rng.uniform(0.1, 0.5) if kind == 'R' else 0.0}",
        ]
        lines += [f"mass = {rng.uniform(0.5, 3.0)}", f"center_of_mass = {rng.uniform(-0.1, 0.3)}"]
        lines += [f"inertia = {rng.uniform(0.01, 0.1)}", "[joint.drive]", f"ratio = {rng.uniform(30.0, 120.0)}"]
        lines += [f"motor_inertia = {rng.uniform(0.5e-4, 2e-4)}", f"viscous_friction = {rng.uniform(0.5e-4, 5e-4)}"]
        lines += [f"coulomb_friction = {friction}"]
        lines += ["rigid = true"] if springs is None else [f"{name} = {value}" for name, value in springs.items()]
    return "\n".join(lines) + "\n"


def effect(name: str, joint: int, **parameters: float) -> str:
    """An [[effect]] table to append to a robot's text."""
    return (
        "\n".join(
            ["", "[[effect]]", f'name = "{name}"', f"joint = {joint}", *(f"{k} = {v}" for k, v in parameters.items())]
        )
        + "\n"
    )
