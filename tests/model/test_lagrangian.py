"""The SymPy derivation holds the laws of mechanics, and the CasADi graph of the chain agrees with it to 1e-12."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray

from gen.model.chain_dynamics import ChainDynamics
from gen.model.kinematic_chain import planar_links
from gen.model.lagrangian import Lagrangian, derive_lagrangian, make_numeric

R, P = "revolute", "prismatic"
CHAINS = [(R,), (P,), (R, R), (R, P), (P, R), (P, P), (R, P, R), (P, R, P), (R, R, R)]
STATES = 20

Vector = NDArray[np.float64]
Sample = tuple[Vector, Vector, dict[str, float]]


def ids(kinds: tuple[str, ...]) -> str:
    return "".join(kind[0].upper() for kind in kinds)


every_chain = pytest.mark.parametrize("kinds", CHAINS, ids=ids)


def sample(model: Lagrangian, seed: int) -> Sample:
    """A random state and random parameters of a physical arm, with gravity in any direction."""
    rng = np.random.default_rng(seed)
    values = {str(p): float(rng.uniform(0.1, 2.0)) for p in model.parameters}
    values |= {"gravity_x": float(rng.uniform(-10, 10)), "gravity_y": float(rng.uniform(-10, 10))}
    values |= {f"length_{j}": 0.0 for j, kind in enumerate(model.kinds, start=1) if kind == P}
    n = len(model.q)
    return rng.uniform(-np.pi, np.pi, n), rng.uniform(-3, 3, n), values


def samples(model: Lagrangian) -> list[Sample]:
    return [sample(model, seed) for seed in range(STATES)]


def close(found: Any, expected: Any, bound: float = 1e-12) -> None:
    """Equal within ``bound`` of the largest entry."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    assert found.shape == expected.shape
    scale = max(1.0, float(np.max(np.abs(expected))))
    assert float(np.max(np.abs(found - expected))) <= bound * scale


# -- the derivation itself ------------------------------------------------------------------------------------------


@every_chain
def test_mass_matrix_is_symmetric_and_positive_definite(kinds: tuple[str, ...]) -> None:
    model = derive_lagrangian(kinds)
    for q, v, p in samples(model):
        M = make_numeric(model).mass_matrix(q, v, p)
        close(M, M.T)
        assert np.linalg.eigvalsh(M).min() > 0


@every_chain
def test_kinetic_energy_is_the_mass_matrix_form(kinds: tuple[str, ...]) -> None:
    model = derive_lagrangian(kinds)
    numbers = make_numeric(model)
    for q, v, p in samples(model):
        close(numbers.kinetic_energy(q, v, p), v @ numbers.mass_matrix(q, v, p) @ v / 2)


@every_chain
def test_rate_of_the_mass_matrix_less_twice_coriolis_is_skew(kinds: tuple[str, ...]) -> None:
    model = derive_lagrangian(kinds)
    h = 1e-5
    numbers = make_numeric(model)
    for q, v, p in samples(model):
        rate = (numbers.mass_matrix(q + h * v, v, p) - numbers.mass_matrix(q - h * v, v, p)) / (2 * h)
        skew = rate - 2 * numbers.coriolis_matrix(q, v, p)
        close(skew, -skew.T, bound=1e-7)  # the difference quotient errs by h²


@pytest.mark.parametrize("kinds", [(R, R), (R, P), (P, R)], ids=ids)
def test_energy_is_conserved_for_every_symbol(kinds: tuple[str, ...]) -> None:
    """With M q̈ = −C q̇ − g, the change of T + V along the motion is zero as an expression, not at samples."""
    model = derive_lagrangian(kinds)
    v = sp.Matrix(model.v)
    energy = model.kinetic_energy + model.potential_energy
    along = sum(sp.diff(energy, q_k) * v_k for q_k, v_k in zip(model.q, model.v, strict=True))
    force = -(model.coriolis_matrix * v + model.gravity)  # M q̈, and ∂T/∂q̇ is M q̇
    assert sp.simplify(sp.expand(along + v.dot(force))) == 0
    torqued = sp.expand(along + v.dot(force) + v[0])  # a torque of 1 on joint 1 must show as its power
    assert sp.simplify(torqued) == v[0]


@every_chain
def test_equations_of_motion_are_euler_and_lagrange_s(kinds: tuple[str, ...]) -> None:
    """d/dt ∂L/∂q̇ − ∂L/∂q along q(t) = polynomials of t, differentiated by SymPy in t, at t = 0."""
    model = derive_lagrangian(kinds)
    t = sp.Symbol("t")
    for seed in range(2):
        q0, v0, p = sample(model, seed)
        a0 = np.random.default_rng(seed + 100).uniform(-5, 5, len(q0))
        numbered = {symbol: p[str(symbol)] for symbol in model.parameters}
        L = (model.kinetic_energy - model.potential_energy).subs(numbered)
        path = {q: a + b * t + c * t**2 / 2 for q, a, b, c in zip(model.q, q0, v0, a0, strict=True)}
        speed = {v: b + c * t for v, b, c in zip(model.v, v0, a0, strict=True)}
        expected = [
            float((sp.diff(sp.diff(L, v).subs(speed).subs(path), t) - sp.diff(L, q).subs(speed).subs(path)).subs(t, 0))
            for q, v in zip(model.q, model.v, strict=True)
        ]
        numbers = make_numeric(model)
        bias = numbers.coriolis_matrix(q0, v0, p) @ v0 + numbers.gravity(q0, v0, p)
        close(numbers.mass_matrix(q0, v0, p) @ a0 + bias, expected)


@every_chain
def test_jacobian_is_the_tip_s_difference_quotient(kinds: tuple[str, ...]) -> None:
    model = derive_lagrangian(kinds)
    numbers = make_numeric(model)
    h = 1e-5
    for q, v, p in samples(model):
        step = h * np.eye(len(q))
        columns = [(numbers.tip(q + d, v, p) - numbers.tip(q - d, v, p)) / (2 * h) for d in step]
        close(numbers.jacobian(q, v, p), np.array(columns).T, bound=1e-8)


def test_pendulum_on_paper() -> None:
    """One link, gravity down, q = 0 along x: M = I + m r², g = m 9.81 r cos q; at 90° the tip is above the joint."""
    numbers = make_numeric(derive_lagrangian((R,)))
    p = {
        "gravity_x": 0.0,
        "gravity_y": -9.81,
        "length_1": 0.5,
        "mass_1": 2.0,
        "center_of_mass_1": 0.3,
        "inertia_1": 0.1,
    }
    close(numbers.mass_matrix([0.4], [0.0], p), [[0.28]])
    close(numbers.gravity([0.4], [0.0], p), [2.0 * 9.81 * 0.3 * np.cos(0.4)])
    close(numbers.tip([np.pi / 2], [0.0], p), [0.0, 0.5])


def test_slider_on_paper() -> None:
    """A slider on a turning link: centrifugal force m (r + q2 + l1) ω², and the Coriolis torque 2 m (…) ω q̇2."""
    numbers = make_numeric(derive_lagrangian((R, P)))
    p = {"gravity_x": 0.0, "gravity_y": 0.0, "length_1": 0.5, "mass_1": 1.0, "center_of_mass_1": 0.2, "inertia_1": 0.1}
    p |= {"length_2": 0.0, "mass_2": 3.0, "center_of_mass_2": 0.1, "inertia_2": 0.2}
    arm = 0.5 + 0.4 + 0.1
    force = numbers.coriolis_matrix([0.7, 0.4], [2.0, -1.5], p) @ [2.0, -1.5]
    close(force, [2 * 3.0 * arm * 2.0 * -1.5, -3.0 * arm * 2.0**2])
    close(numbers.tip([np.pi / 2, 0.4], [0.0, 0.0], p), [0.0, 0.9])


# -- drives ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", [(R, P), (R, R, R)], ids=ids)
def test_rigid_drive_adds_the_reflected_rotor_to_the_diagonal(kinds: tuple[str, ...]) -> None:
    bare, rigid = derive_lagrangian(kinds), derive_lagrangian(kinds, ("rigid",) * len(kinds))
    for q, v, p in samples(rigid):
        rotors = [p[f"ratio_{j}"] ** 2 * p[f"motor_inertia_{j}"] for j in range(1, len(kinds) + 1)]
        close(make_numeric(rigid).mass_matrix(q, v, p), make_numeric(bare).mass_matrix(q, v, p) + np.diag(rotors))
        close(make_numeric(rigid).coriolis_matrix(q, v, p), make_numeric(bare).coriolis_matrix(q, v, p))


def test_flexible_drive_that_cannot_twist_is_the_rigid_one() -> None:
    flexible, rigid = derive_lagrangian((R, R), ("flexible", "flexible")), derive_lagrangian((R, R), ("rigid", "rigid"))
    locked = {
        sp.Symbol(f"motor_velocity_{j}", real=True): sp.Symbol(f"ratio_{j}", real=True) * rigid.v[j - 1] for j in (1, 2)
    }
    assert sp.expand(flexible.kinetic_energy.subs(locked) - rigid.kinetic_energy) == 0
    assert sp.expand(flexible.kinetic_energy - rigid.kinetic_energy) != 0


def test_joint_torque_is_the_slope_of_the_stored_energy() -> None:
    """A quartic U(φ), φ = θ/N − q, for any: τ enters as τ/N at the motor and as −τ at the joint."""
    model = derive_lagrangian((R, P), ("rigid", "flexible"))
    assert [str(q) for q in model.q] == ["motor_position_2", "joint_position_1", "joint_position_2"]
    theta, _, slide = model.q
    ratio, phi, k = sp.Symbol("ratio_2", real=True), sp.Symbol("phi"), sp.Symbol("k")
    law = sp.Lambda(phi, k * phi**4 / 4)
    torque = k * (theta / ratio - slide) ** 3
    potential = model.potential_energy.subs(sp.Function("stored_energy_2"), law).doit()
    expected = sp.Matrix([sp.diff(potential, q) for q in model.q])
    found = (model.gravity + model.spring_torques).subs(model.joint_torques[0], torque)
    assert sp.expand(found - expected) == sp.zeros(3, 1)
    assert model.spring_torques.subs(model.joint_torques[0], 1) == sp.Matrix([1 / ratio, 0, -1])


def test_what_cannot_be_derived_is_refused_in_one_go() -> None:
    with pytest.raises(ValueError, match="screw") as refused:
        derive_lagrangian((R, "screw"), ("rigid", "soft", "rigid"))
    lines = str(refused.value).splitlines()
    assert len(lines) == 3
    assert "joint 2 is 'screw'" in lines[1] and "revolute, prismatic" in lines[1]
    assert "joint 2 is 'soft'" in lines[2] and "flexible, rigid" in lines[2]
    for count in (0, 4):
        with pytest.raises(ValueError, match=f"1 to 3 joints, not for {count}"):
            derive_lagrangian((R,) * count)
    with pytest.raises(ValueError, match="spring energy"):
        make_numeric(derive_lagrangian((R,), ("flexible",)))


# -- against the CasADi graph ---------------------------------------------------------------------------------------


def chain_of(kinds: tuple[str, ...]) -> ChainDynamics:
    """The chain in the plane."""
    return ChainDynamics(*planar_links(kinds), in_space=False)


@cache
def graph(kinds: tuple[str, ...]) -> ca.Function:
    """Everything ``gen.model.chain_dynamics`` says of the chain, as one CasADi function of q, v, a, the tip force and
    the parameters."""
    model, chain, n = derive_lagrangian(kinds), chain_of(kinds), len(kinds)
    q, v, a, force = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n), ca.SX.sym("force", 2)
    vector = ca.SX.sym("p", len(model.parameters))
    p = {str(symbol): vector[k] for k, symbol in enumerate(model.parameters)}
    gravity = (p["gravity_x"], p["gravity_y"])
    outputs = [
        chain.mass_matrix(q, p),
        chain.coriolis_matrix(q, v, p),
        chain.gravity_torque(q, p),
        chain.bias_torque(q, v, p),
        chain.tip_position(q, p),
        chain.tip_jacobian(q, p),
        chain.newton_euler(q, v, a, p, gravity, (force[0], force[1])),
    ]
    return ca.Function("chain", [q, v, a, force, vector], outputs)


@every_chain
def test_casadi_graph_agrees(kinds: tuple[str, ...]) -> None:
    model = derive_lagrangian(kinds)
    numbers = make_numeric(model)
    for seed, (q, v, p) in enumerate(samples(model)):
        rng = np.random.default_rng(1000 + seed)
        a, force = rng.uniform(-5, 5, len(q)), rng.uniform(-20, 20, 2)
        found = [np.array(value) for value in graph(kinds)(q, v, a, force, [p[str(s)] for s in model.parameters])]
        M, C, g = numbers.mass_matrix(q, v, p), numbers.coriolis_matrix(q, v, p), numbers.gravity(q, v, p)
        J = numbers.jacobian(q, v, p)
        close(found[0], M)
        close(found[1], C)
        close(found[2].ravel(), g)
        close(found[3].ravel(), C @ v + g)
        close(found[4].ravel(), numbers.tip(q, v, p))
        close(found[5], J)
        close(found[6].ravel(), M @ a + C @ v + g - J.T @ force)


@pytest.mark.parametrize("kinds", [(R,), (R, R), (P, R), (R, P)], ids=ids)
def test_casadi_tip_mass_is_a_point_at_the_derived_tip(kinds: tuple[str, ...]) -> None:
    """The kinetic energy of a point that moves with the derived tip: it adds m Jᵀ J to M and −m Jᵀ(gravity) to g."""
    model = derive_lagrangian(kinds)
    numbers = make_numeric(model)
    for q, v, p in samples(model):
        mass = 0.7
        loaded = {name: ca.SX(value) for name, value in (p | {"tip_mass": mass}).items()}
        M, g = chain_of(kinds).mass_matrix(ca.SX(q), loaded), chain_of(kinds).gravity_torque(ca.SX(q), loaded)
        J = numbers.jacobian(q, v, p)
        pull = np.array([p["gravity_x"], p["gravity_y"]])
        close(np.array(ca.DM(ca.evalf(M))), numbers.mass_matrix(q, v, p) + mass * J.T @ J)
        close(np.array(ca.DM(ca.evalf(g))).ravel(), numbers.gravity(q, v, p) - mass * J.T @ pull)


def test_casadi_inverse_branches_reach_the_derived_tip() -> None:
    """Both postures put the tip where it was, one is the posture it came from, and out of reach there is none."""
    model = derive_lagrangian((R, R))
    numbers = make_numeric(model)
    for q, v, p in samples(model):
        point = numbers.tip(q, v, p)
        postures = np.array(
            ca.DM(ca.evalf(chain_of((R, R)).inverse_branches(ca.SX(point), {k: ca.SX(x) for k, x in p.items()})))
        )
        assert postures[1, 0] >= 0 >= postures[1, 1]
        for posture in postures.T:
            close(numbers.tip(posture, v, p), point, bound=1e-9)
        assert min(np.abs(np.exp(1j * posture) - np.exp(1j * q)).max() for posture in postures.T) < 1e-6
        beyond = ca.SX(point / np.linalg.norm(point) * (p["length_1"] + p["length_2"] + 0.01))
        nowhere = ca.DM(ca.evalf(chain_of((R, R)).inverse_branches(beyond, {k: ca.SX(x) for k, x in p.items()})))
        assert np.isnan(np.array(nowhere)).all()
