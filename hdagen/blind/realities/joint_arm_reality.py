"""The reality of the family "joint": MuJoCo moves links and rotors, a sampled controller drives them by effort.

MuJoCo has: links in gravity, armatures, payloads, and set-valued dry friction. Springs, walls, cables and the friction
that moves are applied to the joints. A joint with a spring, stated or missing, has a rotor that stands beside the arm;
a rigid one has an armature. The scheme is that of `hdagen.blind.realities.joint_reality`, with steps half as long.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from hdagen.blind.realities.arm_world import ArmWorld, tilt_gravity
from hdagen.blind.realities.joint_arms import CHAIN_GRAVITY, JointArmCase
from hdagen.blind.realities.joint_effects import UNKNOWN_JOINT_KINDS
from hdagen.blind.realities.joint_motion import PERIOD, compute_link_torques
from hdagen.blind.realities.log_noise import choose_kept_rows, color_noise
from hdagen.blind.realities.random_streams import seeded_generator
from hdagen.blind.realities.rigid_joints import CONTROLLER_RATE, SERIES_SPRING_KEYS

CHAIN_STEPS = 10
CHAIN_STEP = PERIOD / CHAIN_STEPS  # s
JointEffects = Mapping[tuple[str, int], Mapping[str, float]]  # parameters by effect and joint
_ARMATURE_RATIO = 2.0  # largest inertia that a loop counts on by the armature, where a spring yields
_EFFORT_BANDWIDTH, _EFFORT_BANDWIDTH_SHARE = (
    20.0,
    0.08,
)  # largest of the position loop, rad/s, and share of the loop's rate, Hz
_EFFORT_DAMPING = 0.9
_FILTER_RATIO = 4.0  # cutoff of the speed's filter by the bandwidth
_LARGEST_STAMP_ERROR = 80e-6  # s, error of a stamp
_CREEP_SPEED = 1e-3  # share of a joint's speed at which one-sided friction has half its torque
_SNAP_SECONDS = 0.03  # s, in which a spring snaps over
_HARDEST_IMPEDANCE = 0.9999  # MuJoCo's hardest impedance


def simulate_chain(case: JointArmCase, which: str, seconds: float, effects: JointEffects) -> dict[str, np.ndarray]:
    """Simulate a motion of a case.

    Args:
        case: the drawn case.
        which: "log" or "hold_out".
        seconds: length of the motion, s.
        effects: parameters by effect and joint (from 1; 0 is the whole arm).

    Returns:
        The log: columns (T,) of docs/guides/bring_your_log.md by name.

    """
    rng = seeded_generator(str(case.seed), "noise", which)
    commands, efforts, angles = ChainSimulation(case, which, seconds, effects).simulate_rows()
    count, nominal = len(efforts), case.machine.joints
    columns = {"time": np.arange(count) / case.rate + rng.uniform(-_LARGEST_STAMP_ERROR, _LARGEST_STAMP_ERROR, count)}
    for j, joint in enumerate(nominal):
        if case.commanded:
            columns[f"motor_torque_command_{j + 1}"] = commands[:, j]
        columns[f"motor_torque_{j + 1}"] = efforts[:, j] + joint["input_noise"] * color_noise(rng, count)
        read = angles[:, j] + joint["encoder_noise"] * rng.standard_normal(count)
        columns[f"{case.robot.encoder}_position_{j + 1}"] = np.round(read / joint["resolution"]) * joint["resolution"]
    kept = choose_kept_rows(rng, count)
    return {name: np.ascontiguousarray(column[kept]) for name, column in columns.items()}


def _build_model(joints: Sequence[Mapping[str, float]], load: float, gravity: tuple[float, float],
                 soft: Sequence[bool]) -> Any:  # fmt: skip
    """The MuJoCo model: links first, then the rotors of joints with springs; a degree of freedom each."""
    dry = (
        f'solreffriction="{2 * CHAIN_STEP} 1" solimpfriction="{_HARDEST_IMPEDANCE} {_HARDEST_IMPEDANCE} 0.001 0.5 2"'
        ' frictionloss="1e-3"'
    )
    chain, rotors, at = [], [], 0.0
    for j, joint in enumerate(joints):
        own, armature = joint["inertia"], joint["motor_inertia"]
        drive = f'armature="{armature!r}" {dry}'
        if soft[j]:
            drive = ""
            rotors.append(
                f'<body><joint name="rotor{j}" axis="0 0 1" {dry}/>'
                f'<inertial pos="0 0 0" mass="1" diaginertia="{armature!r} {armature!r} {armature!r}"/></body>'
            )
        chain.append(
            f'<body pos="{at!r} 0 0"><joint name="joint{j}" axis="0 0 1" {drive}/>'
            f'<inertial pos="{joint["center_of_mass"]!r} 0 0" mass="{joint["mass"]!r}" '
            f'diaginertia="{own!r} {own!r} {own!r}"/>'
        )
        at = joint["length"]
    tip = ""
    if load:
        tip = f'<body pos="{at!r} 0 0"><inertial pos="0 0 0" mass="{load!r}" diaginertia="1e-9 1e-9 1e-9"/></body>'
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <option timestep="{CHAIN_STEP}" integrator="Euler" gravity="{gravity[0]!r} {gravity[1]!r} 0" solver="Newton"
          tolerance="1e-12"><flag eulerdamp="disable"/></option>
        <worldbody>{"".join(chain)}{tip}{"</body>" * len(chain)}{"".join(rotors)}</worldbody></mujoco>"""
    )


class ChainJoint:
    """One joint of the chain: its spring, its friction, and what pulls at its link.

    ``joint``: true base parameters, SI; ``effects``: parameters by effect; ``usual_speed``: rad/s.
    """

    def __init__(
        self, joint: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], usual_speed: float
    ) -> None:
        self.effects, self.usual_speed = effects, usual_speed
        self.level = joint["coulomb_friction"] + effects.get("coulomb_friction", {}).get("torque", 0.0)
        self.viscous = joint["viscous_friction"] + effects.get("viscous_friction", {}).get("coefficient", 0.0)
        self.stiffness, self.stiffening, self.damping = 0.0, 0.0, 0.0
        if SERIES_SPRING_KEYS[0] in joint:
            self.stiffness = joint[SERIES_SPRING_KEYS[0]] * effects.get("stiffness", {}).get("factor", 1.0)
            self.stiffening, self.damping = joint[SERIES_SPRING_KEYS[1]], joint["torsional_damping"]
        elif missing := effects.get("missing_compliance"):
            self.stiffness = 1.0 / missing["compliance"]
            link = joint["inertia"] + joint["mass"] * joint["center_of_mass"] ** 2
            self.damping = 2.0 * missing["damping_ratio"] * math.sqrt(self.stiffness * link)
        self.one_sided = effects.get("asymmetric_friction", {}).get("torque", 0.0)
        self.bias = effects.get("current_bias", {}).get("torque", 0.0)
        self.load = effects.get("load_dependent_friction", {}).get("share", 0.0)
        self.delay = effects.get("command_delay", {}).get("time", 0.0)
        self.stribeck, self.ripple = effects.get("stribeck_friction"), effects.get("torque_ripple")
        self.side = self.memory = 0.0  # of a spring that snaps over: where it goes, where it is

    def spring_torque(self, torsion: float, rate: float) -> float:
        """Compute the torque of the spring, N m.

        Args:
            torsion: rad.
            rate: its rate, rad/s.

        Returns:
            Joint torque of spring and damper.

        """
        if not self.stiffening:
            return self.stiffness * torsion + self.damping * rate
        bent = min(max(self.stiffening * self.stiffness * torsion, -1.5), 1.5)
        return math.tan(bent) / self.stiffening + self.damping * rate

    def rest_torsion(self, torque: float) -> float:
        """Compute the torsion at which the spring carries a torque, rad."""
        if not self.stiffening:
            return torque / self.stiffness
        return math.atan(self.stiffening * torque) / (self.stiffening * self.stiffness)

    def drive_torques(self, theta: float, omega: float, carried: float) -> tuple[float, float]:
        """Compute what acts at the drive beside its input.

        Args:
            theta: angle of the drive, rad.
            omega: its speed, rad/s.
            carried: torque that it transmits, N m.

        Returns:
            Torque and level of dry friction, N m.

        """
        level = self.level + self.load * abs(carried)
        if self.stribeck:
            level += self.stribeck["torque"] * math.exp(-abs(omega) / self.stribeck["speed"])
        torque = self.bias - self.viscous * omega
        if self.one_sided:
            torque -= self.one_sided * abs(omega) / (abs(omega) + _CREEP_SPEED * self.usual_speed)
        if self.ripple:
            torque += self.ripple["torque"] * math.sin(self.ripple["order"] * theta + self.ripple["phase"])
        return torque, max(level, 0.0)

    def link_torque(self, q: float, v: float, time: float) -> float:
        """Compute what pulls at the link: cable, wall and unknown torque.

        Args:
            q: joint angle, rad.
            v: joint speed, rad/s.
            time: since the start, s.

        Returns:
            Torque at the joint, N m.

        """
        total = 0.0
        if cable := self.effects.get("cable_spring"):
            total -= cable["stiffness"] * math.sin(0.7 * (q - cable["rest"])) / 0.7
        if wall := self.effects.get("contact"):
            deep = wall["side"] * (q - wall["angle"])
            if deep > 0.0:
                total -= wall["side"] * wall["stiffness"] * deep * max(1.0 + wall["damping"] * wall["side"] * v, 0.0)
        if unknown := self.effects.get("unknown"):
            total += self._unknown_torque(unknown, q, v, time)
        return total

    def _unknown_torque(self, p: Mapping[str, float], q: float, v: float, time: float) -> float:
        kind, size = UNKNOWN_JOINT_KINDS[int(p["kind"])], p["torque"]
        if kind == "beat":
            beat = math.sin(2.0 * math.pi * 0.17 * p["frequency"] * time)
            return 1.4 * size * beat * math.sin(2.0 * math.pi * p["frequency"] * time + p["phase"])
        if kind == "detent":
            turn = p["order"] * q + p["phase"]
            return size * math.sin(turn + 0.6 * math.sin(turn)) * (1.0 + 0.5 * math.cos(2.0 * q))
        if kind == "product":
            return size * v / self.usual_speed * math.sin(3.0 * q + p["phase"])
        if abs(q) > p["play"]:
            self.side = math.copysign(1.0, q)
        self.memory += (self.side - self.memory) * CHAIN_STEP / _SNAP_SECONDS
        return size * self.memory


class ChainSimulation:
    """One simulation: MuJoCo's state, the drives, the controller, and the rows so far, without noise."""

    def __init__(self, case: JointArmCase, which: str, seconds: float, effects: JointEffects) -> None:
        self.case, self.motion = case, case.draw_motion(which, seconds)
        true, nominal = case.true_joints(), case.machine.joints
        count = len(true)
        own = [{name: p for (name, at), p in effects.items() if at == j} for j in range(count + 1)]
        usual = np.sqrt(np.mean(self.motion.velocity**2, axis=0)).tolist()
        self.joints = [ChainJoint(joint, own[j + 1], usual[j]) for j, joint in enumerate(true)]
        soft = [joint.stiffness > 0.0 for joint in self.joints]
        load = own[count].get("payload", {}).get("mass", 0.0)
        self.model = _build_model(true, load, tilt_gravity(ArmWorld(true, own[1:], own[0], CHAIN_GRAVITY)), soft)
        self.data = mujoco.MjData(self.model)
        self.drive_dof = [count + sum(soft[:j]) if soft[j] else j for j in range(count)]
        self.soft = soft
        self.every = 1000 // case.rate  # PERIODs per row
        self.hold = self.every if case.commanded else 1000 // CONTROLLER_RATE
        self.ahead = compute_link_torques(
            nominal, CHAIN_GRAVITY, self.motion.position, self.motion.velocity, self.motion.acceleration
        )
        still, unit = np.zeros((1, count)), np.eye(count)
        mass = np.vstack(
            [compute_link_torques(nominal, (0.0, 0.0), still, still, unit[j : j + 1])[0] for j in range(count)]
        )
        free = (1.0 / np.diagonal(np.linalg.inv(mass))).tolist()  # inertia of a joint while the others are free
        armatures = [joint["motor_inertia"] for joint in nominal]
        self.inertia = [
            min(whole, _ARMATURE_RATIO * own) if yields else whole
            for whole, own, yields in zip(free, armatures, soft, strict=True)
        ]
        frequency = 1000.0 / self.hold
        self.bandwidth = min(_EFFORT_BANDWIDTH, _EFFORT_BANDWIDTH_SHARE * frequency)
        self.filter = 1.0 - math.exp(-_FILTER_RATIO * self.bandwidth / frequency)
        self._set_rest_state()

    def _set_rest_state(self) -> None:
        """Start at rest at the motion's first point, held by effort and springs."""
        m, d = self.model, self.data
        mujoco.mj_forward(m, d)
        holds = [float(d.qfrc_bias[j]) - joint.link_torque(0.0, 0.0, 0.0) for j, joint in enumerate(self.joints)]
        for j, joint in enumerate(self.joints):
            if self.soft[j]:
                d.qpos[self.drive_dof[j]] = joint.rest_torsion(holds[j])
        ahead = math.ceil(max(joint.delay for joint in self.joints) / CHAIN_STEP) + 1
        self.inputs = [deque([hold] * (ahead + 1), maxlen=ahead + 1) for hold in holds]  # the newest first, a step each
        self.command, self.speed = list(holds), [0.0] * len(holds)
        self.offset = [h - float(a) for h, a in zip(holds, self.ahead[0], strict=True)]
        self.start = self._read_angles()
        self.seen = list(self.start)
        self.before = [0.0] * m.nv

    def _read_angles(self) -> list[float]:
        """The angles, rad, at the encoders: of the rotor, or of the joint."""
        if self.case.robot.encoder == "motor":
            return [float(self.data.qpos[dof]) for dof in self.drive_dof]
        return [float(self.data.qpos[j]) for j in range(len(self.joints))]

    def simulate_rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Simulate the whole motion.

        Returns:
            Commands, efforts, N m, and angles, rad, each (T, J), without noise.

        """
        rows = []
        for k in range(len(self.motion.time)):
            read, acted = self._read_angles(), [self._acting_input(j) for j in range(len(self.joints))]
            if k % self.hold == 0:
                self._control_joints(k, read)
            if k % self.every == 0:
                rows.append((list(self.command), acted, read))
            for n in range(CHAIN_STEPS):
                self._advance_step(k * PERIOD + n * CHAIN_STEP)
        commands, efforts, angles = (np.array(column) for column in zip(*rows, strict=True))
        return commands, efforts, angles

    def _acting_input(self, j: int) -> float:
        """The effort, N m, that acted in the last step."""
        return self.inputs[j][round(self.joints[j].delay / CHAIN_STEP)]

    def _control_joints(self, k: int, read: Sequence[float]) -> None:
        """The file's torque along the reference, and a position loop on the encoders."""
        for j, angle in enumerate(read):
            rate = (angle - self.seen[j]) / (self.hold * PERIOD)
            self.seen[j] = angle
            self.speed[j] += self.filter * (rate - self.speed[j])
            error = float(self.motion.position[k, j]) - (angle - self.start[j])
            slip = float(self.motion.velocity[k, j]) - self.speed[j]
            wanted = self.bandwidth * (self.bandwidth * error + 2.0 * _EFFORT_DAMPING * slip)
            self.command[j] = float(self.ahead[k, j]) + self.offset[j] + self.inertia[j] * wanted

    def _advance_step(self, time: float) -> None:
        """Advance by a step; an input that jumps has the mean of before and after in its first one."""
        m, d = self.model, self.data
        angles, speeds = d.qpos.tolist(), d.qvel.tolist()
        ahead = [1.5 * now - 0.5 * old for now, old in zip(speeds, self.before, strict=True)]
        self.before = speeds
        for j, (joint, dof) in enumerate(zip(self.joints, self.drive_dof, strict=True)):
            acted = self._acting_input(j)
            self.inputs[j].appendleft(self.command[j])
            effort = 0.5 * (acted + self._acting_input(j))
            carried = joint.spring_torque(angles[dof] - angles[j], ahead[dof] - ahead[j]) if self.soft[j] else effort
            own, level = joint.drive_torques(angles[dof], ahead[dof], carried)
            pull = joint.link_torque(angles[j], ahead[j], time)
            m.dof_frictionloss[dof] = level
            if self.soft[j]:
                d.qfrc_applied[dof], d.qfrc_applied[j] = effort + own - carried, carried + pull
            else:
                d.qfrc_applied[j] = effort + own + pull
        mujoco.mj_step(m, d)
