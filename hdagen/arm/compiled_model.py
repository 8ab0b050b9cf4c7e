"""A compiled model: loaded from the folder of a build, its functions called from numpy at one instant or one step.

The build's manifest names the entries of all vectors; no part of a model is stated twice here.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arm_parameters import Parameter, Parameters
from hdagen.arm.arrays import Array, as_rows, as_vector, is_number
from hdagen.arm.build_loader import PlantError, advise_rebuild, open_build
from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.support.messages import join_nearest_names


@dataclass(frozen=True)
class StepJacobians:
    """One step and its derivatives.

    Attributes:
        next: (nx), the state after the step.
        by_state: (nx, nx), its derivative by the state.
        by_input: (nx, nu), by the input.
        by_parameter: (nx, np), by the parameters.

    """

    next: Array
    by_state: Array
    by_input: Array
    by_parameter: Array


class CompiledModel:
    """The compiled model of an arm. x, u and p are ordered as ``state_names``, ``input_names`` and ``parameters`` say;
    units are SI. ``effects`` says of every effect, in the model or not, how it shows itself.

    ``p`` and ``c`` are this object's own; two that are loaded from one build do not share parameters. Threads may share
    a model whose parameters none of them sets: nothing else changes it, and `with_parameters` makes one with other
    parameters.
    """

    source: str | Path | None = None  # the preset or robot.toml that it was loaded from; None: the folder of a build

    def __init__(self, folder: str | Path) -> None:
        self.folder = folder = Path(folder)
        self.manifest, self.module = open_build(folder)
        try:
            self._read_manifest()
        except (LookupError, TypeError, ValueError) as error:
            raise PlantError(
                f"{folder}: the manifest is not what a build writes ({type(error).__name__}: {error});"
                f" {advise_rebuild(folder)}"
            ) from None

    def _read_manifest(self) -> None:
        self.robot: Mapping[str, Any] = self.manifest["robot"]
        self.n = len(self.robot["joints"])
        self.state_names = tuple(s["name"] for s in self.manifest["state"])
        self.input_names = tuple(s["name"] for s in self.manifest["input"])
        self.nx, self.nu = len(self.state_names), len(self.input_names)
        self.moves_in_space = "tip" in self.robot
        self.dimensions = 3 if self.moves_in_space else 2  # of the tip's position
        self.step_size = float(self.robot["step"])
        self.effects = EffectCatalogue(self.manifest["catalogue"])
        self.has_input_stage = any(effect["place"] == "input" for effect in self.manifest["effects"])
        self._shapes = {f["name"]: (f["inputs"], f["outputs"]) for f in self.manifest["functions"]}
        self.p: Array = np.array([q["nominal"] for q in self.manifest["parameters"]])
        self.c: Array = np.empty(self.manifest["constants"])
        self._set_parameters(self.p)
        described = (Parameter(**(q | {"starts": tuple(q["starts"])})) for q in self.manifest["parameters"])
        self.parameters = Parameters(self, {q.name: q for q in described})

    def __repr__(self) -> str:
        size = f"{self.n} joints, {self.nx} states"
        return f"<arm '{self.robot['name']}': {size}, {self.manifest['profile']}, {self.folder.name}>"

    def _set_parameters(self, p: Array) -> None:
        self.module.bind("prepare", p, self.c).run()
        self.p = p

    def with_parameters(self, p: Array) -> Self:
        """Make a model of the same build with other parameters; this one stays as it is.

        Args:
            p: (np), the parameters; their bounds are not checked.

        Returns:
            The other model.

        """
        other = copy(self)
        other.c = np.empty_like(self.c)
        other._set_parameters(np.array(p, float))
        other.parameters = self.parameters.for_arm(other)
        return other

    def index(self, name: str) -> int:
        """Find the index of a state in x or of an input in u.

        Args:
            name: Its name.

        Returns:
            The index.

        Raises:
            PlantError: There is no such state or input.

        """
        for names in (self.state_names, self.input_names):
            if name in names:
                return names.index(name)
        every = [*self.state_names, *self.input_names]
        raise PlantError(f"no state or input named {name}; there are {join_nearest_names([name], every)}.")

    # -- functions --------------------------------------------------------------------------------------------------

    def evaluate(self, name: str, **inputs: ArrayLike) -> dict[str, Array]:
        """Evaluate a compiled function by name, once or for N sets of inputs.

        Args:
            name: The function's name.
            inputs: Its inputs by name, (k) each or (N, k); single ones serve all sets. c is the arm's own unless given.

        Returns:
            Every output by name, (k) or (N, k).

        Raises:
            PlantError: A name or a length is wrong.

        """
        if name not in self._shapes:
            raise PlantError(f"no function named {name}; there are {join_nearest_names([name], list(self._shapes))}.")
        ins, outs = self._shapes[name]
        given: dict[str, Any] = dict(inputs)
        if any(a == "c" for a, _ in ins):
            given.setdefault("c", self.c)
        if set(given) != {a for a, _ in ins}:
            raise PlantError(f"{name} takes {', '.join(a for a, _ in ins if a != 'c')}, not {', '.join(inputs)}.")
        arrays = [as_rows(given[a], k, f"{name}: {a}") for a, k in ins]
        counts = {a.shape[0] for a in arrays if a.ndim == 2}
        if len(counts) > 1:
            raise PlantError(f"{name}: the inputs have {sorted(counts)} rows; give one number of rows.")
        rows = max(counts, default=1)
        results = [np.empty((rows, k)) for _, k in outs]
        if rows:
            self.module.map(name, rows, *arrays, *results)
        if not counts:
            results = [r[0] for r in results]
        return {a: r for (a, _), r in zip(outs, results, strict=True)}

    def rhs(self, x: ArrayLike, u: ArrayLike) -> Array:
        """Evaluate the equations of motion, dry friction with the smooth sign.

        Args:
            x: The state, (nx) or (N, nx).
            u: The input, (nu) or (N, nu).

        Returns:
            The rate of the state, (nx) or (N, nx).

        """
        return self.evaluate("rhs", x=x, u=u)["rate"]

    def outputs(self, x: ArrayLike, u: ArrayLike) -> dict[str, Array]:
        """Evaluate the readings of sensors without noise, with the sensor effects, and the true quantities.

        Args:
            x: The state, (nx) or (N, nx).
            u: The input, (nu) or (N, nu).

        Returns:
            By name: readings of motor and joint positions and velocities and joint_torque; and the true joint_angle,
            torsion, tip, tip_velocity and beyond_law.

        """
        return self.evaluate("outputs", x=x, u=u)

    def step(self, x: ArrayLike, u: ArrayLike, h: float | None = None, exact: bool = False) -> Array:
        """Integrate one step with the input held.

        Args:
            x: (nx), the state.
            u: (nu), the input.
            h: The step, s; None: the robot's.
            exact: Whether dry friction is set-valued and sticks exactly.

        Returns:
            (nx), the state after the step.

        """
        out, name = np.empty(self.nx), "step"
        if exact:
            name = "step_exact"
        size = np.array([self._check_step(h)])
        self.module.bind(name, self._check_state(x), self._check_input(u), self.c, size, out).run()
        return out

    def jacobians(self, x: ArrayLike, u: ArrayLike, h: float | None = None) -> StepJacobians:
        """Integrate one step with smooth friction, with its derivatives by state, input and parameters.

        Args:
            x: (nx), the state.
            u: (nu), the input.
            h: The step, s; None: the robot's.

        Returns:
            The state after the step and its derivatives.

        """
        nx, nu, many = self.nx, self.nu, len(self.p)
        out, A, B, P = np.empty(nx), np.empty(nx * nx), np.empty(nx * nu), np.empty(nx * many)
        size = np.array([self._check_step(h)])
        self.module.bind("step_jacobian", self._check_state(x), self._check_input(u), self.p, size, out, A, B, P).run()
        return StepJacobians(out, A.reshape(nx, nx).T, B.reshape(nu, nx).T, P.reshape(many, nx).T)

    # -- checks -----------------------------------------------------------------------------------------------------

    def _check_state(self, x: ArrayLike) -> Array:
        return as_vector(x, self.nx, f"the state x ({', '.join(self.state_names)})")

    def _check_input(self, u: ArrayLike) -> Array:
        return as_vector(u, self.nu, f"the input u ({', '.join(self.input_names)})")

    def _check_step(self, h: float | None) -> float:
        if h is None:
            h = self.step_size
        if not is_number(h) or not h > 0:
            raise PlantError(f"the step must be positive and finite, s, not {h}.")
        return float(h)
