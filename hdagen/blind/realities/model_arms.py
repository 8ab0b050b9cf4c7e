"""Arms of an imported model: rigid joints in space whose true inertias are scattered, and one effect that is withheld.

Drawing them simulates nothing. Legend: n joints, T instants; q positions, rad or m. Torques are at the joint, N m or N.
"""

from __future__ import annotations

import copy
import math
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from hdagen.blind.realities.population import Population
from hdagen.blind.realities.random_streams import draw_log_uniform, purpose_digest, seeded_generator
from hdagen.model_import.model_file import ModelError, is_model_file
from hdagen.model_import.robot_writing import import_model
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import show_path

RATE = 500  # Hz, of controller and log
STEPS_PER_ROW = 4  # of RK4
STEP = 1.0 / RATE / STEPS_PER_ROW  # s
SCATTER = 0.03  # relative standard deviation of masses, centres of mass and inertias about those of the model
MOST_MASS_DEVIATIONS = 2.0  # of the scatter
ENCODER_NOISE, ENCODER_RESOLUTION = 1e-5, 2 * math.pi / 2**17  # rad or m
TORQUE_NOISE_SHARE = 1e-3  # of the largest torque of a joint
MOST_ROBOT_BYTES = 1_000_000
DEFAULT_TORQUE = 50.0  # N m or N, of a joint whose model states none
DEFAULT_RANGE = (-2.0, 2.0)  # rad or m, the same
DEFAULT_SPEED = 2.0  # rad/s or m/s, the same
EFFECTS = (
    "coulomb_friction",
    "viscous_friction",
    "payload",
    "gravity_tilt",
    "command_delay",
    "current_loop_lag",
    "current_saturation",
    "motor_inertia",
    "missing_compliance",
    "backlash",
    "cable_spring",
    "contact",
    "encoder_eccentricity",
)  # what MuJoCo, the input in front of it, or the encoder behind it has
OWN_ROTOR_EFFECTS = ("missing_compliance", "backlash")  # of a gear between a rotor and a link
LARGEST_ROTOR_DECAY = 0.5  # of a rotor's speed in a step of the robot file, from which it cannot be told from its link
DEFAULT_FILE_STEP = 5e-4  # s, of a robot file that states none
Table = dict[str, Any]


@dataclass(frozen=True)
class ModelRobot:
    """The robot as its file states it: the text of a robot.toml of rigid joints in space at ratio 1."""

    text: str

    @property
    def table(self) -> Table:
        """The robot file as parsed, each number without its tolerance."""
        return {key: _take_values(part) for key, part in tomllib.loads(self.text).items()}

    def toml(self) -> str:
        """Write the robot file, with the log's sensors, and with the tolerance by which the reality is scattered."""
        document = tomlkit.parse(self.text)
        document["tolerance"] = SCATTER
        for joint in document["joint"]:
            joint["sensor"] = {
                "joint_encoder_resolution": ENCODER_RESOLUTION,
                "joint_encoder_noise": ENCODER_NOISE,
                "current_noise": TORQUE_NOISE_SHARE * rate_joint(joint)["torque"],
            }
        return tomlkit.dumps(document)

    def noise(self) -> dict[str, float]:
        """Standard deviation of the noise of each angle; inputs are given to the model and do not count."""
        deviation = math.hypot(ENCODER_NOISE, ENCODER_RESOLUTION / math.sqrt(12.0))
        return {f"joint_position_{j}": deviation for j in range(1, len(self.table["joint"]) + 1)}


def _take_values(part: Any) -> Any:
    """A part of a robot file with plain numbers in place of those with a tolerance or a source."""
    if isinstance(part, list):
        return [_take_values(entry) for entry in part]
    if isinstance(part, dict):
        return _take_values(part["value"]) if "value" in part else {key: _take_values(one) for key, one in part.items()}
    return part


def rate_joint(joint: Table) -> Table:
    """Read the limits of a joint.

    Args:
        joint: its table in the robot file.

    Returns:
        ``position`` (low, high), ``speed`` and ``torque``; usual ones where the file states none.

    """
    return {"position": DEFAULT_RANGE, "speed": DEFAULT_SPEED, "torque": DEFAULT_TORQUE, **joint.get("limits", {})}


@dataclass(frozen=True)
class ModelCase:
    """A case before it is simulated. ``effect`` at ``joint`` (0: the whole arm) is withheld, none where it is empty;
    ``size`` 0 to 1 is its place between the smallest and the largest size; ``seed`` of everything else."""

    name: str
    robot: ModelRobot
    effect: str
    joint: int
    size: float
    seed: int
    kind: str = "single"

    def true_table(self) -> Table:
        """The robot file with the true masses, centres of mass and inertias."""
        rng, table = seeded_generator(str(self.seed), "base"), copy.deepcopy(self.robot.table)
        for joint in table["joint"]:
            off = SCATTER * np.clip(rng.standard_normal(5), -MOST_MASS_DEVIATIONS, MOST_MASS_DEVIATIONS)
            center = np.array(joint["center_of_mass"])
            joint["mass"] *= 1.0 + float(off[0])
            joint["center_of_mass"] = (center + np.linalg.norm(center) * off[1:4]).tolist()
            joint["inertia"] = [entry * (1.0 + float(off[4])) for entry in joint["inertia"]]
        return table

    def label(self) -> Table:
        """The truth that is sealed."""
        named = [f"{self.effect}@{self.joint}"] if self.effect else []
        # the stops of a play yield a little, which may be named or not
        optional = [f"missing_compliance@{self.joint}"] if self.effect == "backlash" else []
        return {
            "kind": self.kind,
            "verdict": named,
            "optional": optional,
            "sizes": [self.size] * len(named),
            "background": 0.0,
            "seed": self.seed,
        }

    def true_diagnosis(self) -> None:
        """None: the true inertias lie about the model's, and no verdict states them."""
        return


@cache
def read_model_text(model: str) -> str:
    """Read the robot file of a model.

    Args:
        model: the path of a URDF or an MJCF, which is imported, or of a robot.toml with joints in space.

    Returns:
        The robot file's text.

    Raises:
        ModelError: the model cannot be imported, or no such robot file can be read.

    """
    if is_model_file(model):
        return import_model(model).text
    try:
        table = read_toml(Path(model), MOST_ROBOT_BYTES, "give a URDF, an MJCF or a robot.toml")
        text = Path(model).read_text(encoding="utf-8-sig")
    except InputFileError as error:
        raise ModelError(str(error)) from None
    joints = table.get("joint")
    if "tip" not in table or not isinstance(joints, list) or not all(map(_is_rigid_in_space, _take_values(joints))):
        raise ModelError(
            f"{show_path(Path(model))}: found no rigid joints in space at ratio 1, possible are those of a URDF,"
            " an MJCF or the long form of robot.toml; name such a file."
        )
    return text


def _is_rigid_in_space(joint: Any) -> bool:
    """Whether a table of a robot file is a rigid joint of the long form at ratio 1, with all its numbers."""
    if not isinstance(joint, dict) or not isinstance(drive := joint.get("drive"), dict):
        return False
    lists = [joint.get(key) for key in ("origin", "rotation", "axis", "center_of_mass", "inertia")]
    numbers = [drive.get(key) for key in ("motor_inertia", "viscous_friction", "coulomb_friction")]
    plain = all(isinstance(one, list) for one in lists) and all(isinstance(one, float) for one in numbers)
    return plain and isinstance(joint.get("mass"), float) and drive.get("rigid") is True and drive.get("ratio") == 1.0


def draw_model_cases(seed: str, population: Population, count: int) -> tuple[ModelCase, ...]:
    """Draw the first cases of a model: all effects one after the other, or none.

    Args:
        seed: the seed of the check.
        population: kind and model.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    Raises:
        ModelError: the model cannot be read.

    """
    text, own = read_model_text(population.model), population.seed_family(seed)
    table = ModelRobot(text).table
    order = [""]
    if population.kind != "none":
        possible = [one for one in EFFECTS if list_possible_joints(one, table)]
        order = seeded_generator(own, "order").permutation(possible).tolist()
    return tuple(_draw_case(own, population.kind, index, text, order) for index in range(count))


def list_possible_joints(effect: str, table: Table) -> tuple[int, ...]:
    """List the joints at which a diagnosis of an arm offers an effect.

    Args:
        effect: one of `EFFECTS`; empty for none.
        table: the robot file.

    Returns:
        Their numbers from 1; (0,) for the arm as a whole; none where such an arm cannot have the effect.

    """
    joints = table["joint"]
    if effect == "gravity_tilt":
        return (0,) if any(table.get("gravity", (0.0,))) else ()
    if effect == "payload":
        return (len(joints),)
    fits: list[bool] = [True] * len(joints)
    if effect in OWN_ROTOR_EFFECTS:
        fits = [_can_turn_alone(joint["drive"], table.get("step", DEFAULT_FILE_STEP)) for joint in joints]
    if effect == "encoder_eccentricity":
        fits = [joint.get("type", "revolute") == "revolute" for joint in joints]
    return tuple(j for j, possible in enumerate(fits, 1) if possible)


def _can_turn_alone(drive: Table, step: float) -> bool:
    """Whether a rotor is stated that friction does not stop within a few steps of the robot file."""
    rotor = float(drive["motor_inertia"])
    return rotor > 0.0 and drive["viscous_friction"] * step <= LARGEST_ROTOR_DECAY * rotor


def _draw_case(seed: str, kind: str, index: int, text: str, order: list[str]) -> ModelCase:
    rng, robot = seeded_generator(seed, kind, index), ModelRobot(text)
    effect = order[index % len(order)]
    possible = list_possible_joints(effect, robot.table)
    joint = possible[int(rng.integers(len(possible)))]
    name = purpose_digest(seed, kind, index, "name").hex()[:16]
    return ModelCase(name, robot, effect, joint, float(rng.random()), int(rng.integers(2**62)), kind)


@dataclass(frozen=True, eq=False)
class SpaceMotion:
    """A reference: ``time`` (T,) s; ``position`` (T, n), its ``velocity`` and its ``acceleration``."""

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def draw_space_motion(rng: np.random.Generator, table: Table, seconds: float) -> SpaceMotion:
    """Draw sines of each joint about the middle of its range, from rest.

    Args:
        rng: the random generator.
        table: the robot file, whose ranges and speeds the motion keeps.
        seconds: length of the motion, s.

    Returns:
        The reference, with a row every 1/RATE.

    """
    time = np.arange(round(seconds * RATE)) / RATE
    ramp = np.clip(time, 0.0, 1.0)
    window = ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2)
    position = np.empty((len(time), len(table["joint"])))
    for k, joint in enumerate(table["joint"]):
        limits = rate_joint(joint)
        pulsation = 2.0 * math.pi * np.array([draw_log_uniform(rng, 0.1, 1.5) for _ in range(6)])
        wave = np.sin(np.outer(time, pulsation) + rng.uniform(0.0, 2.0 * math.pi, 6)) @ (
            rng.uniform(0.5, 1.0, 6) / pulsation
        )
        low, high = limits["position"]
        reach, speed = min(1.0, 0.35 * (high - low)), min(1.2, 0.6 * limits["speed"])
        fastest = float(np.abs(np.gradient(wave, 1 / RATE)).max())
        position[:, k] = (low + high) / 2 + window * wave * min(reach / float(np.abs(wave).max()), speed / fastest)
    velocity = np.asarray(np.gradient(position, 1 / RATE, axis=0))
    return SpaceMotion(time, position, velocity, np.asarray(np.gradient(velocity, 1 / RATE, axis=0)))
