"""What an effect is: one equation at one port of a joint, with its parameters, states and source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


class Port(Enum):
    """Where an effect acts, in the order of the signal chain; the value is the place the diagnosis names."""

    INPUT = "input"
    FRICTION = "motor"  # adds to the level of Coulomb friction, N m at the motor
    MOTOR = "motor "  # adds a torque to the rotor, N m at the motor
    TORSION = "transmission"  # adds an angle to the torsion, rad at the joint, a function of the motor angle
    TRANSMISSION = "transmission "  # adds to the joint torque, N m
    MASS = "link"  # adds a point mass at the tip, kg
    LINK = "link "  # adds a torque to the joint, N m
    SENSOR = "sensor"

    @property
    def place(self) -> str:
        """One of input, motor, transmission, link, sensor."""
        return self.value.strip()


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
    """A memory of an effect; ``stiff`` asks for the L-stable step."""

    name: str
    unit: str
    meaning: str
    stiff: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Signals:
    """What an equation may read: symbols of one joint, everything upstream of its port (others are None)."""

    motor_position: Any = None  # θ, rad
    motor_velocity: Any = None  # θ̇, rad/s
    motor_torque: Any = None  # k_t i, N m
    direction: Any = None  # smooth or exact sign of θ̇, in [-1, 1]
    torsion: Any = None  # φ, rad
    torsion_rate: Any = None  # φ̇, rad/s
    joint_torque: Any = None  # τ, N m
    joint_position: Any = None  # q, rad
    joint_velocity: Any = None  # q̇, rad/s
    ratio: Any = None  # N
    states: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Effect:
    """One effect. ``equation(signals, p)`` returns its term at the port, or (term, {state: rate}) if it has states.

    ``amplitudes`` names the parameters that, when all 0, remove the effect exactly.
    """

    name: str
    port: Port
    parameters: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    equation: Callable[[Signals, Mapping[str, Any]], Any]
    citation: str
    states: tuple[State, ...] = ()
    rigid: bool = True  # has a meaning in a rigid drive too
    whole_arm: bool = False  # stated once at joint 0, not per joint
