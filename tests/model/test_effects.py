"""Every effect × every property of its equation: units balance, derivatives hold, friction gives no energy; and in the
model amplitude 0 is exact."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from compiled import Compiled, Floats

from gen.effects import ALL, NOMINAL, kinematic_error, thermal_friction
from gen.effects.effect import Effect, Port, Signals
from gen.model import harmonic_drive, input_effects, mechanics
from gen.model.arm_model import Model
from gen.model.equations_of_motion import ArmMotion
from gen.robot.load_robot import load
from gen.robot.model_parameters import list_parameters

Builder = Callable[..., Compiled]
IN_SPACE = tuple(effect.space_form for effect in ALL if effect.space_form)
FORMS = [*(pytest.param(effect, id=effect.name) for effect in ALL)]
FORMS += [pytest.param(effect, id=f"{effect.name} in space") for effect in IN_SPACE]
EVERY = pytest.mark.parametrize("effect", FORMS)
ROBOT = load("paper")
KEYS = {
    q.name.removesuffix("_1"): q for q in list_parameters(ROBOT) if q.joint in (0, 1)
}  # what equations read of the robot file
KEYS_IN_SPACE = {"gravity_z": "m/s²"}
SIGNALS = {
    "current": "A",
    "motor_position": "rad",
    "motor_velocity": "rad/s",
    "friction_level": "N m",
    "direction": "1",
    "torsion": "rad",
    "torsion_rate": "rad/s",
    "spring_torque": "N m",
    "joint_torque": "N m",
    "joint_position": "rad",
    "joint_velocity": "rad/s",
    "joint_acceleration": "rad/s²",
    "ratio": "1",
}
TERM = {
    Port.DELAY: ("s",),
    Port.INPUT: ("A",),
    Port.LAG: ("s",),
    Port.WARMTH: ("1",),
    Port.FRICTION: ("N m",),
    Port.MOTOR: ("N m",),
    Port.REACTION: ("1",),
    Port.TORSION: ("rad",),
    Port.PLAY: ("rad",),
    Port.SERIES: ("1", "N m s/rad"),
    Port.TRANSMISSION: ("N m",),
    Port.BASE: ("m/s²", "m/s²"),
    Port.MASS: ("kg",),
    Port.LINK: ("N m",),
    Port.SENSOR: ("rad",),
    Port.TORQUE_SENSOR: ("N m",),
}
TERM_IN_SPACE = {
    Port.BASE: ("m/s²", "m/s²", "m/s²"),
    Port.MASS: ("kg", "m", "m", "m"),
    Port.STAND: ("rad/(N m)", "1/s²"),
}
NO_SUMS = {"gravity_tilt", "payload", "base_compliance"}  # in space: the model's motion shows their amplitudes
CURVED = {"current_saturation", "voltage_sag", "backlash", "sensor_delay", "missing_compliance"}  # by their nature


def symbols(effect: Effect) -> dict[str, tuple[Any, str]]:
    """What the equation may read, as symbols with units: signals, its states, its and the robot's parameters."""
    own = {p.name: p.unit for p in effect.parameters} | {s.name: s.unit for s in effect.states}
    named = SIGNALS | {name: key.unit for name, key in KEYS.items()} | own | {"memory_step": "s", **KEYS_IN_SPACE}
    return {name: (ca.SX.sym(name), unit) for name, unit in named.items()}


def equation(effect: Effect) -> tuple[ca.Function, list[str], list[str]]:
    """The equation as a function of all of `symbols`, with the units of its arguments and of its results."""
    given = symbols(effect)
    names = {name: s for name, (s, _) in given.items()}
    states = {s.name: names[s.name] for s in effect.states}
    field = ca.vertcat(*(names[f"gravity_{axis}"] for axis in "xyz"))
    axes = (ca.DM([0.6, 0.8, 0.0]), ca.DM([0.0, 0.0, 1.0]))
    signals = Signals(**{name: names[name] for name in SIGNALS}, states=states, gravity=field, level_axes=axes)
    result = effect.equation(signals, names)
    term, rates = result if effect.states else (result, ())
    if isinstance(term, ca.SX):
        term = tuple(ca.vertsplit(term))
    out = [*(term if isinstance(term, tuple) else (term,)), *rates]
    terms = TERM_IN_SPACE if effect in IN_SPACE else {}
    units = [*(terms | {port: TERM[port] for port in TERM if port not in terms})[effect.port]]
    units += [f"{s.unit}/s" for s in effect.states]
    arguments = ca.vertcat(*names.values())
    return ca.Function(effect.name, [arguments], [ca.vertcat(*out)]), [unit for _, unit in given.values()], units


def points(effect: Effect, count: int) -> Floats:
    """Random values (count × arguments), sizes as in a running arm, parameters within their bounds."""
    rng = np.random.default_rng(11)
    typical = {"motor_position": 100.0, "motor_velocity": 100.0, "torsion": 1e-3, "torsion_rate": 0.1}
    bounds = {p.name: (p.low, p.high) for p in effect.parameters} | {s.name: (-s.bound, s.bound) for s in effect.states}
    bounds |= {name: (key.low, key.high) for name, key in KEYS.items()} | {
        "direction": (-1.0, 1.0),
        "ratio": (50.0, 150.0),
    }
    bounds |= {"friction_level": (0.0, 0.1), "memory_step": (0.0, 1e-3)}
    # bounds that span decades: where the equation lives
    bounds |= {"presliding_angle": (1e-3, 0.1), "stribeck_speed": (50.0, 300.0), "saturation_inverse": (0.0, 1.0)}
    bounds |= {"voltage_sag": (0.0, 0.3), "backlash_angle": (0.0, 2e-3), "thermal_time": (1.0, 100.0)}
    bounds |= {"missing_compliance": (1e-5, 1e-3), "missing_damping": (0.0, 20.0), "contact_below": (-1.0, 0.0)}
    bounds |= {"ripple_order": (1.0, 4.0)}
    columns = []
    for name in symbols(effect):
        size = typical.get(name, 3.0)
        columns.append(rng.uniform(*bounds.get(name, (-size, size)), count))
    return np.column_stack(columns)


# -- what an effect says of itself ------------------------------------------------------------------------------------


@EVERY
def test_an_effect_names_its_numbers_and_its_source(effect: Effect) -> None:
    assert re.fullmatch(r"[a-z][a-z0-9_]{0,47}", effect.name)
    assert re.search(r"paper .*\(\d+\)|\((19|20)\d\d\)|Lagrangian", effect.citation), (
        "a citation names an equation or a year"
    )
    assert effect.joints in ("each", "first", "last", "arm")
    for p in effect.parameters:
        assert re.fullmatch(r"[a-z][a-z0-9_]{0,47}", p.name)
        assert p.low <= p.nominal <= p.high, p
        assert p.low < p.high, p
        assert p.meaning, p
        if p.name in effect.amplitudes:
            assert p.typical is not None and not p.starts, p
            assert p.low <= p.nominal + p.typical <= p.high or p.scale, p
        else:
            assert p.typical is None and p.starts[0] == p.nominal, p
            assert p.scale or all(p.low <= start <= p.high for start in p.starts), p
        factor(p.unit, np.ones(4))
    for s in effect.states:
        assert s.bound > 0 and s.meaning, s
    known = {p.name for p in effect.parameters} | set(KEYS) | set(KEYS_IN_SPACE)
    assert effect.amplitudes and set(effect.amplitudes) <= known
    sized = {p.name for p in effect.parameters} | set(effect.usual_shares)
    assert effect.name == "gravity" or set(effect.amplitudes) <= sized, "an amplitude without a usual size"
    if effect not in NOMINAL and effect.port is not Port.SERIES:  # adding it changes nothing until one is given
        assert all(p.nominal == 0.0 for p in effect.parameters if p.name in effect.amplitudes)


@pytest.mark.parametrize("in_space", [False, True])
def test_names_are_unique(in_space: bool) -> None:
    """Effects, and all parameters and states that can stand in one model."""
    forms = [effect.choose_form(in_space) for effect in ALL]
    assert [form.name for form in forms] == [effect.name for effect in ALL]
    assert len({form.name for form in forms}) == len(forms)
    inner = [*KEYS, *(q.name for form in forms for q in form.parameters)]
    inner += [state.name for form in forms for state in form.states]
    assert len(set(inner)) == len(inner)
    assert set(NOMINAL) <= set(ALL)


# -- the equation -----------------------------------------------------------------------------------------------------


def factor(unit: str, scale: Floats) -> float:
    """What a number of that unit is multiplied by when kg, m, s, A are measured ``scale`` times smaller."""
    kg, m, s, A = scale
    base = {"1": 1.0, "rad": 1.0, "kg": kg, "m": m, "s": s, "A": A, "N": kg * m / s**2, "J": kg * m**2 / s**2}
    over, _, under = unit.partition("/")
    value = 1.0
    for words, sign in ((over, 1), (under, -1)):
        for word in words.strip("()").replace("/", " ").split():
            name, power = (word[:-1], 2) if word.endswith("²") else (word, 1)
            value *= base[name] ** (sign * power)
    return value


@EVERY
def test_units_balance(effect: Effect) -> None:
    """In other units of mass, length, time and current the equation says the same."""
    f, units_in, units_out = equation(effect)
    x = points(effect, 200)
    here = np.array(f(x.T)).T
    assert np.abs(here).max() > 0.0
    for scale in (
        np.array([2.0, 1, 1, 1]),
        np.array([1, 3.0, 1, 1]),
        np.array([1, 1, 5.0, 1]),
        np.array([1, 1, 1, 7.0]),
    ):
        there = np.array(f((x * [factor(unit, scale) for unit in units_in]).T)).T
        expected = here * [factor(unit, scale) for unit in units_out]
        assert np.allclose(there, expected, rtol=1e-12, atol=1e-13 * np.abs(expected).max())


def is_sum(effect: Effect) -> bool:
    return effect.name not in (CURVED | NO_SUMS if effect in IN_SPACE else CURVED)


@pytest.mark.parametrize("effect", [form for form in FORMS if is_sum(form.values[0])])  # type: ignore[arg-type]
def test_the_term_is_linear_in_its_amplitudes(effect: Effect) -> None:
    """Half of every amplitude is half of the term; none is none."""
    f, _, units = equation(effect)
    x = points(effect, 200)
    column = [list(symbols(effect)).index(name) for name in effect.amplitudes]
    count = len(units) - len(effect.states)
    full = np.array(f(x.T)).T[:, :count]
    x[:, column] *= 0.5
    assert np.allclose(np.array(f(x.T)).T[:, :count], 0.5 * full, rtol=1e-12, atol=0.0)
    x[:, column] = 0.0
    assert not np.array(f(x.T)).T[:, :count].any()


@EVERY
def test_derivatives_are_finite_differences(effect: Effect) -> None:
    """By every signal, state and parameter, away from kinks."""
    f, _, _ = equation(effect)
    w = ca.SX.sym("w", f.numel_in(0))
    J = ca.Function("J", [w], [ca.jacobian(f(w), w)])
    compared = 0.0
    for at in points(effect, 20):
        ours = np.array(J(at))
        step = 1e-6 * np.maximum(np.abs(at), 1e-3)
        theirs = np.column_stack(
            [np.array(f(at + e) - f(at - e)).ravel() / (2 * h) for e, h in zip(np.diag(step), step, strict=True)]
        )
        rounding = 1e-15 * np.abs(np.array(f(at))) / step
        assert (np.abs(ours - theirs) <= 1e-6 * np.abs(ours) + 10 * rounding + 1e-9).all()
        compared = max(compared, np.abs(ours).max())
    assert compared > 0.0


def _slid(term: Floats, v: dict[str, Floats]) -> Floats:
    """Power that a level of dry friction takes."""
    return np.asarray(term[:, 0] * v["direction"] * v["motor_velocity"])


def _opposed(term: Floats, v: dict[str, Floats]) -> Floats:
    return np.asarray(-term[:, 0] * v["motor_velocity"])


POWER: Mapping[
    str, Callable[[Floats, dict[str, Floats]], Floats]
] = {  # what each takes; what a memory stores is no loss
    "coulomb_friction": _slid,
    "stribeck_friction": _slid,
    "load_dependent_friction": _slid,
    "viscous_friction": _opposed,
    "quadratic_friction": _opposed,
    "joint_damping": lambda term, v: term[:, 0] * v["torsion_rate"],
    "transmission_hysteresis": lambda term, v: (
        term[:, 0] * v["torsion_rate"] - v["hysteresis_torque"] * v["hysteresis_angle"] * v["hysteresis"] * term[:, 1]
    ),
    "presliding_friction": lambda term, v: (  # with the rest of dry friction, whose place it takes
        (v["friction_level"] * v["direction"] - term[:, 0]) * v["motor_velocity"]
        - v["presliding_share"] * v["friction_level"] * v["presliding_angle"] * v["bristle"] * term[:, 1]
    ),
    "link_flexibility": lambda term, v: (  # less what the oscillator stores
        -term[:, 0] * v["joint_velocity"]
        - v["link_share"]
        * (v["inertia"] + v["mass"] * v["center_of_mass"] ** 2)
        * (v["bending_speed"] * term[:, 2] + v["link_frequency"] ** 2 * v["bending"] * term[:, 1])
    ),
}
TOGETHER = {"asymmetric_friction", "position_dependent_friction", "thermal_friction"}  # change friction that is there


@pytest.mark.parametrize("name", POWER)
def test_friction_and_damping_give_no_energy(name: str) -> None:
    """The direction of sliding is that of the speed, of any size up to 1; parameters anywhere in their bounds."""
    effect = next(effect for effect in ALL if effect.name == name)
    f, _, _ = equation(effect)
    x = points(effect, 100_000)
    names = list(symbols(effect))
    values = {key: x[:, k] for k, key in enumerate(names)}
    values["direction"][:] = np.abs(values["direction"]) * np.sign(values["motor_velocity"])
    values["memory_step"][:] = 0.0  # a memory that is slowed stores more
    taken = POWER[name](np.array(f(x.T)).T, values)
    assert taken.min() >= -1e-11 * taken.max()
    assert np.median(taken) > 0.0


def test_friction_of_all_kinds_together_gives_no_energy() -> None:
    """Every amplitude anywhere within three times its usual size: a drive without current loses energy or keeps it."""
    kinds = tuple(e for e in ALL if e in NOMINAL or (e.port in (Port.FRICTION, Port.WARMTH)) or "quadratic" in e.name)
    model = Model(ROBOT, kinds)
    assert {e.name for e in kinds} >= TOGETHER
    s = ca.SX.sym("s")
    d = model.drive_outputs(1, model.joint_parameters(1), exact=s, spring_torque=ca.SX(0))
    f = ca.Function("net", [model.x, model.u, model.p, s], [d.net_torque + d.transmitted_torque / 100.0])
    rng, rows = np.random.default_rng(14), 5000
    bound = np.array([slot.bound for slot in model.x_slots])[:, None]
    x = rng.uniform(-1, 1, (bound.size, rows)) * bound
    names = [slot.name for slot in model.x_slots]
    x[names.index("warmth_1")] = rng.uniform(0, 1, rows)
    p = np.array([[q.nominal] for q in model.quantities]) * np.ones(rows)
    for k, q in enumerate(model.quantities):
        if q.role == "amplitude" and q.effect not in ("payload", "stiffness", "torque_constant", "current_bias"):
            assert q.typical is not None
            p[k] = rng.uniform(max(q.low, -3 * q.typical), min(q.high, 3 * q.typical), rows)
        if q.name.startswith("torsional_damping"):
            p[k] = 0.0
    omega = x[names.index("motor_velocity_1")]
    taken = -np.array(f(x, np.zeros((4, rows)), p, np.sign(omega)[None]))[0] * omega
    assert taken.min() >= 0.0 and np.median(taken) > 0.0


def test_every_effect_that_opposes_motion_is_among_them() -> None:
    """Friction, damping and hysteresis by name; whoever adds one adds it above."""
    opposing = {e.name for e in ALL if e.port is Port.FRICTION or re.search("friction|damping|hysteresis", e.name)}
    assert opposing == (set(POWER) - {"link_flexibility"}) | TOGETHER


@pytest.mark.parametrize("speed", [-80.0, 0.3, 80.0])
def test_a_drive_warms_by_its_motion_and_cools_at_rest(speed: float) -> None:
    """The warmth settles at the same share either way, begins to rise from a cold drive and never leaves [0, 1]."""
    p = {"thermal_share": 0.3, "thermal_time": 5.0, "thermal_speed": 8.0}

    def rate(warmth: float, motor_velocity: float) -> float:
        signals = Signals(motor_velocity=motor_velocity, states={"warmth": warmth})
        return float(thermal_friction.compute_friction_loss(signals, p)[1][0])

    assert rate(abs(speed) / (abs(speed) + 8.0), speed) == pytest.approx(0.0, abs=1e-15)
    assert rate(0.0, speed) == pytest.approx(abs(speed) / (abs(speed) + 8.0) / 5.0)
    assert rate(1.0, speed) < 0.0
    assert rate(0.0, 0.0) == 0.0 and rate(0.4, 0.0) == pytest.approx(-0.08)


# -- in the model -----------------------------------------------------------------------------------------------------


class Rates:
    """The paper's arm with some effects, by CasADi's interpreter: rates of x, smooth, and stuck at joint 2; what
    sensors read; what the input stage is given."""

    def __init__(self, effects: tuple[Effect, ...]) -> None:
        m = self.model = Model(ROBOT, effects)
        made, definitions = m.inverse_definitions()
        drives = {j: m.drive_outputs(j, m.joint_parameters(j)) for j in m.joints}
        motion, s = ArmMotion(m), ca.SX.sym("sliding", m.n)
        smooth, _ = motion.equations_of_motion(drives)
        exact, hold = motion.equations_of_motion(
            {j: m.drive_outputs(j, m.joint_parameters(j), exact=s[j - 1]) for j in m.joints}, s
        )
        sensed = mechanics.sensor_outputs(m, drives)
        rest = ca.vertcat(hold, *(sensed[name] for name in ("joint_position", "joint_velocity", "joint_torque")))
        stage = input_effects.emit_input_law(m, m.p).graph(m.u[: m.n], m.p)
        self.f = ca.Function("rates", [m.x, m.u, m.p, made, s], [ca.vertcat(smooth, exact, rest, *stage)])
        self.inverse = ca.Function("inverse", [m.p], [definitions])
        self.names = [slot.name for slot in m.x_slots]

    def __call__(self, x: Floats, u: Floats, p: Mapping[str, float]) -> tuple[Floats, Floats, Floats]:
        """(rate, rate with joint 2 stuck, holding torques with everything else), a column a state."""
        values = [p[q.name] for q in self.model.quantities]
        out = np.array(self.f(x, u, values, self.inverse(values), [1, 0]))
        n = len(self.names)
        return out[:n], out[n : 2 * n], out[2 * n :]


AT_REST = (Port.DELAY, Port.INPUT, Port.LAG, Port.SENSOR, Port.TORQUE_SENSOR)  # before and after the motion


@pytest.fixture(scope="module")
def everything() -> Iterator[Rates]:
    """All effects at once. All models here have the same drives, so their springs are planned once."""
    with pytest.MonkeyPatch.context() as patch:
        once = cache(harmonic_drive.plan_inverse)
        patch.setattr(harmonic_drive, "plan_inverse", lambda drives: once(tuple(drives)))
        yield Rates(tuple(e for e in ALL if e.port is not Port.SERIES))


@pytest.mark.parametrize("effect", [e for e in ALL if e.port is not Port.SERIES], ids=lambda effect: effect.name)
def test_amplitude_zero_is_the_model_without_the_effect_to_the_bit(everything: Rates, effect: Effect) -> None:
    """All other effects are on; the states that both models have move alike, to the last bit, sliding or stuck."""
    full, without = everything, Rates(tuple(e for e in everything.model.effects if e is not effect))
    rng = np.random.default_rng(12)
    rows = 500
    bound = np.array([slot.bound for slot in full.model.x_slots])[:, None]
    x = rng.uniform(-1, 1, (bound.size, rows)) * bound
    for j in (1, 2):
        q, theta = (full.names.index(f"{side}_position_{j}") for side in ("joint", "motor"))
        x[theta] = 100.0 * (x[q] + rng.uniform(-2e-3, 2e-3, rows))
    u = rng.uniform(-10, 10, (4, rows))
    p = {q.name: q.nominal + (q.typical or 0.0 if q.role == "amplitude" else 0.0) for q in full.model.quantities}
    p |= {"gravity_x": 1.0, "gravity_y": -9.0}
    present = full(x, u, p)
    off = p | {
        (f"{name}_{j}" if j else name): 0.0 for name in effect.amplitudes for j in full.model.joints_of_effect(effect)
    }
    off = {name: value for name, value in off.items() if name in p}
    common = [full.names.index(name) for name in without.names]
    removed, absent = full(x, u, off), without(x[common], u, off)
    for ours, theirs in zip(removed, absent, strict=True):
        assert np.array_equal(ours[common] if ours.shape[0] == bound.size else ours, theirs)
    moved = effect.port not in AT_REST
    ours, theirs = (found[0][common] if moved else found[2] for found in (present, removed))
    assert not np.array_equal(ours, theirs), "switched on, it must be seen"
    assert moved or np.array_equal(present[0], removed[0]), "it is no part of the motion"


ERROR = (2e-4, -1e-4, 1e-4, 3e-4, -1e-4, 0.5e-4)


def test_kinematic_error_does_virtual_work(build: Builder) -> None:
    """What the motor gives the gear is what the springs store and the joint gets, φ̇ from the sensed torsion alone."""
    arm = build(
        "paper", effects=("kinematic_error", "presliding_friction", "rotor_coupling", "transmission_hysteresis")
    )
    names = ("viscous_friction", "coulomb_friction", "torsional_damping")
    c = arm.prepare(
        **{f"{name}_{j}": 0.0 for name in names for j in (1, 2)},
        **{f"{name}_{j}": a for name, a in zip(kinematic_error.HARMONIC_NAMES, ERROR, strict=True) for j in (1, 2)},
    )
    rng = np.random.default_rng(13)
    x = arm.random(rng, 2000, share=0.3)
    for j in (1, 2):
        arm.at(x, f"motor_position_{j}")[:] = 100.0 * (
            arm.at(x, f"joint_position_{j}") + rng.uniform(-1e-3, 1e-3, 2000)
        )
    u = np.zeros((2000, 4))
    rate, h = arm("rhs", x, u, c)[0], 1e-8
    torque = arm("outputs", x, u, c)[4]
    torsion_rate = (arm("outputs", x + h * rate, u, c)[2] - arm("outputs", x - h * rate, u, c)[2]) / (2 * h)
    for j in (1, 2):
        omega, v = arm.at(x, f"motor_velocity_{j}"), arm.at(x, f"joint_velocity_{j}")
        given = -1.289e-4 * arm.at(rate, f"motor_velocity_{j}") * omega
        stored_and_got = torque[:, j - 1] * (torsion_rate[:, j - 1] + v)
        assert np.abs(given - stored_and_got).max() < 1e-5 * np.abs(given).max()
        plain = torque[:, j - 1] * omega / 100.0  # without the derivative of the error in the torque balance
        assert np.abs(given - plain).max() > 1e-3 * np.abs(given).max()
