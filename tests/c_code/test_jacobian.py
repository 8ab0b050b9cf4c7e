"""Derivatives of the rate and of the step against finite differences and against CasADi's own, at zero torsion too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import robots
from compiled import EXACT, Compiled, Floats

from gen.effects import NOMINAL
from gen.model.arm_model import Model
from gen.model.right_hand_side import assemble_graphs
from gen.presets import find_presets
from gen.robot.load_robot import load

Builder = Callable[..., Compiled]
MEMORY = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
ON = {
    "kinematic_sine_once": 1e-4,
    "kinematic_cosine_twice": 2e-4,
    "presliding_share": 0.6,
    "presliding_angle": 0.05,
    "coupling": -1.0,
    "hysteresis_torque": 1.5,
    "hysteresis_angle": 2e-4,
    "payload_mass": 0.5,
    "bias": 0.01,
}
STIFF = find_presets()["paper"].read_text() + "".join(
    robots.effect("presliding_friction", j, presliding_share=0.6, presliding_angle=0.05) for j in (1, 2)
)
ARMS = {
    "flexible": ("paper", ()),
    "every effect": ("paper", MEMORY),
    "stiff": (STIFF, MEMORY),
    "rigid": (robots.chain("RPR", 3, friction=0.05), ()),
}


def arm_of(build: Builder, kind: str) -> tuple[Compiled, Floats]:
    """The arm and p with gravity and every effect that it has switched on."""
    robot, effects = ARMS[kind]
    arm = build(robot, effects=effects)
    stem = [name.rstrip("0123456789").rstrip("_") for name in arm.parameters]
    p = np.array([ON.get(name, value) for name, value in zip(stem, arm.nominal, strict=True)])
    p[:2] = 1.0, -9.81
    return arm, p


def states(arm: Compiled, rows: int) -> tuple[Floats, Floats]:
    """x and u at random, the springs within their law and clear of 0, motors fast or slow."""
    rng = np.random.default_rng(31)
    x, u = arm.random(rng, rows, share=0.4), arm.random(rng, rows, "input", share=0.5)
    for j in arm.manifest["flexible"]:
        sign = rng.choice((-1, 1), rows)
        twist = sign * rng.uniform(2e-5, 1.6e-3, rows)
        arm.at(x, f"motor_position_{j}")[:] = 100.0 * (arm.at(x, f"joint_position_{j}") + twist)
        arm.at(x, f"motor_velocity_{j}")[:] = rng.choice((-1, 1), rows) * 10 ** rng.uniform(-1, 2.5, rows)
    return x, u


def differences(f: Callable[[Floats], Floats], at: Floats, step: Floats) -> tuple[Floats, Floats]:
    """∂f/∂at by central differences of order four (outputs × entries), and what rounding may do to each."""
    columns = []
    for k, h in enumerate(step):
        e = np.zeros(at.size)
        e[k] = h
        columns.append((8 * (f(at + e) - f(at - e)) - (f(at + 2 * e) - f(at - 2 * e))) / (12 * h))
    noise = np.abs(f(at)) * 1e-15 + np.abs(f(at * (1 + 4e-15)) - f(at))
    return np.column_stack(columns), 3 * noise[:, None] / step[None, :]


def steps(arm: Compiled, x: Floats, u: Floats, p: Floats) -> tuple[Floats, Floats, Floats]:
    """Widths of the differences: small against what each entry is compared with in the model."""
    hx = np.array([{"motor_position": 1e-4, "joint_position": 1e-6}.get(name[:-2], 1e-4) for name in arm.states])
    if not arm.manifest["flexible"]:
        hx[:] = 1e-4
    turning = np.array([1e-2 if name.startswith("ratio") else 1.0 for name in arm.parameters])  # it turns the springs
    return hx, np.full(u.size, 1e-3), 1e-4 * turning * np.maximum(np.abs(p), 1e-3)


def matrices(flat: list[Floats], nx: int) -> list[Floats]:
    """Column by column -> matrices with nx rows."""
    return [part.reshape(-1, nx).T for part in flat]


def agree(ours: Floats, theirs: tuple[Floats, Floats], bound: float, noise: float = 1.0) -> None:
    """Each entry to ``noise`` times the rounding, and to ``bound`` of the largest in its row or column, the smaller."""
    found, rounding = theirs
    size = np.minimum(np.abs(found).max(axis=1)[:, None], np.abs(found).max(axis=0)[None, :])
    excess = np.abs(ours - found) - bound * size - rounding * noise
    worst = np.unravel_index(int(excess.argmax()), excess.shape)
    assert (excess <= 0.0).all(), (worst, ours[worst], found[worst], rounding[worst])
    assert (np.abs(found) > 10 * rounding).sum() > 0.5 * (found != 0.0).sum(), "rounding hides what is compared"


def compare(
    arm: Compiled,
    flat: list[Floats],
    f: Callable[[Floats, Floats, Floats], Floats],
    at: tuple[Floats, Floats, Floats],
    bounds: tuple[float, float, float],
    noise: float = 1.0,
) -> None:
    """The three derivatives ``flat`` against differences of f(x, u, p) at (x, u, p)."""
    x, u, p = at
    by_x, by_u, by_p = matrices(flat, x.size)
    hx, hu, hp = steps(arm, x, u, p)
    agree(by_x, differences(lambda w: f(w, u, p), x, hx), bounds[0], noise)
    agree(by_u, differences(lambda w: f(x, w, p), u, hu), bounds[1], noise)
    agree(by_p, differences(lambda w: f(x, u, w), p, hp), bounds[2], noise)


@pytest.mark.parametrize("kind", ARMS)
def test_derivatives_of_the_rate_are_finite_differences(build: Builder, kind: str) -> None:
    """By state, input and every parameter."""
    arm, p = arm_of(build, kind)
    (c,) = arm("prepare", p)

    def rate(x: Floats, u: Floats, p: Floats) -> Floats:
        return arm("rhs", x, u, arm("prepare", p)[0])[0]

    for x, u in zip(*states(arm, 12), strict=True):
        compare(arm, arm("rhs_jacobian", x, u, c), rate, (x, u, p), (1e-6, 1e-8, 1e-6))


def test_derivative_by_state_alone_is_the_same(build: Builder) -> None:
    """The stiff step's own derivative, to the bit."""
    arm, p = arm_of(build, "stiff")
    (c,) = arm("prepare", p)
    x, u = states(arm, 200)
    assert np.array_equal(arm("state_jacobian", x, u, c)[0], arm("rhs_jacobian", x, u, c)[0])


def test_stiffness_at_exactly_zero_torsion(build: Builder) -> None:
    """At φ = 0, where |φ| and the sign of φ have no derivative, the springs' 7051 N m/rad stand all the same."""
    arm = build("paper_table1")
    names = ("coulomb_friction", "torsional_damping")
    c = arm.prepare(**{f"{name}_{j}": 0.0 for name in names for j in (1, 2)})
    A = arm("rhs_jacobian", np.zeros(8), np.zeros(4), c)[0].reshape(8, 8).T
    K = 1 / (1 / 9743.94 + 1 / (1e4 * 2.5517))
    assert pytest.approx(7051.0, abs=1.0) == K
    inverse = np.linalg.inv(0.876 * np.array([[2.0, 1.0], [1.0, 1.0]]))
    assert A[4:6, 0:2] == pytest.approx(-np.eye(2) * K / (1e4 * 1.289e-4), rel=1e-12)
    assert A[4:6, 2:4] == pytest.approx(np.eye(2) * K / (1e2 * 1.289e-4), rel=1e-12)
    assert A[6:8, 0:2] == pytest.approx(inverse * K / 1e2, rel=1e-12)
    assert A[6:8, 2:4] == pytest.approx(-inverse * K, rel=1e-12)


def test_stiffness_beyond_the_law_is_the_tangents(build: Builder) -> None:
    """The derivative does not change any more."""
    arm = build("paper_table1")
    c = arm.prepare()
    last = float(arm("outputs", arm.x(), np.zeros(4), c)[2][0]) + 2.1e-3
    column = [arm("rhs_jacobian", arm.x(joint_position_1=-last * f), np.zeros(4), c)[0][2 * 8 + 4] for f in (1.0, 1.5)]
    assert column[0] == column[1] > 10 * 7051.0 / (1e2 * 1.289e-4)


@pytest.mark.parametrize("kind", ["flexible", "rigid"])
def test_derivatives_of_the_step_are_finite_differences(build: Builder, kind: str) -> None:
    """`step_jacobian` against differences of `step`, and its own next state against that of `step`."""
    arm, p = arm_of(build, kind)
    h = [5e-4]

    def step(x: Floats, u: Floats, p: Floats) -> Floats:
        return arm("step", x, u, arm("prepare", p)[0], h)[0]

    for x, u in zip(*states(arm, 8), strict=True):
        after, *flat = arm("step_jacobian", x, u, p, h)
        assert after == pytest.approx(step(x, u, p), rel=1e-13, abs=1e-15)
        compare(arm, flat, step, (x, u, p), (1e-6, 1e-6, 2e-5))


@pytest.mark.parametrize("kind", ["flexible", "rigid"])
def test_derivatives_of_the_step_are_casadis(build: Builder, kind: str, tmp_path: Path) -> None:
    """CasADi differentiates the same Runge–Kutta step of the interpreter's graph, through the springs' polynomial."""
    arm, p = arm_of(build, kind)
    path = tmp_path / "robot.toml"
    path.write_text(ARMS[kind][0])
    graphs = assemble_graphs(Model(load("paper" if kind == "flexible" else str(path)), NOMINAL))
    f = {emitted.name: emitted.graph for emitted in graphs.functions}
    x, u, q = (ca.MX.sym(name, size) for name, size in zip("xup", arm.sizes("step_jacobian")[0], strict=False))
    c, h = f["prepare"](q), 5e-4
    k1 = f["rhs"](x, u, c)
    k2 = f["rhs"](x + h / 2 * k1, u, c)
    k3 = f["rhs"](x + h / 2 * k2, u, c)
    k4 = f["rhs"](x + h * k3, u, c)
    after = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    step = ca.Function("step", [x, u, q], [after, *(ca.jacobian(after, w) for w in (x, u, q))])
    for at, held in zip(*states(arm, 20), strict=True):
        ours, *flat = arm("step_jacobian", at, held, p, [h])
        theirs, *matrix = (np.array(part) for part in step(at, held, p))
        assert ours == pytest.approx(theirs[:, 0], rel=1e-12, abs=1e-14)
        for block, expected in zip(matrices(flat, at.size), matrix, strict=True):
            size = np.abs(expected).max(axis=1, keepdims=True)
            assert (np.abs(block - expected) <= 1e-6 * size).all(), np.abs(block - expected).max()


def test_derivatives_of_the_stiff_step_are_those_of_the_flow(build: Builder) -> None:
    """Bristles and hysteresis: `step_jacobian` against differences of the same 0.1 ms in 32 steps of set-valued RK4.

    With all dry friction in the bristles nothing is set-valued, so the other method integrates the same equations.
    """
    arm, p = arm_of(build, "stiff")
    for name in ("presliding_share_1", "presliding_share_2"):
        p[arm.parameters.index(name)] = 1.0
    (c,) = arm("prepare", p)
    h = 1e-4

    def flow(x: Floats, u: Floats, p: Floats) -> Floats:
        return arm.rollout(x, u[None], arm("prepare", p)[0], h, h / 32, kind=EXACT)[1]

    for x, u in zip(*states(arm, 6), strict=True):
        u[:] *= 0.02
        for j in (1, 2):  # slack springs turned fast: no memory changes its direction within the step
            arm.at(x, f"motor_velocity_{j}")[...] = 40.0 * np.sign(arm.at(x, f"motor_velocity_{j}"))
            arm.at(x, f"joint_velocity_{j}")[...] = 0.0
            arm.at(x, f"motor_position_{j}")[...] = 100.0 * arm.at(x, f"joint_position_{j}") + 2e-3
        after, *flat = arm("step_jacobian", x, u, p, [h])
        assert np.array_equal(after, arm("step", x, u, c, [h])[0])
        compare(arm, flat, flow, (x, u, p), (1e-3, 1e-2, 1e-2), noise=30.0)
