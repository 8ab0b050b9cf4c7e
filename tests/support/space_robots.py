"""Texts of robot.toml with joints in space: chains of any kind with numbers drawn from a seed."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from robots import NAMES

from gen.presets import find_presets

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


def mixed_chains(count: int) -> list[str]:
    """Chains of 2 to 7 joints in any order, each with turning and sliding ones."""
    rng, chains = np.random.default_rng(45), list[str]()
    while len(chains) < count:
        kinds = "".join(rng.choice(["R", "P"], size=2 + len(chains) % 6))
        if len(set(kinds)) == 2:
            chains.append(chain(kinds, 100 + len(chains)))
    return chains


FOUR_JOINTS_FRICTION = 0.3  # N m or N


def four_joint_arm() -> str:
    """An arm of four joints, the second one sliding, with dry friction and limits: fewer than a pose has numbers."""
    limits = "\n[joint.limits]\nposition = [-1.5, 1.5]\nspeed = 3.0\ntorque = 80.0\nmotor_torque_rate = 8000.0\n"
    return chain("RPRR", 11).replace("coulomb_friction = 0.0", f"coulomb_friction = {FOUR_JOINTS_FRICTION}{limits}")


SEVEN_AXES = (  # origin and rotation in the frame before; mass; length of a rod along the next origin
    ((0.0, 0.0, 0.3), (1.0, 0.0, 0.0, 0.0), 3.0),
    ((0.0, 0.0, 0.0), (HALF, -HALF, 0.0, 0.0), 3.0),
    ((0.0, -0.35, 0.0), (HALF, HALF, 0.0, 0.0), 2.5),
    ((0.06, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), 2.5),
    ((-0.06, 0.35, 0.0), (HALF, -HALF, 0.0, 0.0), 2.0),
    ((0.0, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), 1.5),
    ((0.08, 0.0, 0.0), (HALF, HALF, 0.0, 0.0), 0.6),
)
SEVEN_POSTURE = (0.3, 0.5, -0.2, -1.6, 0.3, 1.9, 0.4)  # rad, bent and far from all limits


def seven_joint_arm() -> str:
    """An arm of seven turning joints with dry friction, of the size and the reach of common ones, under gravity."""
    lines = ['name = "seven joints"', "gravity = [0.0, 0.0, -9.81]"]
    for number, (origin, rotation, mass) in enumerate(SEVEN_AXES, 1):
        size = mass * 0.15**2
        lines += ["", "[[joint]]", f'name = "axis_{number}"', 'type = "revolute"']
        lines += [f"origin = {list(origin)}", f"rotation = {list(rotation)}", "axis = [0.0, 0.0, 1.0]"]
        lines += [f"mass = {mass}", "center_of_mass = [0.01, -0.02, 0.05]"]
        lines += [f"inertia = [{size}, {0.9 * size}, {0.5 * size}, 0.0, 0.0, 0.0]", "[joint.drive]", "ratio = 1.0"]
        lines += ["rigid = true", f"motor_inertia = {0.3 if number < 5 else 0.1}"]
        lines += [f"viscous_friction = {2.0 if number < 5 else 0.5}"]
        lines += [f"coulomb_friction = {1.5 if number < 5 else 0.4}", "[joint.limits]", "position = [-2.8, 2.8]"]
        lines += ["speed = 2.5", "torque = 120.0", "motor_torque_rate = 20000.0"]
    return "\n".join([*lines, "", "[tip]", "origin = [0.0, 0.0, 0.15]"]) + "\n"


FLEXIBLE_DRIVE = """ratio = 100.0
motor_inertia = 8e-5
viscous_friction = 3e-4
coulomb_friction = 0.02
flexspline_stiffness = 23000.0
flexspline_stiffening = 0.05
wave_generator_stiffness = 4.0
wave_generator_stiffening = 15.0
torsional_damping = 10.0"""


def flexible_panda(joints: int) -> str:
    """The first joints of the preset `panda`, each with a rotor, a reduction and two springs of finite stiffness."""
    text = find_presets()["panda"].read_text(encoding="utf-8").replace("step = 0.0005", "step = 0.0002")
    head, *tables = text.split("[[joint]]")
    tables[-1], tip, place = tables[-1].partition("[tip]")
    drive = re.compile(r"(?<=\[joint\.drive\]\n).*?(?=\n\[joint\.limits\])", re.DOTALL)
    kept = (drive.sub(FLEXIBLE_DRIVE, table) for table in tables[:joints])
    return "[[joint]]".join([head, *kept]) + tip + place
