"""Compliant control without a torque sensor: the law gets the tip force as both encoders of every joint tell it at the
tick, in place of the force sensor's reading.

Legend: τ̂ joint torque by (14) to (16) corrected, both springs in series, with the hysteresis that the torsion has wound
up; p = M q̇ momentum of the links; L bandwidth; r = Jᵀ F_e torque of the world on the joints:

    r = L (p − ∫ (τ̂ + Cᵀ q̇ − g + r) dt),    F_e = J⁻ᵀ r

At rest that is (20) corrected, F_e = J⁻ᵀ (g − τ̂). The paper uses (20) in motion too, where it takes the links' inertia
for a force.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard
from hdagen.control.guarded_controller import Controller
from hdagen.paper.prototype.torque_estimator import by_joint

OBSERVER_BANDWIDTH = 20.0  # rad/s of the observer, as that of the inner loops for Hall sensors
WINDING_FREQUENCY = 20.0  # Hz: a faster torsion winds no hysteresis, as the encoders' counts make it
SINGULAR_DAMPING = 1e-6  # m², added to J Jᵀ, so that a straight arm gives a finite force


class TipForceObserver:
    """Observer of F_e from encoders; ``model`` has the known springs, kinematic torsion, hysteresis and links."""

    def __init__(self, model: Arm, period: float, bandwidth: float = OBSERVER_BANDWIDTH) -> None:
        self.n, self.period, self.bandwidth = model.n, period, bandwidth
        self.height, angle = by_joint(model, "hysteresis_torque"), by_joint(model, "hysteresis_angle")
        self.angle = np.where(angle > 0, angle, np.inf)
        self.share = 1 - np.exp(-2 * np.pi * WINDING_FREQUENCY * period)
        self._bind_functions(model)
        self.restart()

    def _bind_functions(self, model: Arm) -> None:
        """Bind the model's functions to buffers."""
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
        """Forget the past: the next tick is the first, and starts from rest."""
        self.begun = False
        self.phi: Array = np.zeros(self.n)
        self.wound: Array = np.zeros(self.n)
        self.total: Array = np.zeros(self.n)
        self.r: Array = np.zeros(self.n)

    def tick(self, theta: Array, q: Array) -> Array:
        """Observe the force on the tip.

        Args:
            theta: motor positions at this tick (n,), rad.
            q: joint positions at this tick (n,), rad.

        Returns:
            F_e (2,), N.

        """
        h = self.period
        if self.begun:
            self.v[:] = (q - self.q) / h
        else:
            self.v[:] = 0.0
        self.theta[:], self.q[:] = theta, q
        for function in self._functions:
            function.run()
        if not self.begun:
            self.begun, self.phi = True, self.torsion.copy()
        torque = self.torque + self.height * self._wind_hysteresis()
        self.total += h * (torque + self.C.T @ self.v - self.g + self.r)
        self.r = self.bandwidth * (self.M @ self.v - self.total)
        return _solve_damped(self.J @ self.J.T, self.J @ self.r)

    def _wind_hysteresis(self) -> Array:
        """Advance the hysteresis state (n,), dz = (dφ − |dφ| z)/δ along the torsion below WINDING, exactly."""
        step = self.share * (self.torsion - self.phi)
        self.phi += step
        sign = np.sign(step)
        self.wound = sign + (self.wound - sign) * np.exp(-np.abs(step) / self.angle)
        return self.wound


def _solve_damped(A: Array, b: Array) -> Array:
    """Solve (A + SINGULAR 1) x = b of two axes, written out for speed."""
    (xx, xy), (_, yy) = A.tolist()
    x, y = b.tolist()
    xx, yy = xx + SINGULAR_DAMPING, yy + SINGULAR_DAMPING
    share = 1.0 / (xx * yy - xy * xy)
    return np.array([share * (yy * x - xy * y), share * (xx * y - xy * x)])


class SensorlessController(Controller):
    """A law of ``arm`` that never sees the force sensor. ``estimated_forces``: the observed F_e of each tick (2, N)."""

    def __init__(
        self,
        arm: Arm,
        law: str,
        guard: Guard,
        gains: Mapping[str, float],
        model: Arm,
        bandwidth: float = OBSERVER_BANDWIDTH,
    ) -> None:
        self.observer, self.estimated_forces = TipForceObserver(model, guard.period, bandwidth), list[Array]()
        super().__init__(arm, law, guard, gains)

    def restart(self) -> None:
        """Start again, as a new controller."""
        super().restart()
        self.observer.restart()
        self.estimated_forces = []

    def tick(self, now: float, *given: Any, **named: Any) -> int:
        """Run one tick of the law from the encoders alone.

        Args:
            now: time of the tick, s.
            given: as `Controller.tick` has them.
            named: as `Controller.tick` has them.

        Returns:
            The status of `Controller.tick`.

        """
        self.tip_force[:] = self.observer.tick(self.motor_position, self.joint_position)
        self.estimated_forces.append(self.tip_force.copy())
        return super().tick(now, *given, **named)
