"""Steps over time: their order, their accuracy, bristles, and friction that sticks exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import robots
from arms import WHOLE
from compiled import BATCH, BATCH_OWN, EXACT, Compiled, Floats
from scipy.integrate import solve_ivp

from gen.presets import find_presets

Builder = Callable[..., Compiled]
MEMORY = ("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
HELD = 5e-4  # s: the current is sampled at 2 kHz and held


def bristles(angle: float = 0.02) -> str:
    """Table I with all dry friction in bristles that yield over ``angle`` rad of the motor."""
    text = find_presets()["paper_table1"].read_text().replace('Table I"', 'Table I, bristles"')
    own = {"presliding_share": 1.0, "presliding_angle": angle}
    return text + "".join(robots.effect("presliding_friction", j, **own) for j in (1, 2))


def sine(amplitude: float, hertz: float, end: float, held: float = HELD) -> Floats:
    """Rows of u: the same current in both motors."""
    t = np.arange(0.0, end - held / 2, held)
    u = np.zeros((t.size, 4))
    u[:, :2] = (amplitude * np.sin(2 * np.pi * hertz * t))[:, None]
    return u


def links(x: Floats) -> Floats:
    """Link angles of a flexible two-joint arm."""
    return x[..., 2:4]


# -- smooth friction: RK4 ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_runge_kutta_is_of_order_four_and_keeps_1e_6_at_half_a_millisecond(build: Builder, profile: str) -> None:
    """Table I, friction smoothed at 1 rad/s, 2 A (0.105 N m) at 1 Hz, 3 s: error on the link angle."""
    arm = build("paper_table1", profile)
    c, u = arm.prepare(friction_smoothing_1=1.0, friction_smoothing_2=1.0), sine(2.0, 1.0, 3.0)
    fine = arm.rollout(arm.x(), u, c, HELD, HELD / 32)
    errors = [np.abs(links(arm.rollout(arm.x(), u, c, HELD, HELD / k) - fine)).max() for k in (1, 2, 4)]
    assert links(fine).max() > 0.05
    assert errors[0] < 1e-6
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4.0, abs=0.3)


def test_rollout_agrees_with_another_method(build: Builder) -> None:
    """The eighth-order Dormand–Prince of SciPy over the same rate, row after row of held currents."""
    arm = build("paper_table1")
    c, held = arm.prepare(), 0.02
    u = sine(2.0, 1.0, 0.8, held)
    x = arm.rollout(arm.x(), u, c, held, 1e-5)
    rate, at = np.empty(8), np.empty(8)
    row = np.empty(4)
    rhs = arm.module.bind("rhs", at, row, c, rate)

    def f(_: float, state: Floats) -> Floats:
        at[:] = state
        rhs.run()
        return rate.copy()

    state = arm.x()
    for k, current in enumerate(u):
        row[:] = current
        state = solve_ivp(f, (0.0, held), state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
        assert state == pytest.approx(x[k + 1], rel=1e-7, abs=1e-9)


def test_a_rollout_is_its_steps(build: Builder) -> None:
    """Row after row, in equal parts no longer than `most`, to the bit; x0 stands in the first row."""
    arm = build("paper")
    c, u = arm.prepare(), sine(3.0, 2.0, 0.01)
    dt = np.linspace(0.2e-3, 1.7e-3, u.shape[0])
    for kind, name in ((0, "step"), (EXACT, "step_exact")):
        x = arm.rollout(arm.x(motor_velocity_1=3.0), u, c, dt, 5e-4, kind)
        assert np.array_equal(x[0], arm.x(motor_velocity_1=3.0))
        for k, held in enumerate(dt):
            parts = int(np.ceil(held / 5e-4))
            state = x[k]
            for _ in range(parts):
                (state,) = arm(name, state, u[k], c, [held / parts])
            assert np.array_equal(state, x[k + 1])


# -- batches ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["portable", "native"])
@pytest.mark.parametrize("count", [1, 7, 17])
def test_a_batch_is_its_trajectories(build: Builder, profile: str, count: int) -> None:
    """With shared and with own constants; portable to the bit, native to 1e-12 of each column."""
    arm = build("paper_table1", profile)
    rng = np.random.default_rng(41)
    x0, u = arm.random(rng, count, share=0.02), rng.uniform(-3, 3, (count, 40, 4))
    cs = np.array(
        [arm.prepare(coulomb_friction_1=0.02 + 0.001 * k, flexspline_stiffness_2=9000.0 + k) for k in range(count)]
    )
    for kind, c in ((BATCH, cs[0]), (BATCH_OWN, cs)):
        many = arm.rollout(x0, u, c, 1e-3, 5e-4, kind)
        one = np.array(
            [arm.rollout(x0[k], u[k], cs[k] if kind == BATCH_OWN else cs[0], 1e-3, 5e-4) for k in range(count)]
        )
        if profile == "portable":
            assert np.array_equal(many, one)
        assert (np.abs(many - one) <= 1e-12 * np.abs(one).max(axis=(0, 1))).all()
    assert count == 1 or not np.allclose(many[0], many[1])


# -- bristles: the L-stable step --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angle", "amplitude", "hertz"), [(0.02, 2.0, 1.0), (0.02, 3.0, 5.0), (1e-3, 0.8, 1.0), (1e-4, 2.0, 1.0)]
)
def test_bristles_keep_1e_6_at_half_a_millisecond(build: Builder, angle: float, amplitude: float, hertz: float) -> None:
    """Through every reversal, against RK4 in steps of 5 µs that stop at each reversal; bristles soft and stiff."""
    arm = build(bristles())
    c, u = arm.prepare(presliding_angle_1=angle, presliding_angle_2=angle), sine(amplitude, hertz, 3.0)
    u[:, 1] *= 0.7
    fine = arm.rollout(arm.x(), u, c, HELD, 5e-6, EXACT)
    finer = arm.rollout(arm.x(), u, c, HELD, 2.5e-6, EXACT)
    assert np.abs(links(fine - finer)).max() < 1e-9, "the reference itself"
    assert (np.diff(np.sign(fine[100:, 4])) != 0).sum() >= 2, "no reversal"
    x = arm.rollout(arm.x(), u, c, HELD, HELD)
    assert np.abs(links(x - fine)).max() < 1e-7, "1e-6 is asked, and the tolerance is chosen for a tenth of it"
    assert np.abs(fine[:, 8:]).max() <= 1.0 + 1e-9


def test_the_stiff_step_is_of_order_four(build: Builder) -> None:
    """Away from reversals, where no step is divided: two half steps are then not what the whole step does."""
    arm = build(bristles())
    c = arm.prepare(presliding_angle_1=2.0, presliding_angle_2=3.0)
    start = arm.x(motor_velocity_1=60.0, motor_velocity_2=50.0, joint_velocity_1=0.6, joint_velocity_2=0.5)
    h = 2e-3
    u = np.tile([2.0, -1.0, 3.0, 2.0], (20, 1))
    assert not np.array_equal(arm("step", start, u[0], c, [h])[0], arm.rollout(start, u, c, h, h / 2)[1])
    fine = arm.rollout(start, u, c, h, h / 256, EXACT)
    assert fine[:, 4:6].min() > 10.0, "a reversal"
    coarse = [arm.rollout(start, u, c, h, h / k) for k in (1, 2, 4)]
    errors = np.array([np.abs(links(x - fine)).max() for x in coarse])
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx([4.0] * 2, abs=0.5)


def test_the_stiff_step_is_stable_where_the_bristle_decays_in_microseconds(build: Builder) -> None:
    """λh = 1500: the bristle goes to its end and stays there, in one step of 0.5 ms."""
    arm = build(bristles())
    c = arm.prepare(presliding_angle_1=1e-4, presliding_angle_2=1e-4)
    start = arm.x(motor_velocity_1=300.0, motor_velocity_2=-300.0, joint_velocity_1=3.0, joint_velocity_2=-3.0)
    assert arm("stiffness_rate", start, np.zeros(4), c)[0][0] == pytest.approx(3e6)
    x = arm.rollout(start, np.zeros((40, 4)), c, HELD, HELD)
    assert x[1:, 8:] == pytest.approx(np.broadcast_to([1.0, -1.0], (40, 2)), abs=1e-6)


def test_what_is_not_a_number_stays_so(build: Builder) -> None:
    """One NaN or Inf anywhere in the state or input: every entry that it reaches is NaN, and the step still returns."""
    for arm, kinds in ((build(bristles()), ("step",)), (build("paper"), ("step", "step_exact"))):
        c = arm.prepare()
        for kind in kinds:
            for bad in (np.nan, np.inf, -np.inf):
                for place in ("motor_position_1", "motor_velocity_2", "joint_velocity_1"):
                    x = arm("step" if kind == "step" else kind, arm.x(**{place: bad}), np.zeros(4), c, [HELD])[0]
                    assert not np.isfinite(x).all(), (kind, place)
                x = arm(kind, arm.x(), np.array([bad, 0.0, 0.0, 0.0]), c, [HELD])[0]
                assert not np.isfinite(x[4]), kind
    arm = build(bristles())
    assert np.isnan(arm("step", arm.x(motor_position_1=np.nan), np.zeros(4), arm.prepare(), [HELD])[0]).all()


# -- set-valued friction ----------------------------------------------------------------------------------------------


def test_a_stuck_motor_does_not_move_by_a_bit(build: Builder) -> None:
    """The link swings on its spring for a second, the motor holds: speed exactly 0, the angle's bits unchanged."""
    arm = build("paper")
    c = arm.prepare()
    start = arm.x(
        motor_position_1=12.345678901, motor_position_2=-3.21, joint_position_1=0.1236, joint_position_2=-0.0319
    )
    u = np.zeros((1000, 4))
    u[:, 0] = 0.02 * np.sin(np.arange(1000))
    x = arm.rollout(start, u, c, 1e-3, 5e-4, EXACT)
    assert not arm.at(x, "motor_velocity_1").any() and not arm.at(x, "motor_velocity_2").any()
    assert (arm.at(x, "motor_position_1") == 12.345678901).all() and (arm.at(x, "motor_position_2") == -3.21).all()
    assert np.ptp(arm.at(x, "joint_position_1")) > 1e-4
    smooth = arm.rollout(start, u, c, 1e-3, 5e-4)
    assert arm.at(smooth, "motor_velocity_1").any(), "smooth friction creeps; if it did not, nothing was tested"


@pytest.mark.parametrize("sign", [1, -1])
def test_a_joint_gives_way_at_the_level(build: Builder, sign: int) -> None:
    """A carriage on a screw: 1 part in 1e9 below the level it stays, above it slides off as it is pushed."""
    arm = build("emps")
    c = arm.prepare(bias_1=0.0)
    level = 20.3935
    below = arm.rollout(arm.x(), np.tile([sign * level * (1 - 1e-9), 0.0, 0.0], (100, 1)), c, 1e-3, 5e-4, EXACT)
    assert not below.any()
    above = arm.rollout(arm.x(), np.tile([sign * level * (1 + 1e-9), 0.0, 0.0], (100, 1)), c, 1e-3, 5e-4, EXACT)
    assert (sign * np.diff(above[:, 1]) > 0).all()
    gone = 1e-9 * level * 0.1 / 95.1089
    assert sign * above[-1, 1] == pytest.approx(gone, rel=0.2)


def test_a_motor_gives_way_when_its_spring_pulls_with_the_level(build: Builder) -> None:
    """A push on the tip grows until the motor moves: in that step, and in no other, τ/N passes the level."""
    arm = build("paper")
    c, held = arm.prepare(coulomb_friction_2=10.0), 1e-3
    u = np.zeros((2000, 4))
    u[:, 3] = np.linspace(0.0, 30.0, 2000)
    x = arm.rollout(arm.x(), u, c, held, 2.5e-4, EXACT)
    first = int(np.flatnonzero(arm.at(x, "motor_velocity_1"))[0])
    load = np.abs(arm("outputs", x[:-1], u, c)[4][:, 0]) / 100.0
    assert (load[:first] <= 0.037).all()
    assert load[first - 1] == pytest.approx(0.037, rel=0.01)
    assert load[first] > 0.037


def test_a_sliding_mass_stops_where_the_closed_form_says(build: Builder) -> None:
    """M v̇ = −Fv v − Fc: place and time of the stop, in steps far longer than the last part of the slide."""
    arm = build("emps")
    M, Fv, Fc, v0 = 95.1089, 203.5034, 20.3935, 0.1
    end = M / Fv * np.log(1 + Fv * v0 / Fc)
    distance = M / Fv * v0 - Fc / Fv * end
    for h, error in ((5e-3, 1e-11), (2e-3, 1e-12), (5e-4, 1e-12)):
        x = arm.rollout(arm.x(joint_velocity_1=v0), np.zeros((200, 3)), arm.prepare(bias_1=0.0), 5e-3, h, EXACT)
        stopped = int(np.flatnonzero(x[:, 1] == 0.0)[0])
        assert stopped == int(np.ceil(end / 5e-3))
        assert (x[stopped:, 0] == x[stopped, 0]).all()
        assert x[-1, 0] == pytest.approx(distance, abs=error)


@pytest.mark.parametrize(
    ("robot", "torque", "level"),
    [("dfki_1_0", 0.8, [0.2, 0.15]), (robots.chain("RRRRRR", 4), 0.8, [0.3, 0.3, 0.2, 0.2, 0.1, 0.1])],
    ids=["two joints", "six joints"],
)
def test_coupled_joints_obey_coulombs_law(build: Builder, robot: str, torque: float, level: list[float]) -> None:
    """Whoever moves off pushes its neighbours: after a tiny step each sticks within its level or slides against it."""
    arm, n = build(robot), len(level)
    c = arm.prepare(**{f"coulomb_friction_{j}": value for j, value in enumerate(level, 1)})
    rng = np.random.default_rng(43)
    rows, h = 4000, 1e-7
    q, rest = rng.uniform(-3, 3, (rows, n)), np.zeros((rows, n))
    u = np.hstack([rng.uniform(-torque, torque, (rows, n)), rng.uniform(-3, 3, (rows, 2))])
    v = arm("step_exact", np.hstack([q, rest]), u, c, [h])[0][:, n:]
    friction = u[:, :n] - arm("inverse_dynamics", q, rest, v / h, u[:, n:], c)[1]
    slides = v != 0.0
    assert slides.any(axis=0).all() and (~slides).any(axis=0).all()
    assert np.abs(friction[slides] - (np.array(level) * np.sign(v))[slides]).max() < 1e-4
    assert (np.abs(friction) - level)[~slides].max() < 1e-4


CASES: dict[
    str, tuple[str, tuple[float, ...], dict[str, float]]
] = {  # robot, amplitudes of the inputs of the joints, parameters
    "springs": ("paper_table1", (2.0, 1.6), {}),
    "light springs": ("paper", (2.0, 0.9), {}),
    "rigid, coupled": ("dfki_1_0", (0.1, 0.08), {}),
    "one mass": ("emps", (60.0,), {}),
}


@pytest.mark.parametrize("case", CASES)
def test_set_valued_friction_keeps_order_four_through_every_stop_and_start(build: Builder, case: str) -> None:
    """Stops and breakaways are found within the step, so nothing is lost there: 1.5 s with many of both."""
    robot, amplitudes, changes = CASES[case]
    arm = build(robot)
    c, held, n = arm.prepare(**changes), 2e-3, len(amplitudes)
    t = np.arange(0.0, 1.5 - held / 2, held)
    u = np.zeros((t.size, n + 2))
    for j, (amplitude, hertz, phase) in enumerate(zip(amplitudes, (1.0, 2.3), (0.0, 1.0), strict=False)):
        u[:, j] = amplitude * np.sin(2 * np.pi * hertz * t + phase)
    fine = arm.rollout(arm.x(), u, c, held, held / 128, EXACT)
    speeds = fine[:, [k for k, name in enumerate(arm.states) if "velocity" in name]][:, :n]
    rests = speeds[20:] == 0.0
    assert rests.any(axis=0).all() and (~rests).any(axis=0).all(), "every joint rests and slides"
    first = arm.states.index("joint_position_1")
    errors = []
    for k in (1, 2, 4, 8):
        x = arm.rollout(arm.x(), u, c, held, held / k, EXACT)
        errors.append(np.abs(x - fine)[:, first : first + n].max())
    assert errors[2] < 1e-8, "at half a millisecond"
    if case == "one mass":  # linear between events: the method is exact but for rounding
        assert errors[0] < 1e-12
    else:
        assert np.log2(np.divide(errors[:-1], errors[1:])).min() > 3.3
        assert errors[0] > 1e-11


def test_narrow_smooth_friction_tends_to_the_set_valued(build: Builder) -> None:
    """The limit of the smooth sign, from its own integrator: the difference falls with the width."""
    arm = build("paper_table1")
    u = sine(1.2, 1.0, 1.0, 1e-3)
    exact = arm.rollout(arm.x(), u, arm.prepare(), 1e-3, 5e-4, EXACT)
    apart = []
    for width in (0.4, 0.1, 0.025):
        c = arm.prepare(friction_smoothing_1=width, friction_smoothing_2=width)
        apart.append(np.abs(links(arm.rollout(arm.x(), u, c, 1e-3, 1e-5) - exact)).max())
    assert apart[0] > 2 * apart[1] > 4 * apart[2] > 0.0
    assert apart[2] < 0.01 * np.abs(links(exact)).max()


def test_dry_friction_that_bristles_share_still_sticks(build: Builder) -> None:
    """Half in bristles, half set-valued: below half the level nothing moves; above, the bristle winds up and holds."""
    arm = build("paper", effects=MEMORY)
    share = {f"presliding_share_{j}": 0.5 for j in (1, 2)}
    c = arm.prepare(**share)
    u = np.zeros((400, 4))
    u[:, 0] = 0.45 * 0.037 / 0.0525
    x = arm.rollout(arm.x(), u, c, 1e-3, 5e-4, EXACT)
    assert not x.any()
    u[:, 0] = 0.8 * 0.037 / 0.0525
    x = arm.rollout(arm.x(), u, c, 1e-3, 5e-4, EXACT)
    assert arm.at(x, "motor_velocity_1")[1] > 0.0
    assert arm.at(x, "motor_velocity_1")[-1] == 0.0
    assert 0.0 < arm.at(x, "bristle_1")[-1] <= 1.0


@pytest.mark.parametrize("profile", ["portable", "native"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_motor_pushed_between_its_two_levels_of_friction_stays(build: Builder, profile: str, sign: float) -> None:
    """More friction the way it is pushed than at rest: let go it would be pulled back, and nothing flies apart."""
    arm = build("paper", profile, effects=WHOLE)
    level, constant = (
        arm.vector()[arm.parameters.index(f"{name}_1")] for name in ("coulomb_friction", "torque_constant")
    )
    c = arm.prepare(asymmetric_torque_1=sign * 0.3 * level, gravity_y=0.0)
    rng = np.random.default_rng(9)
    for push in rng.uniform(1.02, 1.28, 40):
        u = np.array([sign * push * level / constant, 0.0, 0.0, 0.0])
        x = arm.x(joint_velocity_1=rng.normal() * 1e-12, motor_position_1=rng.normal() * 1e-13)
        (after,) = arm("step_exact", x, u, c, [HELD])
        assert np.isfinite(after).all() and np.abs(after).max() < 1.0
        assert arm.at(after, "motor_velocity_1") == 0.0 or push > 1.3
