"""The type of an effect: one equation at one port of a joint, with its parameters, states and source."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from gen.effects.appearance import ConfusionGroup, EncoderTerm, Experiment, Plot, Residual, SeriesSpring, Wall


class Port(Enum):
    """Where an effect acts, in the order of the signal chain; each value begins with the place that reports name."""

    DELAY = "input, delay"  # adds to the time by which the command arrives late, s
    INPUT = "input, current"  # changes the current (or torque) that arrives, A or N m
    LAG = "input, lag"  # adds to the time constant with which the current follows, s
    WARMTH = "motor, warmth"  # adds to the share by which dry and viscous friction have fallen
    FRICTION = "motor, level"  # adds to the level of dry friction, N m at the motor
    MOTOR = "motor, torque"  # adds a torque to the rotor, N m
    REACTION = "motor, reaction"  # share of the rotor's torque and inertia that the link before the joint feels
    TORSION = "transmission, angle"  # adds an angle to the torsion, rad at the joint, a function of the motor angle
    PLAY = "transmission, play"  # takes an angle from the torsion before the springs see it, rad at the joint
    SERIES = "transmission, series"  # gives a rigid drive springs: (factor on their level, damping in N m s/rad)
    TRANSMISSION = "transmission, torque"  # adds to the joint torque, N m
    BASE = "link, base"  # adds to gravity in the base frame, m/s² (x, y; in space z too)
    MASS = "link, mass"  # adds a point mass: kg, at the tip; in space with its place in the tip's frame, m
    STAND = "link, stand"  # lets the base turn about three axes: (rad by N m, 1/s²)
    LINK = "link, torque"  # adds a torque to the joint, N m
    SENSOR = "sensor, joint angle"  # adds to the reading of the joint's encoder, rad
    TORQUE_SENSOR = "sensor, joint torque"  # adds to the reading of the joint's torque sensor, N m

    @property
    def place(self) -> str:
        """One of input, motor, transmission, link, sensor."""
        return self.value.split(",")[0]


@dataclass(frozen=True)
class Parameter:
    """A number of the model.

    Attributes:
        name: Name in the robot file and in the model.
        unit: Unit; "A" stands for N m where the input is torque.
        nominal: Value without the effect, or the first guess of a shape.
        low: Lower bound.
        high: Upper bound.
        meaning: Meaning in words.
        typical: Of an amplitude, the difference from nominal with which the effect is usually met. The diagnosis
            counts an effect as present from a share of it on.
        scale: A key of the joint whose nominal value multiplies ``typical`` and ``everywhere``, or ``starts`` and
            nominal; "1/key" and "key/key" too. "largest_input" is the bound of the joint's input.
        starts: Of a shape, the values from which a search starts, the nominal one first.
        sliding: Unit at a prismatic joint, where it is another.
        unless: A key of the drive; drives that have it do not have this parameter.
        everywhere: The size of which every machine has a little, where that is not ``typical``.
        search_unit: Of a shape, the step of a search, where a share of its value or range will not do.
        is_motor_order: Whether it counts cycles a turn of the motor: small steps do not lead from one to another.
        is_reading_delay: Whether it is the time, s, by which the joint's encoder is read late.
        encoder_term: How it shows in the difference between the encoders of its joint; None where it does not.
        equivalent: A key of the robot file from which a small change of this parameter cannot be told.

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
    search_unit: float | None = None
    is_motor_order: bool = False
    is_reading_delay: bool = False
    encoder_term: EncoderTerm | None = None
    equivalent: str | None = None


@dataclass(frozen=True)
class State:
    """A state of an effect, 0 at the start.

    Attributes:
        name: Name, without the joint's number.
        unit: Unit.
        bound: Size up to which the model is meant to be used.
        meaning: Meaning in words.
        is_stiff: Whether it needs the L-stable step where the robot file states the effect.
        is_rate_limited: Whether it builds up no faster than the explicit step carries
            (`gen.effects.state_rate_limit`).
        is_accumulating: Whether the effect comes over time, this state being the share of it that is there.

    """

    name: str
    unit: str
    bound: float
    meaning: str
    is_stiff: bool = False
    is_rate_limited: bool = False
    is_accumulating: bool = False


@dataclass(frozen=True)
class Signals:
    """The symbols of one joint that an equation may read: all those upstream of its port (others are None)."""

    current: Any = None  # that arrives at an input port, or acts at a motor port: A, or N m where the input is torque
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
    gravity: Any = None  # in the base frame as the robot file states it, m/s²
    level_axes: Any = None  # two unit vectors of the base frame across the robot file's gravity
    states: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes:
        name: Name in robot files and reports.
        port: Where it acts.
        parameters: Its own parameters.
        amplitudes: Names of the parameters that, when all 0, remove the effect exactly: its own, or keys of the robot
            file.
        equation: ``equation(signals, p)`` returns its term at the port, or (term, rates of its states).
        citation: Where equation and size come from.
        states: Its states.
        suits_rigid_drive: Whether it has a meaning in a rigid drive.
        joints: Where it is stated: "each" joint, the "first" or the "last" only, or the "arm" as a whole (joint 0).
        suits_prismatic_joint: Whether it has a meaning at a prismatic joint.
        space_form: The effect as it acts in a chain that leaves the plane, where it has other numbers there.
        needs_gravity: Whether it has no meaning where the robot file states no gravity.
        usual_shares: Of amplitudes that are keys of the robot file, the difference from nominal that is usually met,
            as a share of it.
        guessed_keys: Of these keys those that a robot file often guesses, so that the true value may be any multiple.
        experiment: The experiment that shows it.
        plot: The plot that fits it.
        confusion_groups: The groups of effects among which it is hard to tell in a log.
        residual: The residual that shows it.
        is_friction: Whether it changes friction at the motor.
        presupposes: The effect without which it has no meaning, if any.
        twins: Effects from which it differs at standstill only.
        walls: Obstacles that it puts into the joint's range.
        series_spring: The spring that it gives to a drive which the robot file calls rigid.

    """

    name: str
    port: Port
    parameters: tuple[Parameter, ...]
    amplitudes: tuple[str, ...]
    equation: Callable[[Signals, Mapping[str, Any]], Any]
    citation: str
    states: tuple[State, ...] = ()
    suits_rigid_drive: bool = True
    joints: str = "each"
    suits_prismatic_joint: bool = True
    space_form: Effect | None = None
    needs_gravity: bool = False
    usual_shares: Mapping[str, float] = field(default_factory=dict, hash=False)
    guessed_keys: tuple[str, ...] = ()
    experiment: Experiment = field(kw_only=True)
    plot: Plot = field(kw_only=True)
    confusion_groups: tuple[ConfusionGroup, ...] = ()
    residual: Residual = Residual.AT_PLACE
    is_friction: bool = False
    presupposes: str | None = None
    twins: tuple[str, ...] = ()
    walls: tuple[Wall, ...] = ()
    series_spring: SeriesSpring | None = None

    def choose_form(self, in_space: bool) -> Effect:
        """Choose the form of the effect that suits a chain.

        Args:
            in_space: Whether the chain leaves the plane.

        Returns:
            The effect with the numbers and the equation that it has there.

        """
        if in_space and self.space_form is not None:
            return self.space_form
        return self
