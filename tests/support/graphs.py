"""The functions of a robot as CasADi's interpreter evaluates them, and random arguments for both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

import casadi as ca
import numpy as np
from compiled import Compiled
from numpy.typing import NDArray

from gen.effects import ALL, NOMINAL
from gen.model.arm_model import Model
from gen.model.function_library import Library, make_library
from gen.robot.load_robot import load

Floats = NDArray[np.float64]


@cache
def assembled(source: str, extra: tuple[str, ...] = ()) -> Library:
    """The library of a preset or a robot.toml with effects added."""
    robot = load(source)
    wanted = {stated.name for stated in robot.effects} | set(extra)
    return make_library(Model(robot, tuple(e for e in ALL if e in NOMINAL or e.name in wanted)))


class Interpreted:
    """A CasADi function on rows: inputs (rows × n each), outputs (rows × n each), no copies in between."""

    def __init__(self, f: ca.Function, rows: int) -> None:
        self.function = f.map(rows)  # columns of n entries are what rows of n entries are in numpy
        buffer, self.trigger = self.function.buffer()
        self.buffer = cast(Any, buffer)  # its stubs know only the form with a size
        self.outputs = [np.empty((rows, f.numel_out(k))) for k in range(f.n_out())]
        for k, out in enumerate(self.outputs):
            self.buffer.set_res(k, memoryview(out.reshape(-1).data))

    def __call__(self, *inputs: Floats) -> list[Floats]:
        flat = [np.ascontiguousarray(given).reshape(-1) for given in inputs]  # kept until the call is over
        for k, given in enumerate(flat):
            self.buffer.set_arg(k, memoryview(given.data))
        self.trigger()
        assert self.buffer.ret() == 0
        return self.outputs


@dataclass
class Draw:
    """Random arguments of a robot's functions, within the manifest's bounds."""

    made: Compiled
    rng: np.random.Generator

    def parameters(self, rows: int, spread: float | None = None) -> Floats:
        """p (rows × np): uniform within its bounds, or within ``spread`` of nominal, relative to it, and, where nominal
        is 0, within the typical size of its effect."""
        low, high = (np.array([q[end] for q in self.made.manifest["parameters"]]) for end in ("low", "high"))
        if spread is not None:
            about = self.made.nominal
            typical = np.array([q["typical"] or 0.0 for q in self.made.manifest["parameters"]])
            width = np.where(about == 0, typical, spread * abs(about))
            low, high = (np.clip(about + sign * width, low, high) for sign in (-1, 1))
        return self.rng.uniform(low, high, (rows, low.size))

    def inputs(self, f: Mapping[str, Any], c: Floats) -> list[Floats]:
        """The inputs of a function of the manifest, a row for each of c (rows × nc)."""
        return [self._input(f["name"], name, length, c) for name, length in f["inputs"]]

    def _input(self, function: str, name: str, length: int, c: Floats) -> Floats:
        rows = len(c)
        if name == "c":
            return c
        if name == "x":
            return self._states(c)
        if name == "u":
            return self.made.random(self.rng, rows, "input")
        if name == "sliding":
            return self.rng.integers(-1, 2, (rows, length)).astype(float)
        if name == "gains":
            law = next(law for law in self.made.manifest["controllers"] if function.startswith(f"{law['name']}_"))
            return self.rng.uniform([g["low"] for g in law["gains"]], [g["high"] for g in law["gains"]], (rows, length))
        size = {"q": 3.0, "v": 10.0, "joint_position": 3.0, "point": 0.3}.get(name, 100.0)
        return self.rng.uniform(-size, size, (rows, length)) * self._shares(rows)

    def _shares(self, rows: int) -> Floats:
        return np.asarray(10.0 ** self.rng.uniform(-4, 0, (rows, 1)))

    def _states(self, c: Floats) -> Floats:
        """Half of them anywhere, where torsions are far beyond the law; half with torsions within twice the law's."""
        x = self.made.random(self.rng, len(c)) * self._shares(len(c))
        for j in self.made.manifest["flexible"]:
            law = self.made.manifest["robot"]["joints"][j - 1]["drive"]
            most = np.pi / (2 * law["flexspline_stiffening"]["nominal"] * law["flexspline_stiffness"]["nominal"])
            torsion = self.rng.uniform(-2 * most, 2 * most, len(c) // 2)
            motor, joint = (self.made.states.index(f"{side}_position_{j}") for side in ("motor", "joint"))
            x[::2][: len(torsion), motor] = law["ratio"]["nominal"] * (x[::2][: len(torsion), joint] + torsion)
        return x


def bits(values: Floats) -> NDArray[np.int64]:
    """The bits of doubles, all NaN alike."""
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


def toml(folder: Path, text: str) -> str:
    """The name of a file in ``folder`` with a robot's text."""
    path = folder / "robot.toml"
    path.write_text(text)
    return str(path)


def functions(made: Library) -> Sequence[tuple[str, ca.Function]]:
    """Name and graph of everything that is emitted."""
    return [(f.name, f.graph) for f in made.functions]
