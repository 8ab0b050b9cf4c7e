"""A robot written as MJCF and URDF has the robot's equations of motion in MuJoCo and in Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, RIGID

from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.joint_numbers import read_robot_numbers
from hdagen.model_export.mjcf_document import write_delay_attributes, write_document
from hdagen.model_export.urdf_writer import write as write_urdf

Builder = Callable[..., Compiled]


def load_frictionless(build: Builder, robot: str) -> Arm:
    """The arm without dry friction, which no instant shows alone."""
    arm = Arm(build(robot).folder)
    arm.parameters.update({name: 0.0 for name in arm.parameters if name.startswith("coulomb_friction")})
    return arm


def name_joints(arm: Arm) -> tuple[str, ...]:
    return tuple(f"j{k}" for k in range(1, arm.n + 1))


@pytest.mark.parametrize(
    "robot, error",
    [(FLEXIBLE, 0.05), (RIGID, 1e-5), ("emps", 1e-5), ("dfki_1_0", 1e-5)],
    ids=["flexible", "rigid", "emps", "dfki"],
)
def test_mujoco_accelerates_as_the_model_does(build: Builder, robot: str, error: float) -> None:
    """Springs, rotors and their coupling, gravity, sliding and turning joints, at random states: exactly but for
    springs, whose law is a cubic there."""
    arm, rng = load_frictionless(build, robot), np.random.default_rng(3)
    numbers = read_robot_numbers(arm, name_joints(arm))
    model = mujoco.MjModel.from_xml_string(write_document("robot", numbers, arm.step_size))
    data = mujoco.MjData(model)
    for _ in range(5):
        q, v, twist, rate = rng.uniform(-1, 1, (4, arm.n)) * np.array([[1.0], [1.0], [5e-4], [0.01]])
        x, u = np.zeros(arm.nx), np.zeros(arm.nu)
        u[: arm.n] = 0.3 * rng.uniform(-1, 1, arm.n)
        for j, joint in enumerate(numbers.joints):
            soft = joint.transmission is not None
            x[arm.index(f"joint_position_{j + 1}")], x[arm.index(f"joint_velocity_{j + 1}")] = q[j], v[j]
            data.joint(joint.name).qpos, data.joint(joint.name).qvel = q[j] + soft * twist[j], v[j] + soft * rate[j]
            if soft:
                x[arm.index(f"motor_position_{j + 1}")] = joint.ratio * (q[j] + twist[j])
                x[arm.index(f"motor_velocity_{j + 1}")] = joint.ratio * (v[j] + rate[j])
                data.joint(f"{joint.name}_torsion").qpos = -twist[j]
                data.joint(f"{joint.name}_torsion").qvel = -rate[j]
        data.ctrl[:] = u[: arm.n]
        mujoco.mj_forward(model, data)
        change = (arm.rollout(x, u[None], 1e-7, exact=True)[1] - x) / 1e-7
        ours = np.array([change[arm.index(f"joint_velocity_{j}")] for j in range(1, arm.n + 1)])
        theirs = np.array([data.joint(name).qacc[0] for name in name_joints(arm)])
        for j, joint in enumerate(numbers.joints):
            if joint.transmission:
                theirs[j] += data.joint(f"{joint.name}_torsion").qacc[0]
        assert theirs == pytest.approx(ours, rel=error, abs=error * np.abs(ours).max())


def test_urdf_has_the_mass_matrix_and_the_weight(build: Builder, tmp_path: Path) -> None:
    """Read by Pinocchio, which knows nothing of rotors: they are added by hand."""
    arm = load_frictionless(build, RIGID)
    written = write_urdf(CorrectedRobot("robot.toml", arm, arm), tmp_path / "robot.urdf")
    model = pinocchio.buildModelFromUrdf(str(tmp_path / "robot.urdf"))
    numbers, q = read_robot_numbers(arm, name_joints(arm)), np.array([0.4, -0.2])
    place = np.array([np.cos(q[0]), np.sin(q[0]), q[1]])  # as Pinocchio has a joint that turns without end
    model.gravity.linear = np.array(numbers.gravity)
    data = model.createData()
    mass = np.triu(pinocchio.crba(model, data, place)) + np.triu(pinocchio.crba(model, data, place), 1).T
    mass += np.diag([joint.armature for joint in numbers.joints])
    assert mass == pytest.approx(arm.evaluate("mass_matrix", q=q)["M"].reshape(2, 2), rel=1e-6, abs=1e-9)
    weight = pinocchio.computeGeneralizedGravity(model, data, place)
    assert weight == pytest.approx(arm.evaluate("gravity_torque", q=q)["g"], rel=1e-6, abs=1e-9)
    assert any("reflected inertia" in note for note in written.notes)


@pytest.mark.parametrize("integrator, has_stages", [("Euler", False), ("RK4", True)])
@pytest.mark.parametrize("delay", [0.002, 0.0033, 0.0061])
def test_a_delay_acts_when_it_is_due(integrator: str, has_stages: bool, delay: float) -> None:
    """The impulse of a step of force that comes late, by MuJoCo, to a hundredth of a step."""
    step = 0.001
    late = write_delay_attributes(delay, step, has_stages)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>'
        '<joint name="a" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
        f'</worldbody><actuator><motor joint="a"{late}/></actuator></mujoco>'
    )
    data = mujoco.MjData(model)
    for k in range(30):
        data.ctrl[0] = float(k >= 10)
        mujoco.mj_step(model, data)
    assert data.qvel[0] == pytest.approx(0.020 - delay, abs=0.01 * step)


def test_a_delay_of_less_than_half_a_step_is_none() -> None:
    assert write_delay_attributes(0.0004, 0.001) == ""
    assert "nsample" in write_delay_attributes(0.0006, 0.001)
