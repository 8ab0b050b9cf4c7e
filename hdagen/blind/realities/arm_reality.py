"""A reality: MuJoCo moves rotors and links, hand-coded drives join them, a sampled controller moves the arm.

MuJoCo has: the inertias and Coriolis torques of the links, gravity, set-valued dry friction (frictionloss), walls
(contact of two geoms), payloads (a mass at the tip), the current loop's lag (an actuator with a filter). The rest
stands in `hdagen.blind.realities.drivetrain`. Both advance by the leapfrog scheme, 40 steps a sample. MuJoCo's
semi-implicit Euler keeps speeds half a step behind angles; torques that depend on speed therefore read it half a step
ahead. An input that jumps at a sample acts with its mean of before and after in the step around it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from hdagen.blind.realities.arm_world import LARGEST_COMMAND, ArmWorld, tilt_gravity
from hdagen.blind.realities.drivetrain import Drivetrain
from hdagen.blind.realities.two_joint_motion import Motion

PERIOD = 1e-3  # s, of the controller and the log
STEPS_PER_SAMPLE = 40  # a period
ARM_STEP = PERIOD / STEPS_PER_SAMPLE
POSITION_LOOP_BANDWIDTH = 55.0  # rad/s, of the position loop
_HARDEST_IMPEDANCE = 0.9999  # MuJoCo's hardest impedance: dry friction creeps by a millionth of the speed it stops
_WALL_IMPEDANCE = 0.02  # of a wall: near 1 MuJoCo's contact has many times the arm's inertia
_BALL_RADIUS = 0.01  # m, of the ball that meets a wall


def simulate_world(
    world: ArmWorld, nominal: Sequence[Mapping[str, float]], motion: Motion, noise: int
) -> dict[str, np.ndarray]:
    """Simulate a motion.

    Args:
        world: the true arm, SI.
        nominal: base parameters of each joint that the controller believes.
        motion: reference and pushes.
        noise: seed of the sensors' noise.

    Returns:
        The log: columns (T,) of docs/guides/bring_your_log.md by name.

    """
    return _ArmSimulation(world, nominal, motion, noise).simulate_log()


def _build_model(world: ArmWorld) -> Any:
    """The MuJoCo model: rotors stand beside the arm, their reaction on the links is left out as in the robot file."""
    first, second = world.joints
    gx, gy = tilt_gravity(world)
    dry = (
        f'solreffriction="{2 * ARM_STEP} 1" solimpfriction="{_HARDEST_IMPEDANCE} {_HARDEST_IMPEDANCE} 0.001 0.5 2"'
        ' frictionloss="1e-3"'
    )
    rotors = "".join(
        f'<body><joint name="rotor{j}" axis="0 0 1" {dry}/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 {joint["motor_inertia"]!r}"/></body>'
        for j, joint in enumerate(world.joints)
    )
    walls = [_wall_xml(j, world) for j in range(2)]
    load = ""
    if payload := world.effects[1].get("payload"):
        # a body of its own: MuJoCo takes no mass from a geom where a body states its inertia
        load = (
            f'<body pos="{second["length"]!r} 0 0"><inertial pos="0 0 0" mass="{payload["mass"]!r}" '
            'diaginertia="1e-9 1e-9 1e-9"/></body>'
        )
    balls = [
        f'<geom name="ball{j}" type="sphere" size="{_BALL_RADIUS}" pos="{joint["length"]!r} 0 0" mass="0"/>'
        for j, joint in enumerate(world.joints)
    ]
    pairs = "".join(
        f'<pair geom1="ball{j}" geom2="wall{j}" condim="1" solimp="{_WALL_IMPEDANCE} {_WALL_IMPEDANCE} 0.001 0.5 2"/>'
        for j in range(2)
        if walls[j]
    )
    actuators = "".join(_actuator_xml(j, world) for j in range(2))
    return mujoco.MjModel.from_xml_string(f"""<mujoco>
        <option timestep="{ARM_STEP}" integrator="Euler" gravity="{gx!r} {gy!r} 0" solver="Newton" tolerance="1e-12">
          <flag eulerdamp="disable"/></option>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody>{rotors}{walls[0]}
          <body><joint name="joint0" axis="0 0 1"/>{_inertial_xml(first)}{balls[0]}{walls[1]}
            <body pos="{first["length"]!r} 0 0"><joint name="joint1" axis="0 0 1"/>
              {_inertial_xml(second)}{balls[1]}{load}
            </body></body></worldbody>
        <contact>{pairs}</contact><actuator>{actuators}</actuator></mujoco>""")


def _inertial_xml(joint: Mapping[str, float]) -> str:
    own = joint["inertia"]
    inertia = f'mass="{joint["mass"]!r}" diaginertia="{own!r} {own!r} {own!r}"'
    return f'<inertial pos="{joint["center_of_mass"]!r} 0 0" {inertia}/>'


def _actuator_xml(j: int, world: ArmWorld) -> str:
    """The motor of joint ``j``, which filters its current where the current loop lags."""
    dynamics = 'dyntype="none"'
    if lag := world.effects[j].get("current_loop_lag"):
        dynamics = f'dyntype="filterexact" dynprm="{lag["time"]!r}"'
    return f'<general joint="rotor{j}" gainprm="1" biastype="none" {dynamics}/>'


def _wall_xml(j: int, world: ArmWorld) -> str:
    """A box that the ball at the end of link ``j`` touches when the joint stands at the wall's angle; empty without a
    wall."""
    if "contact" not in world.effects[j]:
        return ""
    p, length = world.effects[j]["contact"], world.joints[j]["length"]
    half, away = 0.2, p["side"] * (_BALL_RADIUS + 0.2)
    axis = 0.0  # place of the joint on the body that carries the wall
    if j:
        axis = world.joints[0]["length"]
    x = axis + length * math.cos(p["angle"]) - away * math.sin(p["angle"])
    y = length * math.sin(p["angle"]) + away * math.cos(p["angle"])
    turn = f"{math.cos(p['angle'] / 2)!r} 0 0 {math.sin(p['angle'] / 2)!r}"
    return f'<geom name="wall{j}" type="box" size="{half} {half} {half}" pos="{x!r} {y!r} 0" quat="{turn}"/>'


class _ArmSimulation:
    """One simulation: MuJoCo's state, both drives, the controller, and the rows so far."""

    def __init__(self, world: ArmWorld, nominal: Sequence[Mapping[str, float]], motion: Motion, noise: int) -> None:
        self.world, self.nominal, self.motion = world, nominal, motion
        self.rng = np.random.default_rng(noise)
        self.model = _build_model(world)
        self._stiffen_walls()
        self.data = mujoco.MjData(self.model)
        self.drives = [
            Drivetrain(joint, effects, ARM_STEP) for joint, effects in zip(world.joints, world.effects, strict=True)
        ]
        self.model.actuator_gainprm[:, 0] = [drive.torque_constant for drive in self.drives]
        self.delays = [effects.get("command_delay", {}).get("time", 0.0) for effects in world.effects]
        self.limits = [effects.get("current_saturation", {}).get("limit", math.inf) for effects in world.effects]
        self.lagging = ["current_loop_lag" in effects for effects in world.effects]
        late = [effects.get("sensor_delay", {}).get("time", 0.0) / ARM_STEP for effects in world.effects]
        self.late = late
        self.seen: list[deque[float]] = [deque(maxlen=int(steps) + 2) for steps in late]
        rows = 4 + max(int(delay / PERIOD) for delay in self.delays)
        self.commands: deque[list[float]] = deque([[0.0, 0.0]] * rows, maxlen=rows)  # newest first, A
        self.speed = [0.0, 0.0]  # rad/s, of the motors as the controller sees it
        self.encoder: list[float] | None = None
        self.ahead = [0.0] * 4  # speeds of the step before the last
        self._set_rest_state()

    def _stiffen_walls(self) -> None:
        """Set the walls' stiffness and damping ratio, converted to MuJoCo's contact of this impedance and weight."""
        m = self.model
        for k in range(m.npair):
            j = int(m.geom(m.pair_geom1[k]).name[-1])
            p, length = self.world.effects[j]["contact"], self.world.joints[j]["length"]
            mobility = float(m.body_invweight0[m.geom_bodyid[m.pair_geom1[k]], 0])
            mobility += float(m.body_invweight0[m.geom_bodyid[m.pair_geom2[k]], 0])
            stiffness = p["stiffness"] / length**2 * mobility * (1.0 - _WALL_IMPEDANCE)
            damping = 2.0 * p["damping"] * math.sqrt(stiffness * (1.0 - _WALL_IMPEDANCE))
            m.pair_solref[k] = (-stiffness, -damping)

    def _set_rest_state(self) -> None:
        """Start at rest at the motion's first point: springs hold the links, friction and current hold the motors."""
        q = [float(x) for x in self.motion.position[0]]
        x, v = self.data.qpos, self.data.qvel
        x[2:], v[:] = q, 0.0
        mujoco.mj_forward(self.model, self.data)
        holds = [float(self.data.qfrc_bias[2 + j]) for j in range(2)]
        holds = [hold - self.drives[j].link_torque(q[j], 0.0, q[1 - j], 0.0) for j, hold in enumerate(holds)]
        for j, drive in enumerate(self.drives):
            x[j] = drive.resting_motor_angle(q[j], holds[j])
            self.commands[0] = [*self.commands[0]]
            self.commands[0][j] = holds[j] / drive.ratio / drive.torque_constant
        for row in range(1, len(self.commands)):
            self.commands[row] = self.commands[0]
        mujoco.mj_forward(self.model, self.data)
        for j in range(2):
            if self.lagging[j]:
                self.data.act[sum(self.lagging[:j])] = self.commands[0][j]

    def simulate_log(self) -> dict[str, np.ndarray]:
        """Simulate the whole motion; return the log's columns by name."""
        rows = [self._simulate_sample(k) for k in range(len(self.motion.time))]
        columns: dict[str, np.ndarray] = {"time": self.motion.time}
        names = ("motor_current_command", "motor_current", "motor_position", "joint_position")
        table = np.array(rows)
        for j in (1, 2):
            for at, name in enumerate(names):
                columns[f"{name}_{j}"] = np.ascontiguousarray(table[:, j - 1, at])
            columns[f"joint_position_reference_{j}"] = np.ascontiguousarray(self.motion.position[:, j - 1])
        columns["tip_force_x"], columns["tip_force_y"] = (np.ascontiguousarray(f) for f in self.motion.force.T)
        return columns

    def _simulate_sample(self, k: int) -> list[tuple[float, ...]]:
        """Measure row k and simulate the period after it."""
        d = self.data
        row: list[tuple[float, float, float]] = []
        for j in (0, 1):
            current = self.commands[int(self.delays[j] / PERIOD)][j]
            if self.lagging[j]:
                current = float(d.act[sum(self.lagging[:j])])
            sensor = self.nominal[j]
            theta = _round_to_counts(float(d.qpos[j]), sensor["motor_encoder_resolution"])
            angle = _round_to_counts(self._joint_angle(j), sensor["joint_encoder_resolution"])
            row.append((current + sensor["current_noise"] * float(self.rng.standard_normal()), theta, angle))
        command = self._control_joints(k, [theta for _, theta, _ in row])
        held = [min(max(c, -limit), limit) for c, limit in zip(command, self.limits, strict=True)]
        self.commands.appendleft(held)
        for drive in self.drives:
            drive.tick(PERIOD)
        force, before = self.motion.force[k], self.motion.force[max(k - 1, 0)]
        self._advance_period(k, [float(f) for f in force], [float(f) for f in before])
        return [(c, *read) for c, read in zip(command, row, strict=True)]

    def _control_joints(self, k: int, theta: list[float]) -> list[float]:
        """Position loop on the motors' encoders, as a servo drive has it, with the gravity of the robot file."""
        before, self.encoder = self.encoder or theta, theta
        q = self.motion.position[k]
        holds = _gravity_torques(self.nominal, self.world.gravity, float(q[0]), float(q[1]))
        command = []
        for j, joint in enumerate(self.nominal):
            ratio, constant = joint["ratio"], joint["torque_constant"]
            self.speed[j] += 0.6 * ((theta[j] - before[j]) / PERIOD - self.speed[j])
            inertia = joint["motor_inertia"] + 0.05 / ratio**2
            error, rate = q[j] * ratio - theta[j], self.motion.velocity[k, j] * ratio - self.speed[j]
            wanted = (
                inertia / constant * POSITION_LOOP_BANDWIDTH * (POSITION_LOOP_BANDWIDTH * error + 1.6 * rate)
                + holds[j] / ratio / constant
            )
            command.append(min(max(float(wanted), -LARGEST_COMMAND), LARGEST_COMMAND))
        return command

    def _acting_current(self, j: int, after: float) -> float:
        """The mean current, A, over the step whose middle is ``after`` s past the last sample."""
        if self.lagging[j] and not self.delays[j]:
            return self.commands[0][j]  # MuJoCo's filter takes the newest command
        at = after - self.delays[j]
        age, low = -math.floor((at - 0.5 * ARM_STEP) / PERIOD), (at - 0.5 * ARM_STEP) % PERIOD
        old, new = self.commands[age][j], self.commands[max(age - 1, 0)][j]
        share = min(max((low + ARM_STEP - PERIOD) / ARM_STEP, 0.0), 1.0)  # of the step in which the newer command acts
        return old + share * (new - old)

    def _advance_period(self, k: int, force: list[float], before: list[float]) -> None:
        """Simulate the period after row k under ``force`` on the tip, N; ``before`` acted until row k."""
        m, d = self.model, self.data
        applied, control, loss = d.qfrc_applied, d.ctrl, m.dof_frictionloss
        position, velocity = d.qpos, d.qvel
        first, second = self.drives
        loaded = [bool(drive.cable or drive.unknown) for drive in self.drives]
        late = [j for j in (0, 1) if self.late[j]]
        pushed = any(force) or any(before)
        a1, a2, a3, a4 = self.ahead
        for n, (i1, i2) in enumerate(zip(self._step_currents(0), self._step_currents(1), strict=True)):
            theta1, theta2, q1, q2 = position.tolist()
            v1, v2, v3, v4 = velocity.tolist()
            w3, w4 = 1.5 * v3 - 0.5 * a3, 1.5 * v4 - 0.5 * a4
            motor1, level1, tau1 = first.compute_torques(theta1, 1.5 * v1 - 0.5 * a1, q1, w3)
            motor2, level2, tau2 = second.compute_torques(theta2, 1.5 * v2 - 0.5 * a2, q2, w4)
            a1, a2, a3, a4 = v1, v2, v3, v4
            for j in late:
                self.seen[j].append((q1, q2)[j])
            if loaded[0]:
                tau1 += first.link_torque(q1, w3, q2, k * PERIOD + n * ARM_STEP)
            if loaded[1]:
                tau2 += second.link_torque(q2, w4, q1, k * PERIOD + n * ARM_STEP)
            if pushed:
                fx, fy = force
                if n == 0:
                    fx, fy = (0.5 * (old + new) for old, new in zip(before, force, strict=True))
                add1, add2 = self._push_torques(fx, fy, q1, q2)
                tau1, tau2 = tau1 + add1, tau2 + add2
            applied[:] = (motor1, motor2, tau1, tau2)
            control[0], control[1] = i1, i2
            loss[0], loss[1] = level1, level2
            mujoco.mj_step(m, d)
        self.ahead = [a1, a2, a3, a4]

    def _step_currents(self, j: int) -> list[float]:
        """The current, A, in each step of a period."""
        if not self.delays[j]:
            return [self._acting_current(j, 0.0), *[self.commands[0][j]] * (STEPS_PER_SAMPLE - 1)]
        return [self._acting_current(j, n * ARM_STEP) for n in range(STEPS_PER_SAMPLE)]

    def _push_torques(self, fx: float, fy: float, q1: float, q2: float) -> tuple[float, float]:
        """Joint torques, N m, of a force on the tip, N."""
        l1, l2 = (joint["length"] for joint in self.world.joints)
        x2, y2 = l2 * math.cos(q1 + q2), l2 * math.sin(q1 + q2)
        return (x2 + l1 * math.cos(q1)) * fy - (y2 + l1 * math.sin(q1)) * fx, x2 * fy - y2 * fx

    def _joint_angle(self, j: int) -> float:
        """The angle that the joint's encoder shows, rad: late, off its centre, zero at the home position."""
        q, seen, late = float(self.data.qpos[2 + j]), self.seen[j], self.late[j]
        if late and len(seen) > late:
            path = [*seen, q]
            whole = int(late)
            q = path[-1 - whole] + (late - whole) * (path[-2 - whole] - path[-1 - whole])
        p = self.world.effects[j].get("encoder_eccentricity")
        if not p:
            return q
        return q + _eccentricity_error(p, q) - _eccentricity_error(p, 0.0)


def _eccentricity_error(p: Mapping[str, float], q: float) -> float:
    """Error of a disc off its centre, rad, from the exact triangle."""
    angle = q + p["phase"]
    return math.atan2(p["share"] * math.sin(angle), 1.0 + p["share"] * math.cos(angle))


def _round_to_counts(angle: float, resolution: float) -> float:
    return round(angle / resolution) * resolution


def _gravity_torques(
    joints: Sequence[Mapping[str, float]], gravity: tuple[float, float], q1: float, q2: float
) -> tuple[float, float]:
    """Torques, N m, that hold the links of the robot file, written out for two joints."""
    first, second = joints
    gx, gy = gravity
    own = second["mass"] * second["center_of_mass"]
    outer = -own * (gy * math.cos(q1 + q2) - gx * math.sin(q1 + q2))
    carried = first["mass"] * first["center_of_mass"] + second["mass"] * first["length"]
    return outer - carried * (gy * math.cos(q1) - gx * math.sin(q1)), outer
