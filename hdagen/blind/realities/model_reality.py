"""A reality of an imported model: MuJoCo moves the links in space, a sampled controller drives them.

MuJoCo has inertias, Coriolis torques, armatures, gravity, damping, set-valued dry friction and a payload. It also has
stops, and gears that give way. Delay, lag and saturation stand between the command and it; a cable pulls from outside,
and a disc off its centre stands between it and the reading.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from hdagen.blind.realities.model_arms import (
    ENCODER_NOISE,
    ENCODER_RESOLUTION,
    OWN_ROTOR_EFFECTS,
    RATE,
    STEP,
    STEPS_PER_ROW,
    TORQUE_NOISE_SHARE,
    ModelCase,
    SpaceMotion,
    Table,
    draw_space_motion,
    rate_joint,
)
from hdagen.blind.realities.model_effects import Values, draw_effect
from hdagen.blind.realities.random_streams import seeded_generator
from hdagen.blind.realities.signal_to_noise import measure_signal_to_noise
from hdagen.blind.realities.space_model import set_spring, set_stop, write_space_model

JOINT_BANDWIDTH, LOOP_DAMPING = 15.0, 0.8  # rad/s, and the damping ratio of the position loop
SPEED_SHARE = 0.3  # of a new difference of positions in the filtered speed
MOST_TRACKED_TORQUE = 0.9  # of a joint's largest torque, that commands are limited to
CABLE_BEND = 0.7  # 1/rad, of a cable's torque over the angle: k sin(0.7 Δq) / 0.7


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
        self.motion, self.rng, self.n, self.effects = motion, rng, len(true["joint"]), effects
        self.model, still = self._build_true_model(true), [0.0] * self.n
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(k).name for k in range(self.model.njnt)]
        of_joint = [[name in (f"motor{j}", f"gear{j}") for name in names] for j in range(1, self.n + 1)]
        self.turns = np.array(of_joint, float)  # (n, joints of MuJoCo): a joint turns by its motor and its gear
        self.motors = [names.index(f"motor{j}") for j in range(1, self.n + 1)]
        self.known = mujoco.MjModel.from_xml_string(write_space_model(nominal, still, still))
        self.asked = mujoco.MjData(self.known)
        self.most = MOST_TRACKED_TORQUE * np.array([rate_joint(joint)["torque"] for joint in nominal["joint"]])
        self.late = self._pick("command_delay", "time", 0.0) / STEP
        lag = self._pick("current_loop_lag", "time", 0.0)
        self.keep = np.exp(-STEP / np.maximum(lag, 1e-9))  # of the lag's error over a step
        self.limit = self._pick("current_saturation", "limit", math.inf)
        self.cable = self._pick("cable_spring", "stiffness", 0.0), self._pick("cable_spring", "rest", 0.0)
        self.disc = self._pick("encoder_eccentricity", "share", 0.0), self._pick("encoder_eccentricity", "phase", 0.0)
        self.acting, self.home = np.zeros(self.n), np.zeros(self.n)

    def _pick(self, effect: str, key: str, otherwise: float) -> np.ndarray:
        """A parameter of an effect at each joint, ``otherwise`` where the joint does not have the effect."""
        return np.array([self.effects.get((effect, j), {}).get(key, otherwise) for j in range(1, self.n + 1)])

    def _build_true_model(self, true: Table) -> Any:
        """MuJoCo's model of the arm with the effects that lie in it; a joint has one of a gear's and a stop."""
        true, effects = copy.deepcopy(true), self.effects
        drives = [joint["drive"] for joint in true["joint"]]
        friction = [drive["coulomb_friction"] for drive in drives] + self._pick("coulomb_friction", "torque", 0.0)
        damping = [drive["viscous_friction"] for drive in drives] + self._pick("viscous_friction", "coefficient", 0.0)
        for drive, inertia in zip(drives, self._pick("motor_inertia", "inertia", math.nan), strict=True):
            if math.isfinite(inertia):
                drive["motor_inertia"] = float(inertia)
        gears = [j for effect, j in effects if effect in OWN_ROTOR_EFFECTS]
        payload = effects.get(("payload", self.n))
        model = mujoco.MjModel.from_xml_string(
            write_space_model(true, friction.tolist(), damping.tolist(), payload, gears)
        )
        if tilt := effects.get(("gravity_tilt", 0)):
            model.opt.gravity[:] = _tilt_gravity(np.array(true["gravity"], float), tilt)
        for (effect, j), p in effects.items():
            if effect == "missing_compliance":
                set_spring(model, f"gear{j}", 1.0 / p["compliance"], p["damping"])
            elif effect == "backlash":
                ends = -p["width"] / 2, p["width"] / 2
                set_stop(model, f"gear{j}", ends, 1.0 / p["compliance"], p["damping"])
            elif effect == "contact":
                wall = (None, p["angle"]) if p["side"] > 0.0 else (p["angle"], None)
                set_stop(model, f"motor{j}", wall, p["stiffness"], p["damping"])
        return model

    def _set_start(self) -> None:
        """Start at rest at the first row of the motion; a gear is bent by what its link weighs there, and the motor's
        encoder is set to the joint's."""
        self.data.qpos[self.motors] = self.motion.position[0]
        mujoco.mj_forward(self.model, self.data)
        weight = self.turns @ (self.data.qfrc_bias * (1.0 - np.isin(np.arange(self.model.nv), self.motors)))
        for (effect, j), p in self.effects.items():
            if effect in OWN_ROTOR_EFFECTS:
                bent = -p["compliance"] * weight[j - 1] - np.sign(weight[j - 1]) * p.get("width", 0.0) / 2
                self.data.qpos[self.model.joint(f"gear{j}").id] = bent
                self.data.qpos[self.motors[j - 1]] -= bent
                self.home[j - 1] = bent

    def simulate_log(self) -> dict[str, np.ndarray]:
        """Simulate the whole motion; return the log's columns by name."""
        count, n = len(self.motion.time), self.n
        self._set_start()
        commands, shown, read = (np.empty((count, n)) for _ in range(3))
        speed, before = np.zeros(n), None
        noise = TORQUE_NOISE_SHARE * self.most / MOST_TRACKED_TORQUE
        for k in range(count):
            off = ENCODER_NOISE * self.rng.standard_normal(n)
            read[k] = _round_to_counts(self._turn_discs() + off)
            motor = _round_to_counts(self.data.qpos[self.motors] + self.home + off)
            if before is not None:
                speed += SPEED_SHARE * ((motor - before) * RATE - speed)
            before = motor
            commands[k] = np.clip(self._ask_torque(k, motor, speed), -self.most, self.most)
            if k == 0:
                self.acting = np.clip(commands[0], -self.limit, self.limit)
            shown[k] = self.acting + noise * self.rng.standard_normal(n)
            self._advance_row(commands, k)
        columns = {"time": self.motion.time}
        for j in range(n):
            for name, values in (("motor_torque_command", commands), ("motor_torque", shown), ("joint_position", read)):
                columns[f"{name}_{j + 1}"] = np.ascontiguousarray(values[:, j])
        return columns

    def _turn_discs(self) -> np.ndarray:
        """The angle of the disc of each joint's encoder, rad: off its centre, and 0 at the zero position."""
        share, phase = self.disc
        q = self.turns @ self.data.qpos
        return np.asarray(q + _shift_disc(share, q + phase) - _shift_disc(share, phase))

    def _pull_cables(self) -> np.ndarray:
        """The cables' torques over the next step: their mean is that at its middle."""
        stiffness, rest = self.cable
        middle = self.turns @ (self.data.qpos + 0.5 * STEP * self.data.qvel)
        return np.asarray(-stiffness * np.sin(CABLE_BEND * (middle - rest)) / CABLE_BEND)

    def _ask_torque(self, k: int, read: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """The torque of the model's links along the reference, and a position loop on what the motors ``read``, as a
        servo drive has it."""
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
            self.data.qfrc_applied[:] = 0.0
            if self.cable[0].any():
                self.data.qfrc_applied[:] = self._pull_cables() @ self.turns
            self.data.qfrc_applied[self.motors] += middle
            mujoco.mj_step(self.model, self.data)


def _round_to_counts(angles: np.ndarray) -> np.ndarray:
    return np.asarray(np.round(angles / ENCODER_RESOLUTION) * ENCODER_RESOLUTION)


def _shift_disc(share: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Error of a disc off its centre by a ``share`` of its radius, rad, from the exact triangle."""
    return np.arctan2(share * np.sin(angle), 1.0 + share * np.cos(angle))


def _tilt_gravity(gravity: np.ndarray, tilt: Values) -> np.ndarray:
    """Gravity turned by an angle about an axis that is level."""
    down = gravity / np.linalg.norm(gravity)
    first = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    first /= np.linalg.norm(first)
    axis = math.cos(tilt["about"]) * first + math.sin(tilt["about"]) * np.cross(down, first)
    return np.asarray(math.cos(tilt["angle"]) * gravity + math.sin(tilt["angle"]) * np.cross(axis, gravity))
