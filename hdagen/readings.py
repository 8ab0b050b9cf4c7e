"""The positions and velocities of a log as readings of an arm's state."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdagen.channels import describe
from hdagen.clock import clock_noise
from hdagen.log import Log
from hdagen.plant import Arm, Array
from hdagen.torques import full_torsion

Rows = NDArray[np.intp]
RECENT = 2000  # rows before an instant from which a channel's noise is read where robot.toml states no resolution
BEYOND = 100.0  # times the speed that a state is meant for, from where it is no state of the arm
_LEAST = 1e-9  # rad or m, of noise: a channel that has not moved yet shows none


def encoder_noise(sensor: Mapping[str, float], side: str) -> float:
    """Standard deviation of what the encoder of a "motor" or "joint" reads, its own noise and that of counting, by the
    robot file's ``sensor`` (0: none stated)."""
    return math.hypot(sensor[f"{side}_encoder_resolution"] / math.sqrt(12), sensor[f"{side}_encoder_noise"])


def joint_angles(arm: Arm, log: Log) -> Array:
    """The joints' angles as logged (T, n), rad (m); where a joint has no encoder of its own, by its motor's."""
    ratios = (arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1))
    own = [f"joint_position_{j}" for j in range(1, arm.n + 1)]
    return np.stack(
        [
            log[name] if name in log else log[f"motor_position_{j}"] / ratio
            for j, (name, ratio) in enumerate(zip(own, ratios, strict=True), 1)
        ],
        1,
    )


@dataclass(frozen=True, eq=False)
class Readings:
    """The channels, M of them, joint after joint, motor before joint: ``measured`` (T, M); for each its name, the
    output of the arm that it shows (name, joint), the state that it reads and the factor it reads it with, and the
    standard deviation of its noise as the robot file gives it (0: not stated). ``time`` (T,) of the rows, s, and its
    ``uncertainty``."""

    names: tuple[str, ...]
    outputs: tuple[tuple[str, int], ...]
    places: tuple[int, ...]
    factors: Array
    noise: Array
    measured: Array
    time: Array
    uncertainty: float

    @classmethod
    def of(cls, arm: Arm, log: Log) -> Readings:
        """The channels of ``log`` that ``arm`` has; at least one position a joint must be there."""
        found = []
        for j in range(1, arm.n + 1):
            stated = arm.robot["joints"][j - 1]["sensor"]
            for side in ("motor", "joint"):
                for quantity in ("position", "velocity"):
                    name = f"{side}_{quantity}_{j}"
                    if name not in log:
                        continue
                    own = name in arm.state_names  # else it is the motor of a rigid drive
                    place = arm.index(name if own else f"joint_{quantity}_{j}")
                    factor = 1.0 if own else arm.parameters[f"ratio_{j}"]
                    noise = encoder_noise(stated, side) if quantity == "position" else 0.0
                    found.append((name, (f"{side}_{quantity}", j), place, factor, noise, log[name]))
        names, outputs, places, factors, noise, measured = zip(*found, strict=True)
        read = np.stack(measured, 1)
        return cls(names, outputs, places, np.array(factors), np.array(noise), read, log.time, log.time_uncertainty)

    def noise_before(self, row: int) -> Array:
        """Standard deviation of each channel's noise (M): as stated, with what the clock leaves uncertain at the speeds
        of the rows up to ``row``; else as those rows show."""
        rows = slice(max(0, row + 1 - RECENT), row + 1)
        recent, found = self.measured[rows], self.noise.copy()
        for k, (name, stated) in enumerate(zip(self.names, self.noise, strict=True)):
            clock = clock_noise(self.time[rows], recent[:, k], self.uncertainty)
            found[k] = math.hypot(stated, np.sqrt(np.mean(clock**2))) if stated else describe(name, recent[:, k]).noise
        return np.maximum(found, _LEAST * np.abs(self.factors))

    def say_all(self, arm: Arm) -> bool:
        """Whether every position and velocity of the state is read."""
        return set(self.places) == set(range(mechanical(arm)))

    def encoders(self) -> list[int]:
        """The joints whose own encoder is read."""
        return [j for name, j in self.outputs if name == "joint_position"]

    def state(self, arm: Arm, row: int) -> Array:
        """The state (nx) that ``row`` shows; velocities that are not logged are 0, as are the effects' own states.

        Where motor and joint encoder differ by more than `full_torsion`, the model's own angles between them taken
        off, the joint's is not believed.
        """
        x = np.zeros((1, arm.nx))
        for k, place in enumerate(self.places):  # where two read one state the joint's encoder counts
            x[:, place] = self.measured[row, k] / self.factors[k]
        unread(arm, x, self.encoders())
        known, most = set(self.places), full_torsion(arm)
        twist = np.abs(arm.outputs(x[0], np.zeros(arm.nu))["torsion"])
        for j in arm.manifest["flexible"]:
            motor, joint = arm.index(f"motor_position_{j}"), arm.index(f"joint_position_{j}")
            if {motor, joint} <= known and twist[j - 1] > most[j - 1]:
                known.discard(joint)
        return complete(arm, x, known)[0]


def mechanical(arm: Arm) -> int:
    """How many states are positions and velocities; the effects' own come after them in x."""
    return 2 * (arm.n + len(arm.manifest["flexible"]))


def memories(arm: Arm) -> list[int]:
    """Places in p of the amplitudes of effects with states of their own: where all are 0, nothing of what was before
    is remembered."""
    return places(arm, (effect for effect in arm.manifest["effects"] if effect["states"]), "amplitudes")


def places(arm: Arm, effects: Iterable[Mapping[str, Any]], *roles: str) -> list[int]:
    """Places in p of the parameters of ``effects``, as the manifest has them, of ``roles`` (amplitudes, shapes)."""
    named = ((effect["joints"], key) for effect in effects for role in roles for key in effect[role])
    keys = {f"{key}_{j}" if j else key for joints, key in named for j in joints}
    return [k for k, name in enumerate(arm.parameters.described) if name in keys]


def limits(arm: Arm) -> Array:
    """How large each state (nx) may be: velocities a hundred times what the model is meant for, the others finite."""
    return np.array(
        [
            BEYOND * arm.manifest["state"][k]["bound"] if "velocity" in name else np.finfo(float).max
            for k, name in enumerate(arm.state_names)
        ]
    )


def within(arm: Arm, x: Array) -> NDArray[np.bool_]:
    """Which states (…, nx) are finite and within `limits`."""
    return np.asarray((np.abs(x) <= limits(arm)).all(-1))


def senses(arm: Arm) -> bool:
    """Whether the model has effects at the joints' sensors."""
    return any(effect["place"] == "sensor" for effect in arm.manifest["effects"])


def unread(arm: Arm, x: Array, joints: Iterable[int]) -> Array:
    """``x`` (W, nx), whose positions and velocities of ``joints`` are what their encoders read, as the truth, in place;
    what acceleration changes is left out."""
    at = [[arm.index(f"joint_{what}_{j}") for j in range(1, arm.n + 1)] for what in ("position", "velocity")]
    chosen = [j - 1 for j in joints]
    read, rate = x[:, at[0]], x[:, at[1]]
    q, v = read.copy(), rate.copy()
    for _ in range(2 if senses(arm) and chosen else 0):  # the errors are small and change slowly
        seen = arm.evaluate("encoders", q=q, v=v, a=np.zeros(arm.n))
        q[:, chosen] += (read - seen["joint_position"])[:, chosen]
        v[:, chosen] += (rate - seen["joint_velocity"])[:, chosen]
    x[:, at[0]], x[:, at[1]] = q, v
    return x


def complete(arm: Arm, x: Array, known: set[int]) -> Array:
    """``x`` (W, nx), with what is not ``known`` on one side of a flexible gear taken from the other side, in place: the
    torsion is that at rest under gravity."""
    sides = {j: (arm.index(f"motor_position_{j}"), arm.index(f"joint_position_{j}")) for j in arm.manifest["flexible"]}
    for j, (motor, joint) in sides.items():
        if joint not in known:
            x[:, joint] = x[:, motor] / arm.parameters[f"ratio_{j}"]
    q = x[:, [arm.index(f"joint_position_{j}") for j in range(1, arm.n + 1)]]
    twist = arm.evaluate("torsion", joint_torque=arm.evaluate("gravity_torque", q=q)["g"])["torsion"]
    for j, (motor, joint) in sides.items():
        ratio = arm.parameters[f"ratio_{j}"]
        fast, slow = arm.index(f"motor_velocity_{j}"), arm.index(f"joint_velocity_{j}")
        if motor not in known:
            x[:, motor] = (x[:, joint] + twist[:, j - 1]) * ratio
        elif joint not in known:
            x[:, joint] -= twist[:, j - 1]
        if fast not in known:
            x[:, fast] = x[:, slow] * ratio
        elif slow not in known:
            x[:, slow] = x[:, fast] / ratio
    return x
