"""A reality of an imported model: MuJoCo moves the links in space, a sampled controller drives them.

MuJoCo has inertias, Coriolis torques, armatures, gravity, damping, set-valued dry friction and a payload; delay, lag
and saturation stand between the command and it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from hdagen.blind.realities.model_arms import (
    ENCODER_NOISE,
    ENCODER_RESOLUTION,
    RATE,
    TORQUE_NOISE_SHARE,
    ModelCase,
    SpaceMotion,
    Table,
    draw_space_motion,
    rate_joint,
)
from hdagen.blind.realities.random_streams import seeded_generator
from hdagen.blind.realities.signal_to_noise import measure_signal_to_noise

STEPS_PER_ROW = 4  # of RK4
STEP = 1.0 / RATE / STEPS_PER_ROW  # s
JOINT_BANDWIDTH, LOOP_DAMPING = 15.0, 0.8  # rad/s, and the damping ratio of the position loop
SPEED_SHARE = 0.3  # of a new difference of positions in the filtered speed
HARDEST_IMPEDANCE = 0.9999  # MuJoCo's hardest impedance
MOST_TRACKED_TORQUE = 0.9  # of a joint's largest torque, that commands are limited to
Values = dict[str, float]


def make_model_log(
    case: ModelCase, which: str, seconds: float, known: Values | None = None
) -> tuple[dict[str, np.ndarray], Values, float]:
    """Simulate a motion of a case.

    Args:
        case: the drawn case.
        which: "log" or "hold_out".
        seconds: length of the motion, s.
        known: the effect's parameters from an earlier log of the case; None to draw them.

    Returns:
        The log's columns (T,) by name, the effect's parameters, and the ratio of its change to the sensors' noise on
        the channel that shows it best (0 without an effect, and where the parameters were given).

    """
    nominal, rng = case.robot.table, seeded_generator(str(case.seed), "motion", which)
    motion = draw_space_motion(rng, nominal, seconds)
    without = simulate_space_arm(case.true_table(), nominal, motion, seeded_generator(str(case.seed), "noise", which))
    if not case.effect:
        return without, {}, 0.0
    found = known or draw_effect(case, without)
    noise = seeded_generator(str(case.seed), "noise", which)
    log = simulate_space_arm(case.true_table(), nominal, motion, noise, {(case.effect, case.joint): found})
    if known is not None:
        return log, found, 0.0
    return log, found, measure_signal_to_noise(log, without, case.robot.noise())


def draw_effect(case: ModelCase, without: Mapping[str, np.ndarray]) -> Values:
    """Draw the parameters of a case's effect; its size is the case's.

    Args:
        case: the case.
        without: the log of the same motion without it, which sizes friction and saturation.

    Returns:
        The parameters, SI.

    """
    rng = seeded_generator(str(case.seed), "effect")

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** case.size)

    joint = max(case.joint, 1)
    torque = without[f"motor_torque_{joint}"]
    usual = float(np.sqrt(np.mean(torque**2)))
    speed = float(np.sqrt(np.mean(np.gradient(without[f"joint_position_{joint}"], 1 / RATE) ** 2)))
    match case.effect:
        case "coulomb_friction":
            return {"torque": between(0.1, 0.5) * usual}
        case "viscous_friction":
            return {"coefficient": between(0.1, 0.5) * usual / speed}
        case "payload":
            place = rng.uniform(-0.05, 0.05, 3)
            mass = between(0.05, 0.2) * sum(one["mass"] for one in case.robot.table["joint"][-3:])
            return {"mass": mass, **dict(zip("xyz", map(float, place), strict=True))}
        case "gravity_tilt":
            return {"angle": between(0.02, 0.08), "about": float(rng.uniform(0.0, 2.0 * math.pi))}
        case "command_delay" | "current_loop_lag":
            return {"time": between(0.002, 0.01)}
        case "current_saturation":
            return {"limit": between(0.5, 0.85) * float(np.abs(torque).max())}
    return {"factor": between(1.5, 3.0)}  # of the rotor's inertia


def write_space_model(
    table: Table,
    friction: Sequence[float],
    damping: Sequence[float],
    payload: Mapping[str, float] | None = None,
) -> str:
    """Write an arm in space as MJCF.

    Args:
        table: the robot file, with the links to be simulated.
        friction: dry friction of each joint, N m or N.
        damping: of each joint, N m s/rad or N s/m.
        payload: its ``mass`` and its place ``x``, ``y``, ``z`` at the tip, m.

    Returns:
        The model's text.

    """

    def words(values: Sequence[float]) -> str:
        return " ".join(repr(float(value)) for value in values)

    dry = f'solreffriction="{2 * STEP!r} 1" solimpfriction="{HARDEST_IMPEDANCE} {HARDEST_IMPEDANCE} 0.001 0.5 2"'
    bodies = []
    for joint, dry_friction, slope in zip(table["joint"], friction, damping, strict=True):
        kind = {"revolute": "hinge", "prismatic": "slide"}[joint.get("type", "revolute")]
        bodies.append(
            f'<body pos="{words(joint.get("origin", (0, 0, 0)))}" quat="{words(joint.get("rotation", (1, 0, 0, 0)))}">'
            f'<joint type="{kind}" axis="{words(joint.get("axis", (0, 0, 1)))}" damping="{slope!r}"'
            f' armature="{joint["drive"]["motor_inertia"]!r}" frictionloss="{dry_friction!r}" {dry}/>'
            f'<inertial pos="{words(joint["center_of_mass"])}" mass="{joint["mass"]!r}"'
            f' fullinertia="{words(joint["inertia"])}"/>'
        )
    tip = table.get("tip", {})
    if payload:
        mass, own = payload["mass"], 1e-6 * payload["mass"]
        place = words([payload[axis] for axis in "xyz"])
        bodies.append(
            f'<body pos="{words(tip.get("origin", (0, 0, 0)))}" quat="{words(tip.get("rotation", (1, 0, 0, 0)))}">'
            f'<inertial pos="{place}" mass="{mass!r}" diaginertia="{own} {own} {own}"/>'
        )
    return f"""<mujoco><option timestep="{STEP!r}" integrator="RK4" solver="Newton" tolerance="1e-12"
      gravity="{words(table["gravity"])}"/><worldbody>{"".join(bodies)}{"</body>" * len(bodies)}</worldbody></mujoco>"""


def simulate_space_arm(
    true: Table,
    nominal: Table,
    motion: SpaceMotion,
    rng: np.random.Generator,
    effects: Mapping[tuple[str, int], Values] | None = None,
) -> dict[str, np.ndarray]:
    """Simulate an arm that follows a motion.

    Args:
        true: the robot file with the links that move.
        nominal: the robot file that the controller knows.
        motion: the reference.
        rng: draws the sensors' noise.
        effects: parameters of each effect by its name and joint.

    Returns:
        Columns (T,) by name: time, and of each joint motor_torque_command, motor_torque and joint_position.

    """
    return _SpaceSimulation(true, nominal, motion, rng, effects or {}).simulate_log()


class _SpaceSimulation:
    """One simulation: MuJoCo's state, the controller, and the inputs on their way."""

    def __init__(
        self,
        true: Table,
        nominal: Table,
        motion: SpaceMotion,
        rng: np.random.Generator,
        effects: Mapping[tuple[str, int], Values],
    ) -> None:
        self.motion, self.rng, self.n = motion, rng, len(true["joint"])
        every = range(1, self.n + 1)
        own: dict[str, list[Any]] = {
            name: [effects.get((name, j)) for j in every] for name in {effect for effect, _ in effects}
        }

        def pick(effect: str, key: str, otherwise: float) -> np.ndarray:
            return np.array([one[key] if one else otherwise for one in own.get(effect, [None] * self.n)])

        drives = [joint["drive"] for joint in true["joint"]]
        friction = [drive["coulomb_friction"] for drive in drives] + pick("coulomb_friction", "torque", 0.0)
        damping = [drive["viscous_friction"] for drive in drives] + pick("viscous_friction", "coefficient", 0.0)
        for drive, factor in zip(drives, pick("motor_inertia", "factor", 1.0), strict=True):
            drive["motor_inertia"] = drive["motor_inertia"] * float(factor)
        text = write_space_model(true, friction.tolist(), damping.tolist(), effects.get(("payload", self.n)))
        self.model = mujoco.MjModel.from_xml_string(text)
        if tilt := effects.get(("gravity_tilt", 0)):
            self.model.opt.gravity[:] = _tilt_gravity(np.array(true["gravity"], float), tilt)
        self.data = mujoco.MjData(self.model)
        still = [0.0] * self.n
        self.known = mujoco.MjModel.from_xml_string(write_space_model(nominal, still, still))
        self.asked = mujoco.MjData(self.known)
        self.most = MOST_TRACKED_TORQUE * np.array([rate_joint(joint)["torque"] for joint in nominal["joint"]])
        self.late = pick("command_delay", "time", 0.0) / STEP
        lag = pick("current_loop_lag", "time", 0.0)
        self.keep = np.exp(-STEP / np.maximum(lag, 1e-9))  # of the lag's error over a step
        self.limit = pick("current_saturation", "limit", math.inf)
        self.acting = np.zeros(self.n)

    def simulate_log(self) -> dict[str, np.ndarray]:
        """Simulate the whole motion; return the log's columns by name."""
        count, n = len(self.motion.time), self.n
        self.data.qpos[:] = self.motion.position[0]
        commands, shown, read = (np.empty((count, n)) for _ in range(3))
        speed, before = np.zeros(n), None
        noise = TORQUE_NOISE_SHARE * self.most / MOST_TRACKED_TORQUE
        for k in range(count):
            angles = self.data.qpos + ENCODER_NOISE * self.rng.standard_normal(n)
            read[k] = np.round(angles / ENCODER_RESOLUTION) * ENCODER_RESOLUTION
            if before is not None:
                speed += SPEED_SHARE * ((read[k] - before) * RATE - speed)
            before = read[k]
            commands[k] = np.clip(self._ask_torque(k, read[k], speed), -self.most, self.most)
            if k == 0:
                self.acting = np.clip(commands[0], -self.limit, self.limit)
            shown[k] = self.acting + noise * self.rng.standard_normal(n)
            self._advance_row(commands, k)
        columns = {"time": self.motion.time}
        for j in range(n):
            for name, values in (("motor_torque_command", commands), ("motor_torque", shown), ("joint_position", read)):
                columns[f"{name}_{j + 1}"] = np.ascontiguousarray(values[:, j])
        return columns

    def _ask_torque(self, k: int, read: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """The torque of the model's links along the reference, and a position loop on the encoders."""
        motion, asked = self.motion, self.asked
        slip = motion.velocity[k] - speed
        pull = JOINT_BANDWIDTH * (JOINT_BANDWIDTH * (motion.position[k] - read) + 2.0 * LOOP_DAMPING * slip)
        asked.qpos[:], asked.qvel[:], asked.qacc[:] = (
            motion.position[k],
            motion.velocity[k],
            motion.acceleration[k] + pull,
        )
        mujoco.mj_inverse(self.known, asked)
        return np.asarray(asked.qfrc_inverse.copy())

    def _advance_row(self, commands: np.ndarray, k: int) -> None:
        """Simulate until the next row: what was commanded arrives late, is limited, and is followed with a lag."""
        rows, joints = len(commands), np.arange(self.n)
        for step in range(STEPS_PER_ROW):
            ages = np.ceil((self.late - step - 0.5) / STEPS_PER_ROW).clip(0).astype(int)
            arrived = commands[np.clip(k - ages, 0, rows - 1), joints]
            wanted = np.clip(arrived, -self.limit, self.limit)
            middle = wanted + np.sqrt(self.keep) * (self.acting - wanted)  # the mean over the step, nearly
            self.acting = wanted + self.keep * (self.acting - wanted)
            self.data.qfrc_applied[:] = middle
            mujoco.mj_step(self.model, self.data)


def _tilt_gravity(gravity: np.ndarray, tilt: Values) -> np.ndarray:
    """Gravity turned by an angle about an axis that is level."""
    down = gravity / np.linalg.norm(gravity)
    first = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    first /= np.linalg.norm(first)
    axis = math.cos(tilt["about"]) * first + math.sin(tilt["about"]) * np.cross(down, first)
    return np.asarray(math.cos(tilt["angle"]) * gravity + math.sin(tilt["angle"]) * np.cross(axis, gravity))
