"""The named entries of a model's vectors: parameters p, states x and inputs u, each with unit and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gen.effects.effect import Effect, Parameter, State
from gen.effects.file_numbers import FILE_NUMBERS, USUAL_ERROR
from gen.model.harmonic_drive import SPRING_SPREAD
from gen.robot import typical_loads
from gen.robot.description import Robot, SpatialLink, Value
from gen.robot.gear_catalogue import SPRING_KEYS
from gen.robot.model_parameters import (
    AXES,
    LARGEST_INERTIAL_FACTOR,
    SPACE_ENTRIES,
    ParameterValue,
    list_parameters,
)
from gen.robot.schema import keys_of

FILE_NUMBER_NAMES = frozenset(number.name for number in FILE_NUMBERS)
ROTOR = "motor_inertia"  # the one of them that a robot file may state as 0
TIP_FORCE = 100.0  # N, along each axis, up to which the model is meant to be used
TIP_MOMENT = 20.0  # N m, the same


@dataclass(frozen=True)
class Quantity:
    """A named entry of p with its bounds; ``joint`` 0 is the whole arm. Its standard deviation is ``tolerance`` times
    ``reference_size``."""

    name: str
    joint: int
    unit: str
    nominal: float
    low: float
    high: float
    tolerance: float
    reference_size: float
    meaning: str
    effect: str | None = None  # whose amplitude or shape it is
    role: str = "base"  # "base" a key of the robot file, "amplitude" or "shape" of an effect
    typical: float | None = None  # size of a difference from nominal that is usually met, in `unit`
    everywhere: float | None = None  # that of which every machine has a little, where that is another
    starts: tuple[float, ...] = ()  # of a shape: values from which a search starts
    is_guess: bool = False  # whether the robot file's value is often a guess
    search_unit: float | None = None  # the rest as in `gen.effects.effect.Parameter`
    is_motor_order: bool = False
    is_reading_delay: bool = False
    encoder_term: str | None = None
    equivalent: str | None = None
    offset: float = 0.0  # with it, the number that the robot file states: of a lumped inertia mass·center_of_mass²


@dataclass(frozen=True)
class Slot:
    """A named entry of x or u; ``bound`` is the size up to which the model is meant to be used."""

    name: str
    unit: str
    bound: float


# -- states and inputs ------------------------------------------------------------------------------------------------


def list_states(robot: Robot, effect_states: Sequence[tuple[State, int]]) -> tuple[Slot, ...]:
    """List the entries of x: motor and joint positions, then velocities, then the states of the effects.

    Args:
        robot: The robot description.
        effect_states: Each state of an effect with the number of its joint, in the order of x.

    Returns:
        The entries in the order of x; a rigid drive has no motor position of its own.

    """
    slots = []
    for quantity, unit, size in (
        ("position", "rad", typical_loads.MEANT_POSITION),
        ("velocity", "rad/s", typical_loads.MEANT_VELOCITY),
    ):
        for j, joint in enumerate(robot.joints, 1):
            if not joint.drive.rigid:
                slots.append(Slot(f"motor_{quantity}_{j}", unit, size * abs(joint.drive.ratio.nominal)))
        for j, joint in enumerate(robot.joints, 1):
            own_unit = unit
            if joint.kind == "prismatic":
                own_unit = unit.replace("rad", "m")
            slots.append(Slot(f"joint_{quantity}_{j}", own_unit, size))
    slots += [Slot(f"{state.name}_{j}", state.unit, state.bound) for state, j in effect_states]
    return tuple(slots)


def list_inputs(robot: Robot) -> tuple[Slot, ...]:
    """List the entries of u: the current (or torque) of each motor, then the force on the tip, in space its moment.

    Args:
        robot: The robot description.

    Returns:
        The entries in the order of u.

    """
    slots = []
    for j, joint in enumerate(robot.joints, 1):
        name, unit = "motor_current", "A"
        if joint.drive.torque_constant is None:
            name, unit = "motor_torque", "N m"
        slots.append(Slot(f"{name}_{j}", unit, typical_loads.largest_input(robot, j)))
    axes = AXES[: len(robot.gravity)]
    slots += [Slot(f"tip_force_{axis}", "N", TIP_FORCE) for axis in axes]
    if robot.in_space:
        slots += [Slot(f"tip_moment_{axis}", "N m", TIP_MOMENT) for axis in axes]
    return tuple(slots)


# -- parameters -------------------------------------------------------------------------------------------------------


def list_quantities(
    robot: Robot, effects: Sequence[tuple[Effect, tuple[int, ...]]], inputs: Sequence[Slot]
) -> tuple[Quantity, ...]:
    """List the entries of p: those of the robot file, then those of the effects.

    Args:
        robot: The robot description.
        effects: Each effect with the joints at which it stands.
        inputs: The entries of u (`list_inputs`).

    Returns:
        The entries in the order of p.

    """
    amplitude_of = {key: effect for effect, _ in effects for key in effect.usual_shares}
    found = [_base_quantity(robot, value, amplitude_of) for value in list_parameters(robot)]
    stated = {(effect.name, effect.joint): effect.parameters for effect in robot.effects}
    for effect, joints in effects:
        for j in joints:
            values = stated.get((effect.name, j), {})
            for parameter in effect.parameters:
                if not _is_left_out(robot, parameter, j):
                    found.append(_effect_quantity(robot, inputs, effect, parameter, j, values.get(parameter.name)))
    return tuple(found)


def memory_step_quantity(step: float) -> Quantity:
    """Describe the step for which slowed states of effects are prepared.

    Whoever integrates with another step sets this parameter to it.

    Args:
        step: The integration step of the robot file, s.

    Returns:
        The entry of p.

    """
    key = keys_of("")["step"]
    meaning = "integration step, faster than which no memory of an effect builds up"
    return Quantity("memory_step", 0, "s", step, key.range.low, key.range.high, 0.0, step, meaning)


def _base_quantity(robot: Robot, value: ParameterValue, amplitude_of: dict[str, Effect]) -> Quantity:
    """The entry of p for a parameter of the robot file, which may also be the amplitude of an effect."""
    low, high = value.low, value.high
    key = value.name.rpartition("_")[0]
    if key in SPRING_KEYS:  # where the springs' inverse keeps its error, and a robot file may state them
        low = max(min(low, value.nominal), value.nominal / SPRING_SPREAD)
        high = min(max(high, value.nominal), value.nominal * SPRING_SPREAD)
    name, typical, everywhere, is_guess = None, None, None, False
    number, size = _find_file_number(robot, value, key)
    if number == ROTOR and not size:  # a model without an armature: it lacks all of it
        size = typical_loads.usual_size(robot, value.joint, ROTOR) / USUAL_ERROR
        high = min(LARGEST_INERTIAL_FACTOR * size, keys_of("joint.drive")[ROTOR].range.high)
    if number is not None and size:  # wrong by a factor, which 0 has not
        name, typical, everywhere, is_guess = number, USUAL_ERROR * size, 0.0, True
    elif key in amplitude_of:
        effect = amplitude_of[key]
        is_guess = key in effect.guessed_keys
        name, typical = effect.name, effect.usual_shares[key] * typical_loads.usual_size(robot, value.joint, key)
    return Quantity(
        value.name,
        value.joint,
        value.unit,
        value.nominal,
        low,
        high,
        value.tolerance,
        value.reference_size,
        value.meaning,
        name,
        "base",
        typical,
        everywhere,
        is_guess=is_guess,
        offset=value.offset,
    )


def _find_file_number(robot: Robot, value: ParameterValue, key: str) -> tuple[str | None, float]:
    """The number of the robot file that a parameter is, or is an entry of, and its size; None where it is none.

    The size of a centre of mass in space is its distance from the joint's frame, that of an inertia the mean of its
    moments: an entry of them that is 0 may be wrong as much as the others.
    """
    if key in FILE_NUMBER_NAMES:
        return key, abs(value.nominal + value.offset)
    name, _, entry = key.rpartition("_")
    if entry not in SPACE_ENTRIES.get(name, ()):
        return None, 0.0
    if name == "center_of_mass":
        return name, value.reference_size
    link = robot.joints[value.joint - 1].link
    assert isinstance(link, SpatialLink)
    return name, sum(moment.nominal for moment in link.inertia[:3]) / 3


def _is_left_out(robot: Robot, parameter: Parameter, j: int) -> bool:
    """Whether the drive of joint j has the key that makes the parameter needless."""
    if not parameter.unless:
        return False
    return getattr(robot.joints[j - 1].drive, parameter.unless) is not None


def _effect_quantity(
    robot: Robot, inputs: Sequence[Slot], effect: Effect, parameter: Parameter, j: int, stated: Value | None
) -> Quantity:
    """The entry of p for an effect's parameter at joint j, with the value that the robot file states, if any."""
    factor = _scale_factor(robot, parameter.scale, j)
    if stated is not None:
        nominal, tolerance = stated.nominal, stated.tolerance
    elif parameter.starts:
        nominal, tolerance = parameter.nominal * factor, 0.0
    else:
        nominal, tolerance = parameter.nominal, 0.0
    name, unit = parameter.name, parameter.unit
    if j:
        name = f"{parameter.name}_{j}"
        if robot.joints[j - 1].kind == "prismatic":
            unit = parameter.sliding or unit
        if inputs[j - 1].unit != "A":
            unit = unit.replace("1/A", "1/(N m)")
    role = "shape"
    if parameter.name in effect.amplitudes:
        role = "amplitude"
    return Quantity(
        name,
        j,
        unit,
        nominal,
        parameter.low,
        parameter.high,
        tolerance,
        abs(nominal),
        parameter.meaning,
        effect.name,
        role,
        _scale_size(parameter.typical, factor),
        _scale_size(parameter.everywhere, factor),
        tuple(start * factor for start in parameter.starts),
        search_unit=parameter.search_unit,
        is_motor_order=parameter.is_motor_order,
        is_reading_delay=parameter.is_reading_delay,
        encoder_term=parameter.encoder_term,
        equivalent=parameter.equivalent,
    )


def _scale_size(size: float | None, factor: float) -> float | None:
    if size is None:
        return None
    return size * factor


def _scale_factor(robot: Robot, scale: str | None, j: int) -> float:
    """The number that a parameter's scale gives at joint j."""
    numerator, _, denominator = (scale or "1").partition("/")
    return _usual_size(robot, numerator, j) / _usual_size(robot, denominator, j)


def _usual_size(robot: Robot, key: str, j: int) -> float:
    if key in ("1", ""):
        return 1.0
    return typical_loads.usual_size(robot, j, key)
