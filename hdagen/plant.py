"""A compiled arm: found or built, checked, loaded, and called from numpy.

Vectors are named by the build's manifest; nothing about a model is typed twice here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.carried import Carried
from hdagen.given import Array, finite, is_number, of_rows, vector
from hdagen.names import list_nearest
from hdagen.opening import PlantError, Structured, folder_of, opened, remedy
from hdagen.parameters import Parameter, Parameters, UnknownParameter

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

DECAYS = 2.0  # of a slowed memory, that a step may span: RK4 carries 2.78


@dataclass(frozen=True)
class StepJacobians:
    """One step and its derivatives: next (nx), by_state (nx, nx), by_input (nx, nu), by_parameter (nx, np)."""

    next: Array
    by_state: Array
    by_input: Array
    by_parameter: Array


class Arm:
    """An arm, loaded from the folder of a build. x, u and p are ordered as ``state_names``, ``input_names`` and
    ``parameters`` say; units are SI.

    ``p`` and ``c`` are this arm's own; two arms loaded from one build do not share parameters. Threads may share an arm
    whose parameters none of them sets: nothing else changes it, and `at` makes one with other parameters.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = folder = Path(folder)
        self.manifest, self.module = opened(folder)
        try:
            self._read()
        except (LookupError, TypeError, ValueError) as error:
            raise PlantError(
                f"{folder}: the manifest is not what a build writes ({type(error).__name__}: {error}); {remedy(folder)}"
            ) from None

    def _read(self) -> None:
        self.robot: Mapping[str, Any] = self.manifest["robot"]
        self.n = len(self.robot["joints"])
        self.state_names = tuple(s["name"] for s in self.manifest["state"])
        self.input_names = tuple(s["name"] for s in self.manifest["input"])
        self.nx, self.nu = len(self.state_names), len(self.input_names)
        self.step_size = float(self.robot["step"])
        self.staged = any(effect["place"] == "input" for effect in self.manifest["effects"])
        self._shapes = {f["name"]: (f["inputs"], f["outputs"]) for f in self.manifest["functions"]}
        self.p: Array = np.array([q["nominal"] for q in self.manifest["parameters"]])
        self.c: Array = np.empty(self.manifest["constants"])
        self._prepare(self.p)
        described = (Parameter(**(q | {"starts": tuple(q["starts"])})) for q in self.manifest["parameters"])
        self.parameters = Parameters(self, {q.name: q for q in described})

    def __repr__(self) -> str:
        size = f"{self.n} joints, {self.nx} states"
        return f"<arm '{self.robot['name']}': {size}, {self.manifest['profile']}, {self.folder.name}>"

    def _prepare(self, p: Array) -> None:
        self.module.bind("prepare", p, self.c).run()
        self.p = p

    def at(self, p: Array) -> Arm:
        """An arm of the same build with parameters ``p`` (np), whose bounds are not checked here; this one stays."""
        other = copy(self)
        other.c = np.empty_like(self.c)
        other._prepare(np.array(p, float))
        other.parameters = self.parameters.of(other)
        return other

    def index(self, name: str) -> int:
        """Place of a state or input by name."""
        for names in (self.state_names, self.input_names):
            if name in names:
                return names.index(name)
        every = [*self.state_names, *self.input_names]
        raise PlantError(f"no state or input named {name}; there are {list_nearest([name], every)}.")

    # -- functions --------------------------------------------------------------------------------------------------

    def evaluate(self, name: str, **inputs: ArrayLike) -> dict[str, Array]:
        """An emitted function by name, for one set of inputs (length k each) or for N at once ((N, k) each; single
        ones serve all).

        c is the arm's own unless given. Returns every output, (k,) or (N, k). PlantError for wrong names or lengths.
        """
        if name not in self._shapes:
            raise PlantError(f"no function named {name}; there are {list_nearest([name], list(self._shapes))}.")
        ins, outs = self._shapes[name]
        given: dict[str, Any] = {"c": self.c, **inputs} if any(a == "c" for a, _ in ins) else dict(inputs)
        if set(given) != {a for a, _ in ins}:
            raise PlantError(f"{name} takes {', '.join(a for a, _ in ins if a != 'c')}, not {', '.join(inputs)}.")
        arrays = [of_rows(given[a], k, f"{name}: {a}") for a, k in ins]
        counts = {a.shape[0] for a in arrays if a.ndim == 2}
        if len(counts) > 1:
            raise PlantError(f"{name}: the inputs have {sorted(counts)} rows; give one number of rows.")
        rows = counts.pop() if counts else 1
        many = any(a.ndim == 2 for a in arrays)
        results = [np.empty((rows, k)) for _, k in outs]
        if rows:
            self.module.map(name, rows, *arrays, *results)
        return {a: r if many else r[0] for (a, _), r in zip(outs, results, strict=True)}

    def rhs(self, x: ArrayLike, u: ArrayLike) -> Array:
        """Rate of x (nx) or (N, nx), dry friction with the smooth sign."""
        return self.evaluate("rhs", x=x, u=u)["rate"]

    def outputs(self, x: ArrayLike, u: ArrayLike) -> dict[str, Array]:
        """What sensors without noise read, with the sensor effects: motor and joint positions and velocities,
        joint_torque; and the truth: joint_angle, torsion, tip, tip_velocity, beyond_law."""
        return self.evaluate("outputs", x=x, u=u)

    def step(self, x: ArrayLike, u: ArrayLike, h: float | None = None, exact: bool = False) -> Array:
        """State after h seconds (default: the robot's step) with u held; ``exact``: dry friction set-valued, sticking
        exactly."""
        out = np.empty(self.nx)
        size = np.array([self._size(h)])
        self.module.bind("step_exact" if exact else "step", self._state(x), self._input(u), self.c, size, out).run()
        return out

    def jacobians(self, x: ArrayLike, u: ArrayLike, h: float | None = None) -> StepJacobians:
        """One smooth step with its derivatives by state, input and parameters."""
        nx, nu, many = self.nx, self.nu, len(self.p)
        out, A, B, P = np.empty(nx), np.empty(nx * nx), np.empty(nx * nu), np.empty(nx * many)
        size = np.array([self._size(h)])
        self.module.bind("step_jacobian", self._state(x), self._input(u), self.p, size, out, A, B, P).run()
        return StepJacobians(out, A.reshape(nx, nx).T, B.reshape(nu, nx).T, P.reshape(many, nx).T)

    def rollout(
        self, x0: ArrayLike, u: ArrayLike, dt: ArrayLike | None = None, exact: bool = False, most: float | None = None
    ) -> Array:
        """States over time ((T + 1, nx), the first is x0) with row k of u (T, nu) held for dt[k] seconds (one number:
        for all rows; default: the robot's step), in steps of at most ``most`` (default: the robot's step)."""
        inputs = self._inputs(u)
        times, x = self._times(dt, len(inputs)), np.empty((len(inputs) + 1, self.nx))
        self.module.rollout(int(exact), self._state(x0), inputs, self.c, times, self._most(most), 1, x)
        return x

    def windows(
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
        """States (R, nx) in the rows of windows that each begin anew, set-valued friction. Window w is the rows
        edges[w] = (first, end) of u (T, nu) and begins with the positions and velocities ``begun[w]`` (m) and with the
        effects' own states ``memory[w]`` (nx − m); without them as the window before left them (0 where it ended
        elsewhere). ``jump`` (T, nx) is added to
        the state in each row. Where |x| would leave ``limit`` (nx) the window stays. With ``c`` (L, nc), constants of L
        lanes: begun (L, W, m), memory (L, W, nx − m), u (L, T, nu), jump (L, T, nx) -> (L, R, nx). ``out``: where the
        result goes.
        """
        rows, count = np.ascontiguousarray(edges, np.int32), 1 if c is None else len(c)
        x = np.empty((count, int(np.diff(rows).sum()), self.nx)) if out is None else out
        given = (u, self.c if c is None else c, dt, jump, memory)
        inputs, used, times, added, own = (a if a is None else np.ascontiguousarray(a, float) for a in given)
        first, size = finite(begun, "begun"), self._most(most) if c is None else self._size(most)
        self.module.windows(first, own, rows, inputs, used, times, added, limit, x, size, count)
        return x[0] if c is None else x

    def acting(self, command: ArrayLike, dt: ArrayLike, before: ArrayLike) -> tuple[Array, Array]:
        """What the input effects (delay, saturation, sag, lag) make of commands.

        ``command`` (T, n), row k held for ``dt[k]`` s, after ``before`` (n) had been held for ever. Returns the mean
        over each row of what acts (T, n), and what acts at each row's instant (T, n), which a sensor reads there.
        Without such effects: the command, and the command a row before. Raises PlantError.
        """
        rows = finite(command, "command")
        first = vector(before, self.n, "before")
        if rows.ndim != 2 or rows.shape[1] != self.n or not len(rows):
            raise PlantError(f"command must be (T, {self.n}), a row or more; it is {rows.shape}.")
        times = self._times(dt, len(rows))
        mean, end = rows.copy(), rows.copy()
        if self.staged:
            state = self.input_state(first)
            first = self.evaluate("input_law", command=first)["current"]
            self.module.map("input_step", len(rows), state, rows, self.c, times, mean, end)
        return mean, np.concatenate([first[None], end[:-1]])

    def input_state(self, before: ArrayLike) -> NDArray[np.uint8]:
        """The memory of the input stage after ``before`` (n) had been commanded for ever."""
        state = np.zeros(self.module.length("input_reset", "state"), np.uint8)
        self.module.bind("input_reset", state, vector(before, self.n, "before"), self.c).run()
        return state

    def rollout_batch(
        self,
        x0: ArrayLike,
        u: ArrayLike,
        p: ArrayLike | None = None,
        dt: ArrayLike | None = None,
        most: float | None = None,
    ) -> Array:
        """B rollouts at once, smooth friction: x0 (B, nx), u (B, T, nu) -> (B, T + 1, nx). ``p`` (B, np): parameters
        of each; default: the arm's for all. Bounds of p are not checked here."""
        starts, inputs = finite(x0, "x0"), finite(u, "u")
        if inputs.ndim != 3 or starts.shape != (inputs.shape[0], self.nx) or inputs.shape[2] != self.nu:
            raise PlantError(
                f"rollout_batch takes x0 (B, {self.nx}) and u (B, T, {self.nu}), not {starts.shape} and {inputs.shape}."
            )
        count, rows, _ = inputs.shape
        if not count:
            raise PlantError("rollout_batch takes at least one trajectory.")
        constants = self.c
        if p is not None:
            constants = self.evaluate("prepare", p=of_rows(p, len(self.p), "p"))["c"]
            if constants.shape != (count, len(self.c)):
                raise PlantError(f"rollout_batch takes p ({count}, {len(self.p)}).")
        x = np.empty((count, rows + 1, self.nx))
        kind = 2 if p is None else 3
        self.module.rollout(kind, starts, inputs, constants, self._times(dt, rows), self._size(most), count, x)
        return x

    def rest(self, q: ArrayLike, torque: ArrayLike | None = None) -> Array:
        """State at rest at joint positions q (n) with each spring under ``torque`` (n, N m; default: what gravity
        asks)."""
        joint = vector(q, self.n, "q")
        load = self.evaluate("gravity_torque", q=joint)["g"] if torque is None else vector(torque, self.n, "torque")
        twist = self.evaluate("torsion", joint_torque=load)["torsion"]
        x = np.zeros(self.nx)
        x[[self.index(f"joint_position_{j}") for j in range(1, self.n + 1)]] = joint
        for j in self.manifest["flexible"] * 4:  # the last times for angles that effects add to the torsion
            off = self.outputs(x, np.zeros(self.nu))["torsion"][j - 1] - twist[j - 1]
            x[self.index(f"motor_position_{j}")] -= off * self.parameters[f"ratio_{j}"] * (abs(off) > 1e-12)
        return x

    # -- checks -----------------------------------------------------------------------------------------------------

    def _state(self, x: ArrayLike) -> Array:
        return vector(x, self.nx, f"the state x ({', '.join(self.state_names)})")

    def _input(self, u: ArrayLike) -> Array:
        return vector(u, self.nu, f"the input u ({', '.join(self.input_names)})")

    def _inputs(self, u: ArrayLike) -> Array:
        inputs = finite(u, "u")
        if inputs.ndim != 2 or inputs.shape[1] != self.nu:
            raise PlantError(f"u must be (T, {self.nu}): {', '.join(self.input_names)}; it is {inputs.shape}.")
        return inputs

    def _times(self, dt: ArrayLike | None, rows: int) -> Array:
        times = finite(self.step_size if dt is None else dt, "dt")
        if times.shape not in ((), (1,), (rows,)) or not (times > 0).all():
            raise PlantError(f"dt must be one positive time, s, or {rows} of them, a row of u each.")
        return np.ascontiguousarray(np.broadcast_to(times, (rows,)))

    @cached_property
    def carried(self) -> Carried:
        """What tells the step that RK4 carries."""
        return Carried.of(self)

    @property
    def _memory_step(self) -> float:
        """The longest step that the memories of effects, as they are slowed, bear, s; inf where none is slowed."""
        slowed = "memory_step" in self.parameters.described
        return DECAYS * self.parameters["memory_step"] if slowed else math.inf

    @property
    def stable_step(self) -> float:
        """The robot file's step, or the shorter one that springs and walls as the parameters say allow, s."""
        return self._most(None)

    def steps_in(self, time: float) -> int:
        """How many steps of equal length a time (s) takes, none longer than the stable one."""
        return max(1, math.ceil(time / self.stable_step - 1e-9))

    def _most(self, most: float | None) -> float:
        """The longest step of a rollout with the parameters at hand, s."""
        return min(self._size(most), self.carried.longest(self.p), self._memory_step)

    def _size(self, h: float | None) -> float:
        size = self.step_size if h is None else h
        if not is_number(size) or not size > 0:
            raise PlantError(f"the step must be positive and finite, s, not {size}.")
        return float(size)


def load(
    robot: str | Path = "paper",
    profile: str = "portable",
    effects: tuple[str, ...] = (),
    out: str | Path | None = None,
    mpc: Structured | None = None,
) -> Arm:
    """The arm of a preset or a robot.toml; `Arm` loads the folder of a build.

    A robot that is not built yet is built first, by a child process, which says so. ``effects`` adds effects to the
    model; ``out`` is where builds lie (default: $HDAGEN_BUILD, else ./build if it is there, else the user's cache);
    ``mpc``, a configuration of the predictive controller, adds it to the library. Raises PlantError.
    """
    return Arm(folder_of(robot, profile, effects, out, mpc))
