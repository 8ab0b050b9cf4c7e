"""docs/method/errata.md row by row: the printed form of the paper fails, the checked form passes.

Legend (paper's letters): τ_f, τ_w torque of flexspline and wave generator; θ_wi, θ_wo, θ_fi, θ_fo angles in and out;
Δθ_w = θ_wi − θ_wo, Δθ_f = θ_fi − θ_fo; θ_wo = −N θ_fi; Δθ_h whole torsion; Δθ what (12) makes of the encoders.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from sympy.physics.units import energy, force, length
from sympy.physics.units.systems.si import dimsys_SI

from gen.model.lagrangian import derive_lagrangian, make_numeric

N = 100.0
T1, T2, K1, K2, PSI, TAU_FS = 3.9, 12.0, 1.0e4, 1.4e4, 2.9e-4, 0.037  # CSG-17-100, catalogue
C_F, K_F0, C_W, K_W0, K_F = 0.0831, 9743.94, 27.027, 2.5517, 1.0e4  # Table I, as printed
J_MOTOR = 1.21e-4 + 0.079e-4  # Table I, rotor and wave generator
K_M, PEAK_CURRENT = 0.0525, 2.0  # N m/A, Table II; A, section III.B
LARGEST_TWIST = math.pi / (2 * C_F * K_F0) + PSI / 2  # rad, where (10) and (6) end
MID_1, MID_2 = T1 / 2, (T1 + T2) / 2  # N m, the middles of the catalogue's regions 1 and 2

t, tau, c, K = sp.symbols("t tau c K", positive=True)
wave_generator_twist = (1 - sp.exp(-c * tau)) / (c * K)  # (6) for τ > 0, c = c_w and K = K_w0
flexspline_twist = sp.atan(c * tau) / (c * K)  # (10), c = c_f and K = K_f0


def twist_w(torque: float) -> float:
    """(6) with Table I."""
    return math.copysign(1 - math.exp(-C_W * abs(torque)), torque) / (C_W * K_W0)


def twist_f(torque: float) -> float:
    """Δθ_f by adding up dτ/K_f with K_f = K_f0 (1 + (c_f τ)²), without (10)."""
    x, w = np.polynomial.legendre.leggauss(20)
    return float(torque / 2 * np.sum(w / (K_F0 * (1 + (C_F * torque * (x + 1) / 2) ** 2))))


def drive_angles(torque: float, output: float) -> tuple[float, float, float]:
    """θ_wi, θ_wo, θ_fo of a drive at rest that carries τ_f = torque, from the definitions and τ_w = −τ_f/N."""
    out_of_generator = -N * (output + twist_f(torque))
    return out_of_generator + twist_w(-torque / N), out_of_generator, output


# -- the springs ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", [1, -1])
def test_wave_generator_stiffens(side: int) -> None:
    """(5) with (4) gives (6) for both signs of the torque only if the exponent is positive."""

    def follows(exponent: int) -> bool:
        stiffness = K * sp.exp(exponent * c * side * t)  # |τ_w| = side · t on the way to side · τ
        return bool(sp.simplify(sp.integrate(1 / stiffness, (t, 0, side * tau)) - side * wave_generator_twist) == 0)

    assert follows(+1)
    assert not follows(-1)


def test_wave_generator_stiffness_in_six_is_its_own() -> None:
    """K_0 is defined nowhere: of Table I's stiffnesses only K_w0 gives ψ/2 in (30), and the slope of (4) at zero."""
    limit = sp.limit(wave_generator_twist, tau, sp.oo) / N
    table = {"K_w0": K_W0, "K_f0": K_F0, "K_f": K_F}
    limits = {name: float(limit.subs({c: C_W, K: value})) for name, value in table.items()}
    assert [name for name, found in limits.items() if math.isclose(found, PSI / 2, rel_tol=1e-4)] == ["K_w0"]
    zero = sp.Symbol("K_0", positive=True)
    slope = sp.diff(wave_generator_twist.subs(K, zero), tau).subs(tau, 0)
    assert sp.solve(slope - 1 / K, zero) == [K]


def test_flexspline_stiffens_with_torque_not_angle() -> None:
    """Integrating (9) gives (10), and (27) the catalogue's K_1 and K_2, only with τ in the bracket."""
    theta = sp.Symbol("theta", positive=True)
    assert sp.simplify(sp.integrate(1 / (K * (1 + (c * t) ** 2)), (t, 0, tau)) - flexspline_twist) == 0
    printed_torque = sp.integrate(K * (1 + (c * t) ** 2), (t, 0, theta))
    assert sp.simplify(sp.tan(c * K * theta) / c - printed_torque) != 0

    def regions(first: float, second: float) -> bool:
        found = [K_F0 * (1 + (C_F * x) ** 2) for x in (first, second)]
        return np.allclose(found, [K1, K2], rtol=1e-3)

    assert regions(MID_1, MID_2)
    assert not regions(twist_f(MID_1), twist_f(MID_2))  # 1 + 1e-9: an angle of 1 mrad never stiffens it by 40 %


def test_catalogue_gives_table_one_from_mid_torques() -> None:
    """(27) at two points solved for c_f and K_f0: Table I comes out to every digit from the mid-torques alone."""

    def solved(x1: float, x2: float) -> tuple[float, float]:
        slope = (K2 - K1) / (x2**2 - x1**2)
        return round(K1 - slope * x1**2, 2), round(math.sqrt(slope / (K1 - slope * x1**2)), 4)

    assert solved(MID_1, MID_2) == (K_F0, C_F)
    assert solved(T1, T2) != (K_F0, C_F)
    torsion_1, torsion_2 = MID_1 / K1, T1 / K1 + (T2 - T1) / 2 / K2
    assert solved(torsion_1, torsion_2)[0] != K_F0 and solved(torsion_1, torsion_2)[1] > 1000 * C_F
    under_the_root = (K1 - K2) / (K_F0 * (torsion_2**2 - torsion_1**2))
    assert under_the_root < 0  # as printed, c_f is imaginary


def test_cubic_is_the_series_of_the_tangent() -> None:
    """d_1 and d_3 of (8) match the inverse of (10) up to the fifth order; those of (9) as printed do not."""
    x = sp.Symbol("x", positive=True)

    def error(d1: sp.Expr, d3: sp.Expr) -> sp.Expr:
        return sp.expand(sp.series(sp.tan(c * K * x) / c - d1 * x - d3 * x**3, x, 0, 5).removeO())

    assert error(K, c**2 * K**3 / 3) == 0
    assert error(K, c**2 * K / 3) != 0
    whole = flexspline_twist + wave_generator_twist.subs({c: C_W, K: K_W0, tau: tau / N}) / N  # Δθ_h of (11) with (2)
    slope = float(1 / sp.diff(whole, tau).subs({tau: 0, c: C_F, K: K_F0}))
    assert round(slope) == 7051  # so with d_1 = K_f0 the angle in (8) is Δθ_f, not Δθ_h


def test_wave_generator_limit_is_seen_at_the_joint() -> None:
    """(30) is ψ/2, an angle of the joint: the limit of (6) divided by N. At the wave generator it is N times off."""
    limit = float(sp.limit(wave_generator_twist, tau, sp.oo).subs({c: C_W, K: K_W0}))
    right_side = 1 / (C_W * N * K_W0)
    assert math.isclose(right_side, PSI / 2, rel_tol=1e-4)
    assert math.isclose(limit / N, right_side, rel_tol=1e-12) and not math.isclose(limit, right_side, rel_tol=0.5)


# -- the torque estimate --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("torque", [-11.0, -0.4, 0.05, 3.0, 20.0])
def test_total_torsion_has_a_minus(torque: float) -> None:
    """Two springs wound by a torque; (12), (15), (16) must give it back. The software's θ/N − q is the same Δθ."""
    wi, _, fo = drive_angles(torque, output=0.7)

    def estimate(total: float) -> float:
        return math.tan((total + twist_w(-torque / N) / N) * C_F * K_F0) / C_F

    assert math.isclose(estimate(-(fo + wi / N)), torque, rel_tol=1e-9)
    assert not math.isclose(estimate(fo + wi / N), torque, rel_tol=0.1)
    motor_position, joint_position = -wi, fo  # both positive in the joint's direction
    assert math.isclose(motor_position / N - joint_position, -(fo + wi / N), abs_tol=1e-15)


@pytest.mark.parametrize("output", [-2.0, -0.1, 0.1, 0.7])
def test_motor_encoder_is_the_wave_generator_s(output: float) -> None:
    """With the motor's encoder as θ_wi the torsion is within the law's reach; exchanged, as large as the motion."""
    motor_encoder, _, optical_encoder = drive_angles(5.0, output)
    assert abs(-(optical_encoder + motor_encoder / N)) < LARGEST_TWIST
    assert abs(-(motor_encoder + optical_encoder / N)) > 1000 * LARGEST_TWIST


def friction_settles(motor_torque: float, held: float) -> float:
    """τ_w after a slow rise of the motor torque: a rotor on the locked drive's spring, wound to ``held``."""
    stiffness, viscous, h = 7051 / N**2, 0.05, 2e-4
    twist, speed = held / stiffness, 0.0
    for step in range(10_000):
        drive = motor_torque * min(1.0, step * h)
        free = speed + h / J_MOTOR * (drive - stiffness * twist)
        # set-valued friction, solved implicitly: it takes as much of the speed as it can, and no more
        speed = math.copysign(max(abs(free) - h / J_MOTOR * TAU_FS, 0.0), free) / (1 + h / J_MOTOR * viscous)
        twist += h * speed
    return stiffness * twist


def test_between_the_breakaways_the_joint_sticks() -> None:
    """(17) against a rotor that feels Coulomb's friction: driven either way, and at rest with and without a load."""

    def printed(motor: float, flexspline: float) -> float:
        if motor == TAU_FS:
            return flexspline / N
        return motor - TAU_FS if motor > TAU_FS else motor + TAU_FS

    def checked(motor: float, flexspline: float) -> float:
        if abs(motor) <= TAU_FS:
            return -flexspline / N
        return motor - math.copysign(TAU_FS, motor)

    cases = {"driven": (0.06, 0.0), "driven back": (-0.06, 0.0), "unpowered": (0.0, 0.0), "too weak": (0.02, 0.0)}
    cases |= {"loaded": (0.0, 0.015), "loaded at breakaway": (TAU_FS, 0.015)}
    right: dict[str, list[str]] = {"printed": [], "checked": []}
    for name, (motor, held) in cases.items():
        settled = friction_settles(motor, held)
        for form in (printed, checked):
            if math.isclose(form(motor, -N * held), settled, abs_tol=1e-6):
                right[form.__name__].append(name)
    assert right == {"printed": ["driven", "driven back"], "checked": list(cases)}


def test_friction_takes_power() -> None:
    """τ_m ω less what accelerates the rotor and what goes into the drive is lost, both ways: never negative."""
    inertia, viscous, coulomb, speed = sp.symbols("J r tau_fs omega", positive=True)
    rate, acceleration, load = sp.symbols("rate acceleration tau_w", real=True)

    def loss(friction: sp.Expr, direction: int) -> sp.Expr:
        motor = inertia * acceleration + viscous * rate + load + friction
        lost = motor * rate - inertia * acceleration * rate - load * rate
        return sp.expand(lost.subs(rate, direction * speed))

    assert all(loss(coulomb * sp.sign(rate), direction).is_positive for direction in (1, -1))
    slow = {viscous: 4e-5, coulomb: TAU_FS, speed: 1}
    assert loss(-coulomb, 1).subs(slow) < 0


def test_motor_inertia_turns_with_the_motor() -> None:
    """Stored energy changes by τ_m θ̇_wi − τ_w θ̇_wo, whatever the spring, only with J on θ_wi."""
    J, motor, spring = sp.symbols("J tau_m tau_w", real=True)
    rate = dict(zip(("wi", "wo"), sp.symbols("rate_wi rate_wo", real=True), strict=True))
    acceleration = dict(zip(("wi", "wo"), sp.symbols("acc_wi acc_wo", real=True), strict=True))

    def balances(carrier: str) -> bool:
        law = {acceleration[carrier]: (motor - spring) / J}  # (18) without friction
        into = motor * rate["wi"] - spring * rate["wo"]
        change = [J * rate[x] * acceleration[x] + spring * (rate["wi"] - rate["wo"]) for x in ("wi", "wo")]
        return any(sp.expand(one.subs(law) - into) == 0 for one in change)

    assert balances("wi")
    assert not balances("wo")

    def stored(sign: int) -> sp.Expr:
        difference = -sign * wave_generator_twist  # θ_wi − θ_wo for θ_wo = θ_wi + sign · Δθ_w
        return sp.integrate(t * sp.diff(difference, tau).subs(tau, t), (t, 0, tau)).subs({c: C_W, K: K_W0, tau: 0.02})

    assert stored(-1) > 0
    assert stored(+1) < 0  # as printed the spring gives work when it is wound


@pytest.mark.parametrize("torque", [-12.0, -5.0, 5.0, 12.0])
def test_joint_torque_is_the_secant(torque: float) -> None:
    """The flexspline is wound by adding up dτ/K_f; (10) gives its torque back, tangent times angle does not."""
    _, wo, fo = drive_angles(torque, output=-0.3)
    across = fo + wo / N
    assert math.isclose(math.tan(-C_F * K_F0 * across) / C_F, torque, rel_tol=1e-9)
    tangent = K_F0 * (1 + (C_F * torque) ** 2)
    assert tangent * across * torque < 0  # as printed even the sign is wrong, for the reason of (12)
    assert abs(tangent * across / torque) > 1.1
    assert abs(K_F * across) < 0.98 * abs(torque)  # nor does Table I's constant K_f


# -- the arm --------------------------------------------------------------------------------------------------------


def test_force_matrix_is_in_the_frame_of_link_two() -> None:
    """The derived Jacobian turned into the frame of link 2 is (20) with l_1 in the first entry; l_1 = l_2 hides it."""
    model = derive_lagrangian(("revolute", "revolute"))
    l1, l2 = sp.symbols("length_1 length_2", real=True)
    q1, q2 = model.q
    turned = sp.rot_ccw_axis3(q1 + q2)[:2, :2]  # link 2 -> base
    derived = (turned.T * model.jacobian).T

    def matrix(first: sp.Expr) -> sp.Matrix:
        return sp.Matrix([[first * sp.sin(q2), l2 + l1 * sp.cos(q2)], [0, l2]])

    assert sp.simplify(matrix(l1) - derived) == sp.zeros(2, 2)
    assert sp.simplify(matrix(l2) - derived) != sp.zeros(2, 2)
    assert sp.simplify((matrix(l2) - derived).subs(l2, l1)) == sp.zeros(2, 2)
    assert sp.simplify(matrix(l1) - model.jacobian.T) != sp.zeros(2, 2)  # so X, Y take a turn by θ_1 + θ_2 more


def inverse(
    point: np.ndarray | tuple[float, float], l1: float, l2: float, branch: int, quadrants: bool = True
) -> tuple[float, float]:
    """(21) of a point; ``quadrants`` False keeps the printed arctan(y/x). ValueError out of reach."""
    x, y = point
    r2 = x * x + y * y
    elbow = math.acos((r2 - l1 * l1 - l2 * l2) / (2 * l1 * l2))
    shoulder = math.acos((r2 + l1 * l1 - l2 * l2) / (2 * l1 * math.sqrt(r2)))
    return (math.atan2(y, x) if quadrants else math.atan(y / x)) - branch * shoulder, branch * elbow


@pytest.mark.parametrize("l1, l2", [(0.15, 0.15), (0.2, 0.13)])
def test_inverse_kinematics_takes_a_position(l1: float, l2: float) -> None:
    """Forward of inverse is the point, on both branches and in all quadrants; a force in its place reaches nothing."""
    numbers = make_numeric(derive_lagrangian(("revolute", "revolute")))
    p = {f"{name}_{j}": 1.0 for name in ("mass", "center_of_mass", "inertia") for j in (1, 2)}
    p |= {"gravity_x": 0.0, "gravity_y": 0.0, "length_1": l1, "length_2": l2}

    def reaches(angles: tuple[float, float], point: np.ndarray) -> bool:
        return np.allclose(numbers.tip(angles, (0.0, 0.0), p), point, atol=1e-9)

    for posture in np.random.default_rng(1).uniform(-math.pi, math.pi, (40, 2)):
        point = numbers.tip(posture, (0.0, 0.0), p)
        both = [inverse(point, l1, l2, branch) for branch in (1, -1)]
        assert all(reaches(angles, point) for angles in both)
        nearest = min(np.abs(np.exp(1j * np.array(angles)) - np.exp(1j * posture)).max() for angles in both)
        assert nearest < 1e-6  # the posture it came from is one of the two
        assert reaches(inverse(point, l1, l2, 1, quadrants=False), point) == (point[0] > 0)
        assert not reaches(inverse((0.12, -0.09), l1, l2, 1), point)  # a push of 0.15 N taken for metres
    for outside in ((15.0, 0.0), (0.0, l1 + l2 + 1e-6)):  # 15 N in the place of metres is out of reach too
        with pytest.raises(ValueError, match="math domain error"):
            inverse(outside, l1, l2, 1)


def test_impedance_error_is_actual_less_desired() -> None:
    """(24) solved for the F that makes (22) hold is (25) only with x_e = x − x_d; else (25) feeds back positively."""
    m, M, B, K_c, F_e = sp.symbols("m M B K F_e", positive=True)
    e, e_rate, e_acc, desired_acc, control = sp.symbols("e e_rate e_acc xdd_d F", real=True)
    printed_25 = (m / M - 1) * F_e + m * desired_acc - m / M * (B * e_rate + K_c * e)
    values = {m: 2.0, M: 1.5, B: 20.0, K_c: 100.0, F_e: 0.0}

    def loop(sign: int) -> tuple[bool, float]:
        motion = sp.Eq(m * (desired_acc + sign * e_acc), control + F_e)  # x = x_d + sign · x_e in (24)
        wanted = motion.subs(e_acc, (F_e - B * e_rate - K_c * e) / M)  # (22)
        derived = sp.simplify(sp.solve(wanted, control)[0] - printed_25) == 0
        closed = sp.solve(motion.subs(control, printed_25), e_acc)[0].subs(values)
        system = np.array([[0, 1], [closed.coeff(e), closed.coeff(e_rate)]], dtype=float)
        return bool(derived), float(np.linalg.eigvals(system).real.max())

    derived, growth = loop(+1)
    assert derived and growth < 0
    derived, growth = loop(-1)
    assert not derived and growth > 0


# -- texts and tables -----------------------------------------------------------------------------------------------


def test_citations_name_the_equations_that_do_it() -> None:
    """Joint torque of a tip force is (20), by virtual work; (22) and (23) pass through the compliance and miss it.

    II.C calls on (20) for the inverse kinematics. That can only be checked by dimension: solved, (20) is a force, and
    arguments of arccos are numbers, which (21) has with lengths and not with forces.
    """
    model = derive_lagrangian(("revolute", "revolute"))
    q = np.array([0.4, 0.9])
    p = {str(symbol): 0.2 for symbol in model.parameters} | {"length_1": 0.2, "length_2": 0.13}
    numbers, rest, small = make_numeric(model), np.zeros(2), np.array([1e-5, -2e-5])
    tip_force, stiffness, (a, b) = np.array([15.0, -4.0]), 100.0, q
    work = tip_force @ (numbers.tip(q + small / 2, rest, p) - numbers.tip(q - small / 2, rest, p))
    in_link = np.array([[np.cos(a + b), np.sin(a + b)], [-np.sin(a + b), np.cos(a + b)]]) @ tip_force
    by_20 = np.array([[0.2 * np.sin(b), 0.13 + 0.2 * np.cos(b)], [0.0, 0.13]]) @ in_link
    angle_error = np.linalg.solve(numbers.jacobian(q, rest, p), tip_force / stiffness)  # of x_e = F/K, (22) at rest
    assert math.isclose(by_20 @ small, work, rel_tol=1e-8)
    assert not math.isclose(stiffness * angle_error @ small, work, rel_tol=0.1)  # K θ_e, (23) at rest

    def pure_number(dimension: object) -> bool:
        return dimsys_SI.get_dimensional_dependencies(dimension) == {}

    torque = energy
    assert dimsys_SI.equivalent_dims(torque / length, force) and not pure_number(torque / length)
    assert pure_number(length**2 / (length * length)) and not pure_number(force**2 / (length * length))


def test_masses_are_grams_in_one_table_and_kilograms_in_the_other() -> None:
    """Equal sets (by B and K) stand in Table III, Fig. 21 and Table V; they are one controller after conversion only.

    The physics: a set's compliance 1/(M s² + B s + K), at one turn a second, cannot depend on where it is printed.
    """
    impedance = {(1e-10, 1e-5): (0.001, 1.0), (1e-7, 1e-12): (0.0015, 1.5)}  # (B, K): Table III or Fig. 21, Table V
    admittance = {(1.0, 10.0): (500.0, 500.0)}  # Fig. 21, Table V

    def compliance(mass: float, damping: float, stiffness: float) -> float:
        s = 2j * math.pi
        return abs(1 / (mass * s**2 + damping * s + stiffness))

    def same(sets: dict[tuple[float, float], tuple[float, float]], unit: float) -> bool:
        pairs = [(compliance(a, *rest), compliance(b * unit, *rest)) for rest, (a, b) in sets.items()]
        return all(math.isclose(first, second, rel_tol=1e-9) for first, second in pairs)

    gram, kilogram = 1e-3, 1.0
    assert same(impedance, gram) and same(admittance, kilogram)
    assert not any(same(impedance, unit) and same(admittance, unit) for unit in (gram, kilogram))


def test_four_newton_metres_are_at_the_joint() -> None:
    """Of four readings only 4 N m at the joint breaks the wave generator away and stays below the motor's peak."""
    readings = {(0.4, "motor"): 0.4, (0.4, "joint"): 0.4 / N, (4.0, "motor"): 4.0, (4.0, "joint"): 4.0 / N}
    assert [r for r, at_motor in readings.items() if TAU_FS < at_motor <= K_M * PEAK_CURRENT] == [(4.0, "joint")]


def test_table_four_holds_tracking_errors() -> None:
    """Max, mean and std of one error obey mean² + std² ≤ max²; as M, B, K they would contradict Table III's ratios.

    What the title ought to say cannot be derived; the rows can be held against both readings.
    """
    columns = np.array([[3.1, 1.5, 2.4], [3.6, 0.3, 1.8], [3.4, 0.4, 1.7], [3.7, 1.5, 0.8]])  # mm
    largest, mean, deviation = columns.T
    assert np.all(mean**2 + deviation**2 <= largest**2)
    table_three = np.array([[0.001, 1e-10, 1e-5], [1000.0, 0.5, 10.0]])  # M, B, K: impedance, admittance
    ratios = table_three[1] / table_three[0]
    assert np.all(ratios > 1e5) and np.all(columns[2:] / columns[:2] < 10)


# -- the published list ---------------------------------------------------------------------------------------------


def test_list_and_tests_agree() -> None:
    """Every row of docs/method/errata.md is whole and names a test here; every test here has its row."""
    text = (Path(__file__).parents[2] / "docs" / "method" / "errata.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    head, _, *body = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    assert head == ["eq.", "printed", "checked", "how it shows", "test"]
    assert all(len(row) == 5 and all(row) for row in body)
    tests = [name for name in globals() if name.startswith("test_") and name != "test_list_and_tests_agree"]
    assert sorted(row[4] for row in body) == sorted(f"`{name}`" for name in tests)
