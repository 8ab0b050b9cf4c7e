"""The drive's laws: torsion, its inverse, their numbers, resonance, and the torque–torsion loop of the paper's Fig. 3b.

`Law` writes (11) with (2), checked form, in numpy from the robot file's numbers; the compiled arm has to agree with it.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from compiled import EXACT, Compiled, Floats
from hypothesis import assume, given, settings
from hypothesis import strategies as some

from gen.effects.effect import Signals
from gen.effects.transmission_hysteresis import EFFECT as HYSTERESIS
from gen.model import harmonic_drive
from gen.presets import find_presets
from gen.robot.description import Value
from gen.robot.load_robot import load

Builder = Callable[..., Compiled]
PSI = 2.9e-4  # rad, hysteresis loss of the catalogue
PHI = 1e-12  # rad, the bound on the inverse


@dataclass(frozen=True)
class Law:
    """Flexspline and wave generator in series, exact up to ``law_torque`` (N m), along the tangent beyond."""

    flexspline_stiffness: float = 9743.94
    flexspline_stiffening: float = 0.0831
    wave_generator_stiffness: float = 2.5517
    wave_generator_stiffening: float = 27.027
    ratio: float = 100.0
    law_torque: float = 12.0 / 0.0831

    def inside(self, tau: Any) -> Any:
        """φ of a torque within the law."""
        flexspline = np.arctan(self.flexspline_stiffening * tau) / (
            self.flexspline_stiffening * self.flexspline_stiffness
        )
        softness = self.wave_generator_stiffening * self.ratio * self.wave_generator_stiffness
        return (
            flexspline - np.sign(tau) * np.expm1(-self.wave_generator_stiffening * np.abs(tau) / self.ratio) / softness
        )

    def compliance(self, tau: Any) -> Any:
        """dφ/dτ within the law: (9) checked and the wave generator's (4) checked, in series."""
        flexspline = self.flexspline_stiffness * (1 + (self.flexspline_stiffening * tau) ** 2)
        faded = np.exp(-self.wave_generator_stiffening * np.abs(tau) / self.ratio)
        return 1 / flexspline + faded / (self.ratio**2 * self.wave_generator_stiffness)

    def torsion(self, tau: Any) -> Any:
        """φ, rad."""
        inside = np.clip(tau, -self.law_torque, self.law_torque)
        return self.inside(inside) + (tau - inside) * self.compliance(np.float64(self.law_torque))


def torques(arm: Compiled, phi: Floats, c: Floats, effects: dict[str, Floats] | None = None) -> Floats:
    """Joint torque of joint 1, N m, at rest with the springs turned by φ (and memories as given)."""
    x = np.zeros((phi.size, len(arm.states)))
    arm.at(x, "joint_position_1")[:] = -phi
    for name, value in (effects or {}).items():
        arm.at(x, name)[:] = value
    return arm("outputs", x, np.zeros((phi.size, 4)), c)[4][:, 0]


# -- the law and its inverse ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_inverse_returns_the_torsion_over_law_continuation_and_spread(build: Builder, profile: str) -> None:
    """φ → τ → φ within 1e-12 rad, from 1 nrad to one and a half times the law, for springs off by up to the spread."""
    arm = build("paper_table1", profile)
    nominal = Law()
    for factors in itertools.product((1 / harmonic_drive.SPRING_SPREAD, 1.0, harmonic_drive.SPRING_SPREAD), repeat=4):
        own = Law(
            nominal.flexspline_stiffness * factors[0],
            nominal.flexspline_stiffening * factors[1],
            nominal.wave_generator_stiffness * factors[2],
            nominal.wave_generator_stiffening * factors[3],
        )
        names = list(vars(own))[:4]
        c = arm.prepare(**{f"{name}_1": getattr(own, name) for name in names})
        last = own.torsion(np.float64(own.law_torque))
        phi = np.concatenate([np.geomspace(1e-9, 1e-5, 60), np.linspace(1e-5, 1.5 * last, 600)])
        tau = torques(arm, phi, c)
        assert np.abs(own.torsion(tau) - phi).max() <= PHI, factors
        assert (np.diff(tau[60:]) > 0).all(), factors
        assert (np.diff(tau[:60]) > 0).all(), factors


def test_torque_is_odd_to_the_bit_and_smooth_at_zero(build: Builder) -> None:
    """τ(−φ) = −τ(φ); the slope through zero is one number from both sides: 7051 N m/rad."""
    arm = build("paper_table1")
    c = arm.prepare()
    phi = np.concatenate([np.geomspace(1e-12, 1e-5, 200), np.linspace(1e-5, 4e-3, 500)])
    assert np.array_equal(torques(arm, -phi, c), -torques(arm, phi, c))
    tiny = np.array([1e-9, 1e-8, 1e-7])
    stiffness = torques(arm, tiny, c) / tiny
    assert stiffness == pytest.approx(1 / (1 / 9743.94 + 1 / (1e4 * 2.5517)), rel=1e-4)
    assert stiffness == pytest.approx(7051.0, abs=1.0)


def test_continuation_is_the_tangent_and_is_reported(build: Builder) -> None:
    """Beyond law_torque the torque grows with the law's slope there; `outputs` says where."""
    arm, law = build("paper_table1"), Law()
    c = arm.prepare()
    last = float(law.torsion(np.float64(law.law_torque)))
    phi = last * np.linspace(1.0, 2.0, 200)
    tau = torques(arm, phi, c)
    assert np.diff(tau) / np.diff(phi) == pytest.approx(1 / law.compliance(np.float64(law.law_torque)), rel=1e-6)
    assert tau[0] == pytest.approx(law.law_torque, rel=1e-6)
    x = np.array(
        [arm.x(joint_position_1=-last * f, joint_position_2=last * g) for f, g in ((0.99, 1.01), (1.01, 0.99))]
    )
    assert np.array_equal(arm("outputs", x, np.zeros((2, 4)), c)[3], [[0, 1], [1, 0]])


def test_numbers_of_table_1() -> None:
    """Ranges of the law, stiffness at the catalogue's T2 and at 30 N m, the wave generator's share at zero torque."""
    law = Law()
    endless = Law(law_torque=np.inf)
    assert endless.inside(np.float64(1e9)) == pytest.approx(2.08e-3, abs=0.005e-3)
    assert endless.inside(np.float64(1e9)) == pytest.approx(np.pi / (2 * 0.0831 * 9743.94) + PSI / 2, rel=1e-3)
    assert np.pi / (2 * 0.0831 * 9743.94) == pytest.approx(1.94e-3, abs=0.005e-3)
    flexspline = 9743.94 * (1 + (0.0831 * np.array([12.0, 30.0])) ** 2)
    assert flexspline == pytest.approx([19_400, 70_000], rel=5e-3)
    share = 1 / (1e4 * 2.5517) / law.compliance(np.float64(0.0))
    assert share == pytest.approx(0.28, abs=0.005)


def test_energy_of_the_springs_is_the_integral_of_their_torque(build: Builder) -> None:
    """∫ τ dφ by Gauss–Legendre against `energy`, from within the law and from beyond it."""
    arm = build("paper_table1")
    c = arm.prepare()
    nodes, weights = np.polynomial.legendre.leggauss(200)
    last = float(Law().torsion(np.float64(Law().law_torque)))
    for end in (1e-5, 5e-4, 0.99 * last, 1.5 * last):
        parts = [(0.0, min(end, last)), (last, end)] if end > last else [(0.0, end)]
        work = 0.0
        for low, high in parts:
            work += (high - low) / 2 * float(weights @ torques(arm, (high - low) / 2 * nodes + (high + low) / 2, c))
        stored = arm("energy", arm.x(joint_position_1=-end), c)[1][0]
        assert stored == pytest.approx(work, rel=1e-8)


def gears(count: int) -> list[Law]:
    """Laws as from a catalogue, over three decades of size: c_w = 1/τ_fs, K_w0 = 2 τ_fs/(N ψ), (28) to (31)."""
    rng = np.random.default_rng(8)
    laws = []
    for _ in range(count):
        N, psi, start = rng.uniform(30, 200), rng.uniform(0.5e-4, 6e-4), 10 ** rng.uniform(-2.5, 0)
        K_f, T2 = 10 ** rng.uniform(3, 6), 10 ** rng.uniform(0, 3)
        c_f = rng.uniform(0.3, 1.5) / T2
        laws.append(Law(K_f, c_f, 2 * start / (N * psi), 1 / start, N, rng.uniform(1.0, 12.0) / c_f))
    return laws


@pytest.mark.parametrize("law", gears(6), ids=lambda law: f"{law.flexspline_stiffness:.0f}")
def test_plan_keeps_its_word_for_other_gears(law: Law) -> None:
    """Whatever plan is chosen for a drive, the inverse stays within 1e-12 rad of the law written here."""
    base = load("paper_table1").joints[0].drive
    stated = base.__class__(**(vars(base) | {name: Value(value, 0.05) for name, value in vars(law).items()}))
    chosen = harmonic_drive.plan_inverse([stated])
    k = harmonic_drive.spring_constants(vars(law))
    coefficients = harmonic_drive.inverse_coefficients(k, chosen.degree)
    tau = law.law_torque * np.concatenate([np.geomspace(1e-8, 1e-2, 50), np.linspace(0.01, 1.6, 200)])
    phi = law.torsion(tau)
    found = np.array([float(harmonic_drive.spring_torque(value, k, coefficients, chosen)) for value in phi])
    assert np.abs(law.torsion(found) - phi).max() <= PHI


def test_a_law_too_sharp_to_invert_is_refused() -> None:
    """A wave generator that is used up within a thousandth of the law leaves no polynomial; the plan says so."""
    base = load("paper_table1").joints[0].drive
    law = Law(999_999.0, 1e-4, 1.0, 1.0, 30.0, 3e4)
    stated = base.__class__(**(vars(base) | {name: Value(value, 0.05) for name, value in vars(law).items()}))
    with pytest.raises(ValueError, match="too sharp for law_torque; lower law_torque"):
        harmonic_drive.plan_inverse([stated])


# -- resonance --------------------------------------------------------------------------------------------------------


def frequency(arm: Compiled, **changes: float) -> float:
    """Hz at which joint 1 swings against its motor, joint 2's link free, by the derivative of φ̈ by θ at zero torque."""
    c = arm.prepare(torsional_damping_1=0.0, torsional_damping_2=0.0, **changes)
    nx = len(arm.states)
    A = arm("rhs_jacobian", np.zeros(nx), np.zeros(4), c)[0].reshape(nx, nx).T
    column = A[:, arm.states.index("motor_position_1")]
    acceleration = column[arm.states.index("motor_velocity_1")] / 100.0 - column[arm.states.index("joint_velocity_1")]
    return float(np.sqrt(-acceleration * 100.0) / (2 * np.pi))


def test_resonance_of_table_1(build: Builder) -> None:
    """18.5 Hz with both springs; 22 Hz with K_f = 10,000 and a rigid wave generator."""
    arm = build("paper_table1")
    assert frequency(arm) == pytest.approx(18.5, abs=0.05)
    stiff = {"flexspline_stiffness_1": 1e4, "wave_generator_stiffness_1": 1e6}
    assert frequency(arm, **stiff) == pytest.approx(22.0, abs=0.1)


def test_resonances_of_the_light_arm(build: Builder) -> None:
    """Modes of ∂ẋ/∂x are those of M(q), rotors and 7051 N m/rad: 48 Hz at a right angle, 139 Hz half a radian bent."""
    arm = build("paper")
    free = {
        f"{name}_{j}": 0.0 for name in ("torsional_damping", "viscous_friction", "coulomb_friction") for j in (1, 2)
    }
    c = arm.prepare(**free)
    K = 1 / Law(flexspline_stiffening=0.08313).compliance(np.float64(0.0))
    lowest, highest = {}, {}
    for elbow in (0.0, 0.5, np.pi / 2, np.pi):
        x = arm.x(joint_position_2=elbow, motor_position_2=100.0 * elbow)
        A = arm("rhs_jacobian", x, np.zeros(4), c)[0].reshape(8, 8).T
        modes = np.sort(np.abs(np.linalg.eigvals(A).imag) / (2 * np.pi))[[5, 7]]
        M = arm("mass_matrix", np.array([0.0, elbow]), c)[0].reshape(2, 2)
        springs = K * (np.linalg.inv(M) + np.eye(2) / (1e4 * 1.289e-4))
        assert modes == pytest.approx(np.sqrt(np.sort(np.linalg.eigvals(springs))) / (2 * np.pi), rel=1e-6)
        lowest[elbow], highest[elbow] = modes
    assert lowest[np.pi / 2] == pytest.approx(48.0, abs=0.5)
    assert highest[0.5] == pytest.approx(139.0, abs=0.5)


# -- the loop of Fig. 3b ----------------------------------------------------------------------------------------------


def loop(arm: Compiled, hysteresis: float, stiff: bool) -> tuple[Floats, Floats]:
    """Torsion and joint torque of joint 1 over one cycle, its motor locked by friction, its tip pushed to and fro."""
    locked = {f"coulomb_friction_{j}": 50.0 for j in (1, 2)}
    memory = {f"hysteresis_torque_{j}": hysteresis for j in (1, 2)} if stiff else {}
    c = arm.prepare(**locked, **memory)
    t = np.arange(0.0, 7.5, 0.005)
    u = np.zeros((t.size, 4))
    u[:, 3] = 40.0 * np.sin(2 * np.pi * t / 5.0)  # ±12 N m at joint 1
    x = arm.rollout(arm.x(), u, c, 0.005, 0.0005, kind=EXACT)[:-1]
    assert not arm.at(x, "motor_position_1").any(), "the input is not locked"
    outputs = arm("outputs", x, u, c)
    last = t >= 2.5
    return outputs[2][last, 0], outputs[4][last, 0]


def crossings(phi: Floats, tau: Floats) -> Floats:
    """Torsions at which the torque passes zero."""
    k = np.flatnonzero(np.diff(np.sign(tau)) != 0)
    return phi[k] - tau[k] * (phi[k + 1] - phi[k]) / (tau[k + 1] - tau[k])


def test_the_papers_law_alone_closes_no_loop(build: Builder) -> None:
    """Input locked: the torsion at zero torque is the same from both sides, within what the dashpot leaves."""
    phi, tau = loop(build("paper"), 0.0, stiff=False)
    assert tau.max() > 10.0
    assert np.ptp(crossings(phi, tau)) < 0.02 * PSI


def test_with_hysteresis_the_loop_has_the_catalogues_width(build: Builder) -> None:
    """A = ψ K(0)/2 opens it to ψ (less the 4 % by which the drive stiffens up to A), and every cycle costs its area."""
    A = PSI * 7051.0 / 2
    arm = build(
        "paper", effects=("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
    )
    phi, tau = loop(arm, A, stiff=True)
    width = np.ptp(crossings(phi, tau))
    assert width == pytest.approx(2 * float(Law(flexspline_stiffening=0.08313).torsion(np.float64(A))), rel=0.02)
    assert width == pytest.approx(PSI, rel=0.05)
    area = float(np.sum((tau[1:] + tau[:-1]) / 2 * np.diff(phi)))
    assert area == pytest.approx(2 * A * np.ptp(phi), rel=0.1)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(some.lists(some.floats(-2e-3, 2e-3), min_size=2, max_size=6), some.floats(2e-5, 1e-3), some.floats(0.01, 10.0))
def test_closed_paths_of_torsion_cost_energy(corners: list[float], angle: float, speed: float) -> None:
    """Once the memory has become periodic on a closed path, hysteresis has taken energy, the same at any speed."""
    p = {"hysteresis_torque": 1.0, "hysteresis_angle": angle, "memory_step": 1e-9}  # a memory that no step slows
    stops = np.array([*corners, corners[0]])
    lengths, signs = np.abs(np.diff(stops)), np.sign(np.diff(stops))
    assume(lengths.sum() > 0.1 * angle)
    z = work = 0.0
    for _ in range(2 + int(15 * angle / lengths.sum())):  # the start is forgotten by exp(−15)
        work = 0.0
        for length, sign in zip(lengths, signs, strict=True):
            count = 1 + int(length / (0.05 * angle))
            for _ in range(count):  # midpoint rule along the path
                step, half = length / count, length / count / 2
                rate = float(HYSTERESIS.equation(moving(sign * speed, z), p)[1][0]) / speed
                torque, (middle,) = HYSTERESIS.equation(moving(sign * speed, z + half * rate), p)
                work += float(torque) * sign * step
                z += step * float(middle) / speed
    assert -1.0 <= z <= 1.0
    assert work > 0.0


def moving(torsion_rate: float, z: float) -> Signals:
    """What the hysteresis reads."""
    return Signals(torsion_rate=torsion_rate, states={"hysteresis": z})


def test_presets_state_the_numbers_used_here() -> None:
    """`Law` holds what paper_table1 says."""
    d = tomllib.loads(find_presets()["paper_table1"].read_text())["joint"][0]["drive"]
    for name in list(vars(Law()))[:5]:
        assert d[name] == getattr(Law(), name)
