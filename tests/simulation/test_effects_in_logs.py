"""Effects from end to end: what a truth writes into a log, a replay with the same parameters takes out again; what
manifests say of effects; drives that were called rigid; sensors that lie."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import robots
from compiled import Compiled, Floats
from replayed import FLEXIBLE, RIGID, simulated
from uncompiled import load_uncompiled

from gen.effects import ALL, NOMINAL
from gen.effects.effect import Effect, Port
from gen.robot.description import RobotError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import circle
from hdagen.prediction.window_replay import Replay, replay
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import simulate

Builder = Callable[..., Compiled]
NAMES = tuple(effect.name for effect in ALL)
# What is put into the log where the usual size would not show on an arm that hangs under gravity and swings by 1 rad.
# Of hysteresis half the usual size: with all of it the first states of windows are known to 7 times the noise, not 6.
SHAPES = {"contact_above": 0.02, "contact_below": -0.03, "thermal_time": 0.5, "ripple_order": 2.0, "cable_rest": 0.5}
FACTORS = {
    "current_saturation": 4.0,
    "voltage_sag": 2.0,
    "base_compliance": 5.0,
    "rotor_coupling": -1.0,
    "transmission_hysteresis": 0.5,
}


@pytest.fixture(scope="module")
def superset(build: Builder) -> Arm:
    """The flexible arm with every effect."""
    return Arm(build(FLEXIBLE, effects=NAMES).folder)


def truth(arm: Arm, name: str, factor: float = 1.0) -> dict[str, float]:
    """Parameters with which an effect is there at its usual size, at the last joint that has it."""
    own = [q for q in arm.parameters.described.values() if q.effect == name]
    joint = max(q.joint for q in own)
    values = {}
    for q in (q for q in own if q.joint == joint):
        shape = SHAPES.get(q.name.removesuffix(f"_{joint}"), q.nominal)
        values[q.name] = shape if q.typical is None else q.nominal + factor * q.typical
    return values


def multiples(found: Replay) -> Floats:
    return np.array([found.errors[name] / found.noise[name] for name in found.errors if found.noise[name]])


# -- a truth put in comes out -----------------------------------------------------------------------------------------

SEEN = [e for e in ALL if e.port not in (Port.SERIES, Port.TORQUE_SENSOR) and e.name != "gravity"]


@pytest.mark.parametrize("effect", SEEN, ids=lambda effect: effect.name)
def test_a_replay_with_the_truth_is_at_the_noise_and_without_it_is_not(superset: Arm, effect: Effect) -> None:
    arm = superset
    arm.parameters.reset()
    values = truth(arm, effect.name, FACTORS.get(effect.name, 1.0))
    arm.parameters.update(values)
    log = simulated(arm, 0.75)
    right = multiples(replay(arm, log))
    arm.parameters.reset()
    wrong = multiples(replay(arm, log))
    assert right.max() < 6.0, right
    assert (wrong / right).max() > 1.5


def test_a_simulated_controller_s_log_is_replayed_to_its_noise(superset: Arm) -> None:
    """Through `simulate`: commands late and lagging, a joint encoder off centre and the other late."""
    arm = superset
    arm.parameters.reset()
    controller = Controller(Arm(arm.folder), "position", Guard(Safe.ZERO, torque_rate=(50.0, 50.0)))
    present = {"command_delay_1": 1.5e-3, "current_lag_2": 1e-3, "eccentricity_sine_2": 5e-4, "sensor_delay_1": 1e-3}
    arm.parameters.update(present)
    log = simulate(arm, controller, circle(0.05, (0.4, 0.0), 1.0, 1.0), (), Sensors(force_noise=0.0), seed=4)
    right = multiples(replay(arm, log))
    arm.parameters.reset()
    wrong = multiples(replay(arm, log))
    assert right.max() < 6.0, right
    assert (wrong / right).max() > 5.0


def test_memories_are_carried_across_windows(superset: Arm) -> None:
    """Friction that fades within half a second: at the end it is what it has become, not what a window began with."""
    arm = superset
    arm.parameters.reset()
    arm.parameters.update(truth(arm, "thermal_friction") | {"thermal_speed_2": 1e-6})  # warms wherever it moves
    log = simulated(arm, 0.75)
    warmth = replay(arm, log, window=0.1).states[:, arm.index("warmth_2")]
    arm.parameters.reset()
    assert warmth == pytest.approx(1 - np.exp(-(log.time - log.time[0]) / 0.5), abs=0.03)  # it sticks for a moment


# -- sensors that lie -------------------------------------------------------------------------------------------------


def test_a_late_encoder_reads_what_was(superset: Arm) -> None:
    """q(t − d) along a motion without kinks, to the third order of d; its velocity with it."""
    arm = superset
    arm.parameters.reset()
    d, h = 1e-3, 1e-4
    t = np.arange(4000) * h
    u = np.zeros((len(t), arm.nu))
    u[:, 0], u[:, 1] = 3.0 * (1 - np.cos(4 * t)), 1.0 * (1 - np.cos(6 * t))
    x = arm.rollout(arm.rest([-np.pi / 2, 0.0]), u[:-1], h)[1000:]
    arm.parameters["sensor_delay_1"] = d
    seen = arm.outputs(x, u[1000:])
    late = round(d / h)
    q, v = seen["joint_angle"][:, 0], x[:, arm.index("joint_velocity_1")]
    arm.parameters.reset()
    moved = np.abs(q[late:] - q[:-late]).max()
    assert np.abs(seen["joint_position"][late:, 0] - q[:-late]).max() < 1e-3 * moved
    assert np.abs(seen["joint_velocity"][late:, 0] - v[:-late]).max() < 0.02 * np.abs(v).max()
    assert np.array_equal(seen["joint_position"][:, 1], seen["joint_angle"][:, 1])
    assert np.array_equal(q, x[:, arm.index("joint_position_1")])


def test_encoder_and_torque_sensor_read_what_their_equations_say(superset: Arm) -> None:
    arm = superset
    arm.parameters.reset()
    x = np.random.default_rng(5).normal(size=(50, arm.nx))
    x[:, arm.index("motor_position_1")] = 100 * x[:, arm.index("joint_position_1")]
    u = np.zeros(arm.nu)
    true = arm.outputs(x, u)
    given = {"eccentricity_sine_1": 3e-4, "eccentricity_cosine_1": -2e-4, "encoder_bias_1": 1e-3}
    arm.parameters.update(given | {"torque_sensor_error_1": 0.1})
    seen, q = arm.outputs(x, u), true["joint_angle"][:, 0]
    arm.parameters.reset()
    error = 3e-4 * np.sin(q) - 2e-4 * np.cos(q) + 1e-3
    assert seen["joint_position"][:, 0] - q == pytest.approx(error, abs=1e-15)
    rate = (3e-4 * np.cos(q) + 2e-4 * np.sin(q)) * true["joint_velocity"][:, 0]
    assert seen["joint_velocity"][:, 0] - true["joint_velocity"][:, 0] == pytest.approx(rate, abs=1e-13)
    assert seen["joint_torque"][:, 0] == pytest.approx(1.1 * true["joint_torque"][:, 0], rel=1e-14)
    for name in ("tip", "torsion", "joint_angle"):
        assert np.array_equal(seen[name], true[name])


# -- drives that were called rigid ------------------------------------------------------------------------------------


def test_missing_compliance_is_a_linear_spring_with_a_dashpot(build: Builder) -> None:
    """τ = φ/C + d φ̇ for any C and d, not only those that the build began with."""
    arm = Arm(build(RIGID, effects=("missing_compliance",)).folder)
    assert arm.manifest["flexible"] == [1, 2]
    assert arm.parameters["missing_compliance_1"] == arm.parameters.described["missing_compliance_1"].typical
    rng = np.random.default_rng(6)
    for compliance, damping in ((1e-4, 5.0), (3e-5, 0.0), (2e-3, 40.0)):
        arm.parameters.update({"missing_compliance_1": compliance, "missing_damping_1": damping})
        x = np.zeros((100, arm.nx))
        torsion, rate = rng.uniform(-5e-3, 5e-3, 100), rng.uniform(-0.1, 0.1, 100)
        ratio = arm.parameters["ratio_1"]
        x[:, arm.index("motor_position_1")], x[:, arm.index("motor_velocity_1")] = ratio * torsion, ratio * rate
        torque = arm.outputs(x, np.zeros(arm.nu))["joint_torque"][:, 0]
        spring = torsion / compliance  # the wave generator's, a million times stiffer, yields by a millionth of it
        assert (np.abs(torque - spring - damping * rate) <= 2e-6 * np.abs(spring) + 1e-9).all()


def test_a_stiffer_drive_comes_nearer_to_the_rigid_one(build: Builder) -> None:
    """Link angles of both under the same push: the difference goes with the compliance."""
    rigid, arm = Arm(build(RIGID).folder), Arm(build(RIGID, effects=("missing_compliance",)).folder)
    u = np.zeros((300, 4))
    u[:, 0] = 0.3 * np.sin(np.arange(300) * 0.02)
    angle = "joint_position_1"
    true = rigid.rollout(rigid.rest([-1.5, 0.1]), u, 1e-3, exact=True)[:, rigid.index(angle)]
    gaps = []
    for compliance in (4e-4, 2e-4, 1e-4):
        arm.parameters.update({"missing_compliance_1": compliance, "missing_damping_1": 20.0})
        x = arm.rollout(arm.rest([-1.5, 0.1]), u, 1e-3, exact=True)
        gaps.append(np.abs(x[:, arm.index(angle)] - true).max())
    assert gaps[0] > gaps[1] > gaps[2] > 0.0
    assert gaps[0] / gaps[2] > 2.0


def test_where_missing_compliance_has_no_place_it_is_left_out_or_refused(build: Builder, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(FLEXIBLE)
    flexible = load_uncompiled(tmp_path / "robot.toml", effects=("missing_compliance",)).manifest
    assert "missing_compliance" not in [e["name"] for e in flexible["effects"]]
    for text, said in (
        (FLEXIBLE, "whose drive has springs, possible for missing_compliance is a joint with rigid = true"),
        (RIGID.replace("motor_inertia = 0.00013", "motor_inertia = 0.0"), "whose motor_inertia is 0"),
    ):
        with pytest.raises(RobotError, match=said):
            build(text + robots.effect("missing_compliance", 1))


# -- what a manifest says ---------------------------------------------------------------------------------------------


def test_a_manifest_says_what_every_parameter_is_for(superset: Arm) -> None:
    described = superset.parameters.described
    effects = {e["name"]: e for e in superset.manifest["effects"]}
    assert set(effects) == {e.name for e in ALL if e.port is not Port.SERIES}
    for effect in effects.values():
        for j in effect["joints"]:
            suffix = f"_{j}" if j else ""
            amplitudes = [described[name + suffix] for name in effect["amplitudes"]]
            shapes = [described[name + suffix] for name in effect["shapes"]]
            assert {q.role for q in amplitudes} <= {"amplitude", "base"} and {q.role for q in shapes} <= {"shape"}
            assert all(q.starts[0] == q.nominal and q.typical is None for q in shapes)
            if effect["name"] != "gravity":
                assert all((q.typical or 0.0) > 0 and q.effect == effect["name"] for q in amplitudes)
    p = described
    assert p["stribeck_torque_1"].typical == pytest.approx(0.4 * p["coulomb_friction_1"].nominal)
    assert p["saturation_inverse_1"].typical == pytest.approx(2.0 / 10.0)  # half of max_current
    assert p["presliding_angle_1"].starts == pytest.approx((0.02, 0.005, 0.1, 0.5))  # by the ratio of 100
    assert p["mass_1"].effect == "mass" and p["mass_1"].role == "base"
    assert p["coulomb_friction_1"].role == "base" and p["coulomb_friction_1"].effect == "coulomb_friction"


def test_a_rigid_robot_has_the_effects_that_mean_something_there(tmp_path: Path) -> None:
    """One that turns and one that slides, driven by torque."""
    rest = tuple(name for name in NAMES if name != "missing_compliance")
    (tmp_path / "robot.toml").write_text(RIGID)
    manifest = load_uncompiled(tmp_path / "robot.toml", effects=rest).manifest
    effects = {e["name"]: e for e in manifest["effects"]}
    assert not {e.name for e in ALL if not e.suits_rigid_drive and e not in NOMINAL} & set(effects)
    assert list(effects["encoder_eccentricity"]["joints"]) == [1] and list(effects["contact"]["joints"]) == [1, 2]
    assert effects["torque_constant"]["amplitudes"] == ["torque_gain"]
    units = {q["name"]: q["unit"] for q in manifest["parameters"]}
    assert (units["cable_stiffness_1"], units["cable_stiffness_2"]) == ("N m/rad", "N/m")


def test_an_effect_is_refused_where_it_has_no_meaning(build: Builder) -> None:
    for name, joint, said in (
        ("encoder_eccentricity", 2, "found 2, which is prismatic, possible for encoder_eccentricity is a revolute"),
        ("base_compliance", 2, r"possible for base_compliance is 1 \(the first joint\)"),
        ("backlash", 1, "whose drive is rigid"),
    ):
        with pytest.raises(RobotError, match=said):
            build(RIGID + robots.effect(name, joint))
