"""A built arm as tests use it: the compiled functions on numpy arrays, by the names of the manifest."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SMOOTH, EXACT, BATCH, BATCH_OWN = range(4)  # kinds of rollout


@dataclass(frozen=True)
class Compiled:
    """A loaded build: ``module`` as the library offers it, ``manifest`` beside it, ``folder`` of both."""

    module: ModuleType
    manifest: Mapping[str, Any]
    folder: Path

    @property
    def states(self) -> list[str]:
        """Names of x."""
        return [slot["name"] for slot in self.manifest["state"]]

    @property
    def parameters(self) -> list[str]:
        """Names of p."""
        return [quantity["name"] for quantity in self.manifest["parameters"]]

    @property
    def nominal(self) -> Floats:
        """p as the robot file gives it."""
        return np.array([quantity["nominal"] for quantity in self.manifest["parameters"]])

    def vector(self, **changes: float) -> Floats:
        """p with some entries changed, by name."""
        p = self.nominal
        for name, value in changes.items():
            p[self.parameters.index(name)] = value
        return p

    def prepare(self, **changes: float) -> Floats:
        """c of the nominal parameters with some entries changed, by name."""
        return self("prepare", self.vector(**changes))[0]

    def x(self, **entries: float) -> Floats:
        """A state that is 0 but for the named entries."""
        x = np.zeros(len(self.states))
        for name, value in entries.items():
            x[self.states.index(name)] = value
        return x

    def at(self, x: Floats, name: str) -> Floats:
        """The column of x (… × nx) of that name."""
        return x[..., self.states.index(name)]

    def random(self, rng: np.random.Generator, rows: int, vector: str = "state", share: float = 1.0) -> Floats:
        """rows × entries of x ("state") or u ("input"), uniform within ``share`` of the manifest's bounds."""
        bound = np.array([slot["bound"] for slot in self.manifest[vector]])
        return rng.uniform(-share, share, (rows, bound.size)) * bound

    def sizes(self, name: str) -> tuple[list[int], list[int]]:
        """Lengths of a function's inputs and outputs."""
        nx, nu, np_ = len(self.states), len(self.manifest["input"]), len(self.parameters)
        if name in ("step", "step_exact"):
            return [nx, nu, self.manifest["constants"], 1], [nx]
        if name == "step_jacobian":
            return [nx, nu, np_, 1], [nx, nx * nx, nx * nu, nx * np_]
        f = next(f for f in self.manifest["functions"] if f["name"] == name)
        return [n for _, n in f["inputs"]], [n for _, n in f["outputs"]]

    def __call__(self, name: str, *inputs: Any) -> list[Floats]:
        """The outputs of a function; inputs of shape (rows, n) give outputs of shape (rows, n), one row serves all."""
        lengths, widths = self.sizes(name)
        arrays = [np.ascontiguousarray(np.atleast_1d(a), dtype=float) for a in inputs]
        assert [a.shape[-1] for a in arrays] == lengths, (name, lengths, [a.shape for a in arrays])
        many = {a.shape[0] for a in arrays if a.ndim == 2}
        assert len(many) <= 1, (name, many)
        rows = many.pop() if many else 1
        outputs = [np.empty((rows, width)) for width in widths]
        self.module.map(name, rows, *arrays, *outputs)
        return outputs if any(a.ndim == 2 for a in arrays) else [out[0] for out in outputs]

    def rollout(self, x0: Any, u: Any, c: Floats, dt: Any, most: float = 1.0, kind: int = SMOOTH) -> Floats:
        """States from x0 under the rows of u, each held for dt; (…, rows + 1, nx)."""
        x0, u = np.ascontiguousarray(x0, dtype=float), np.ascontiguousarray(u, dtype=float)
        held = np.ascontiguousarray(np.broadcast_to(dt, u.shape[-2]), dtype=float)
        count = x0.shape[0] if x0.ndim == 2 else 1
        x = np.empty((*x0.shape[:-1], u.shape[-2] + 1, x0.shape[-1]))
        self.module.rollout(kind, x0, u, np.ascontiguousarray(c), held, most, count, x)
        return x


def load(folder: Path) -> Compiled:
    """The build in a folder."""
    manifest = json.loads((folder / "manifest.json").read_text())
    spec = importlib.util.spec_from_file_location("hda", folder / manifest["library"])
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Compiled(module, manifest, folder)
