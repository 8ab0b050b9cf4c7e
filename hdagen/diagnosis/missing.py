"""What is missing along the measured motion: torque that the model does not account for, at the motors and the links.

The measured positions are smoothed without lag and differentiated. At those states the model says which acceleration
its own torques give; what the measured one exceeds it by, times inertia, is missing. Model and measurement pass the
same filter. Where only one side of a flexible gear is measured, or the drive is rigid, the balance is that of the whole
joint, at the motor.

Legend: K even instants, n joints, m positions and velocities of the state; θ motor angle, q joint angle, φ torsion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hdagen import verdict
from hdagen.channels import Even, even
from hdagen.columns import commanded
from hdagen.driving_inputs import acted_on, driven_by
from hdagen.log import Log
from hdagen.plant import Arm, Array
from hdagen.readings import Readings, complete, mechanical, unread
from hdagen.replay import Replay
from hdagen.torques import torque_per_input

NARROW = 0.007  # s, of the boxcar before the velocity that friction sees: reversals stay where they are
GAP = 3.5  # periods between rows, from where they are not neighbours
NEAR = 0.5  # of the filter's width to each side of a reversal
SMALL = 1e-3  # of the torque at full torsion, over which the spring's slope is taken


@dataclass(frozen=True, eq=False)
class Missing:
    """Torque at the motors (K, n) and at the links (K, n), N m, positive where it would speed the joint up; ``link`` is
    None where the log does not part the two sides."""

    motor: Array
    link: Array | None


@dataclass(eq=False)
class Sight:
    """A log seen through the model before and after the verdict.

    ``arm`` has the verdict's effects; ``before`` and ``after`` are its parameters (np) as the robot file and as the
    verdict has them; ``own`` the places in p of each effect's parameters, by name@joint.
    """

    arm: Arm
    log: Log
    before: Array
    after: Array
    own: Mapping[str, tuple[int, ...]]
    replays: tuple[Replay, ...]

    @cached_property
    def grid(self) -> Even:
        """Even instants over the log."""
        at = even(self.log.time)
        return Even(at.time, at.time)

    @property
    def time(self) -> Array:
        """The instants (K,), s."""
        return self.grid.time

    def driven(self, joint: int) -> bool:
        """Whether the input of a joint is logged as commanded and as measured."""
        name = self.arm.input_names[joint - 1]
        return name in self.log and commanded(name) in self.log

    def input_word(self, joint: int) -> str:
        """What drives a joint: current or torque."""
        return "current" if self.arm.input_names[joint - 1].startswith("motor_current") else "torque"

    def input_unit(self, joint: int) -> str:
        """The unit of that."""
        return "A" if self.input_word(joint) == "current" else "N m"

    @cached_property
    def kept(self) -> np.ndarray:
        """Which instants (K,) count: not those at the ends and about gaps of the log, where a filter knows too
        little."""
        reach = 2 * self.grid.width + 2
        good = np.ones(len(self.time), bool)
        good[:reach] = good[-reach:] = False
        for row in np.flatnonzero(np.diff(self.log.time) > GAP * self.grid.period):
            a, b = np.searchsorted(self.time, self.log.time[row : row + 2])
            good[max(a - reach, 0) : b + reach] = False
        return good

    @property
    def n(self) -> int:
        """Joints."""
        return self.arm.n

    def on_grid(self, values: Array) -> Array:
        """Logged samples (T,) at the instants."""
        return np.asarray(np.interp(self.time, self.log.time, values))

    @cached_property
    def split(self) -> bool:
        """Whether both sides of every gear are measured."""
        return all(
            j in self.arm.manifest["flexible"]
            and f"motor_position_{j}" in self.log
            and f"joint_position_{j}" in self.log
            for j in range(1, self.n + 1)
        )

    @cached_property
    def ratio(self) -> Array:
        """Of the gears (n)."""
        return np.array([self.arm.parameters.described[f"ratio_{j}"].nominal for j in range(1, self.n + 1)])

    @cached_property
    def _read(self) -> Array:
        """The states (K, nx) as the sensors read them: positions as they are, velocities smoothed a little."""
        arm, readings = self.arm, Readings.of(self.arm, self.log)
        x = np.zeros((len(self.time), arm.nx))
        known: set[int] = set()
        width = max(3, round(NARROW / self.grid.period)) | 1
        for k, place in enumerate(readings.places):
            name = arm.state_names[place]
            if "position" not in name:
                continue
            rate = arm.index(name.replace("position", "velocity"))
            x[:, place] = self.on_grid(readings.measured[:, k] / readings.factors[k])
            padded = np.pad(x[:, place], width // 2, mode="reflect", reflect_type="odd")
            x[:, rate] = self.grid.rate(np.convolve(padded, np.full(width, 1.0 / width), "valid"))
            known |= {place, rate}
        m = mechanical(arm)
        x[:, :m] = complete(arm, x, known)[:, :m]
        for k in range(m, arm.nx) if self.replays else ():
            x[:, k] = self.on_grid(self.replays[1].states[:, k])
        return x

    def states(self, p: Array) -> Array:
        """The states (K, nx) that the readings mean under parameters ``p``."""
        return unread(self.arm.at(p), self._read.copy(), Readings.of(self.arm, self.log).encoders())

    def column(self, quantity: str, j: int) -> Array:
        """A state as it is read, by its name without the joint: motor_position, joint_velocity, … (K,)."""
        name = f"{quantity}_{j}"
        if name in self.arm.state_names:
            return self._read[:, self.arm.index(name)]
        other = name.replace("motor", "joint")  # the motor of a rigid drive
        return self._read[:, self.arm.index(other)] * self.ratio[j - 1]

    def inputs(self, p: Array) -> Array:
        """What acts about each instant (K, nu): measured where it is logged, else commands through the model."""
        arm = self.arm.at(p)
        given, _ = driven_by(arm, self.log, "measured")
        acting, _ = acted_on(arm, self.log, given, "measured")
        acting = acting.copy()
        n = self.n
        acting[1:, :n] = (acting[1:, :n] + acting[:-1, :n]) / 2
        return np.stack([self.on_grid(column) for column in acting.T], 1)

    def commanded(self, p: Array) -> tuple[Array, Array]:
        """What the model makes of the commands, row by row: what acts and what a sensor of it shows (T, nu each)."""
        arm = self.arm.at(p)
        return acted_on(arm, self.log, driven_by(arm, self.log, "command")[0], "command")

    def smooth(self, values: Array) -> Array:
        """Columns (K, k) through the filter that all of a balance pass."""
        return np.stack([self.grid.smooth(column) for column in values.T], 1)

    @cached_property
    def acceleration(self) -> tuple[Array, Array]:
        """Of motors and joints as measured (K, n), rad/s²."""
        found = []
        for side in ("motor", "joint"):
            angle = np.stack([self.column(f"{side}_position", j) for j in range(1, self.n + 1)], 1)
            smooth = self.smooth(angle)
            found.append(np.stack([self.grid.rate(self.grid.rate(column)) for column in smooth.T], 1))
        return found[0], found[1]

    @cached_property
    def direction(self) -> Array:
        """Of each motor (K, n): −1, 1, or 0 where it stands still."""
        speed = np.stack([self.column("motor_velocity", j) for j in range(1, self.n + 1)], 1)
        noise = np.array([_jitter(self.column("motor_position", j), self.grid) for j in range(1, self.n + 1)])
        return np.where(np.abs(speed) > 3.0 * noise, np.sign(speed), 0.0)

    def slides(self, joint: int) -> np.ndarray:
        """Where a motor moves in one direction through most of the filter (K,): about a reversal friction of both signs
        mixes."""
        direction = self.direction[:, joint - 1]
        good = direction != 0
        for step in range(1, max(round(NEAR * self.grid.width), 1) + 1):
            good[step:] &= direction[step:] == direction[:-step]
            good[:-step] &= direction[:-step] == direction[step:]
        return good

    def sensed_torque(self, p: Array) -> Array:
        """What the torque sensors of the joints read in the model (K, n), N m."""
        return self.smooth(self.arm.at(p).outputs(self.states(p), self.inputs(p))["joint_torque"])

    def rates(self, p: Array, x: Array) -> tuple[Array, Array]:
        """Acceleration of motors (0 in rigid drives) and joints (K, n) that the model gives in states x, unfiltered."""
        rate = self.arm.at(p).evaluate("rhs_exact", x=x, u=self.inputs(p), sliding=self.direction)["rate"]
        motor, joint = np.zeros((len(x), self.n)), np.zeros((len(x), self.n))
        for j in range(1, self.n + 1):
            joint[:, j - 1] = rate[:, self.arm.index(f"joint_velocity_{j}")]
            if j in self.arm.manifest["flexible"]:
                motor[:, j - 1] = rate[:, self.arm.index(f"motor_velocity_{j}")]
        return motor, joint

    def missing(self, p: Array) -> Missing:
        """What the model with parameters ``p`` (np) does not account for."""
        return self._parted(p) if self.split else Missing(self._whole(p), None)

    def _parted(self, p: Array) -> Missing:
        x = self.states(p)
        motor, joint = self.rates(p, x)
        motor, joint = self.acceleration[0] - self.smooth(motor), self.acceleration[1] - self.smooth(joint)
        return Missing(motor * self.inertia(p), self.weighed(p, x, joint))

    def _whole(self, p: Array) -> Array:
        given = self.inputs(p)[:, : self.n] * torque_per_input(self.arm.at(p))
        found = self.smooth(self._asked(p)["motor_torque"] - given)
        return np.where(self.direction == 0, 0.0, found)  # what holds a joint at rest is not known

    def _asked(self, p: Array) -> dict[str, Array]:
        """What the inverse dynamics say of the measured motion under parameters ``p``, unfiltered."""
        q, v = self._joints(self.states(p))
        force = self.inputs(p)[:, self.n :]
        return self.arm.at(p).evaluate("inverse_dynamics", q=q, v=v, a=self.acceleration[1], tip_force=force)

    def _joints(self, x: Array) -> tuple[Array, Array]:
        """Positions and velocities of the joints (K, n each) in states ``x`` (K, nx)."""
        names = ([f"joint_{what}_{j}" for j in range(1, self.n + 1)] for what in ("position", "velocity"))
        q, v = (x[:, [self.arm.index(name) for name in side]] for side in names)
        return q, v

    def inertia(self, p: Array) -> Array:
        """Of the motors (n), kg m²."""
        names = list(self.arm.parameters.described)
        return np.array([p[names.index(f"motor_inertia_{j}")] for j in range(1, self.n + 1)])

    def weighed(self, p: Array, x: Array, acceleration: Array) -> Array:
        """Torque at the links (K, n) that goes with an ``acceleration`` (K, n)."""
        mass = self.arm.at(p).evaluate("mass_matrix", q=self._joints(x)[0])["M"].reshape(len(x), self.n, self.n)
        return np.asarray(np.einsum("kij,kj->ki", mass, acceleration))

    def added(self, p: Array, less: Array) -> Missing:
        """What parameters ``p`` add to ``less`` (np each) in the states of ``p``, filtered alike."""
        x = self.states(p)
        (motor, joint), (motor_less, joint_less) = self.rates(p, x), self.rates(less, x)
        at_motor = self.smooth(motor - motor_less) * self.inertia(p)
        at_link = self.weighed(p, x, self.smooth(joint - joint_less))
        if self.split:
            return Missing(at_motor, at_link)
        return Missing(at_motor + at_link / self.ratio, None)

    def without(self, entry: str) -> Array:
        """The parameters after the verdict with one effect (name@joint) as the robot file has it."""
        p = self.after.copy()
        for place in self.own.get(entry, ()):
            p[place] = self.before[place]
        return p

    def link_torque(self, p: Array) -> Array:
        """What the links ask of the transmission along the measured motion (K, n), N m."""
        return self.smooth(self._asked(p)["joint_torque"])

    def slope(self, p: Array) -> Array:
        """Stiffness of the springs (K, n) under that torque, N m/rad."""
        torque = self.link_torque(p)
        h = SMALL * max(float(np.abs(torque).max()), 1.0)
        arm = self.arm.at(p)
        ends = [arm.evaluate("torsion", joint_torque=torque + side * h)["torsion"] for side in (1.0, -1.0)]
        return np.asarray(2 * h / np.maximum(ends[0] - ends[1], 1e-12))

    def read_error(self, p: Array, less: Array) -> Array:
        """By how much the joint encoders read more under ``p`` than under ``less`` (K, n), rad."""
        q, v = self._joints(self.states(p))
        read = [
            self.arm.at(one).evaluate("encoders", q=q, v=v, a=self.acceleration[1])["joint_position"]
            for one in (p, less)
        ]
        return self.smooth(read[0] - read[1])


def look(arm: Arm, content: Mapping[str, Any], log: Log, before: Replay, after: Replay) -> Sight:
    """The log of two replays: ``before`` with the robot file, ``after`` with what the diagnosis' ``content`` says on
    ``arm``, which has its effects. Raises PlantError."""
    said = verdict.read(content)
    changed, _ = verdict.applied(arm, said)
    names = list(arm.parameters.described)
    own = {f"{e.name}@{e.joint}": tuple(names.index(name) for name in e.parameters) for e in said.effects}
    nominal = np.array([q.nominal for q in arm.parameters.described.values()])
    return Sight(arm.at(nominal), log, nominal, changed.p.copy(), own, (before, after))


def _jitter(angle: Array, grid: Even) -> float:
    """Standard deviation of the speed that the noise of an angle makes."""
    width = max(3, round(NARROW / grid.period)) | 1
    steps = np.diff(angle, 3)
    noise = float(np.median(np.abs(steps))) * 1.4826 / np.sqrt(20.0) if len(steps) else 0.0
    return noise * np.sqrt(2.0) / (width * grid.period)
