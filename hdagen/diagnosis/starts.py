"""What a log itself suggests before any search: walls at the ends of a range, what the drive makes of its commands, and
what the joints' torsion shows.

The linear model of an effect is a difference over the size by which its parameter is moved. Where an effect answers to
its size with a corner (a limit, a delay of whole rows, a wall) that size has to be near the one that reality has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hdagen.diagnosis.record import Record, usual_torque
from hdagen.diagnosis.torsion import torsion
from hdagen.plant import Arm, Array
from hdagen.readings import joint_angles

BEYOND = (0.005, 0.03, 0.1, 0.25)  # shares of the rows that lie beyond a wall that is tried
SIZES = np.geomspace(0.1, 10.0, 25)  # of an input effect, in usual sizes
SHARES = np.linspace(0.1, 1.0, 19)  # of an input effect, that are left to it beside another one
SIZED = ("sensor_delay", "backlash_angle")  # read off well enough to be tried at that size
FRICTION = 0.25  # of the usual input, that is usual of dry friction where nothing else is known
SIZED_BY = {"N m": "coulomb_friction", "N m s/rad": "viscous_friction", "N m s²/rad²": "viscous_friction"}  # by unit
LEAST = 0.1  # usual sizes, from which that is worth it
WORTH = 0.99  # of the error of the current without the effect, below which a size is suggested


@dataclass(frozen=True)
class Suggested:
    """``shapes``: values from which the search starts, by shape parameter, in place of the model's; ``sizes``: by how
    much an amplitude is moved for its column, in its unit; ``seen``: what can be read off the joints' torsion, from
    which every hypothesis starts as far as it tolerates that, by parameter; ``units``: what is usual of torques and
    friction at a motor, where the robot file gives none to go by, by parameter."""

    shapes: dict[str, tuple[float, ...]]
    sizes: dict[str, float]
    seen: dict[str, float]
    units: dict[str, float] = field(default_factory=dict)


def suggested(arm: Arm, record: Record) -> Suggested:
    """All that the log suggests."""
    twisted = torsion(arm, record)
    seen = {name: value for twist in twisted for name, value in twist.seen.items()}
    least = {name: LEAST * (q.typical or np.inf) for name, q in arm.parameters.described.items()}
    sized = {name: size for name, size in seen.items() if name.startswith(SIZED) and abs(size) > least[name]}
    shapes = _ends(arm, record)
    for name, value in (pair for twist in twisted for pair in twist.shapes.items()):
        shapes[name] = (value, *shapes[name])
    return Suggested(shapes, _inputs(arm, record) | sized, seen, _units(arm, record))


def _units(arm: Arm, record: Record) -> dict[str, float]:
    """What is usual of torques at motors whose robot file has no dry friction, and of friction that grows with speed
    where it has none of that: in the manifest shares of the largest input, here as many of what the log's usual input
    makes likely."""
    described, usual, found = arm.parameters.described, usual_torque(arm, record), {}
    for effect in arm.manifest["effects"]:
        for j in effect["joints"] if effect["place"] == "motor" else ():
            if not j or not usual[j - 1] > 0.0:
                continue
            scale = FRICTION * usual[j - 1] / float(described[f"coulomb_friction_{j}"].typical or np.inf)
            for name in (f"{amplitude}_{j}" for amplitude in effect["amplitudes"]):
                q = described.get(name)
                sized = SIZED_BY.get(q.unit) if q else None
                if q and q.typical and sized and not described[f"{sized}_{j}"].nominal:
                    found[name] = scale * q.typical
    return found


def _ends(arm: Arm, record: Record) -> dict[str, tuple[float, ...]]:
    """Walls near the ends of the range."""
    found: dict[str, tuple[float, ...]] = {}
    angles = joint_angles(arm, record.log)
    for j in range(1, arm.n + 1):
        if f"contact_above_{j}" in arm.parameters.described:
            q = angles[record.shown, j - 1]
            found[f"contact_above_{j}"] = tuple(float(np.quantile(q, 1 - share)) for share in BEYOND)
            found[f"contact_below_{j}"] = tuple(float(np.quantile(q, share)) for share in BEYOND)
    return found


def _inputs(arm: Arm, record: Record) -> dict[str, float]:
    """The size of each input effect with which the commands alone give the measured inputs best."""
    described = arm.parameters.described
    return {name: value - described[name].nominal for _, name, _, value, share in driven(arm, record) if share < WORTH}


def driven(arm: Arm, record: Record) -> Iterator[tuple[str, str, int, float, float]]:
    """Of each input effect whose joint's input is measured: its name, its amplitude's, the joint, the value with which
    the commands alone give that best, and how far (rms) they are from it, as a share of how far without."""
    names = [
        (effect["name"], f"{a}_{j}", j)
        for effect in arm.manifest["effects"]
        if effect["place"] == "input"
        for j in effect["joints"]
        for a in effect["amplitudes"]
    ]
    for effect, name, j in names:
        if arm.input_names[j - 1] not in record.names:
            continue
        described, place = arm.parameters.described[name], list(arm.parameters.described).index(name)
        tried = [described.nominal + float(s) * (described.typical or 0.0) for s in SIZES]
        tried = [value for value in tried if described.low <= value <= described.high]
        points = np.tile(arm.p, (1 + len(tried), 1))
        points[:, place] = described.nominal, *tried
        errors = [_error(arm, record, p, j) for p in points]
        best = int(np.argmin(errors[1:]))
        yield effect, name, j, tried[best], errors[1 + best] / max(errors[0], np.finfo(float).tiny)


def shared(arm: Arm, record: Record, p: Array, there: str, beside: str, j: int) -> tuple[float, float]:
    """The values of an input effect that is ``there`` in the parameters ``p`` (np) and of one ``beside`` it on joint j,
    with which the commands alone give the measured input best: one may have stood in for both."""
    described = arm.parameters.described
    places = [list(described).index(name) for name in (there, beside)]
    q, base = described[beside], described[there].nominal
    error, best = np.inf, (float(p[places[0]]), q.nominal)
    for share in SHARES:
        for size in SIZES[:: len(SIZES) // 8] * (q.typical or 0.0):
            moved = p.copy()
            moved[places] = base + share * (p[places[0]] - base), np.clip(q.nominal + size, q.low, q.high)
            left = _error(arm, record, moved, j)
            if left < error:
                error, best = left, (float(moved[places[0]]), float(moved[places[1]]))
    return best


def _error(arm: Arm, record: Record, p: Array, j: int) -> float:
    """How far (rms) what the commands give under the parameters ``p`` (np) is from what is measured of joint j's
    input."""
    _, at = arm.at(p).acting(record.command[:, : arm.n], record.steps, record.before)
    return float(np.sqrt(np.mean((at[:, j - 1] - record.log[arm.input_names[j - 1]])[record.shown] ** 2)))
