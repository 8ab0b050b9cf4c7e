"""What sensors read along a whole path: an encoder that is read late shows where the joint was then.

At one instant the model knows a late reading only as a series, which a joint that rings fast does not follow. Along a
path the past is there: between rows it is Hermite's cubic of angle and speed.

Legend: d age of a joint encoder's reading, s; q, q̇ joint angle and speed.
"""

from __future__ import annotations

import numpy as np

from hdagen.plant import Arm, Array

APART = 3.0  # times the usual time between rows, from where rows are not neighbours


def read(arm: Arm, time: Array, x: Array, u: Array, begins: Array | None = None) -> dict[str, Array]:
    """`Arm.outputs` for the states x (T, nx) at ``time`` (T) with what acts there, u (T, nu); joint_position is read as
    late as ``sensor_delay`` says. ``begins``: rows at which a path begins that knows nothing of the one before."""
    delays = {j: arm.p[k] for k, name in enumerate(arm.parameters.described) if (j := _joint(name))}
    late = {j: float(d) for j, d in delays.items() if d}
    if not late:
        return arm.outputs(x, u)
    kept, prompt = arm.p.copy(), arm.p.copy()
    for k, name in enumerate(arm.parameters.described):
        if _joint(name):
            prompt[k] = 0.0
    arm._prepare(prompt)
    seen = arm.outputs(x, u)
    arm._prepare(kept)
    for j, d in late.items():
        q, rate = x[:, arm.index(f"joint_position_{j}")], x[:, arm.index(f"joint_velocity_{j}")]
        seen["joint_position"][:, j - 1] += _before(time, q, rate, d, begins) - q
    return seen


def _joint(name: str) -> int:
    """The joint whose encoder's age the parameter is; 0 for any other parameter."""
    stem, _, joint = name.rpartition("_")
    return int(joint) if stem == "sensor_delay" else 0


def _before(time: Array, q: Array, rate: Array, d: float, begins: Array | None) -> Array:
    """q (T) as it was ``d`` seconds before each row; by its series where no two rows of its path enclose that."""
    then, path = time - d, np.zeros(len(time), int)
    if begins is not None:
        path[begins] = 1
        path = np.cumsum(path)
    k = np.clip(np.searchsorted(time, then, side="right") - 1, 0, len(time) - 2)
    h = time[k + 1] - time[k]
    s = (then - time[k]) / h
    inside = (s >= 0) & (s <= 1) & (h < APART * np.median(np.diff(time))) & (path[k] == path) & (path[k + 1] == path)
    cubic = (
        (1 + 2 * s) * (1 - s) ** 2 * q[k]
        + s * (1 - s) ** 2 * h * rate[k]
        + s**2 * (3 - 2 * s) * q[k + 1]
        + s**2 * (s - 1) * h * rate[k + 1]
    )
    slope = np.diff(rate) / np.diff(time)
    after = np.append(slope, slope[-1])
    after[:-1][path[1:] != path[:-1]] = 0.0
    return np.where(inside, cubic, q - d * rate + 0.5 * d**2 * after)
