"""The reality of the family "maxwell": its own integrator, links, drives, controller and sensors, in plain Python.

- The links move by Lagrange's equations in absolute angles, α = q₁ and β = q₁ + q₂.
- Every 20 µs Moreau's midpoint rule: half a step of the angles, all forces there, an impulse of set-valued friction,
  which stops a motor exactly where its bounds allow, and the other half of the angles.
- A PID loop inside the drive follows the reference by the motor's own encoder; it knows no gravity.
- Currents have coloured noise, stamps are off, and rows are lost, as on a bus.

Source: Moreau, Comput. Methods Appl. Mech. Eng. 177 (1999) 329, equations 4.1 to 4.5 (the midpoint rule with impulses).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from hdagen.blind.realities.arm_world import LARGEST_COMMAND, ArmWorld, tilt_gravity
from hdagen.blind.realities.log_noise import choose_kept_rows, color_noise
from hdagen.blind.realities.maxwell_drive import MaxwellDrive
from hdagen.blind.realities.two_joint_motion import PERIOD, Motion

MAXWELL_STEPS = 50
MAXWELL_STEP = PERIOD / MAXWELL_STEPS  # s
_DRIVE_BANDWIDTH = 45.0  # rad/s, of the position loop
_INTEGRAL_RATE = 6.0  # 1/s
_TUNED_INERTIA = 0.06  # kg m², that the drive was tuned for
_SPEED_FILTER = 0.5  # share of a new speed that the drive takes
_OVERCENTER_SECONDS = 0.02  # s, in which a spring snaps over
_LARGEST_BUS_JITTER = 30e-6  # s, error of a stamp


def simulate_arm(
    world: ArmWorld, nominal: Sequence[Mapping[str, float]], motion: Motion, noise: int
) -> dict[str, np.ndarray]:
    """Simulate a motion.

    Args:
        world: the true arm, SI.
        nominal: base parameters of each joint that the drive was tuned with.
        motion: reference and pushes.
        noise: seed of the noise, the jitter and the lost rows.

    Returns:
        The log: columns (T,) of docs/guides/bring_your_log.md by name.

    Source: Moreau, Comput. Methods Appl. Mech. Eng. 177 (1999) 329, equations 4.1 to 4.5.

    """
    rng = np.random.default_rng([noise, 5])
    columns = MaxwellSimulation(world, nominal, motion).simulate_rows()
    count = len(motion.time)
    for j, joint in enumerate(nominal, 1):
        columns[f"motor_current_{j}"] += joint["current_noise"] * color_noise(rng, count)
        for name in ("motor", "joint"):
            step = joint[f"{name}_encoder_resolution"]
            columns[f"{name}_position_{j}"] = np.round(columns[f"{name}_position_{j}"] / step) * step
    columns["time"] = motion.time + rng.uniform(-_LARGEST_BUS_JITTER, _LARGEST_BUS_JITTER, count)
    kept = choose_kept_rows(rng, count)
    return {name: np.ascontiguousarray(column[kept]) for name, column in columns.items()}


class MaxwellSimulation:
    """One simulation: the state of links, motors and drives, and the rows so far, without noise."""

    def __init__(self, world: ArmWorld, nominal: Sequence[Mapping[str, float]], motion: Motion) -> None:
        self.world, self.motion = world, motion
        self.drives = [MaxwellDrive(j, e, MAXWELL_STEP) for j, e in zip(world.joints, world.effects, strict=True)]
        first, second = world.joints
        load = world.effects[1].get("payload", {}).get("mass", 0.0)
        self.lengths = first["length"], second["length"]
        self.moments = (  # kg m, that gravity pulls at in α and in β
            first["mass"] * first["center_of_mass"] + (second["mass"] + load) * first["length"],
            second["mass"] * second["center_of_mass"] + load * second["length"],
        )
        outer = (second["mass"] + load) * first["length"] ** 2
        self.inertias = (
            first["inertia"] + first["mass"] * first["center_of_mass"] ** 2 + outer,
            second["inertia"] + second["mass"] * second["center_of_mass"] ** 2 + load * second["length"] ** 2,
        )
        self.coupling = first["length"] * self.moments[1]
        self.gravity = tilt_gravity(world)
        self.walls = [e.get("contact") for e in world.effects]
        self.unknown = [e.get("unknown") for e in world.effects]
        self.cables = any("cable_spring" in e for e in world.effects)
        self.side, self.memory = [0.0, 0.0], [0.0, 0.0]  # of springs that snap over: where they go, where they are
        self._tune_drives(nominal)
        self._set_rest_state()

    def _tune_drives(self, nominal: Sequence[Mapping[str, float]]) -> None:
        """The gains of the PID loops in A/rad, A s/rad and A/(rad s), of the motor's angle."""
        self.ratios = [joint["ratio"] for joint in nominal]
        self.gains = []
        for joint in nominal:
            inertia = joint["motor_inertia"] + _TUNED_INERTIA / joint["ratio"] ** 2
            stiff = inertia * _DRIVE_BANDWIDTH**2 / joint["torque_constant"]
            self.gains.append((stiff, 1.7 * stiff / _DRIVE_BANDWIDTH, _INTEGRAL_RATE * stiff))
        effects = self.world.effects
        self.limits = [e.get("current_saturation", {}).get("limit", math.inf) for e in effects]
        self.delays = [e.get("command_delay", {}).get("time", 0.0) / MAXWELL_STEP for e in effects]
        self.lags = [e.get("current_loop_lag", {}).get("time", 0.0) for e in effects]
        self.late = [e.get("sensor_delay", {}).get("time", 0.0) / MAXWELL_STEP for e in effects]

    def _set_rest_state(self) -> None:
        """Start at rest at the motion's first point, held by currents and springs."""
        q = [float(x) for x in self.motion.position[0]]
        self.q, self.v, self.omega = q, [0.0, 0.0], [0.0, 0.0]
        pulls = self.gravity_torques(q[0], q[0] + q[1])
        holds = [-(pulls[0] + pulls[1]), -pulls[1]]
        holds = [
            hold - drive.cable_torque(q[j]) for j, (hold, drive) in enumerate(zip(holds, self.drives, strict=True))
        ]
        self.theta = [drive.find_rest_angle(q[j], holds[j]) for j, drive in enumerate(self.drives)]
        self.current = [h / d.ratio / d.torque_constant for h, d in zip(holds, self.drives, strict=True)]
        self.integral = list(self.current)
        self.seen_speed, self.seen = [0.0, 0.0], list(self.theta)
        self.reference = [t - r * x for t, r, x in zip(self.theta, self.ratios, q, strict=True)]
        rows = 3 + max(math.ceil(steps / MAXWELL_STEPS) for steps in self.delays)
        self.commands = [deque([i] * rows, maxlen=rows) for i in self.current]  # A, the newest first
        self.path = [
            deque([x] * (int(steps) + 2), maxlen=int(steps) + 2) for x, steps in zip(q, self.late, strict=True)
        ]
        self.rates = [0.0] * 4  # accelerations of the last step: both motors', then α's and β's

    def gravity_torques(self, alpha: float, beta: float) -> tuple[float, float]:
        """Compute the pull of gravity.

        Args:
            alpha: absolute angle of the first link, rad.
            beta: absolute angle of the second link, rad.

        Returns:
            Generalised torques in both angles, N m.

        """
        gx, gy = self.gravity
        return (
            self.moments[0] * (gy * math.cos(alpha) - gx * math.sin(alpha)),
            self.moments[1] * (gy * math.cos(beta) - gx * math.sin(beta)),
        )

    def compute_energy(self) -> float:
        """Compute the energy, J, of links and motors and of gravity, without that of springs."""
        v1, v2 = self.v[0], self.v[0] + self.v[1]
        alpha, beta = self.q[0], self.q[0] + self.q[1]
        gx, gy = self.gravity
        moving = 0.5 * self.inertias[0] * v1**2 + 0.5 * self.inertias[1] * v2**2
        moving += self.coupling * math.cos(beta - alpha) * v1 * v2
        moving += sum(0.5 * d.inertia * w**2 for d, w in zip(self.drives, self.omega, strict=True))
        high = [m * (gx * math.cos(a) + gy * math.sin(a)) for m, a in zip(self.moments, (alpha, beta), strict=True)]
        return moving - sum(high)

    def simulate_rows(self) -> dict[str, np.ndarray]:
        """Simulate the whole motion.

        Returns:
            The log's columns (T,) by name, without noise, rounding and time.

        """
        rows = []
        for k in range(len(self.motion.time)):
            shown = [(self._acting_current(j), self.theta[j], self._show_angle(j)) for j in (0, 1)]
            self._control_motors(k)
            rows.append([(self.commands[j][0], *shown[j], float(self.motion.position[k, j])) for j in (0, 1)])
            force = self.motion.force[k].tolist()
            for n in range(MAXWELL_STEPS):
                self.advance_step(k * PERIOD + n * MAXWELL_STEP, n, force)
            for drive in self.drives:
                drive.warm_up(PERIOD)
        names = (
            "motor_current_command",
            "motor_current",
            "motor_position",
            "joint_position",
            "joint_position_reference",
        )
        table = np.array(rows)
        columns = {f"{name}_{j}": table[:, j - 1, at].copy() for at, name in enumerate(names) for j in (1, 2)}
        columns["tip_force_x"], columns["tip_force_y"] = (np.array(f) for f in self.motion.force.T)
        return columns

    def _control_motors(self, k: int) -> None:
        """A PID loop on each motor's own encoder; it does not wind up where the command is at its limit."""
        for j, (stiff, damp, slow) in enumerate(self.gains):
            step = self.world.joints[j]["motor_encoder_resolution"]
            read = round(self.theta[j] / step) * step
            self.seen_speed[j] += _SPEED_FILTER * ((read - self.seen[j]) / PERIOD - self.seen_speed[j])
            self.seen[j] = read
            error = float(self.motion.position[k, j]) * self.ratios[j] + self.reference[j] - read
            slip = float(self.motion.velocity[k, j]) * self.ratios[j] - self.seen_speed[j]
            asked = stiff * error + damp * slip + self.integral[j]
            command = min(max(asked, -LARGEST_COMMAND), LARGEST_COMMAND)
            if command == asked:
                self.integral[j] += slow * error * PERIOD
            self.commands[j].appendleft(command)

    def _acting_current(self, j: int) -> float:
        """The current, A, at the end of a row, before the next command."""
        if self.lags[j]:
            return self.current[j]
        age = max(math.ceil(self.delays[j] / MAXWELL_STEPS) - 1, 0)
        return min(max(self.commands[j][age], -self.limits[j]), self.limits[j])

    def _step_current(self, j: int, n: int) -> float:
        """The mean current, A, of step ``n`` of a row."""
        command, limit, delay = self.commands[j], self.limits[j], self.delays[j]
        if delay:
            early, late = n - delay, n + 1 - delay
            old, new = command[-math.floor(early / MAXWELL_STEPS)], command[max(-math.floor(late / MAXWELL_STEPS), 0)]
            share = late % MAXWELL_STEPS if old != new else 1.0
            asked = old + min(share, 1.0) * (new - old)
        else:
            asked = command[0]
        asked = min(max(asked, -limit), limit)
        if not self.lags[j]:
            return asked
        keep = math.exp(-0.5 * MAXWELL_STEP / self.lags[j])
        middle = asked + (self.current[j] - asked) * keep
        self.current[j] = asked + (middle - asked) * keep
        return middle

    def advance_step(self, time: float, n: int, force: Sequence[float]) -> None:
        """Advance by a step.

        Args:
            time: at its begin, s.
            n: number of the step in its row.
            force: on the tip, N.

        """
        h, half = MAXWELL_STEP, 0.5 * MAXWELL_STEP
        q, v, theta, omega, rates = self.q, self.v, self.theta, self.omega, self.rates
        alpha_dot, beta_dot = v[0], v[0] + v[1]
        alpha, beta = q[0] + half * alpha_dot, q[0] + q[1] + half * beta_dot
        taus = []
        # speeds in the middle of the step, as far as the last step's accelerations tell
        va, vb = alpha_dot + half * rates[2], beta_dot + half * rates[3]
        for j in (0, 1):
            drive = self.drives[j]
            middle = theta[j] + half * omega[j]
            angle, speed = (alpha, va) if j == 0 else (beta - alpha, vb - va)
            motor, ahead, back, tau = drive.compute_torques(middle, omega[j] + half * rates[j], angle, speed)
            motor += drive.torque_constant * self._step_current(j, n)
            free = omega[j] + h * motor / drive.inertia
            stop = free * drive.inertia / h  # N m, that would stop the motor within the step
            after = free - h / drive.inertia * min(max(stop, -back), ahead)
            rates[j] = (after - omega[j]) / h
            omega[j] = after
            theta[j] = middle + half * after
            taus.append(tau)
        if self.cables or self.walls != [None, None] or self.unknown != [None, None]:
            for j, add in enumerate(self._outer_torques(time + half, alpha, beta, va, vb)):
                taus[j] += add
        self._move_links(alpha, beta, va, vb, taus, force)
        for j in (0, 1):
            if self.late[j]:
                self.path[j].append(self.q[j])

    def _move_links(
        self, alpha: float, beta: float, va: float, vb: float, taus: Sequence[float], force: Sequence[float]
    ) -> None:
        """Advance the links by a step from its middle."""
        h, half, rates = MAXWELL_STEP, 0.5 * MAXWELL_STEP, self.rates
        cosine, sine = math.cos(beta - alpha), math.sin(beta - alpha)
        pull_a, pull_b = self.gravity_torques(alpha, beta)
        b = self.coupling * cosine
        qa = taus[0] - taus[1] + pull_a + self.coupling * sine * vb * vb
        qb = taus[1] + pull_b - self.coupling * sine * va * va
        fx, fy = force
        if fx or fy:
            qa += self.lengths[0] * (fy * math.cos(alpha) - fx * math.sin(alpha))
            qb += self.lengths[1] * (fy * math.cos(beta) - fx * math.sin(beta))
        ia, ib = self.inertias
        whole = ia * ib - b * b
        rates[2], rates[3] = (ib * qa - b * qb) / whole, (ia * qb - b * qa) / whole
        new_a, new_b = self.v[0] + h * rates[2], self.v[0] + self.v[1] + h * rates[3]
        at_a, at_b = alpha + half * new_a, beta + half * new_b
        self.q, self.v = [at_a, at_b - at_a], [new_a, new_b - new_a]

    def _outer_torques(self, time: float, alpha: float, beta: float, va: float, vb: float) -> list[float]:
        """Torques of cables, walls and unknown effects at both joints, N m."""
        found = []
        for j, (q, v, other, along) in enumerate(
            ((alpha, va, beta - alpha, vb - va), (beta - alpha, vb - va, alpha, va))
        ):
            total = self.drives[j].cable_torque(q)
            wall, unknown = self.walls[j], self.unknown[j]
            if wall:
                total += _wall_torque(wall, q, v)
            if unknown:
                total += self._unknown_torque(j, unknown, time, (q, v, other, along))
            found.append(total)
        return found

    def _unknown_torque(
        self, j: int, p: Mapping[str, float], time: float, at: tuple[float, float, float, float]
    ) -> float:
        """A torque that no effect of the table describes; at angle and speed of this joint and of the other."""
        q, v, other, along = at
        size, kind = p["torque"], int(p["kind"])
        if kind == 0:  # both speeds together, as of a fluid that one joint stirs and the other feels
            return -size * v * abs(along)
        if kind == 1:  # two machines nearby that beat
            beat = math.sin(2.0 * math.pi * 0.21 * p["frequency"] * time)
            return size * beat * math.sin(2.0 * math.pi * p["frequency"] * time + p["phase"])
        if kind == 2:  # a spring that snaps over, on to one side and back at another angle
            if abs(q) > p["play"]:
                self.side[j] = math.copysign(1.0, q)
            self.memory[j] += (self.side[j] - self.memory[j]) * MAXWELL_STEP / _OVERCENTER_SECONDS
            return size * self.memory[j]
        turn = p["order"] * q + p["phase"]  # teeth of a saw, rounded, that lean the way the other joint stands
        return size * math.sin(turn + 0.6 * math.sin(turn)) * math.cos(2.0 * other)

    def _show_angle(self, j: int) -> float:
        """The angle that the joint's encoder shows, rad."""
        q, path, late = self.q[j], self.path[j], self.late[j]
        if late:
            whole = int(late)
            q = path[-1 - whole] + (late - whole) * (path[-2 - whole] - path[-1 - whole])
        p = self.world.effects[j].get("encoder_eccentricity")
        if p:
            q += math.asin(p["share"] * math.sin(q + p["phase"])) - math.asin(p["share"] * math.sin(p["phase"]))
        return q


def _wall_torque(p: Mapping[str, float], q: float, v: float) -> float:
    """The push of a wall that gives off no pull (Hunt and Crossley's damping), N m."""
    deep = p["side"] * (q - p["angle"])
    if deep <= 0.0:
        return 0.0
    return -p["side"] * p["stiffness"] * deep * max(1.0 + p["damping"] * p["side"] * v, 0.0)
