"""Energy: kept where nothing takes it, balanced where something does, never given by friction, damping, hysteresis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import robots
from compiled import Compiled, Floats

Builder = Callable[..., Compiled]
STATES = 20_000
MEMORY = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
LOSSLESS = {
    f"{name}_{j}": 0.0 for name in ("viscous_friction", "coulomb_friction", "torsional_damping") for j in (1, 2)
}
MANY = LOSSLESS | {  # every effect, without loss
    "gravity_x": 2.0,
    "gravity_y": -9.81,
    "payload_mass_2": 0.7,
    "coupling_2": -1.0,
    "kinematic_sine_once_1": 1e-4,
    "kinematic_cosine_twice_1": -2e-4,
    "kinematic_cosine_once_2": 1.5e-4,
    "kinematic_sine_twice_2": 2e-4,
}
LOSSES = {
    "viscous_friction": 2e-4,
    "coulomb_friction": 0.04,
    "torsional_damping": 6.0,
    "presliding_share": 0.7,
    "presliding_angle": 0.03,
    "hysteresis_torque": 1.0,
    "hysteresis_angle": 1e-4,
}
LOSSY = {f"{name}_{j}": value for name, value in LOSSES.items() for j in (1, 2)}


def states(arm: Compiled, rows: int) -> Floats:
    """Random states of a flexible arm with the springs turned by up to 1 mrad, and memories within ±1."""
    rng = np.random.default_rng(3)
    x = arm.random(rng, rows, share=0.5)
    for j in (1, 2):
        ratio = 100.0
        arm.at(x, f"motor_position_{j}")[:] = ratio * (
            arm.at(x, f"joint_position_{j}") + rng.uniform(-1e-3, 1e-3, rows)
        )
        arm.at(x, f"motor_velocity_{j}")[:] = ratio * (arm.at(x, f"joint_velocity_{j}") + rng.uniform(-0.1, 0.1, rows))
    return x


def power(arm: Compiled, x: Floats, u: Floats, c: Floats) -> Floats:
    """d/dt of kinetic and potential energy along the flow, W, by central differences over 0.1 µs."""
    h = 1e-7
    rate = arm("rhs", x, u, c)[0]
    ahead, behind = (np.sum(arm("energy", x + s * h * rate, c), axis=0)[:, 0] for s in (1, -1))
    return (ahead - behind) / (2 * h)


def torsion_rate(arm: Compiled, x: Floats, j: int, p: dict[str, float]) -> Floats:
    """φ̇ with the kinematic error's part."""
    theta, omega = arm.at(x, f"motor_position_{j}"), arm.at(x, f"motor_velocity_{j}")
    gear = (
        0.01
        + p.get(f"kinematic_sine_once_{j}", 0) * np.cos(theta)
        - p.get(f"kinematic_cosine_once_{j}", 0) * np.sin(theta)
    )
    gear += 2 * p.get(f"kinematic_sine_twice_{j}", 0) * np.cos(2 * theta) - 2 * p.get(
        f"kinematic_cosine_twice_{j}", 0
    ) * np.sin(2 * theta)
    return gear * omega - arm.at(x, f"joint_velocity_{j}")


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_energy_is_kept_without_loss(build: Builder, profile: str) -> None:
    """Table I released at rest from 5 N m in each spring: 1e-6 of its energy over 10 s at 0.1 ms."""
    arm = build("paper_table1", profile)
    c = arm.prepare(**LOSSLESS)
    turned = 100.0 * (
        np.arctan(0.0831 * 5.0) / (0.0831 * 9743.94) + (1 - np.exp(-27.027 * 0.05)) / (27.027 * 100.0 * 2.5517)
    )
    start = arm.x(motor_position_1=turned, motor_position_2=turned)
    torque = arm("outputs", start, np.zeros(4), c)[4]
    assert torque == pytest.approx([5.0, 5.0], rel=1e-8)
    x = arm.rollout(start, np.zeros((10_000, 4)), c, 1e-3, 1e-4)
    energy = np.sum(arm("energy", x, c), axis=0)[:, 0]
    kinetic = arm("energy", x, c)[0][:, 0]
    assert kinetic.max() > 0.5 * energy[0] > 0.0, "an arm that does not swing keeps its energy anyhow"
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-6


def test_power_balances_with_every_conservative_effect(build: Builder) -> None:
    """d/dt energy is the power of motors and push: kinematic error, coupling, payload and springs lose nothing."""
    arm = build("paper", effects=MEMORY)
    c = arm.prepare(**MANY)
    x = states(arm, STATES)
    u = arm.random(np.random.default_rng(4), STATES, "input")
    motors = 0.0525 * sum(u[:, j - 1] * arm.at(x, f"motor_velocity_{j}") for j in (1, 2))
    outputs = next(f["outputs"] for f in arm.manifest["functions"] if f["name"] == "outputs")
    tip_velocity = arm("outputs", x, u, c)[[name for name, _ in outputs].index("tip_velocity")]
    given = motors + (u[:, 2:] * tip_velocity).sum(axis=1)
    assert np.abs(power(arm, x, u, c) - given).max() < 1e-6 * np.abs(given).max()


def test_losses_take_exactly_what_their_laws_say(build: Builder) -> None:
    """Every loss is the product of a force and a speed, with the memories wherever they are; the balance shows each."""
    arm = build("paper", effects=MEMORY)
    p = MANY | LOSSY
    c = arm.prepare(**p)
    x = states(arm, STATES // 10)
    u = np.zeros((x.shape[0], 4))
    taken = np.zeros(x.shape[0])
    for j in (1, 2):
        omega, phi_rate = arm.at(x, f"motor_velocity_{j}"), torsion_rate(arm, x, j, p)
        dry = 0.04 * (0.7 * arm.at(x, f"bristle_{j}") + 0.3 * np.tanh(omega / 1.0))
        taken += 2e-4 * omega**2 + dry * omega + 6.0 * phi_rate**2 + arm.at(x, f"hysteresis_{j}") * phi_rate
    assert np.abs(power(arm, x, u, c) + taken).max() < 1e-6 * np.abs(taken).max()


def test_nothing_that_dissipates_gives_energy(build: Builder) -> None:
    """At random states, with what the memories' springs store (½ level δ z²) counted, energy never grows by itself."""
    arm = build("paper", effects=MEMORY)
    c = arm.prepare(**(MANY | LOSSY))
    x = states(arm, STATES)
    u = np.zeros((STATES, 4))
    rate = arm("rhs", x, u, c)[0]
    stored = np.zeros(STATES)
    stored += sum(0.7 * 0.04 * 0.03 * arm.at(x, f"bristle_{j}") * arm.at(rate, f"bristle_{j}") for j in (1, 2))
    stored += sum(1e-4 * arm.at(x, f"hysteresis_{j}") * arm.at(rate, f"hysteresis_{j}") for j in (1, 2))
    total = power(arm, x, u, c) + stored
    assert total.max() < 1e-8 * np.abs(total).max()
    assert np.median(total) < -1.0


def test_a_swinging_arm_with_losses_comes_to_rest(build: Builder) -> None:
    """From a random state energy with its stores only falls, step after step, until nothing moves."""
    arm = build("paper", effects=MEMORY)
    c = arm.prepare(**(MANY | LOSSY | {"gravity_x": 0.0, "gravity_y": 0.0}))  # smooth friction creeps under a load
    start = states(arm, 1)[0]
    x = arm.rollout(start, np.zeros((8000, 4)), c, 1e-3, 5e-4)
    total = np.sum(arm("energy", x, c), axis=0)[:, 0]
    total += sum(0.7 * 0.04 * 0.03 / 2 * arm.at(x, f"bristle_{j}") ** 2 for j in (1, 2))
    total += sum(1e-4 / 2 * arm.at(x, f"hysteresis_{j}") ** 2 for j in (1, 2))
    assert np.diff(total).max() < 1e-6 * (total[0] - total[-1])
    assert np.abs(x[0, 4:8]).max() > 10.0
    assert np.abs(x[-1, 4:8]).max() < 1e-6


@pytest.mark.parametrize("kinds", ["RPR", "RRRRRR"])
def test_mass_matrix_is_positive_and_its_rate_less_2C_is_skew(build: Builder, kinds: str) -> None:
    """M symmetric positive definite and Ṁ − 2C skew at many states."""
    n = len(kinds)
    arm = build(robots.chain(kinds, {"RPR": 3, "RRRRRR": 4}[kinds]))
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-3, 3, (STATES, n)), rng.uniform(-3, 3, (STATES, n))
    c, h = arm.prepare(), 1e-6

    def M(at: Floats) -> Floats:
        return arm("mass_matrix", at, c)[0].reshape(-1, n, n)

    mass = M(q)
    assert np.array_equal(mass, mass.transpose(0, 2, 1))
    np.linalg.cholesky(mass)  # raises where one is not positive definite
    C = arm("coriolis_matrix", q, v, c)[0].reshape(-1, n, n).transpose(0, 2, 1)
    S = (M(q + h * v) - M(q - h * v)) / (2 * h) - 2 * C
    assert np.abs(C).max() > 1.0
    assert np.abs(S + S.transpose(0, 2, 1)).max() < 1e-7 * np.abs(C).max()
