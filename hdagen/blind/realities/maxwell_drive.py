"""One joint's drive in the family "maxwell", with other formulas than `hdagen.blind.realities.drivetrain`.

| effect | formula |
|---|---|
| friction of the motor | set-valued, with a bound for each direction |
| viscous friction | thins with shear, c ω/(1 + |ω|/ω_t) |
| Stribeck friction | a Lorentzian, T/(1 + (ω/ω_s)²) |
| presliding | Maxwell slip: springs of graded stiffness that slide one after another |
| hysteresis | Dahl, dF = T/δ (1 − F/T sign dφ) dφ, solved over the step |
| warming | a film and a housing, each a node of heat; friction falls as 1/(1 + c T) |
| ripple | a sine that a second one bends |
| springs | the torsion law, tabulated by torque and inverted by interpolation |

Legend: θ motor angle, ω its speed; q, v joint angle and speed; N ratio; φ = θ/N − q + Δ torsion; τ joint torque.
Source: Al-Bender, Lampaert, Swevers, IEEE Trans. Autom. Control 50 (2005) 1883 (Maxwell slip); Dahl, AIAA J. 14 (1976)
1675.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hdagen.blind.realities.kinematic_lead import compute_kinematic_lead

_LAW_CELLS = 16384  # of the spring table
_LAW_LIMIT = 12.0  # c_f τ up to which the spring law holds, as in robot_toml.md
_GRADED_ELEMENTS = 5  # of presliding
_THINNING_SPEED = 3000.0  # rad/s, at which viscous friction has half its slope
_HOUSING_TIME_RATIO = 5.0  # time constant of the housing by that of the film
_FILM_SHARE = 0.8  # share of the warming that is the film's
_RIPPLE_BEND = 0.15  # rad, by which the ripple's own phase bends it
_CABLE_STIFFENING = 0.12  # 1/rad², growth of a cable's stiffness with the square of its bend


class LawTable:
    """The springs' torque over torsion: the torsion of many torques, inverted by interpolation between them."""

    def __init__(self, drive: Mapping[str, float]) -> None:
        k, c = drive["flexspline_stiffness"], drive["flexspline_stiffening"]
        kw, cw, ratio = drive["wave_generator_stiffness"], drive["wave_generator_stiffening"], drive["ratio"]
        last = _LAW_LIMIT / c
        # dense where the springs stiffen fastest, near zero torque
        tau = last * np.linspace(0.0, 1.0, 8 * _LAW_CELLS) ** 2
        phi = np.arctan(c * tau) / (c * k) - np.expm1(-cw * tau / ratio) / (cw * ratio * kw)
        self.end = float(phi[-1])
        table = np.interp(np.linspace(0.0, self.end, _LAW_CELLS + 1), phi, tau)
        self.values: list[float] = table.tolist()
        self.per_cell = _LAW_CELLS / self.end
        self.end_stiffness = 1.0 / (1.0 / (k * (1.0 + _LAW_LIMIT**2)) + math.exp(-cw * last / ratio) / (ratio**2 * kw))

    def read_torque(self, phi: float) -> float:
        """Read the springs' torque.

        Args:
            phi: torsion, rad.

        Returns:
            Joint torque, N m.

        """
        place = abs(phi) * self.per_cell
        cell = int(place)
        if cell >= _LAW_CELLS:
            tau = self.values[-1] + self.end_stiffness * (abs(phi) - self.end)
        else:
            low = self.values[cell]
            tau = low + (place - cell) * (self.values[cell + 1] - low)
        return -tau if phi < 0.0 else tau


class MaxwellDrive:
    """One joint's drive with the effects that a reality has there.

    ``drive``: true base parameters, SI; ``effects``: parameters by effect, as `hdagen.blind.realities.effect_sizes`
    draws them; ``step``: length of a simulation step, s.
    """

    def __init__(self, drive: Mapping[str, float], effects: Mapping[str, Mapping[str, float]], step: float) -> None:
        self.effects, self.step, self.ratio = effects, step, drive["ratio"]
        self.law, self.inertia = LawTable(drive), drive["motor_inertia"]
        self.level = effects.get("stiffness", {}).get("factor", 1.0)
        self.damping = drive["torsional_damping"] * effects.get("joint_damping", {}).get("factor", 1.0)
        self.half_gap = 0.5 * effects.get("backlash", {}).get("width", 0.0)
        self.dry = drive["coulomb_friction"] + effects.get("coulomb_friction", {}).get("torque", 0.0)
        self.viscous, self.more_viscous = (
            drive["viscous_friction"],
            effects.get("viscous_friction", {}).get("coefficient", 0.0),
        )
        self.torque_constant = drive["torque_constant"] * effects.get("torque_constant", {}).get("factor", 1.0)
        self.bias = self.torque_constant * effects.get("current_bias", {}).get("current", 0.0)
        self.one_sided = effects.get("asymmetric_friction", {}).get("torque", 0.0)
        self.kinematic, self.ripple = effects.get("kinematic_error"), effects.get("torque_ripple")
        self.stribeck, self.load = effects.get("stribeck_friction"), effects.get("load_dependent_friction")
        self.presliding, self.thermal = effects.get("presliding_friction"), effects.get("thermal_friction")
        self.hysteresis, self.loop, self.torsion = effects.get("transmission_hysteresis"), 0.0, math.nan
        self.slips = [0.0] * _GRADED_ELEMENTS  # rad, extension of each element
        self.film = self.housing = 0.0  # shares of the temperature that the stated power settles at
        self.heat, self.cold_share = 0.0, 1.0  # J since the last row; share of the cold friction left

    def find_rest_angle(self, q: float, tau: float) -> float:
        """Find the motor angle at which the springs hold a joint at rest.

        Args:
            q: joint angle, rad.
            tau: torque that the springs carry, N m.

        Returns:
            Motor angle, rad.

        """
        size = abs(tau) / self.level
        phi = math.copysign(float(np.searchsorted(self.law.values, size)) / self.law.per_cell, tau)
        for _ in range(60):  # Newton's steps, within a cell of the table
            slope = 0.5 * (self.law.read_torque(phi + 1e-7) - self.law.read_torque(phi - 1e-7)) / 1e-7
            phi += (tau / self.level - self.law.read_torque(phi)) / slope
        if tau:
            phi += math.copysign(self.half_gap, tau)
        theta = self.ratio * (q + phi)
        for _ in range(20):
            theta = self.ratio * (q + phi - compute_kinematic_lead(self.kinematic, theta)[0])
        return theta

    def compute_torques(self, theta: float, omega: float, q: float, v: float) -> tuple[float, float, float, float]:
        """Compute the torques of a step.

        Args:
            theta: motor angle, rad.
            omega: motor speed, rad/s.
            q: joint angle, rad.
            v: joint speed, rad/s.

        Returns:
            The torque at the motor without current and dry friction; the bounds of dry friction against forward and
            against backward motion; and the joint torque τ; all in N m.

        """
        per_turn, lead = 1.0 / self.ratio, 0.0
        if self.kinematic:
            lead, slope = compute_kinematic_lead(self.kinematic, theta)
            per_turn += slope
        tau = self._join_torque(theta / self.ratio - q + lead, omega * per_turn - v)
        motor = self.bias - self.cold_share * self.viscous * omega - tau * per_turn
        if self.more_viscous:
            motor -= self.cold_share * self.more_viscous * omega / (1.0 + abs(omega) / _THINNING_SPEED)
        level = self.dry
        if self.stribeck:
            level += self.stribeck["torque"] / (1.0 + (omega / self.stribeck["speed"]) ** 2)
        if self.load:
            level += self.load["share"] * abs(tau) / self.ratio
        if self.thermal:
            level *= self.cold_share
            self.heat += (
                (level + self.cold_share * (self.viscous + self.more_viscous) * abs(omega)) * abs(omega) * self.step
            )
        if self.ripple:
            motor += _bend_ripple(self.ripple, theta)
        if self.presliding:
            share = self.presliding["share"]
            motor -= self._slip_torque(omega * self.step, share * level)
            level *= 1.0 - share
        return motor, max(level + self.one_sided, 0.0), max(level - self.one_sided, 0.0), tau

    def cable_torque(self, q: float) -> float:
        """Compute the torque of a cable that stiffens as it bends.

        Args:
            q: joint angle, rad.

        Returns:
            Torque at the joint, N m; 0 without a cable.

        """
        p = self.effects.get("cable_spring")
        if not p:
            return 0.0
        bend = q - p["rest"]
        return -p["stiffness"] * bend * (1.0 + _CABLE_STIFFENING * bend * bend)

    def warm_up(self, period: float) -> None:
        """Advance the heat of film and housing by a row.

        Args:
            period: length of the row, s.

        """
        p = self.thermal
        if p:
            power = self.heat / period / p["power"]
            self.film += (_FILM_SHARE * power - self.film) * -math.expm1(-period / p["time"])
            self.housing += ((1.0 - _FILM_SHARE) * power - self.housing) * -math.expm1(
                -period / (_HOUSING_TIME_RATIO * p["time"])
            )
            self.heat = 0.0
            self.cold_share = 1.0 / (1.0 + (self.film + self.housing) * p["drop"] / (1.0 - p["drop"]))

    def _join_torque(self, phi: float, rate: float) -> float:
        """Torque of springs, damper, play and hysteresis, N m."""
        loop = 0.0
        if self.hysteresis:
            loop = self._dahl_torque(phi)
        if not self.half_gap:
            return self.level * self.law.read_torque(phi) + self.damping * rate + loop
        beyond = abs(phi) - self.half_gap
        if beyond <= 0.0:
            return loop
        side = math.copysign(1.0, phi)
        tau = self.level * self.law.read_torque(side * beyond) + self.damping * rate
        return loop + side * max(side * tau, 0.0)  # teeth push and do not pull

    def _dahl_torque(self, phi: float) -> float:
        assert self.hysteresis is not None
        moved = 0.0 if math.isnan(self.torsion) else phi - self.torsion
        self.torsion = phi
        if moved:
            most = math.copysign(self.hysteresis["torque"], moved)
            self.loop = most + (self.loop - most) * math.exp(-abs(moved) / self.hysteresis["angle"])
        return self.loop

    def _slip_torque(self, moved: float, level: float) -> float:
        """Torque of the slip elements, N m, that a motor moved by an angle, rad; each slides at its own."""
        assert self.presliding is not None
        total = 0.0
        for k in range(_GRADED_ELEMENTS):
            most = 2.0 * self.presliding["angle"] * (k + 1) / _GRADED_ELEMENTS
            self.slips[k] = min(max(self.slips[k] + moved, -most), most)
            total += self.slips[k] / most
        return level * total / _GRADED_ELEMENTS


def _bend_ripple(p: Mapping[str, float], theta: float) -> float:
    first, second = p["order"] * theta + p["phase"], p["second_order"] * theta + p["second_phase"]
    bent = math.sin(first + _RIPPLE_BEND * math.sin(first))
    return p["torque"] * bent + p["second_torque"] * math.sin(second)
