"""Controllers: a compiled law inside its guard, tick by tick.

A tick always leaves a whole, legal torque vector; faults come back as a status, never as an exception. Not a
safety-rated function: use it behind a certified stop (docs/safety.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.plant import Arm, Array, PlantError

UNLIMITED = 1e100
NEVER = 2**31 - 1


class Safe(Enum):
    """What a controller does after a fault; there is no default."""

    ZERO = 1  # no torque
    DAMPING = 2  # against the motors' speed
    HOLD = 3  # about the motors' positions at the fault


@dataclass(frozen=True)
class Guard:
    """Limits of a controller. None: from the robot file; where that states none, the limit must be given here.

    Torques are at the motors. Jumps are per tick. ``stale_*``: ticks after which an unchanged stamp, or unchanged
    bits, are a fault.
    """

    safe: Safe
    period: float = 1e-3  # s
    period_share: tuple[float, float] = (0.5, 2.0)  # shortest and longest tick, in periods
    watchdog: float = 0.02  # s
    torque_limit: tuple[float, ...] | None = None  # N m
    torque_rate: tuple[float, ...] | None = None  # N m/s
    force_limit: float = UNLIMITED  # N, static, at the tip
    motor_jump: tuple[float, ...] | None = None  # rad; None: twice the joint's speed limit allows
    joint_jump: tuple[float, ...] | None = None  # rad
    stale_stamp_ticks: int = 5
    stale_bits_ticks: int = NEVER
    safe_damping: tuple[float, ...] = field(default=())  # N m s/rad, for DAMPING and HOLD
    safe_stiffness: tuple[float, ...] = field(default=())  # N m/rad, for HOLD


@dataclass(frozen=True)
class Fault:
    """The first fault since the last reading: its status and sentence, what came in, and what was sent before."""

    status: int
    sentence: str
    index: int
    further: int
    now: float
    raw: Array
    sent: Array
    measurement: Array
    reference: Array


class Controller:
    """One law of an arm: ``position``, ``impedance_cartesian``, ``impedance_joint``, ``admittance_cartesian``,
    ``admittance_joint``.

    ``gains`` by name (defaults in `gain_table`), SI units. Buffers ``measurement`` and ``reference`` may be filled in
    place for speed.
    Raises PlantError where the law, a gain or a limit is refused.
    """

    def __init__(self, arm: Arm, law: str, guard: Guard, gains: Mapping[str, float] | None = None) -> None:
        laws = {entry["name"]: (k, entry) for k, entry in enumerate(arm.manifest["controllers"])}
        if law not in laws:
            raise PlantError(f"no controller named {law}; there are {', '.join(laws)}.")
        self.arm, self.law, self.guard = arm, law, guard
        self._number, self.described = laws[law]
        self.gains = {g["name"]: float(g["nominal"]) for g in self.described["gains"]}
        self.reference_names = tuple(self.described["reference"])
        module, n = arm.module, arm.n
        self._context = np.zeros(module.length("controller_tick", "controller"), np.uint8)
        self._now = np.zeros(1)
        self.measurement = np.zeros(module.length("controller_tick", "measurement"))
        self._reference = np.zeros(module.length("controller_tick", "reference"))
        self.reference = self._reference[: len(self.reference_names)]
        self.torque: Array = np.zeros(n)
        self._status: NDArray[np.int32] = np.zeros(1, np.int32)
        # the measurement: stamp, then n each of motor and joint positions and velocities and motor torque, then the
        # tip force
        self.motor_position, self.motor_velocity, self.joint_position, self.joint_velocity, self.motor_torque = (
            self.measurement[1 + k * n : 1 + (k + 1) * n] for k in range(5)
        )
        self.tip_force = self.measurement[1 + 5 * n : 3 + 5 * n]
        buffers = (self._context, self._now, self.measurement)
        self._tick = module.bind("controller_tick", *buffers, self._reference, self.torque, self._status)
        self._recover = module.bind("controller_recover", *buffers, self._status)
        self._watchdog = module.bind("controller_watchdog", self._context, self._now, self.torque, self._status)
        self.configure(guard, gains or {})

    def configure(self, guard: Guard, gains: Mapping[str, float]) -> None:
        """Replace guard and gains, with the arm's present parameters: all of it, or PlantError and nothing changes."""
        wanted = dict(self.gains)
        problems = []
        bounds = {g["name"]: g for g in self.described["gains"]}
        for name, value in gains.items():
            if name not in wanted:
                problems.append(f"{self.law}: no gain named {name}; there are {', '.join(wanted)}.")
            elif not bounds[name]["low"] <= value <= bounds[name]["high"]:
                b = bounds[name]
                problems.append(
                    f"{self.law}: gain {name} is {value} {b['unit']}; possible is {b['low']:g} to {b['high']:g}."
                )
            else:
                wanted[name] = float(value)
        if problems:
            raise PlantError("\n".join(problems))
        wanted["period"] = guard.period
        numbers = np.zeros(self.arm.module.length("controller_configure", "gains"))
        numbers[: len(wanted)] = list(wanted.values())
        whole = np.array([guard.safe.value, guard.stale_stamp_ticks, guard.stale_bits_ticks], np.int32)
        law = np.array([self._number], np.int32)
        call = (self._context, law, self.arm.p, numbers, whole, self._limits(guard), self._status)
        self.arm.module.bind("controller_configure", *call).run()
        if self._status[0]:
            raise PlantError(f"{self.law}: {self.sentence(int(self._status[0]))}")
        self.gains, self.guard = wanted, guard

    def _limits(self, guard: Guard) -> Array:
        joints, n = self.arm.robot["joints"], self.arm.n
        torque, rate, problems = [], [], []
        for j, joint in enumerate(joints, 1):
            constant, current = joint["drive"]["torque_constant"], joint["drive"]["max_current"]
            torque.append(constant["nominal"] * current if constant and current else None)
            rate.append(joint["limits"]["motor_torque_rate"])
            del j
        values = []
        for name, stated, given in (
            ("torque_limit", torque, guard.torque_limit),
            ("torque_rate", rate, guard.torque_rate),
        ):
            chosen = list(given) if given is not None else stated
            if len(chosen) != n or any(value is None for value in chosen):
                where = "max_current and torque_constant" if name == "torque_limit" else "limits.motor_torque_rate"
                problems.append(
                    f"{name}: the robot file states no {where} for every joint; give {n} values in Guard({name}=...)."
                )
            values.append(chosen)
        speeds = [joint["limits"]["speed"] for joint in joints]
        ratios = [joint["drive"]["ratio"]["nominal"] for joint in joints]
        for given, scale in ((guard.motor_jump, ratios), (guard.joint_jump, [1.0] * n)):
            default = [UNLIMITED if v is None else 2 * v * s * guard.period for v, s in zip(speeds, scale, strict=True)]
            values.append(list(given) if given is not None else default)
        values += [list(guard.safe_damping) or [0.0] * n, list(guard.safe_stiffness) or [0.0] * n]
        if problems or any(len(value) != n for value in values):
            raise PlantError("\n".join(problems) or f"every limit of Guard takes {n} values, one a joint.")
        period = [guard.period, *(share * guard.period for share in guard.period_share)]
        joined = [float(number) for value in values for number in value if number is not None]
        return np.array([*period, guard.watchdog, guard.force_limit, *joined])

    # -- ticks ------------------------------------------------------------------------------------------------------

    def tick(
        self, now: float, reference: ArrayLike | None = None, stamp: float | None = None, **measured: ArrayLike
    ) -> int:
        """One tick at ``now`` (s, monotonic). ``measured``: motor_position, joint_position, tip_force and the like,
        written into the measurement; without them it holds what was put there in place. Returns the status; the
        torque is in ``torque``."""
        for name, value in measured.items():
            getattr(self, name)[:] = value
        if reference is not None:
            self.reference[:] = reference
        self._now[0] = now
        self.measurement[0] = now if stamp is None else stamp
        self._tick.run()
        return int(self._status[0])

    def watchdog(self, now: float) -> int:
        """To be called when a tick may be missing: legal torque in ``torque``, status of the watchdog."""
        self._now[0] = now
        self._watchdog.run()
        return int(self._status[0])

    def recover(self, now: float, stamp: float | None = None, **measured: ArrayLike) -> int:
        """Leave the safe state with a fresh measurement; 0, or the status that says why not."""
        for name, value in measured.items():
            getattr(self, name)[:] = value
        self._now[0] = now
        self.measurement[0] = now if stamp is None else stamp
        self._recover.run()
        return int(self._status[0])

    def read_fault(self) -> Fault | None:
        """The first fault since the last reading, and clear it; the safe state stays until `recover`."""
        n, module = self.arm.n, self.arm.module
        whole, real = np.zeros(4, np.int32), np.zeros(module.length("controller_read", "real"))
        module.bind("controller_read", self._context, whole, real).run()
        if not whole[0]:
            return None
        ends = np.cumsum([1, n, n, len(self.measurement)])
        now, raw, sent, measurement, reference = np.split(real, ends)
        code = int(whole[0])
        count = int(whole[3])
        return Fault(
            code,
            self.sentence(code),
            int(whole[1]),
            int(whole[2]),
            float(now[0]),
            raw,
            sent,
            measurement,
            reference[:count],
        )

    def sentence(self, status: int) -> str:
        """What a status means."""
        return str(self.arm.module.sentence(status))

    def gain_table(self) -> tuple[dict[str, Any], ...]:
        """Name, unit, nominal, bounds and meaning of every gain."""
        return tuple(self.described["gains"])
