"""What an effect is: one equation at one port of a joint, with its parameters, states and source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Port(Enum):
    """Where an effect acts, in the order of the signal chain; the value begins with the place the diagnosis names."""

    INPUT = "input"
    FRICTION = "motor, level"  # adds to the level of dry friction, N m at the motor
    MOTOR = "motor, torque"  # adds a torque to the rotor, N m
    REACTION = "motor, reaction"  # share of the rotor's torque and inertia that the link before the joint feels
    TORSION = "transmission, angle"  # adds an angle to the torsion, rad at the joint, a function of the motor angle
    TRANSMISSION = "transmission, torque"  # adds to the joint torque, N m
    BASE = "link, base"  # adds to gravity in the base frame, m/s² (x, y)
    MASS = "link, mass"  # adds a point mass at the tip, kg
    LINK = "link, torque"  # adds a torque to the joint, N m
    SENSOR = "sensor"

    @property
    def place(self) -> str:
        """One of input, motor, transmission, link, sensor."""
        return self.value.split(",")[0]


@dataclass(frozen=True)
class Parameter:
    """A number of the model. ``typical`` is the size with which an effect is usually met (None for base parameters)."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float
    meaning: str
    typical: float | None = None


@dataclass(frozen=True)
class State:
    """A memory of an effect, 0 at the start; ``stiff`` asks for the L-stable step."""

    name: str
    unit: str
    bound: float
    meaning: str
    stiff: bool = False


@dataclass(frozen=True)
class Signals:
    """What an equation may read: symbols of one joint, everything upstream of its port (others are None)."""

    motor_position: Any = None  # θ, rad
    motor_velocity: Any = None  # θ̇, rad/s
    friction_level: Any = None  # N m at the motor
    direction: Any = None  # smooth or exact sign of θ̇, in [-1, 1]
    torsion: Any = None  # φ, rad
    torsion_rate: Any = None  # φ̇, rad/s
    spring_torque: Any = None  # τ(φ) of the springs alone, N m
    joint_torque: Any = None  # τ, N m
    joint_position: Any = None  # q, rad
    joint_velocity: Any = None  # q̇, rad/s
    ratio: Any = None  # N
    states: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """One effect: ``equation(signals, p)`` returns its term at the port, or (term, rates of its states).

    ``amplitudes`` names the parameters that, when all 0, remove the effect exactly: its own, or keys of the robot file.
    ``rigid`` tells whether it has a meaning in a rigid drive; ``joints`` where it is stated: "each" joint, the "last"
    joint only, or the "arm" as a whole (joint 0).
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
