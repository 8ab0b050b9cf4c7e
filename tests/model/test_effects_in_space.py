"""Effects of arms in space: their equations of motion against Lagrange's, MuJoCo and difference quotients, and nothing
changed at amplitude 0."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pytest
import robots
import space_robots
from compiled import Compiled, Floats
from mujoco_in_space import SpatialMuJoCo

from gen.effects import ALL, NOMINAL
from gen.effects.effect import Effect
from gen.model import harmonic_drive, mechanics
from gen.model.arm_model import Model
from gen.model.equations_of_motion import ArmMotion
from gen.model.right_hand_side import assemble_graphs
from gen.robot.description import RobotError
from gen.robot.load_robot import from_table

PLAN = harmonic_drive.plan_inverse
OURS = ("payload", "rotor_coupling", "gravity_tilt", "link_flexibility", "base_compliance")
LOSSLESS = ("viscous_friction", "coulomb_friction", "torsional_damping", "base_damping", "link_damping")
HARMONIC: dict[str, tuple[str, dict[str, float] | None]] = {"harmonic drives": ("RRP", robots.SPRINGS)}
PAIR: dict[str, tuple[str, dict[str, float] | None]] = {"two springs": ("RP", robots.LINEAR)}  # compiled sooner
CHAINS: dict[str, tuple[str, dict[str, float] | None]] = {"rigid": ("RRP", None), "springs": ("RPR", robots.LINEAR)}
ON = {
    "payload_mass": 0.7,
    "payload_x": 0.05,
    "payload_y": -0.08,
    "payload_z": 0.12,
    "tilt_roll": 0.2,
    "tilt_pitch": -0.3,
    "coupling": 1.0,
    "bending_inertia": 0.3,
    "base_compliance": 8e-5,
    "base_frequency": 150.0,
    "bias": 0.02,
}


def text(kind: str) -> str:
    """The robot's text, with gravity along −z."""
    kinds, springs = (CHAINS | HARMONIC | PAIR)[kind]
    made = space_robots.chain(kinds, 5, springs=springs).replace("gravity = [", "gravity = [0.0, 0.0, -9.81] # [")
    return re.sub(r"viscous_friction = \S+", f"viscous_friction = {0.2 if springs is None else 1e-3}", made)


def effects(*names: str) -> tuple[Effect, ...]:
    return tuple(e for e in ALL if e in NOMINAL or e.name in names)


class Interpreted:
    """An arm by CasADi's interpreter, and its parameters by name."""

    def __init__(self, kind: str, *names: str) -> None:
        robot = from_table(tomllib.loads(text(kind)), "robot.toml", Path("robot.toml"))
        with pytest.MonkeyPatch.context() as patch:  # all arms here have the same springs, which are planned once
            patch.setattr(harmonic_drive, "plan_inverse", plan_once)
            self.model = model = Model(robot, effects(*names))
        motion, s = ArmMotion(model), ca.SX.sym("sliding", model.n)
        made, definitions = model.inverse_definitions()
        drives = {j: model.drive_outputs(j, model.joint_parameters(j)) for j in model.joints}
        exact = {j: model.drive_outputs(j, model.joint_parameters(j), exact=s[j - 1]) for j in model.joints}
        smooth, _ = motion.equations_of_motion(drives)
        stuck, hold = motion.equations_of_motion(exact, s)
        energy = mechanics.arm_energy(model, drives)
        c = ca.vertcat(model.p, made)
        xuc = [model.x, model.u, c]
        self.functions = {
            "prepare": ca.Function("prepare", [model.p], [ca.vertcat(model.p, definitions)]),
            "rhs": ca.Function("rhs", xuc, [smooth]),
            "rhs_exact": ca.Function("rhs_exact", [*xuc[:2], s, c], [ca.vertcat(stuck, hold)]),
            "energy": ca.Function("energy", [model.x, c], energy),
        }
        self.states = [slot.name for slot in model.x_slots]
        self.parameters = [q.name for q in model.quantities]

    def constants(self, **changes: float) -> Any:
        """c with every effect on, and ``changes`` of parameters by their name without the joint's number."""
        values = []
        for q in self.model.quantities:
            stem = q.name.removesuffix(f"_{q.joint}")
            values.append((ON | changes).get(stem, q.nominal))
        return self.functions["prepare"](values)

    def draw(self, rows: int) -> tuple[Floats, Floats]:
        """Random states, springs turned by up to 1 mrad, and inputs, a column each."""
        rng = np.random.default_rng(6)
        size = {"joint_position": 1.5, "joint_velocity": 3.0, "motor_velocity": 100.0, "bending": 0.02}
        size |= {"bending_speed": 3.0, "base_moment": 40.0, "base_moment_rate": 2000.0}
        stems = ["base_moment_rate" if "moment_rate" in name else name.rpartition("_")[0] for name in self.states]
        stems = ["base_moment" if stem.startswith("base_moment_") and "rate" not in stem else stem for stem in stems]
        x = rng.uniform(-1, 1, (len(stems), rows)) * np.array([size.get(stem, 1.0) for stem in stems])[:, None]
        for j in self.model.flexible:
            ratio = self.model.robot.joints[j - 1].drive.ratio.nominal
            q = x[self.states.index(f"joint_position_{j}")]
            x[self.states.index(f"motor_position_{j}")] = ratio * (q + rng.uniform(-1e-3, 1e-3, rows))
        u = rng.uniform(-1, 1, (len(self.model.u_slots), rows)) * 5.0
        return x, u


@cache
def _plan(drives: tuple[Any, ...]) -> Any:
    return PLAN(drives)


def plan_once(drives: Any) -> Any:
    """The plan of the springs' inverse, made once for the same drives."""
    return _plan(tuple(drives))


@cache
def arm(kind: str, *names: str) -> Interpreted:
    return Interpreted(kind, *names)


def entries(made: Interpreted, *stems: str) -> list[int]:
    return [k for k, name in enumerate(made.states) if name.startswith(stems)]


@pytest.mark.parametrize("kind", CHAINS | HARMONIC)
def test_the_motion_is_lagranges(kind: str) -> None:
    """d/dt ∂T/∂v − ∂T/∂q + ∂V/∂q is the motors' torque, in the coordinates of rotors, joints and base, without loss.

    So energy is kept, with the laws of harmonic drives, too.
    """
    made = arm(kind, "payload", "rotor_coupling", "gravity_tilt", "base_compliance")
    c = made.constants(**dict.fromkeys(LOSSLESS, 0.0), bias=0.0)
    f, model = made.functions, made.model
    x, u = ca.SX.sym("x", len(made.states)), ca.SX.sym("u", len(model.u_slots))
    places = entries(made, "motor_position", "joint_position") + [
        made.states.index(f"base_moment_{k}_1") for k in "xyz"
    ]
    speeds = entries(made, "motor_velocity", "joint_velocity") + entries(made, "base_moment_rate")
    kinetic, potential = f["energy"](x, c)
    rate = f["rhs"](x, u, c)
    momentum = ca.gradient(kinetic, x)[speeds]
    lacking = ca.jtimes(momentum, x, rate) - ca.gradient(kinetic, x)[places] + ca.gradient(potential, x)[places]
    given = ca.SX.zeros(len(speeds))
    for j in model.joints:
        side = "motor" if j in model.flexible else "joint"
        gear = 1.0 if j in model.flexible else model.robot.joints[j - 1].drive.ratio.nominal
        given[places.index(made.states.index(f"{side}_position_{j}"))] = gear * u[j - 1]
    rows, inputs = made.draw(50)
    inputs[model.n :] = 0.0
    sums = ca.Function("f", [x, u], [lacking - given, lacking, ca.gradient(kinetic, x)[speeds]])
    residual, size, _ = (np.array(part) for part in sums.map(50)(rows, inputs))
    scale = np.abs(np.array(ca.Function("g", [x, u], [ca.fabs(ca.gradient(potential, x)[places]) + ca.fabs(given)]).map(
        50)(rows, inputs))).max(axis=1)  # fmt: skip
    assert scale.min() > 0 and size.shape == residual.shape
    assert (np.abs(residual).max(axis=1) < 1e-6 * scale).all()


def test_rotors_are_gyroscopes() -> None:
    """Without the twist of the rotors' spin the motion of the test above would not be Lagrange's."""
    made = arm("springs", "payload", "rotor_coupling", "gravity_tilt", "base_compliance")
    x, u = made.draw(20)
    rhs = made.functions["rhs"].map(20)
    fast = x.copy()
    fast[entries(made, "motor_velocity")] *= 2
    gaps = []
    for coupling in (0.0, 1.0):
        c = ca.repmat(made.constants(coupling=coupling, viscous_friction=0.0, torsional_damping=0.0), 1, 20)
        slow, quick = (np.array(rhs(rows, u, c))[entries(made, "joint_velocity")] for rows in (x, fast))
        gaps.append(np.abs(quick - slow).max())
    assert gaps[0] < 1e-9 and gaps[1] > 1e-3


def state_effects(joints: int) -> str:
    """The effects in a robot's text, each of a size that shows."""
    payload = {key: ON[key] for key in ("payload_mass", "payload_x", "payload_y", "payload_z")}
    return (
        robots.effect("payload", joints, **payload)
        + robots.effect("gravity_tilt", 0, tilt_roll=0.2, tilt_pitch=-0.3)
        + "".join(robots.effect("rotor_coupling", j, coupling=2.0 * j - 5.0) for j in range(2, joints + 1))
        + robots.effect("base_compliance", 1, base_compliance=8e-5, base_frequency=150.0, base_damping=0.05)
    )


@pytest.mark.parametrize("kind", CHAINS)
def test_forward_dynamics_agree_with_mujoco(kind: str) -> None:
    """Payload, tilt, rotors on their links turning either way, and a base on hinges, under a wrench on the tip."""
    riding = ("rotor_coupling",) if kind == "springs" else ()  # a rigid drive's rotor has no body in MuJoCo
    made = arm(kind, "payload", "gravity_tilt", "base_compliance", *riding)
    x, u = made.draw(200)
    values = {q.name: ON.get(q.name.removesuffix(f"_{q.joint}"), q.nominal) for q in made.model.quantities}
    values |= {name: 0.0 for name in values if name.startswith("bias")}
    values |= {"coupling_1": 0.0, "coupling_2": -1.0, "base_damping_1": 0.05}
    c = made.functions["prepare"]([values[name] for name in made.parameters])
    ours = np.array(made.functions["rhs"].map(200)(x, u, ca.repmat(c, 1, 200)))
    reference = SpatialMuJoCo(text(kind) + state_effects(3))
    moving = entries(made, "motor_velocity", "joint_velocity")
    base = [made.states.index(f"base_moment_{k}_1") for k in "xyz"]
    base_rate = entries(made, "base_moment_rate")
    for k in range(200):
        whole = x[[*entries(made, "motor_position", "joint_position"), *moving], k]
        reference.place(whole, u[:, k], 8e-5 * x[base, k], 8e-5 * x[base_rate, k])
        theirs, turning = reference.accelerations()
        for found, expected in ((ours[moving, k], theirs), (8e-5 * ours[base_rate, k], turning)):
            assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()


def test_an_oscillator_on_a_joint_loses_what_its_damper_takes() -> None:
    """Energy with that of the oscillators, ½ B (b² + ω² a²), changes by the motors' power less the dampers' alone."""
    made = arm("rigid", "link_flexibility", "payload")
    damping = dict.fromkeys(LOSSLESS, 0.0) | {"link_damping": 0.1, "bias": 0.0}
    c = made.constants(**damping)
    x, u = ca.SX.sym("x", len(made.states)), ca.SX.sym("u", len(made.model.u_slots))
    a, b = x[entries(made, "bending_1", "bending_2")], x[entries(made, "bending_speed")]
    stored = 0.3 / 2 * (ca.sumsqr(b) + 150.0**2 * ca.sumsqr(a))
    kinetic, potential = made.functions["energy"](x, c)
    rate = made.functions["rhs"](x, u, c)
    v = x[entries(made, "joint_velocity")]
    ratio = [joint.drive.ratio.nominal for joint in made.model.robot.joints]
    slip = b - v[:2]  # the third joint slides, and has none
    given = ca.dot(u[:3] * ca.DM(ratio), v) - 2 * 0.1 * 150.0 * 0.3 * ca.sumsqr(slip)
    gap = ca.jtimes(kinetic + potential + stored, x, rate) - given
    rows, inputs = made.draw(50)
    inputs[3:] = 0.0
    found, size = (np.array(part) for part in ca.Function("f", [x, u], [gap, given]).map(50)(rows, inputs))
    assert len(entries(made, "bending_speed")) == 2
    assert np.abs(found).max() < 1e-9 * np.abs(size).max()


@pytest.mark.parametrize("kind", CHAINS)
def test_derivatives_are_difference_quotients(kind: str) -> None:
    """By x, u and p with every one of these effects on, at one state."""
    made = arm(kind, *OURS)
    f = {one.name: one.graph for one in assemble_graphs(made.model).functions}
    x, u = made.draw(2)
    x, u = x[:, 0], u[:, 0]
    p = np.array([ON.get(q.name.removesuffix(f"_{q.joint}"), q.nominal) for q in made.model.quantities])
    c = f["prepare"](p)
    found = [np.array(part).reshape(-1, x.size).T for part in f["rhs_jacobian"](x, u, c)]

    def by(at: Floats, rate: Callable[[Floats], Any]) -> tuple[Floats, Floats]:
        """Differences of order four, and what rounding may do to them."""
        columns, steps = [], 1e-5 * np.maximum(np.abs(at), 1e-3)
        for e in np.diag(steps):
            far, near = (np.array(rate(at + s * e) - rate(at - s * e)).ravel() for s in (2, 1))
            columns.append((8 * near - far) / 12)
        here, beside = (np.array(rate(at * factor)).ravel() for factor in (1.0, 1 + 4e-15))
        noise = 3 * (np.abs(beside - here) + 1e-15 * np.abs(here))
        return np.column_stack(columns) / steps, noise[:, None] / steps

    expected = [
        by(x, lambda at: f["rhs"](at, u, c)),
        by(u, lambda at: f["rhs"](x, at, c)),
        by(p, lambda at: f["rhs"](x, u, f["prepare"](at))),
    ]
    for ours, (theirs, noise) in zip(found, expected, strict=True):
        assert np.abs(theirs).max() > 1.0
        assert (np.abs(ours - theirs) <= 1e-6 * np.abs(theirs).max(axis=1, keepdims=True) + noise).all()
        assert (np.abs(ours - theirs) <= 1e-4 * np.abs(theirs).max(axis=0) + 10 * noise).all()


@pytest.mark.parametrize("name", OURS)
@pytest.mark.parametrize("kind", CHAINS)
def test_amplitude_zero_is_the_model_without_the_effect_to_the_bit(kind: str, name: str) -> None:
    """The other effects are on; states that both models have move alike, sliding or stuck; switched on, it is seen."""
    full, without = arm(kind, *OURS), arm(kind, *(other for other in OURS if other != name))
    effect = next(e.choose_form(in_space=True) for e in full.model.effects if e.name == name)
    off = dict.fromkeys(effect.amplitudes, 0.0)
    x, u = full.draw(100)
    common = [full.states.index(state) for state in without.states]
    stuck = np.repeat([[1.0], [0.0], [-1.0]], 100, axis=1)
    for function, more in (("rhs", ()), ("rhs_exact", (stuck,))):
        here, there = (made.functions[function].map(100) for made in (full, without))
        c, c_on, c_without = (
            ca.repmat(given, 1, 100) for given in (full.constants(**off), full.constants(), without.constants(**off))
        )
        rows = [*common, *range(len(full.states), here.size1_out(0))]  # holding torques stand behind the rates
        ours, present = (np.array(here(x, u, *more, given))[rows] for given in (c, c_on))
        theirs = np.array(there(x[common], u, *more, c_without))
        if name == "base_compliance":  # CasADi joins other constants where the base's turns stand between
            assert np.abs(ours - theirs).max() < 1e-13 * np.abs(theirs).max()
        else:
            assert np.array_equal(ours, theirs)
        assert not np.array_equal(present, theirs)


# -- what each of them says -------------------------------------------------------------------------------------------


def test_a_tilt_turns_gravity_with_the_base() -> None:
    """Torques at rest are those of a robot whose file states the turned gravity, whichever way it points."""
    for gravity in ([0.0, 0.0, -9.81], [9.0, 1.0, 2.0], [0.0, 9.81, 0.0]):
        table = tomllib.loads(text("rigid")) | {"gravity": gravity}
        robot = from_table(table, "robot.toml", Path("robot.toml"))
        model = Model(robot, effects("gravity_tilt"))
        p = model.chain_parameters()
        values = [{"tilt_roll": 0.3, "tilt_pitch": -0.2}.get(q.name, q.nominal) for q in model.quantities]
        turned = np.array(ca.Function("g", [model.p], [ca.vertcat(*model.chain.gravity(p))])(values)).ravel()
        up = -np.array(gravity) / np.linalg.norm(gravity)
        assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(gravity))
        cosine = -turned @ up / np.linalg.norm(turned)
        assert cosine == pytest.approx(np.cos(0.3) * np.cos(0.2))


def test_a_tilt_without_gravity_is_refused_and_never_tried() -> None:
    table = tomllib.loads(text("rigid")) | {"gravity": [0.0, 0.0, 0.0]}
    robot = from_table(table, "robot.toml", Path("robot.toml"))
    assert "tilt_roll" not in [q.name for q in Model(robot, effects("gravity_tilt")).quantities]
    table["effect"] = [{"name": "gravity_tilt", "joint": 0, "tilt_roll": 0.1}]
    with pytest.raises(RobotError, match="found gravity_tilt without gravity, which it turns; remove it or state"):
        from_table(table, "robot.toml", Path("robot.toml"))


def test_parameters_of_the_plane_are_refused_in_space() -> None:
    table = tomllib.loads(text("rigid"))
    table["effect"] = [{"name": "gravity_tilt", "joint": 0, "tilt_x": 0.1}]
    with pytest.raises(RobotError, match=r"effect\[1\].tilt_x: found an unknown key.*tilt_roll"):
        from_table(table, "robot.toml", Path("robot.toml"))


# -- flexible drives --------------------------------------------------------------------------------------------------


def test_a_flexible_arm_moves_as_in_mujocos_runge_kutta(build: Callable[..., Compiled]) -> None:
    """0.5 s in steps of 0.5 ms from rest under held torques: springs at each joint, payload, tilt, riding rotors."""
    robot = text("two springs") + state_effects(2)
    made, reference = build(robot), SpatialMuJoCo(robot, 0.0005)
    t = np.arange(0.0, 0.5, 0.01)
    u = np.hstack([0.5 * np.column_stack([np.sin(6 * t), np.cos(9 * t)]), np.zeros((t.size, 6))])
    x = made.rollout(np.zeros(len(made.states)), u, made.prepare(), 0.01, 0.0005)
    moving = [k for k, name in enumerate(made.states) if name.startswith(("motor_", "joint_"))]
    reference.place(np.zeros(len(moving)), u[0])
    theirs = [np.zeros(len(moving))]
    for row in u:
        reference.data.qfrc_applied[reference.motors] = row[:2]
        for _ in range(20):
            mujoco.mj_step(reference.model, reference.data)
        theirs.append(np.concatenate([reference.data.qpos[reference.order], reference.data.qvel[reference.order]]))
    scale = np.abs(x[:, moving]).max(axis=0)
    assert scale.min() > 0.05, "an arm that hardly moves compares nothing"
    assert (np.abs(x[:, moving] - np.array(theirs)) / scale).max() < 1e-7  # ours stiffens by 4e-8 at the law's torque
