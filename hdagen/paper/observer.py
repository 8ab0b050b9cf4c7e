"""Compliant control without a torque sensor: a law that is given, in place of the force sensor's reading, the force on
the tip as both encoders of every joint tell it at the tick.

Legend: τ̂ joint torque by (14) to (16) corrected, both springs in series, with the hysteresis that the torsion has wound
up; p = M q̇ momentum of the links; L bandwidth; r what the world does to the joints, Jᵀ F_e:

    r = L (p − ∫ (τ̂ + Cᵀ q̇ − g + r) dt),    F_e = J⁻ᵀ r

At rest that is (20) corrected, F_e = J⁻ᵀ (g − τ̂). The paper takes (20) in motion too, where the links' own inertia
would be felt as a force.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.control import Controller, Guard
from hdagen.plant import Arm, Array

BANDWIDTH = 20.0  # rad/s of the observer: as fast as the inner loops' own on Hall sensors
WINDING = 20.0  # Hz up to which the torsion is taken to wind the hysteresis; counts of the encoders come faster
SINGULAR = 1e-6  # m², beside J Jᵀ, so that a straight arm gives a finite force


class TipForce:
    """F_e from encoders, by ``model``: what is known of springs, kinematic torsion, hysteresis and links."""

    def __init__(self, model: Arm, period: float, bandwidth: float = BANDWIDTH) -> None:
        n, p = model.n, model.parameters
        self.n, self.period, self.bandwidth = n, period, bandwidth
        self.height, self.angle = (
            np.array([p.get(f"{name}_{j}", 0.0) for j in range(1, n + 1)])
            for name in ("hysteresis_torque", "hysteresis_angle")
        )
        self.angle = np.where(self.angle > 0, self.angle, np.inf)
        self.share = 1 - np.exp(-2 * np.pi * WINDING * period)
        self._bind(model)
        self.restart()

    def _bind(self, model: Arm) -> None:
        """The model's functions, bound to buffers."""
        n, module, c = self.n, model.module, model.c.copy()
        self.theta, self.q, self.v = np.zeros(n), np.zeros(n), np.zeros(n)
        self.torque, self.torsion, none = np.zeros(n), np.zeros(n), np.zeros(n)
        mass, coriolis, self.g = np.zeros(n * n), np.zeros(n * n), np.zeros(n)
        jacobian, tip, bend = np.zeros(2 * n), np.zeros(2), np.zeros(2)
        self.M, self.C, self.J = mass.reshape(n, n).T, coriolis.reshape(n, n).T, jacobian.reshape(n, 2).T
        unused = np.zeros(n), np.zeros(n)
        self._functions = (
            module.bind("torque_estimate", self.theta, self.q, none, none, none, c, self.torque, *unused),
            module.bind("torsion", self.torque, c, self.torsion),
            module.bind("mass_matrix", self.q, c, mass),
            module.bind("coriolis_matrix", self.q, self.v, c, coriolis),
            module.bind("gravity_torque", self.q, c, self.g),
            module.bind("tip_jacobian", self.q, self.v, c, jacobian, tip, bend),
        )

    def restart(self) -> None:
        """Forget: the next tick is the first, and what it reads is taken for rest."""
        self.begun = False
        self.phi: Array = np.zeros(self.n)
        self.wound: Array = np.zeros(self.n)
        self.total: Array = np.zeros(self.n)
        self.r: Array = np.zeros(self.n)

    def tick(self, theta: Array, q: Array) -> Array:
        """F_e (2, N) from motor and joint positions (n each, rad) of this tick."""
        h = self.period
        self.v[:] = (q - self.q) / h if self.begun else 0.0
        self.theta[:], self.q[:] = theta, q
        for function in self._functions:
            function.run()
        if not self.begun:
            self.begun, self.phi = True, self.torsion.copy()
        torque = self.torque + self.height * self._wind()
        self.total += h * (torque + self.C.T @ self.v - self.g + self.r)
        self.r = self.bandwidth * (self.M @ self.v - self.total)
        return _solved(self.J @ self.J.T, self.J @ self.r)

    def _wind(self) -> Array:
        """The hysteresis state (n), dz = (dφ − |dφ| z)/δ along the torsion below WINDING, exact from tick to tick."""
        step = self.share * (self.torsion - self.phi)
        self.phi += step
        sign = np.sign(step)
        self.wound = sign + (self.wound - sign) * np.exp(-np.abs(step) / self.angle)
        return self.wound


def _solved(A: Array, b: Array) -> Array:
    """(A + SINGULAR 1)⁻¹ b of two axes, written out: it is done at every tick."""
    (xx, xy), (_, yy) = A.tolist()
    x, y = b.tolist()
    xx, yy = xx + SINGULAR, yy + SINGULAR
    share = 1.0 / (xx * yy - xy * xy)
    return np.array([share * (yy * x - xy * y), share * (xx * y - xy * x)])


class Sensorless(Controller):
    """A law of ``arm`` that never sees the force sensor. ``felt``: F_e as it was fed back, a row a tick (2, N)."""

    def __init__(
        self, arm: Arm, law: str, guard: Guard, gains: Mapping[str, float], model: Arm, bandwidth: float = BANDWIDTH
    ) -> None:
        self.observer, self.felt = TipForce(model, guard.period, bandwidth), list[Array]()
        super().__init__(arm, law, guard, gains)

    def restart(self) -> None:
        """Begin as if just made."""
        super().restart()
        self.observer.restart()
        self.felt = []

    def tick(self, now: float, *given: Any, **named: Any) -> int:
        """One tick of the law, from the encoders alone."""
        self.tip_force[:] = self.observer.tick(self.motor_position, self.joint_position)
        self.felt.append(self.tip_force.copy())
        return super().tick(now, *given, **named)
