"""A reality of rigid joints: MuJoCo moves the links, its dry friction holds them, a sampled controller drives them.

MuJoCo has: inertias and Coriolis torques of the links, rotors (armature), gravity, set-valued dry friction. Friction
that grows with speed and torque without a name are applied to the joints. Both advance by the leapfrog scheme, as in
`hdagen.blind.realities.arm_reality`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from hdagen.blind.realities.joint_motion import PERIOD, JointMotion, compute_link_torques
from hdagen.blind.realities.random_streams import seeded_generator
from hdagen.blind.realities.rigid_joints import CONTROLLER_RATE, JointCase, NamelessTorque

STEPS_PER_PERIOD = 5  # per PERIOD
JOINT_STEP = PERIOD / STEPS_PER_PERIOD
_LARGEST_BANDWIDTH, _BANDWIDTH_SHARE = (
    30.0,
    0.25,
)  # largest bandwidth of the position loop: rad/s, and share of the loop's rate, Hz
_LOOP_DAMPING = 0.8  # damping ratio of the position loop
_SPEED_FILTER_RATIO = 4.0  # cutoff of the speed filter, in multiples of the bandwidth
_HARDEST_IMPEDANCE = 0.9999  # MuJoCo's hardest impedance


def make_joint_log(case: JointCase, which: str, seconds: float) -> dict[str, np.ndarray]:
    """Simulate a motion of a case.

    Args:
        case: the drawn case.
        which: "log" or "hold_out".
        seconds: length of the motion, s.

    Returns:
        The log: columns (T,) of docs/guides/bring_your_log.md by name.

    """
    motion = case.draw_motion(which, seconds)
    return _JointSimulation(case, motion, seeded_generator(str(case.seed), "noise", which)).simulate_log()


def _build_model(case: JointCase, joints: Sequence[Mapping[str, float]]) -> Any:
    """The MuJoCo model of the true links."""
    dry = (
        f'solreffriction="{2 * JOINT_STEP} 1" solimpfriction="{_HARDEST_IMPEDANCE} {_HARDEST_IMPEDANCE} 0.001 0.5 2"'
        ' frictionloss="1e-3"'
    )
    at, bodies = 0.0, []
    for j, joint in enumerate(joints):
        own, rotor = joint["inertia"], joint["motor_inertia"] * joint["ratio"] ** 2
        bodies.append(
            f'<body pos="{at!r} 0 0"><joint name="joint{j}" axis="0 0 1" armature="{rotor!r}" {dry}/>'
            f'<inertial pos="{joint["center_of_mass"]!r} 0 0" mass="{joint["mass"]!r}" '
            f'diaginertia="{own!r} {own!r} {own!r}"/>'
        )
        at = joint["length"]
    body = "".join(bodies) + "</body>" * len(bodies)
    gx, gy = case.robot.gravity
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <option timestep="{JOINT_STEP}" integrator="Euler" gravity="{gx!r} {gy!r} 0" solver="Newton" tolerance="1e-12">
          <flag eulerdamp="disable"/></option>
        <worldbody>{body}</worldbody></mujoco>"""
    )


def draw_wandering_torque(rng: np.random.Generator, nameless: NamelessTorque, count: int) -> np.ndarray:
    """Draw a random torque of the stated rms and correlation time.

    Args:
        rng: the random generator.
        nameless: states the rms, N m, and the correlation time, s.
        count: how many PERIODs.

    Returns:
        The torque in each PERIOD (count,), N m.

    """
    keep = math.exp(-PERIOD / nameless.time)
    kicks = rng.standard_normal(count)
    values, value = np.empty(count), float(rng.standard_normal())
    for k, kick in enumerate(kicks.tolist()):
        values[k] = value
        value = keep * value + math.sqrt(1.0 - keep * keep) * kick
    return nameless.wander * values


def _input_gains(case: JointCase, joints: Sequence[Mapping[str, float]]) -> list[float]:
    """Torque at each joint per unit of its input, N m/A or 1."""
    if case.robot.current:
        return [joint["ratio"] * joint["torque_constant"] for joint in joints]
    return [joint["ratio"] for joint in joints]


class _JointSimulation:
    """One simulation: MuJoCo's state, the controller, and the rows so far."""

    def __init__(self, case: JointCase, motion: JointMotion, rng: np.random.Generator) -> None:
        self.case, self.motion, self.rng = case, motion, rng
        nominal = case.robot.joints
        self.true = case.true_joints()
        self.every = 1000 // case.rate  # PERIODs per row
        self.hold = 1000 // CONTROLLER_RATE  # PERIODs for which a command is held
        if case.commanded:
            self.hold = self.every
        self.model = _build_model(case, self.true)
        self.data = mujoco.MjData(self.model)
        self.wander = np.column_stack([draw_wandering_torque(rng, one, len(motion.time)) for one in case.nameless])
        self.ahead = compute_link_torques(
            nominal, case.robot.gravity, motion.position, motion.velocity, motion.acceleration
        )
        frequency = 1000.0 / self.hold
        self.bandwidth = min(_LARGEST_BANDWIDTH, _BANDWIDTH_SHARE * frequency)
        at_rest, still = np.zeros((1, len(nominal))), np.eye(len(nominal))
        self.inertia = [
            float(compute_link_torques(nominal, (0.0, 0.0), at_rest, at_rest, still[j : j + 1])[0, j])
            for j in range(len(nominal))
        ]
        self.filter = 1.0 - math.exp(-_SPEED_FILTER_RATIO * self.bandwidth / frequency)
        self.scale = [1.0] * len(nominal)  # angle at the encoder per angle of the joint
        if case.robot.encoder == "motor":
            self.scale = [joint["ratio"] for joint in nominal]
        self.gain, self.gain_known = _input_gains(case, self.true), _input_gains(case, nominal)
        self.speed = [0.0] * len(nominal)
        self.seen: list[float] | None = None
        self.input = [float(t) / g for t, g in zip(self.ahead[0], self.gain_known, strict=True)]
        self.before = [0.0] * len(nominal)

    def simulate_log(self) -> dict[str, np.ndarray]:
        """Simulate the whole motion; return the log's columns by name."""
        case, rows = self.case, []
        for k in range(len(self.motion.time)):
            acted, read = list(self.input), self._read_encoders()
            if k % self.hold == 0:
                self._control_joints(k, read)
            if k % self.every == 0:
                noise = [j["input_noise"] * float(self.rng.standard_normal()) for j in case.robot.joints]
                rows.append([list(self.input), [a + n for a, n in zip(acted, noise, strict=True)], read])
            self._advance_period(k, acted)
        table = np.array(rows)
        quantity = ("motor_torque", "motor_current")[case.robot.current]
        names = [f"{quantity}_command", quantity, f"{case.robot.encoder}_position"]
        jitter = self.rng.uniform(-case.jitter, case.jitter, len(rows))
        columns: dict[str, np.ndarray] = {"time": np.arange(len(rows)) / case.rate + jitter}
        for j in range(len(case.robot.joints)):
            for at, name in enumerate(names):
                if at or case.commanded:
                    columns[f"{name}_{j + 1}"] = np.ascontiguousarray(table[:, at, j])
        return columns

    def _read_encoders(self) -> list[float]:
        """Read the encoders, rad."""
        read = []
        for j, joint in enumerate(self.case.robot.joints):
            angle = float(self.data.qpos[j]) * self.scale[j] + joint["encoder_noise"] * float(
                self.rng.standard_normal()
            )
            read.append(round(angle / joint["resolution"]) * joint["resolution"])
        return read

    def _control_joints(self, k: int, read: list[float]) -> None:
        """Set the input: the torque of the robot file's links along the reference, and a position loop on encoders."""
        seen, self.seen = self.seen or read, read
        for j, scale in enumerate(self.scale):
            rate = (read[j] - seen[j]) / scale / (self.hold * PERIOD)
            self.speed[j] += self.filter * (rate - self.speed[j])
            error = float(self.motion.position[k, j]) - read[j] / scale
            slip = float(self.motion.velocity[k, j]) - self.speed[j]
            wanted = self.bandwidth * (self.bandwidth * error + 2.0 * _LOOP_DAMPING * slip)
            self.input[j] = (float(self.ahead[k, j]) + self.inertia[j] * wanted) / self.gain_known[j]

    def _advance_period(self, k: int, acted: list[float]) -> None:
        """Simulate a PERIOD; in its first step an input that jumps has the mean of before and after."""
        m, d = self.model, self.data
        drive = [i * g for i, g in zip(self.input, self.gain, strict=True)]
        first = [0.5 * (i * g + new) for i, g, new in zip(acted, self.gain, drive, strict=True)]
        wander = self.wander[k].tolist()
        for n in range(STEPS_PER_PERIOD):
            torques = drive if n else first
            angles, speeds = d.qpos.tolist(), d.qvel.tolist()
            for j, (friction, nameless) in enumerate(zip(self.case.friction, self.case.nameless, strict=True)):
                q, v = angles[j], 1.5 * speeds[j] - 0.5 * self.before[j]
                level = 1.0 + nameless.varying * math.sin(nameless.waves * q + nameless.phase)
                grown = friction.viscous * (abs(v) / friction.speed) ** friction.exponent
                without_name = wander[j] + nameless.ripple * math.sin(nameless.order * q + nameless.phase)
                d.qfrc_applied[j] = torques[j] - math.copysign(level * grown, v) + without_name
                m.dof_frictionloss[j] = level * friction.coulomb
            self.before = speeds
            mujoco.mj_step(m, d)
