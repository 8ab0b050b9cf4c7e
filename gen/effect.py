"""What an effect is: one equation at one port of a joint, with its parameters, states and source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Port(Enum):
    """Where an effect acts, in the order of the signal chain; the value begins with the place the diagnosis names."""

    DELAY = "input, delay"  # adds to the time by which the command arrives late, s
    INPUT = "input, current"  # makes another current (or torque) of the one that arrives, A or N m
    LAG = "input, lag"  # adds to the time constant with which the current follows, s
    WARMTH = "motor, warmth"  # adds to the share by which dry and viscous friction have fallen
    FRICTION = "motor, level"  # adds to the level of dry friction, N m at the motor
    MOTOR = "motor, torque"  # adds a torque to the rotor, N m
    REACTION = "motor, reaction"  # share of the rotor's torque and inertia that the link before the joint feels
    TORSION = "transmission, angle"  # adds an angle to the torsion, rad at the joint, a function of the motor angle
    PLAY = "transmission, play"  # takes an angle from the torsion before the springs see it, rad at the joint
    SERIES = "transmission, series"  # gives a rigid drive springs: (factor on their level, damping in N m s/rad)
    TRANSMISSION = "transmission, torque"  # adds to the joint torque, N m
    BASE = "link, base"  # adds to gravity in the base frame, m/s² (x, y)
    MASS = "link, mass"  # adds a point mass at the tip, kg
    LINK = "link, torque"  # adds a torque to the joint, N m
    SENSOR = "sensor, joint angle"  # adds to what the joint's encoder reads, rad
    TORQUE_SENSOR = "sensor, joint torque"  # adds to what the joint's torque sensor reads, N m

    @property
    def place(self) -> str:
        """One of input, motor, transmission, link, sensor."""
        return self.value.split(",")[0]


@dataclass(frozen=True)
class Parameter:
    """A number of the model.

    ``typical``: of an amplitude, the difference from nominal with which the effect is usually met; from 15 % of it on
    an effect counts as present. ``everywhere``: the size of which every machine has a little, where that is not
    ``typical``. ``starts``: of a shape, the values from which a search starts, the nominal one first. ``scale``: a key
    of the joint (or "1/key", "key/key"; "largest_input" is the bound of the joint's input) by whose nominal
    ``typical`` and ``everywhere``, or ``starts`` and nominal, are to be multiplied. ``sliding``: the unit at a
    prismatic joint, where it is another; in ``unit`` "A" stands for N m where the input is torque. ``unless``: left out
    at drives that have that key.
    """

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    meaning: str
    typical: float | None = None
    scale: str | None = None
    starts: tuple[float, ...] = ()
    sliding: str | None = None
    unless: str | None = None
    everywhere: float | None = None


@dataclass(frozen=True)
class State:
    """A memory of an effect, 0 at the start; ``stiff`` asks for the L-stable step where the robot file states the
    effect; ``slowed``: where it has the explicit one, it builds up no faster than that carries (`gen.memory`)."""

    name: str
    unit: str
    bound: float
    meaning: str
    stiff: bool = False
    slowed: bool = False


@dataclass(frozen=True)
class Signals:
    """What an equation may read: symbols of one joint, everything upstream of its port (others are None)."""

    current: Any = None  # at an input port what arrives, at a motor port what acts: A, or N m where the input is torque
    motor_position: Any = None  # θ, rad
    motor_velocity: Any = None  # θ̇, rad/s
    friction_level: Any = None  # N m at the motor
    direction: Any = None  # smooth or exact sign of θ̇, in [-1, 1]
    torsion: Any = None  # φ, rad
    torsion_rate: Any = None  # φ̇, rad/s
    spring_torque: Any = None  # τ(φ) of the springs alone, N m
    joint_torque: Any = None  # τ that the gear transmits, N m; of a rigid drive N times the motor's torque
    joint_position: Any = None  # q, rad
    joint_velocity: Any = None  # q̇, rad/s
    joint_acceleration: Any = None  # q̈ with smooth friction, rad/s²
    ratio: Any = None  # N
    states: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """One effect: ``equation(signals, p)`` returns its term at the port, or (term, rates of its states).

    ``amplitudes`` names the parameters that, when all 0, remove the effect exactly: its own, or keys of the robot file.
    ``sizes``: of such keys, the difference from nominal that is usually met, as a share of it. ``rigid`` tells whether
    the effect has a meaning in a rigid drive, ``prismatic`` whether at a sliding joint; ``joints`` where it is stated:
    "each" joint, the "first" or the "last" only, or the "arm" as a whole (joint 0).
    """

    name: str
    port: Port
    parameters: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    equation: Callable[[Signals, Mapping[str, Any]], Any]
    citation: str
    states: tuple[State, ...] = ()
    rigid: bool = True
    joints: str = "each"
    prismatic: bool = True
    sizes: Mapping[str, float] = field(default_factory=dict, hash=False)
