"""The hand-coded half of a reality: one joint's drive, from current to the torque at its link.

MuJoCo has the inertias, the set-valued dry friction, the walls and the current loop's lag
(`hdagen.blind.realities.arm_reality`). This file has the rest, evaluated at every step; effects with a memory advance
by their exact solution over the step. The formulas are of other kinds than those of the smooth model: Maxwell's slip
elements in parallel, LuGre's bristle, a heat balance, a coupling that is engaged or not, a table for the springs.

Legend: θ motor angle, ω its speed; q, v joint angle and speed; N ratio; φ = θ/N − q + Δ torsion; τ joint torque.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.blind.realities.effect_sizes import UNKNOWN_KINDS
from hdagen.blind.realities.kinematic_lead import compute_kinematic_lead

_TABLE_CELLS = 4096  # number of cells of the spring table
_SLIP_ELEMENTS = 8  # number of elements of Maxwell's slip model
_LAW_LIMIT = 12.0  # c_f τ up to which the spring law holds; beyond it its tangent does (robot_toml.md: law_torque)


class Springs:
    """τ(φ) of both springs in series (robot_toml.md): solutions of the torsion law, interpolated by cubics."""

    def __init__(self, drive: Mapping[str, float]) -> None:
        k, c, kw, cw, ratio = (
            drive[key]
            for key in (
                "flexspline_stiffness",
                "flexspline_stiffening",
                "wave_generator_stiffness",
                "wave_generator_stiffening",
                "ratio",
            )
        )

        def torsion(tau: np.ndarray) -> np.ndarray:
            return np.arctan(c * tau) / (c * k) + (1.0 - np.exp(-cw * tau / ratio)) / (cw * ratio * kw)

        def compliance(tau: np.ndarray) -> np.ndarray:
            return 1.0 / (k * (1.0 + (c * tau) ** 2)) + np.exp(-cw * tau / ratio) / (ratio**2 * kw)

        last = np.array([_LAW_LIMIT / c])
        self.end, self.end_torque = float(torsion(last)[0]), float(last[0])
        self.end_stiffness = float(1.0 / compliance(last)[0])
        phi = np.linspace(0.0, self.end, _TABLE_CELLS + 1)
        low, high = np.zeros(phi.size), np.full(phi.size, last[0])
        for _ in range(60):  # bisection: slow, and cannot fail
            middle = 0.5 * (low + high)
            below = torsion(middle) < phi
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        tau, step = 0.5 * (low + high), self.end / _TABLE_CELLS
        tau[0] = 0.0
        slope = step / compliance(tau)
        rise = np.diff(tau)
        cells = (tau[:-1], slope[:-1], 3.0 * rise - 2.0 * slope[:-1] - slope[1:], slope[:-1] + slope[1:] - 2.0 * rise)
        self.cells = list(zip(*(column.tolist() for column in cells), strict=True))
        self.per_cell = 1.0 / step

    def torque(self, phi: float) -> float:
        """Interpolate the springs' torque.

        Args:
            phi: torsion, rad.

        Returns:
            Joint torque, N m.

        """
        size = abs(phi)
        if size >= self.end:
            tau = self.end_torque + self.end_stiffness * (size - self.end)
        else:
            place = size * self.per_cell
            cell = int(place)
            x = place - cell
            a, b, c, d = self.cells[cell]
            tau = a + x * (b + x * (c + x * d))
        if phi < 0.0:
            return -tau
        return tau


class MaxwellSlip:
    """Generalised Maxwell slip: parallel springs that each slide at a torque of their own, independent of the rate."""

    def __init__(self, torque: float, angle: float) -> None:
        shares = np.arange(1, _SLIP_ELEMENTS + 1) / _SLIP_ELEMENTS
        limits = torque / _SLIP_ELEMENTS * np.ones(_SLIP_ELEMENTS)
        self.elements = [[0.0, float(f / (2.0 * angle * s)), float(f)] for f, s in zip(limits, shares, strict=True)]
        self.at: float | None = None

    def torque(self, phi: float) -> float:
        """Move the torsion on.

        Args:
            phi: the new torsion, rad.

        Returns:
            Sum of the elements' torques, N m.

        """
        moved = 0.0
        if self.at is not None:
            moved = phi - self.at
        self.at = phi
        total = 0.0
        for element in self.elements:
            force = element[0] + element[1] * moved
            force = min(max(force, -element[2]), element[2])
            element[0] = force
            total += force
        return total


class Drivetrain:
    """One joint's drive with the effects that a reality has there.

    ``drive``: true base parameters, SI; ``effects``: parameters by effect, as `hdagen.blind.realities.effect_sizes`
    draws them; ``step``: length of a simulation step, s.
    """

    def __init__(self, drive: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], step: float) -> None:
        self.effects, self.step = effects, step
        self.ratio = drive["ratio"]
        self.springs = Springs(drive)
        self.level = effects.get("stiffness", {}).get("factor", 1.0)
        self.damping = drive["torsional_damping"] * effects.get("joint_damping", {}).get("factor", 1.0)
        self.gap = effects.get("backlash", {}).get("width", 0.0)
        self.slip: MaxwellSlip | None = None
        if "transmission_hysteresis" in effects:
            self.slip = MaxwellSlip(**effects["transmission_hysteresis"])
        self.dry = drive["coulomb_friction"] + effects.get("coulomb_friction", {}).get("torque", 0.0)
        self.viscous = drive["viscous_friction"] + effects.get("viscous_friction", {}).get("coefficient", 0.0)
        constant = drive["torque_constant"] * effects.get("torque_constant", {}).get("factor", 1.0)
        self.torque_constant = constant
        self.bias = constant * effects.get("current_bias", {}).get("current", 0.0)
        self.kinematic = effects.get("kinematic_error")
        self.ripple, self.stribeck = effects.get("torque_ripple"), effects.get("stribeck_friction")
        self.load, self.asymmetry = effects.get("load_dependent_friction"), effects.get("asymmetric_friction")
        self.presliding, self.thermal = effects.get("presliding_friction"), effects.get("thermal_friction")
        special = (self.ripple, self.stribeck, self.load, self.asymmetry, self.presliding, self.thermal)
        self.plain = not any(special)
        self.warm, self.cold_share = (
            0.0,
            1.0,
        )  # shares: of the settled temperature; of the cold friction left
        self.lost = 0.0  # heat of friction since the last tick, J
        self.bristle = 0.0  # rad
        self.played = 0.0  # rad, output of the play operator
        self.cable, self.unknown = effects.get("cable_spring"), effects.get("unknown")

    def resting_motor_angle(self, q: float, tau: float) -> float:
        """Find the motor angle at which the springs hold a joint at rest.

        Args:
            q: joint angle, rad.
            tau: torque that the springs carry, N m.

        Returns:
            Motor angle, rad.

        """
        size = abs(tau) / self.level
        low, high = 0.0, self.springs.end
        for _ in range(60):
            middle = 0.5 * (low + high)
            if self.springs.torque(middle) < size:
                low = middle
            else:
                high = middle
        phi = 0.0
        if tau:
            phi = math.copysign(low + 0.5 * self.gap, tau)
        theta = self.ratio * (q + phi)
        if self.kinematic:
            for _ in range(20):
                theta = self.ratio * (q + phi - compute_kinematic_lead(self.kinematic, theta)[0])
        return theta

    def compute_torques(self, theta: float, omega: float, q: float, v: float) -> tuple[float, float, float]:
        """Compute the torques of a step.

        Args:
            theta: motor angle, rad.
            omega: motor speed, rad/s.
            q: joint angle, rad.
            v: joint speed, rad/s.

        Returns:
            The torque at the motor without dry friction and current, the level of its dry friction, and the joint
            torque τ, all in N m.

        """
        lead, slope = compute_kinematic_lead(self.kinematic, theta)
        phi = theta / self.ratio - q + lead
        rate = omega * (1.0 / self.ratio + slope) - v
        if self.slip or self.gap:
            tau = self._transmission_torque(phi, rate)
        else:
            tau = self.level * self.springs.torque(phi) + self.damping * rate
        motor = self.bias - self.viscous * self.cold_share * omega - tau * (1.0 / self.ratio + slope)
        level = self.dry
        if self.plain:
            return motor, level, tau
        if self.stribeck:
            p = self.stribeck
            level += p["torque"] * math.exp(-((abs(omega) / p["speed"]) ** p["exponent"]))
        if self.load:
            p = self.load
            level += p["share"] * (math.hypot(tau, p["rounding"]) - p["rounding"]) / self.ratio
        if self.thermal:
            level *= self.cold_share
            self.lost += (level * abs(omega) + self.viscous * self.cold_share * omega * omega) * self.step
        if self.ripple:
            p = self.ripple
            motor += p["torque"] * math.sin(p["order"] * theta + p["phase"])
            motor += p["second_torque"] * math.sin(p["second_order"] * theta + p["second_phase"])
        if self.asymmetry:
            p = self.asymmetry
            motor -= p["torque"] * abs(omega) / (abs(omega) + p["speed"])
        if self.presliding:
            motor -= self._bristle_torque(omega, self.presliding["share"] * level)
            level *= 1.0 - self.presliding["share"]
        return motor, max(level, 0.0), tau

    def link_torque(self, q: float, v: float, other: float, time: float) -> float:
        """Compute the torque of cables and unknown effects.

        Args:
            q: joint angle, rad.
            v: joint speed, rad/s.
            other: angle of the other joint, rad.
            time: time since the start, s.

        Returns:
            Torque at the joint, N m.

        """
        total = 0.0
        if self.cable:  # a hose that yields a little as it bends further
            total -= self.cable["stiffness"] * math.sin(0.8 * (q - self.cable["rest"])) / 0.8
        if self.unknown:
            total += self._unknown_torque(self.unknown, q, v, other, time)
        return total

    def tick(self, period: float) -> None:
        """Advance the heat balance C Ṫ = P − T/R by a sample, in shares of the temperature that ``power`` settles at.

        Args:
            period: length of the sample, s.

        """
        if self.thermal:
            p = self.thermal
            self.warm += (self.lost / period / p["power"] - self.warm) * -math.expm1(-period / p["time"])
            self.lost = 0.0
            self.cold_share = math.exp(self.warm * math.log1p(-p["drop"]))

    def _transmission_torque(self, phi: float, rate: float) -> float:
        """Torque of springs, damper and hysteresis, N m, at torsion ``phi``, rad, that changes by ``rate``, rad/s."""
        loop = 0.0
        if self.slip:
            loop = self.slip.torque(phi)
        if self.gap:
            half = 0.5 * self.gap
            if -half < phi < half:
                return loop  # the flanks are apart: neither spring nor damper reaches across
            phi -= math.copysign(half, phi)
            tau = self.level * self.springs.torque(phi) + self.damping * rate
            # the flanks push and do not pull
            if phi > 0.0:
                return loop + max(tau, 0.0)
            return loop + min(tau, 0.0)
        return self.level * self.springs.torque(phi) + self.damping * rate + loop

    def _bristle_torque(self, omega: float, level: float) -> float:
        """LuGre: ż = ω − |ω| z/δ, solved over the step; F = level (z/δ + damping · ż/δ), level the sliding friction."""
        assert self.presliding is not None
        angle = self.presliding["angle"]
        before = self.bristle
        if omega:
            target = math.copysign(angle, omega)
            self.bristle = target + (before - target) * math.exp(-abs(omega) * self.step / angle)
        rate = (self.bristle - before) / self.step
        force = (self.bristle + self.presliding["damping"] * 1e-2 * rate) / angle
        return level * min(max(force, -1.0), 1.0)

    def _unknown_torque(self, p: Mapping[str, Any], q: float, v: float, other: float, time: float) -> float:
        kind = UNKNOWN_KINDS[int(p["kind"])]
        if kind == "product":  # of this joint's speed and the other's angle
            return p["torque"] * v * math.sin(3.0 * other + p["phase"])
        if kind == "vibration":  # something turns nearby
            return p["torque"] * math.sin(2.0 * math.pi * p["frequency"] * time + p["phase"])
        if kind == "detent":
            return p["torque"] * math.sin(p["order"] * q + p["phase"])
        # a cubic spring that sees the angle through play
        self.played = min(max(self.played, q - p["play"]), q + p["play"])
        return -p["torque"] * (self.played / 0.4) ** 3
