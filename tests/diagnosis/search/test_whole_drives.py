"""A robot file without rotors and with guessed frictions, as of a URDF: all joints' numbers are found together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from hdagen.arm.compiled_arm import load
from hdagen.diagnosis.data.models import load_models
from hdagen.diagnosis.data.prepared_data import prepare_data
from hdagen.diagnosis.decision.effect_presence import keep_present_effects
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import start_fit
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.null_model import fit_null_model, make_nominal_point
from hdagen.diagnosis.search.whole_drives import are_rotors_missing, fit_whole_drives, list_absent_inertias
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.measured_log import Log

RESOLUTION = 1e-5  # rad
JOINT = """[[joint]]
length = 0.25
mass = 0.8
center_of_mass = 0.1
inertia = 0.004
[joint.drive]
rigid = true
ratio = 1.0
motor_inertia = 0.0
viscous_friction = 0.01
coulomb_friction = 0.1
friction_smoothing = 0.05
[joint.limits]
torque = 20.0
"""
SENSOR = f"[joint.sensor]\njoint_encoder_resolution = {RESOLUTION}\n"
ROBOT = 'name = "leg"\ngravity = [0.0, -9.81]\nstep = 1e-3\n' + 2 * (JOINT + SENSOR)
TRUTH = {
    "motor_inertia_1": 0.02,
    "motor_inertia_2": 0.004,  # a fifth of its usual size, and yet missing
    "coulomb_friction_1": 0.3,
    "coulomb_friction_2": 0.25,
    "viscous_friction_1": 0.15,
    "viscous_friction_2": 0.1,
}


def move_leg(robot: Path, seconds: float, truth: Mapping[str, float]) -> Log:
    """A log of a machine with some true numbers, held near the file's weight by its torques."""
    arm = load(robot)
    time = np.arange(0.0, seconds, 2e-3)
    waves = [np.sin(2 * np.pi * np.outer(time, f) + np.arange(3)) for f in ([0.31, 0.83, 1.9], [0.47, 1.1, 2.6])]
    wanted = np.stack([0.35 * (wave @ [1.0, 0.4, 0.15]) for wave in waves], axis=1) + np.array([-1.2, -0.6])
    arm.parameters.update(truth)
    x, rows, u = arm.rest(wanted[0].tolist()), [], np.zeros((len(time), arm.nu))
    velocity = np.gradient(wanted, time, axis=0)
    for k in range(len(time)):
        rows.append(x)
        u[k, :2] = [40.0, 20.0] * (wanted[k] - x[:2]) + [2.0, 1.0] * (velocity[k] - x[2:4])
        x = arm.rollout(x, u[k : k + 1], np.array([2e-3]), exact=True)[-1]
    angle = arm.outputs(np.array(rows), u)["joint_position"]
    columns = {f"motor_torque_command_{j}": u[:, j - 1].copy() for j in (1, 2)}
    columns |= {f"joint_position_{j}": np.round(angle[:, j - 1] / RESOLUTION) * RESOLUTION for j in (1, 2)}
    return Log(time, columns, 2, "made")


def test_rotors_and_frictions_of_all_joints_are_found_at_once(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT)
    with threadpool_limits(1):
        models = load_models(robot)
        record = prepare_data(models, [move_leg(robot, 8.0, TRUTH)], []).record
        assert are_rotors_missing(models.full, record)
        null = fit_null_model(models.full, record, TimeBudget(), with_numbers=True)
        candidates = null.candidates
        at = compute_sensitivities(null.shooting, candidates, make_nominal_point(null.shooting, candidates))
        assert len(list_absent_inertias(candidates)) == 2
        regression = TorqueRegression.from_record(models.full, record, candidates)
        assert regression is not None
        base = start_fit(at, candidates, (), null.fit.score.posterior.s)
        found = fit_whole_drives(regression, at, candidates, null.fit.score.posterior.s)
    assert {name.replace("@", "_") for name in found.names} == {*TRUTH}
    assert keep_present_effects(found) == found.names
    assert found.evidence_here > base.evidence_here + 100.0
    p = dict(zip(models.full.parameters, found.sensitivities.point.p, strict=True))
    for name, truth in TRUTH.items():
        assert abs(p[name] - truth) < 0.1 * truth, name


@pytest.mark.parametrize("missing", [(), ("coulomb_friction_1", "viscous_friction_1"), ("coulomb_friction_2",)])
def test_a_machine_without_rotors_lacks_none(tmp_path: Path, missing: tuple[str, ...]) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT)
    with threadpool_limits(1):
        models = load_models(robot)
        log = move_leg(robot, 4.0, {name: TRUTH[name] for name in missing})
        assert not are_rotors_missing(models.full, prepare_data(models, [log], []).record)


def test_a_file_that_states_its_rotors_lacks_none(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT.replace("motor_inertia = 0.0", "motor_inertia = 0.004"))
    with threadpool_limits(1):
        models = load_models(robot)
        record = prepare_data(models, [move_leg(robot, 4.0, TRUTH)], []).record
        assert not are_rotors_missing(models.full, record)
