"""The robot description as frozen data: the content of robot.toml, complete and checked. `gen.robot.load_robot` reads
it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


class RobotError(Exception):
    """A robot file that cannot be used: ``problems`` holds one sentence for each problem."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


@dataclass(frozen=True)
class Value:
    """A number with the relative standard deviation with which it is known."""

    nominal: float
    tolerance: float


@dataclass(frozen=True)
class Drive:
    """A drive. Spring values are None where ``rigid``; ``torque_constant`` None: the input is motor torque."""

    rigid: bool
    ratio: Value
    motor_inertia: Value
    viscous_friction: Value
    coulomb_friction: Value
    friction_smoothing: Value  # rad/s at the motor, width of the smooth sign
    torque_constant: Value | None
    max_current: float | None
    flexspline_stiffness: Value | None  # K_f0
    flexspline_stiffening: Value | None  # c_f
    wave_generator_stiffness: Value | None  # K_w0
    wave_generator_stiffening: Value | None  # c_w
    torsional_damping: Value | None
    law_torque: Value | None  # N m at the joint; beyond it the spring law goes on along its tangent
    hysteresis_loss: float | None  # ψ, rad, from the catalogue; None if unknown
    compliant: bool = False  # called rigid by the file and given a spring by `missing_compliance`


@dataclass(frozen=True)
class Limits:
    """Limits of a joint; None where the file states none."""

    position: tuple[float, float] | None
    speed: float | None
    torque: float | None
    motor_torque_rate: float | None


@dataclass(frozen=True)
class Sensor:
    """Sensors of a joint; 0 where the file states none (exact)."""

    motor_encoder_resolution: float
    joint_encoder_resolution: float
    motor_encoder_noise: float
    joint_encoder_noise: float
    current_noise: float
    torque_noise: float


@dataclass(frozen=True)
class PlanarLink:
    """A link of the short form, along x of its joint.

    Attributes:
        length: To the next joint or the tip, m.
        center_of_mass: From the joint's axis, m.
        inertia: About the centre of mass, kg m² (negative possible only where the file lumps).
        is_lumped: Whether the file states it about the joint: a way to write it, and no part of the robot's meaning.

    """

    length: Value
    center_of_mass: Value
    inertia: Value
    is_lumped: bool = False


@dataclass(frozen=True)
class SpatialLink:
    """A link of the long form, with the frame of its joint.

    Attributes:
        origin: The joint's frame in the frame before, m.
        rotation: The same as a unit quaternion w, x, y, z.
        axis: Unit vector of the joint in its frame.
        center_of_mass: In the joint's frame, m.
        inertia: About the centre of mass in the joint's frame, xx, yy, zz, xy, xz, yz, kg m².

    """

    origin: tuple[float, ...]
    rotation: tuple[float, ...]
    axis: tuple[float, ...]
    center_of_mass: tuple[Value, ...]
    inertia: tuple[Value, ...]


@dataclass(frozen=True)
class Joint:
    """A joint with its link; ``name`` is its label, empty where the file states none."""

    kind: str  # "revolute" or "prismatic"
    mass: Value
    link: PlanarLink | SpatialLink
    drive: Drive
    limits: Limits
    sensor: Sensor
    name: str = ""


@dataclass(frozen=True)
class Tip:
    """The tip in the last joint's frame: origin, m, and unit quaternion w, x, y, z."""

    origin: tuple[float, ...]
    rotation: tuple[float, ...]


@dataclass(frozen=True)
class StatedEffect:
    """An effect that the robot file states, with every parameter filled in whose nominal value is not the joint's.

    Attributes:
        name: The effect's name.
        joint: The joint's number from 1; 0 is the whole arm.
        parameters: Values by name.
        assumed: Whether the file does not state it: these are the values of a spring that is only looked for.

    """

    name: str
    joint: int
    parameters: dict[str, Value]
    assumed: bool = False


@dataclass(frozen=True)
class Robot:
    """A robot description, complete and within physical ranges."""

    name: str
    slug: str  # matches ^[a-z][a-z0-9_]{0,47}$; the only form of the name that reaches a path
    gravity: tuple[Value, ...]  # along x and y of the plane, or in space
    tolerance: float
    step: float  # s, integration step the model is meant for
    force_noise: float  # N
    joints: tuple[Joint, ...]
    effects: tuple[StatedEffect, ...]
    source: Path
    tip: Tip | None = None  # of a chain in space

    @property
    def in_space(self) -> bool:
        """Whether the joints stand in space."""
        return self.tip is not None


def describe_robot(robot: Robot) -> dict[str, Any]:
    """Write the description as JSON can hold it, for the manifest.

    Args:
        robot: The robot description.

    Returns:
        Everything but the place of the file, and effects that the file does not state.

    """
    description = _to_plain_json(asdict(robot))
    del description["source"]
    if not robot.in_space:
        del description["tip"]
    for joint in description["joints"]:
        joint |= joint.pop("link")  # noqa: PLW2901 - a joint's keys stand side by side, as in the file
        joint.pop("is_lumped", None)
        if not joint["name"]:
            del joint["name"]
    description["effects"] = [effect for effect in description["effects"] if not effect.pop("assumed")]
    return description


def _to_plain_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _to_plain_json(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain_json(part) for part in value]
    return value
