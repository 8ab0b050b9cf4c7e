"""One or two joints of a real machine whose friction the robot file leaves out, beside torque that no effect describes.

Drawing them simulates nothing. Legend: J joints, T instants; q angles, rad; v speeds, a accelerations. Torques are at
the joint, N m, unless the motor is named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import tomlkit

from hdagen.blind.realities.joint_motion import JointMotion, compute_link_torques, draw_joint_motion
from hdagen.blind.realities.population import FRICTION_KIND
from hdagen.blind.realities.random_streams import draw_log_uniform, purpose_digest, seeded_generator

SIZING_SECONDS = 24.0  # s of the log's motion, over which friction is drawn and its best linear size is fitted
LOG_RATES = (50, 100, 200, 500, 1000)  # Hz, of logs
CONTROLLER_RATE = 1000  # Hz, of a controller whose commands are not logged
TOLERANCE = 0.05  # relative standard deviation that the robot file states
MOST_DEVIATIONS = 2.5  # largest deviation of a true parameter, in standard deviations
SCATTERED_JOINT_PARAMETERS = ("mass", "center_of_mass", "inertia", "motor_inertia", "torque_constant")
FRICTION_EFFECTS = ("coulomb_friction", "viscous_friction")
SERIES_SPRING_KEYS = (  # of a joint that is not rigid
    "flexspline_stiffness",
    "flexspline_stiffening",
    "wave_generator_stiffness",
    "wave_generator_stiffening",
    "torsional_damping",
)
REQUIRED_SHARE = 0.25  # share of a joint's friction at its usual speed from which a term has to be named
LARGEST_NAMELESS_SHARE = 0.1  # largest torque without a name, as a share of the friction, both rms
_STANDSTILL_SPEED = 1e-3  # rad/s; a slower joint stands


@dataclass(frozen=True)
class Friction:
    """``coulomb`` level and ``viscous`` torque at ``speed``, growing with the speed's power ``exponent``."""

    coulomb: float
    viscous: float
    exponent: float
    speed: float

    def torque(self, v: np.ndarray) -> np.ndarray:
        """Compute the friction torque.

        Args:
            v: speeds (T,), rad/s.

        Returns:
            Torque (T,), N m, with the sign of the speed.

        """
        return np.asarray(np.sign(v) * (self.coulomb + self.viscous * (np.abs(v) / self.speed) ** self.exponent))

    def fit_linear(self, v: np.ndarray) -> tuple[float, float]:
        """Fit Coulomb and viscous friction to the true friction by least squares.

        Args:
            v: speeds (T,), rad/s.

        Returns:
            Level, N m, and coefficient, N m s/rad.

        """
        columns = np.column_stack([np.sign(v), v])
        level, coefficient = np.linalg.lstsq(columns, self.torque(v), rcond=None)[0]
        return float(level), float(coefficient)


@dataclass(frozen=True)
class NamelessTorque:
    """Torque at a joint that no effect describes. ``wander``: rms of a slow random torque with correlation ``time``, s;
    ``ripple`` with ``order`` periods a turn and ``phase``; ``varying``: amplitude of the friction's relative change
    with the angle, at ``waves`` rad per rad."""

    wander: float
    time: float
    ripple: float
    order: float
    phase: float
    varying: float
    waves: float


@dataclass(frozen=True)
class JointRobot:
    """A chain of joints as its file states it; those without a ``flexspline_stiffness`` are rigid. ``joints``: keys of
    the tables link, drive and sensor together, SI; ``encoder``: "motor" or "joint", where the encoders sit;
    ``current``: currents drive it, not torques."""

    name: str
    gravity: tuple[float, float]
    joints: tuple[dict[str, float], ...]
    encoder: str
    current: bool

    def toml(self) -> str:
        """robot.toml."""
        document = tomlkit.document()
        document.update({"name": self.name, "gravity": list(self.gravity), "tolerance": TOLERANCE})
        tables = tomlkit.aot()
        drive = ["ratio", "motor_inertia", *FRICTION_EFFECTS]
        if self.current:
            drive.insert(2, "torque_constant")
        for joint in self.joints:
            table = tomlkit.table()
            table.update({key: joint[key] for key in ("length", "mass", "center_of_mass", "inertia")})
            table["drive"] = {key: joint[key] for key in (*drive, *SERIES_SPRING_KEYS) if key in joint}
            if SERIES_SPRING_KEYS[0] not in joint:
                table["drive"]["rigid"] = True
            table["sensor"] = {
                f"{self.encoder}_encoder_resolution": joint["resolution"],
                f"{self.encoder}_encoder_noise": joint["encoder_noise"],
                "current_noise": joint["input_noise"],
            }
            tables.append(table)
        document["joint"] = tables
        return tomlkit.dumps(document)

    def noise(self) -> dict[str, float]:
        """Standard deviation of the noise of each angle; inputs are given to the model and do not count."""
        return {
            f"{self.encoder}_position_{j}": math.hypot(joint["encoder_noise"], joint["resolution"] / math.sqrt(12.0))
            for j, joint in enumerate(self.joints, 1)
        }


@dataclass(frozen=True)
class JointCase:
    """A case before it is simulated. ``rate`` of the log, Hz; ``commanded``: the log has commands, and the controller
    runs at the log's rate; ``scatter``: relative standard deviation of the true parameters; ``jitter``: largest error
    of the time stamps, s; ``speeds``, rad/s, that each joint's motion seldom passes; ``seed`` of everything else."""

    name: str
    robot: JointRobot
    rate: int
    commanded: bool
    friction: tuple[Friction, ...]
    nameless: tuple[NamelessTorque, ...]
    speeds: tuple[float, ...]
    scatter: float
    jitter: float
    seed: int
    kind: str = FRICTION_KIND

    def draw_motion(self, which: str, seconds: float) -> JointMotion:
        """Draw the motion of the log or of the hold-out.

        Args:
            which: "log" or "hold_out".
            seconds: length of the motion, s.

        Returns:
            The reference of all joints.

        """
        return draw_joint_motion(seeded_generator(str(self.seed), "motion", which), self.speeds, seconds)

    def true_joints(self) -> list[dict[str, float]]:
        """The true base parameters, a joint each."""
        rng = seeded_generator(str(self.seed), "base")
        true = []
        for joint in self.robot.joints:
            off = (
                np.clip(rng.standard_normal(len(SCATTERED_JOINT_PARAMETERS)), -MOST_DEVIATIONS, MOST_DEVIATIONS)
                * self.scatter
            )
            true.append(
                {
                    **joint,
                    **{k: joint[k] * (1.0 + float(d)) for k, d in zip(SCATTERED_JOINT_PARAMETERS, off, strict=True)},
                }
            )
        return true

    def friction_parameters(self) -> dict[str, dict[str, float]]:
        """Parameters of each term of friction by effect@joint, at the motor: ``level`` of the best linear friction,
        ``alone`` with the other term as in the robot file, and ``share`` of the joint's friction at its usual speed."""
        found = {}
        for j, (joint, friction, v) in enumerate(
            zip(self.robot.joints, self.friction, self._moving_speeds(), strict=True), 1
        ):
            level, coefficient = friction.fit_linear(v)
            rms = float(np.sqrt(np.mean(v**2)))
            shares = np.abs([level, coefficient * rms]) / (abs(level) + abs(coefficient) * rms)
            columns = np.sign(v) * joint["ratio"], v * joint["ratio"] ** 2
            torque = friction.torque(v)
            for k, name in enumerate(FRICTION_EFFECTS):
                own, left = columns[k], torque - columns[1 - k] * joint[FRICTION_EFFECTS[1 - k]]
                found[f"{name}@{j}"] = {
                    "level": (level / joint["ratio"], coefficient / joint["ratio"] ** 2)[k],
                    "alone": float(own @ left / (own @ own)),
                    "share": float(shares[k]),
                }
        return found

    def snr(self) -> float:
        """Ratio of the friction that the robot file lacks to the noise of the input, rms; the largest of all joints."""
        found = []
        for joint, friction, v in zip(self.robot.joints, self.friction, self._moving_speeds(), strict=True):
            stated = joint["coulomb_friction"] * np.sign(v) + joint["viscous_friction"] * joint["ratio"] * v
            lacking = friction.torque(v) / joint["ratio"] - stated
            noise = joint["input_noise"]
            if self.robot.current:
                noise *= joint["torque_constant"]
            found.append(float(np.sqrt(np.mean(lacking**2))) / noise)
        return max(found)

    def _moving_speeds(self) -> list[np.ndarray]:
        """Speeds at which each joint moves in the log."""
        return _select_moving_speeds(self.draw_motion("log", SIZING_SECONDS))

    def label(self) -> dict[str, Any]:
        """The truth that is sealed: ``optional`` effects may be named or not, ``sizes`` are levels at the motor."""
        found = self.friction_parameters()
        required = [name for name, p in found.items() if p["share"] >= REQUIRED_SHARE]
        optional = [name for name in found if name not in required]
        return {
            "kind": self.kind,
            "verdict": required,
            "optional": optional,
            "sizes": [found[name]["level"] for name in (*required, *optional)],
            "background": max(map(_nameless_share, self.friction, self.nameless, self._moving_speeds())),
            "joints": [asdict(f) | asdict(n) for f, n in zip(self.friction, self.nameless, strict=True)],
            "seed": self.seed,
        }

    def true_diagnosis(self) -> dict[str, Any]:
        """A diagnosis.json with the best linear friction and the true base parameters."""
        found = self.friction_parameters()
        causes = []
        for name, p in found.items():
            effect, _, j = name.partition("@")
            value = {effect: {"value": max(p["level"], 0.0)}}
            causes.append({"effect": effect, "joint": int(j), "parameters": value})
        base = SCATTERED_JOINT_PARAMETERS if self.robot.current else SCATTERED_JOINT_PARAMETERS[:-1]
        numbers = {f"{key}_{j}": joint[key] for j, joint in enumerate(self.true_joints(), 1) for key in base}
        return {"schema": 1, "verdict": list(found), "causes": causes, "parameters": numbers}


def _select_moving_speeds(motion: JointMotion) -> list[np.ndarray]:
    """Speeds of each joint at the instants at which it moves."""
    return [v[np.abs(v) > _STANDSTILL_SPEED] for v in motion.velocity.T]


def _nameless_share(friction: Friction, nameless: NamelessTorque, v: np.ndarray) -> float:
    """Ratio of the torque without a name to the friction, both rms."""
    usual = float(np.sqrt(np.mean(friction.torque(v) ** 2)))
    squares = (nameless.wander / usual) ** 2 + 0.5 * (nameless.ripple / usual) ** 2 + 0.5 * nameless.varying**2
    return math.sqrt(squares)


def draw_joint_cases(seed: str, count: int) -> tuple[JointCase, ...]:
    """Draw the first cases.

    Args:
        seed: the seed of the check.
        count: how many cases.

    Returns:
        The cases, in an order that the seed decides; a larger ``count`` appends to them.

    """
    return tuple(_draw_case(seed, index) for index in range(count))


def _draw_case(seed: str, index: int) -> JointCase:
    rng = seeded_generator(seed, FRICTION_KIND, index)
    count = int(rng.integers(1, 3))
    gravity = (0.0, float(rng.choice([0.0, -9.81])))
    rate = int(rng.choice(LOG_RATES))
    current = bool(rng.integers(2))
    commanded = current or bool(rng.random() < 1 / 3)
    encoder = str(rng.choice(["motor", "joint"]))
    speeds = tuple(draw_log_uniform(rng, 0.8, 4.0) for _ in range(count))
    seed_of_case = int(rng.integers(2**62))
    motion = draw_joint_motion(seeded_generator(str(seed_of_case), "motion", "log"), speeds, SIZING_SECONDS)
    moving = _select_moving_speeds(motion)
    links = _draw_links(rng, count)
    asked = compute_link_torques(links, gravity, motion.position, motion.velocity, motion.acceleration)
    usual = np.sqrt(np.mean(asked**2, axis=0))
    friction = tuple(_draw_friction(rng, float(t), v) for t, v in zip(usual, moving, strict=True))
    nameless = tuple(_draw_nameless_torque(rng, f, v) for f, v in zip(friction, moving, strict=True))
    known = 0.0  # share of the friction that the robot file states
    if rng.random() < 1 / 3:
        known = 0.5
    joints = [
        {**link, **_draw_drive(rng, link, f, float(t), v, known), **_draw_sensor(rng, encoder, link["ratio"])}
        for link, f, t, v in zip(links, friction, usual, moving, strict=True)
    ]
    scatter, jitter = float(rng.uniform(0.02, 0.04)), float(rng.uniform(0.0, 50e-6))
    robot = JointRobot(
        f"joint-{purpose_digest(seed, 'robot', index).hex()[:10]}", gravity, tuple(joints), encoder, current
    )
    name = purpose_digest(seed, FRICTION_KIND, index, "name").hex()[:16]
    return JointCase(name, robot, rate, commanded, friction, nameless, speeds, scatter, jitter, seed_of_case)


def _draw_links(rng: np.random.Generator, count: int) -> list[dict[str, float]]:
    """Draw links from those of a light leg to those of a welding robot, and rotors of up to the same inertia at the
    joint; a quarter of the drives have no gear."""
    links: list[dict[str, float]] = []
    mass = draw_log_uniform(rng, 1.0, 12.0)
    for _ in range(count):
        length = float(rng.uniform(0.2, 0.5))
        center = length * float(rng.uniform(0.3, 0.6))
        own = mass * length**2 * float(rng.uniform(0.06, 0.12))
        ratio = 1.0
        if rng.random() >= 0.25:
            ratio = _round_digits(draw_log_uniform(rng, 1.0, 100.0), 3)
        about = own + mass * center**2
        stated = {"length": length, "mass": mass, "center_of_mass": center, "inertia": own}
        stated["motor_inertia"] = about * draw_log_uniform(rng, 0.1, 1.0) / ratio**2
        links.append({**{key: _round_digits(value) for key, value in stated.items()}, "ratio": ratio})
        mass *= float(rng.uniform(0.4, 0.7))
    return links


def _draw_friction(rng: np.random.Generator, usual: float, v: np.ndarray) -> Friction:
    """Draw friction between a fifth of the ``usual`` torque of the motion and all of it, rms."""
    speed = float(np.sqrt(np.mean(v**2)))
    dry = float(rng.uniform(0.1, 0.9))
    one = Friction(dry, 1.0 - dry, float(rng.uniform(0.8, 1.2)), speed)
    size = usual * draw_log_uniform(rng, 0.2, 1.0) / float(np.sqrt(np.mean(one.torque(v) ** 2)))
    return Friction(size * dry, size * (1.0 - dry), one.exponent, speed)


def _draw_nameless_torque(rng: np.random.Generator, friction: Friction, v: np.ndarray) -> NamelessTorque:
    """Draw torque of up to a tenth of the friction, shared at random among wandering, ripple and varying friction."""
    usual = float(np.sqrt(np.mean(friction.torque(v) ** 2)))
    wander, ripple, varying = np.sqrt(rng.dirichlet([1.0, 1.0, 1.0])) * rng.uniform(0.0, LARGEST_NAMELESS_SHARE)
    order = draw_log_uniform(rng, 5.0, 120.0)
    return NamelessTorque(
        wander=float(wander) * usual,
        time=draw_log_uniform(rng, 0.1, 2.0),
        ripple=math.sqrt(2.0) * float(ripple) * usual,
        order=math.floor(order) + float(rng.uniform(0.2, 0.8)),
        phase=float(rng.uniform(-math.pi, math.pi)),
        varying=math.sqrt(2.0) * float(varying),
        waves=float(rng.uniform(1.0, 4.0)),
    )


def _draw_drive(
    rng: np.random.Generator, link: Mapping[str, float], friction: Friction, usual: float, v: np.ndarray, known: float
) -> dict[str, float]:
    """Draw a drive of the robot file: the ``known`` share of its friction, at the motor; and the noise of its input, A
    or N m, which is small beside the input that the motion needs."""
    ratio = link["ratio"]
    level, coefficient = friction.fit_linear(v)
    constant = usual / ratio / draw_log_uniform(rng, 1.0, 8.0)
    return {
        "coulomb_friction": _round_digits(known * max(level, 0.0) / ratio),
        "viscous_friction": _round_digits(known * max(coefficient, 0.0) / ratio**2),
        "torque_constant": _round_digits(constant),
        "input_noise": usual / ratio * draw_log_uniform(rng, 0.003, 0.015),
    }


def _draw_sensor(rng: np.random.Generator, encoder: str, ratio: float) -> dict[str, float]:
    """Draw an encoder at the rotor or at the joint; its counts per turn are a power of two."""
    scale = 1.0
    if encoder == "motor":
        scale = ratio
    resolution = 2.0 * math.pi / 2 ** round(math.log2(2.0 * math.pi / (scale * draw_log_uniform(rng, 5e-6, 3e-4))))
    return {"resolution": resolution, "encoder_noise": _round_digits(resolution * float(rng.uniform(0.0, 0.5)))}


def _round_digits(value: float, digits: int = 4) -> float:
    return float(f"{value:.{digits}g}")
