"""A compiled arm: found or built, checked, loaded, and integrated over time from numpy."""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.arm.arm_parameters import Parameter, Parameters, UnknownParameter
from hdagen.arm.arrays import Array, as_finite_array, as_rows, as_vector, is_number
from hdagen.arm.build_loader import PlantError, StructuredController, find_or_build
from hdagen.arm.compiled_model import CompiledModel, StepJacobians
from hdagen.arm.step_limit import StableStep

__all__ = [
    "Arm",
    "Array",
    "Parameter",
    "Parameters",
    "PlantError",
    "StepJacobians",
    "UnknownParameter",
    "is_number",
    "load",
]

MOST_MEMORY_DECAYS = 2.0  # decays of a slowed memory in one step at most: RK4 is stable up to 2.78


class Arm(CompiledModel):
    """An arm, loaded from the folder of a build: its compiled model, and trajectories of it.

    x, u and p are ordered as ``state_names``, ``input_names`` and ``parameters`` say; units are SI. `CompiledModel`
    says which objects share parameters.
    """

    def rollout(
        self, x0: ArrayLike, u: ArrayLike, dt: ArrayLike | None = None, exact: bool = False, most: float | None = None
    ) -> Array:
        """Integrate a trajectory.

        Args:
            x0: (nx), the first state.
            u: (T, nu), the inputs.
            dt: How long each row of ``u`` is held, (T) or one number, s; None: the robot's step.
            exact: Whether dry friction is set-valued and sticks exactly.
            most: The longest step, s; None: the robot's.

        Returns:
            (T + 1, nx), the states, of which the first is ``x0``.

        """
        inputs = self._check_inputs(u)
        times, x = self._check_times(dt, len(inputs)), np.empty((len(inputs) + 1, self.nx))
        self.module.rollout(
            int(exact), self._check_state(x0), inputs, self.c, times, self._longest_stable_step(most), 1, x
        )
        return x

    def rollout_windows(
        self,
        begun: ArrayLike,
        edges: ArrayLike,
        u: ArrayLike,
        dt: ArrayLike,
        most: float,
        limit: Array,
        jump: Array | None = None,
        c: Array | None = None,
        out: Array | None = None,
        memory: Array | None = None,
    ) -> Array:
        """Integrate windows that each begin at a state of their own, with set-valued friction.

        Args:
            begun: (W, m), the positions and velocities at the begin of each window.
            edges: (W, 2), the first row of each window in ``u`` and the row after its last.
            u: (T, nu), the inputs.
            dt: (T), how long each row is held, s.
            most: The longest step, s.
            limit: (nx), the magnitudes of the state beyond which a window stays where it is.
            jump: (T, nx), added to the state in each row.
            c: (L, nc), the constants of L lanes; ``begun``, ``u``, ``jump`` and ``memory`` then begin with an axis L.
            out: Where the result is written.
            memory: (W, nx − m), the effects' own states at the begin of each window; None: as the window before ended,
                0 where that ended at another row.

        Returns:
            (R, nx) or (L, R, nx), the states in the R rows of all windows.

        """
        if c is None:
            count, size, constants = 1, self._longest_stable_step(most), self.c
        else:
            count, size, constants = len(c), self._check_step(most), np.ascontiguousarray(c, float)
        rows, first = np.ascontiguousarray(edges, np.int32), as_finite_array(begun, "begun")
        if out is None:
            out = np.empty((count, int(np.diff(rows).sum()), self.nx))
        inputs, times = np.ascontiguousarray(u, float), np.ascontiguousarray(dt, float)
        added, own = (a if a is None else np.ascontiguousarray(a, float) for a in (jump, memory))
        self.module.windows(first, own, rows, inputs, constants, times, added, limit, out, size, count)
        if c is None:
            return out[0]
        return out

    def apply_input_stage(self, command: ArrayLike, dt: ArrayLike, before: ArrayLike) -> tuple[Array, Array]:
        """Pass commands through the input effects (delay, saturation, sag, lag).

        Args:
            command: (T, n), A or N m.
            dt: How long each row is held, (T) or one number, s.
            before: (n), the command that was held for ever before the first row.

        Returns:
            (T, n) the mean over each row of the input that acts, and (T, n) the input that acts at each row's instant,
            which a sensor reads there; without input effects the command, and the command of the row before.

        Raises:
            PlantError: An array has another shape, or is not finite.

        """
        rows = as_finite_array(command, "command")
        first = as_vector(before, self.n, "before")
        if rows.ndim != 2 or rows.shape[1] != self.n or not len(rows):
            raise PlantError(f"command must be (T, {self.n}), a row or more; it is {rows.shape}.")
        times = self._check_times(dt, len(rows))
        mean, end = rows.copy(), rows.copy()
        if self.has_input_stage:
            state = self.start_input_stage(first)
            first = self.evaluate("input_law", command=first)["current"]
            self.module.map("input_step", len(rows), state, rows, self.c, times, mean, end)
        return mean, np.concatenate([first[None], end[:-1]])

    def start_input_stage(self, before: ArrayLike) -> NDArray[np.uint8]:
        """Start the input stage after a command that was held for ever.

        Args:
            before: (n), the command.

        Returns:
            The memory of the input stage, bytes that the compiled input_step reads and writes.

        """
        state = np.zeros(self.module.length("input_reset", "state"), np.uint8)
        self.module.bind("input_reset", state, as_vector(before, self.n, "before"), self.c).run()
        return state

    def rollout_batch(
        self,
        x0: ArrayLike,
        u: ArrayLike,
        p: ArrayLike | None = None,
        dt: ArrayLike | None = None,
        most: float | None = None,
    ) -> Array:
        """Integrate B trajectories at once, with smooth friction.

        Args:
            x0: (B, nx), the first states.
            u: (B, T, nu), the inputs.
            p: (B, np), the parameters of each, their bounds unchecked; None: the arm's for all.
            dt: How long each row is held, (T) or one number, s; None: the robot's step.
            most: The longest step, s; None: the robot's.

        Returns:
            (B, T + 1, nx), the states.

        Raises:
            PlantError: An array has another shape, or is not finite.

        """
        starts, inputs = as_finite_array(x0, "x0"), as_finite_array(u, "u")
        if inputs.ndim != 3 or starts.shape != (inputs.shape[0], self.nx) or inputs.shape[2] != self.nu:
            raise PlantError(
                f"rollout_batch takes x0 (B, {self.nx}) and u (B, T, {self.nu}), not {starts.shape} and {inputs.shape}."
            )
        count, rows, _ = inputs.shape
        if not count:
            raise PlantError("rollout_batch takes at least one trajectory.")
        constants, kind = self.c, 2
        if p is not None:
            constants, kind = self.evaluate("prepare", p=as_rows(p, len(self.p), "p"))["c"], 3
            if constants.shape != (count, len(self.c)):
                raise PlantError(f"rollout_batch takes p ({count}, {len(self.p)}).")
        x = np.empty((count, rows + 1, self.nx))
        self.module.rollout(
            kind, starts, inputs, constants, self._check_times(dt, rows), self._check_step(most), count, x
        )
        return x

    def rest(self, q: ArrayLike, torque: ArrayLike | None = None) -> Array:
        """Find the state of an arm at rest.

        Args:
            q: (n), the joint positions, rad (m where prismatic).
            torque: (n), the torque of each spring, N m; None: the torque that holds the arm against gravity.

        Returns:
            (nx), the state.

        """
        joint = as_vector(q, self.n, "q")
        load = torque
        if load is None:
            load = self.evaluate("gravity_torque", q=joint)["g"]
        twist = self.evaluate("torsion", joint_torque=as_vector(load, self.n, "torque"))["torsion"]
        x = np.zeros(self.nx)
        x[[self.index(f"joint_position_{j}") for j in range(1, self.n + 1)]] = joint
        for j in self.manifest["flexible"] * 4:  # the last times for angles that effects add to the torsion
            off = self.outputs(x, np.zeros(self.nu))["torsion"][j - 1] - twist[j - 1]
            x[self.index(f"motor_position_{j}")] -= off * self.parameters[f"ratio_{j}"] * (abs(off) > 1e-12)
        return x

    # -- checks -----------------------------------------------------------------------------------------------------

    def _check_inputs(self, u: ArrayLike) -> Array:
        inputs = as_finite_array(u, "u")
        if inputs.ndim != 2 or inputs.shape[1] != self.nu:
            raise PlantError(f"u must be (T, {self.nu}): {', '.join(self.input_names)}; it is {inputs.shape}.")
        return inputs

    def _check_times(self, dt: ArrayLike | None, rows: int) -> Array:
        if dt is None:
            dt = self.step_size
        times = as_finite_array(dt, "dt")
        if times.shape not in ((), (1,), (rows,)) or not (times > 0).all():
            raise PlantError(f"dt must be one positive time, s, or {rows} of them, a row of u each.")
        return np.ascontiguousarray(np.broadcast_to(times, (rows,)))

    @cached_property
    def stability(self) -> StableStep:
        """The bounds on the step at which RK4 is stable."""
        return StableStep.from_arm(self)

    @property
    def _longest_memory_step(self) -> float:
        """The longest step at which the slowed memories of effects are stable, s; inf where none is slowed."""
        if "memory_step" not in self.parameters.described:
            return math.inf
        return MOST_MEMORY_DECAYS * self.parameters["memory_step"]

    @property
    def stable_step(self) -> float:
        """The robot file's step, s, or a shorter one at which springs and walls with the present parameters are
        stable."""
        return self._longest_stable_step(None)

    def count_steps(self, time: float) -> int:
        """Count the equal steps of a time, none longer than the stable one.

        Args:
            time: The time, s.

        Returns:
            The number of steps.

        """
        return max(1, math.ceil(time / self.stable_step - 1e-9))

    def _longest_stable_step(self, most: float | None) -> float:
        """The longest stable step of a rollout with the present parameters, s."""
        return min(self._check_step(most), self.stability.longest_step(self.p), self._longest_memory_step)


def load(
    robot: str | Path = "paper",
    profile: str = "portable",
    effects: tuple[str, ...] = (),
    out: str | Path | None = None,
    mpc: StructuredController | None = None,
) -> Arm:
    """Load the arm of a preset or a robot.toml; `Arm` loads the folder of a build.

    A robot that is not built yet is built first, by a child process that reports it on standard error.

    Args:
        robot: The preset or the path.
        profile: "portable" or "native".
        effects: Effects that are added to the model.
        out: The folder where builds lie; None: $HDAGEN_BUILD, else ./build if it exists, else the user's cache.
        mpc: A configuration of the predictive controller, which is then compiled into the library.

    Returns:
        The arm.

    Raises:
        PlantError: The robot cannot be built or loaded.

    """
    arm = Arm(find_or_build(robot, profile, effects, out, mpc))
    arm.source = robot
    return arm
