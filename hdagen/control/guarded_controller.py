"""Controllers: a compiled law inside its guard, tick by tick.

A tick always leaves a whole, legal torque vector; faults come back as a status, never as an exception. This is not a
safety-rated function: use it behind a certified stop (docs/project/safety.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.arm.arrays import Array, is_number
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, pack_limits
from hdagen.control.reference_motion import Reference, convert_to_joint_motion
from hdagen.support.messages import join_nearest_names

MEASUREMENT_CHANNELS = (
    "motor_position",
    "motor_velocity",
    "joint_position",
    "joint_velocity",
    "motor_torque",
    "tip_force",
)


@dataclass(frozen=True)
class Fault:
    """The first fault since the last reading.

    Attributes:
        status: The fault's status.
        sentence: Its meaning.
        index: The joint's or the input's number at fault, from 1; 0: neither.
        further: The number of faults after it.
        now: The time of its tick, s.
        raw: (n), the law's torque where the fault was found in it, else 0, N m.
        sent: (n), the torque sent before the fault, N m.
        measurement: The measurement of the tick.
        reference: The reference of the tick.

    """

    status: int
    sentence: str
    index: int
    later_faults: int
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
        self.number, self.described = laws[law]
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
        self._name_channels()
        buffers = (self._context, self._now, self.measurement)
        self._read = "controller_read"
        self._tick = module.bind("controller_tick", *buffers, self._reference, self.torque, self._status)
        self._recover = module.bind("controller_recover", *buffers, self._status)
        self._watchdog = module.bind("controller_watchdog", self._context, self._now, self.torque, self._status)
        self.configure(guard, gains or {})

    def _name_channels(self) -> None:
        """Name the parts of the measurement.

        They are the stamp, n each of motor and joint positions and velocities and motor torques, and the tip force.
        """
        n = self.arm.n
        ends = np.cumsum([1, n, n, n, n, n])
        parts = np.split(self.measurement, ends)[1:]
        self._channels: dict[str, Array] = dict(zip(MEASUREMENT_CHANNELS, parts, strict=True))
        self.motor_position, self.motor_velocity, self.joint_position, self.joint_velocity = parts[:4]
        self.motor_torque, self.tip_force = parts[4:]

    def configure(self, guard: Guard, gains: Mapping[str, float]) -> None:
        """Replace guard and gains, with the arm's present parameters: all of it, or nothing changes.

        Args:
            guard: The guard.
            gains: Gains by name, SI units; the others stay. The gain ``period`` is the guard's.

        Raises:
            PlantError: A gain or a limit is refused, or a fault is latched.

        """
        wanted, problems = dict(self.gains), []
        bounds = {g["name"]: g for g in self.described["gains"]}
        for name, value in {**gains, "period": guard.period}.items():
            if name not in wanted:
                problems.append(
                    f"{self.law}: no gain named {name}; there are {join_nearest_names([name], list(wanted))}."
                )
            elif name == "period" and name in gains and gains[name] != guard.period:
                problems.append(f"{self.law}: period is no gain but the guard's, {guard.period} s; leave it out.")
            elif not is_number(value) or not bounds[name]["low"] <= value <= bounds[name]["high"]:
                b = bounds[name]
                problems.append(
                    f"{self.law}: gain {name} is {value} {b['unit']}; possible is {b['low']:g} to {b['high']:g}."
                )
            else:
                wanted[name] = float(value)
        limits = pack_limits(self.arm, guard, problems)
        if problems:
            raise PlantError("\n".join(problems))
        numbers = np.zeros(self.arm.module.length("controller_configure", "gains"))
        numbers[: len(wanted)] = list(wanted.values())
        whole = np.array([guard.safe.value, guard.stale_stamp_ticks, guard.stale_bits_ticks], np.int32)
        law = np.array([self.number], np.int32)
        call = (self._context, law, self.arm.p.copy(), numbers, whole, limits, self._status)
        configure = self.arm.module.bind("controller_configure", *call)
        configure.run()
        if self._status[0]:
            raise PlantError(f"{self.law}: {self.sentence(int(self._status[0]))}")
        self._configure, self.gains, self.guard = configure, wanted, guard

    def rows(self, reference: Reference) -> Array:
        """Arrange a motion as the law takes it.

        Args:
            reference: The motion, in the law's space.

        Returns:
            (T, k), a row a tick.

        """
        return reference.rows()

    def restart(self) -> None:
        """Begin as if just made: no torque sent, no time known, no fault; law, parameters, gains and guard stay.

        It serves the next run of a simulation, or a machine at standstill; after a fault `recover` goes on without a
        jump.
        """
        self._context[:] = 0
        self._configure.run()

    def torque_limits(self) -> tuple[Array, Array]:
        """Largest torque (n, N m) and torque rate (n, N m/s) of the guard."""
        n = self.arm.n
        limits = pack_limits(self.arm, self.guard, [])
        return limits[5 : 5 + n], limits[5 + n : 5 + 2 * n]

    # -- ticks ------------------------------------------------------------------------------------------------------

    def tick(
        self, now: float, reference: ArrayLike | None = None, stamp: float | None = None, **measured: ArrayLike
    ) -> int:
        """Compute the torque of one tick, which is then in ``torque``.

        Args:
            now: The time on a monotonic clock, s.
            reference: The reference; None: as `reference` holds it.
            stamp: The time of the measurement, s; None: ``now``.
            measured: Channels by name (motor_position, joint_position, tip_force, …); the others stay as the buffer
                ``measurement`` holds them.

        Returns:
            The status; negative for a fault.

        Raises:
            PlantError: A channel's name or length is wrong.

        """
        self._write_measurement(now, stamp, measured)
        if reference is not None:
            self.reference[:] = _check_entries("reference", reference, len(self.reference))
        self._tick.run()
        return int(self._status[0])

    def _write_measurement(self, now: float, stamp: float | None, measured: Mapping[str, ArrayLike]) -> None:
        values = {}
        for name, value in measured.items():
            if name not in self._channels:
                raise PlantError(f"no measured channel is named {name}; there are {', '.join(MEASUREMENT_CHANNELS)}.")
            values[name] = _check_entries(name, value, len(self._channels[name]))
        for name, value in values.items():
            self._channels[name][:] = value
        self._now[0] = now
        self.measurement[0] = now if stamp is None else stamp

    def watchdog(self, now: float) -> int:
        """Compute a legal torque, then in ``torque``, when a tick may be missing.

        Args:
            now: The time on the clock of `tick`, s.

        Returns:
            The status of the watchdog.

        """
        self._now[0] = now
        self._watchdog.run()
        return int(self._status[0])

    def recover(self, now: float, stamp: float | None = None, **measured: ArrayLike) -> int:
        """Leave the safe state with a fresh measurement.

        Args:
            now: The time on the clock of `tick`, s.
            stamp: The time of the measurement, s; None: ``now``.
            measured: Channels by name, as `tick` takes them.

        Returns:
            0, or the status of the reason why the controller stays in the safe state.

        """
        self._write_measurement(now, stamp, measured)
        self._recover.run()
        return int(self._status[0])

    def read_fault(self) -> Fault | None:
        """Read the first fault since the last reading and clear it; the safe state stays until `recover`."""
        n, module = self.arm.n, self.arm.module
        whole, real = np.zeros(4, np.int32), np.zeros(module.length(self._read, "real"))
        module.bind(self._read, self._context, whole, real).run()
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
        """Explain a status.

        Args:
            status: The status.

        Returns:
            Its meaning, in a sentence.

        """
        return str(self.arm.module.sentence(status))

    def gain_table(self) -> tuple[dict[str, Any], ...]:
        """The name, unit, nominal value, bounds and meaning of every gain."""
        return tuple(self.described["gains"])


def _check_entries(name: str, value: ArrayLike, count: int) -> Array:
    """Turn a value into ``count`` real numbers, NaN and infinity among them: the guard judges those."""
    try:
        entries = np.asarray(value, float)
    except (TypeError, ValueError):
        entries = np.empty(0)
    if entries.shape != (count,):
        raise PlantError(f"{name} takes {count} numbers, not {value!r}.")
    return entries


def convert_to_law_space(controller: Controller, reference: Reference, near: ArrayLike) -> Reference:
    """Convert a motion to the space of a controller's law, joints or tip.

    Args:
        controller: The controller.
        reference: The motion.
        near: (n), joint positions next to the first ones.

    Returns:
        The motion in that space.

    Raises:
        PlantError: The law follows the tip and the motion is of the joints, or a point is out of reach.

    """
    wanted = controller.reference_names[0].split("_")[0]
    if reference.space == wanted:
        return reference
    if wanted == "joint":
        return convert_to_joint_motion(controller.arm, reference, near)
    raise PlantError(f"{controller.law} follows the tip; give a motion of the tip, not of the joints.")
