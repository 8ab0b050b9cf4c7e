"""The same arm in MuJoCo and Pinocchio, timed beside ours: forward dynamics and Runge–Kutta steps without contacts.

Both get the model that `hdagen export mjcf` writes. Dry friction is left out there, for it would need their solvers of
constraints; ours has it. Python calls Pinocchio once for each state, so a call of it that does nothing is timed too.
"""

from __future__ import annotations

import importlib
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.model_export.joint_numbers import read_robot_numbers
from hdagen.model_export.mjcf_document import write_document

STEPS = 500  # in a run
OURS, OURS_WITH_DERIVATIVES = "forward dynamics", "forward dynamics with derivatives"  # names of runs
MUJOCO_STEP = "MuJoCo, Runge–Kutta step"
PINOCCHIO_ABA, PINOCCHIO_CALL = "Pinocchio, ABA from Python", "Pinocchio, an empty call"
RACED_RUNS = (OURS, OURS_WITH_DERIVATIVES, PINOCCHIO_ABA, PINOCCHIO_CALL, MUJOCO_STEP)
SPREAD = 0.5  # rad and rad/s, of the states whose accelerations are timed

Run = tuple[Callable[[], Any], int]


def list_simulator_runs(arm: Arm) -> dict[str, Run]:
    """List what is timed of an arm beside other simulators.

    Args:
        arm: The arm; its drives are rigid.

    Returns:
        Each run with its number of steps or calls, by name; of simulators that are not installed none.

    """
    if arm.manifest["flexible"]:
        return {}
    rng = np.random.default_rng(1)
    x, u = rng.uniform(-SPREAD, SPREAD, (STEPS, arm.nx)), np.zeros((STEPS, arm.nu))
    out, slopes = np.empty((STEPS, arm.nx)), [np.empty(k * arm.nx) for k in (arm.nx, arm.nu, len(arm.p))]
    runs: dict[str, Run] = {
        OURS: (lambda: arm.module.map("rhs", STEPS, x, u, arm.c, out), STEPS),
        OURS_WITH_DERIVATIVES: (
            lambda: arm.module.map("rhs_jacobian", STEPS, x, u, arm.c, *slopes),
            STEPS,
        ),
    }
    document = _write_model(arm)
    mujoco, pinocchio = _find_module("mujoco"), _find_module("pinocchio")
    if mujoco is not None:
        runs[MUJOCO_STEP] = _make_mujoco_run(mujoco, document)
    if pinocchio is not None:
        runs |= _make_pinocchio_runs(pinocchio, document, x)
    return runs


def compare_simulators(times: Mapping[str, Array], step: Array) -> dict[str, Array]:
    """Compare an arm with the simulators that were timed beside it.

    Args:
        times: Time of each run of `list_simulator_runs`, ns a call or a step, over rounds.
        step: Time of our Runge–Kutta step upon step in C, ns, over the same rounds.

    Returns:
        The figures of bars_panda.toml that rest on these, over rounds; of a simulator that was not timed none.

    """
    ours, slopes = times[OURS], times[OURS_WITH_DERIVATIVES]
    reached = {"forward_dynamics": ours, "forward_dynamics_with_derivatives": slopes}
    if MUJOCO_STEP in times:
        reached["step_against_mujoco"] = times[MUJOCO_STEP] / step
    if PINOCCHIO_ABA in times:
        theirs = times[PINOCCHIO_ABA] - times[PINOCCHIO_CALL]
        reached |= {
            "forward_dynamics_against_pinocchio": theirs / ours,
            "derivatives_against_pinocchio": slopes / theirs,
        }
    return reached


def _find_module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _write_model(arm: Arm) -> str:
    names = tuple(f"joint_{j}" for j in range(1, arm.n + 1))
    return write_document(arm.robot["name"], read_robot_numbers(arm, names), arm.step_size)


def compile_frictionless(mujoco: Any, document: str) -> Any:
    """Compile a MuJoCo model without contacts and dry friction, integrated by Runge and Kutta's method.

    Args:
        mujoco: The module.
        document: The model.

    Returns:
        MuJoCo's model.

    """
    model = mujoco.MjModel.from_xml_string(document)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    return model


def _make_mujoco_run(mujoco: Any, document: str) -> Run:
    model = compile_frictionless(mujoco, document)
    data = mujoco.MjData(model)
    return (lambda: mujoco.mj_step(model, data, STEPS)), STEPS


def _make_pinocchio_runs(pinocchio: Any, document: str, x: Any) -> dict[str, Run]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(document, encoding="utf-8")
        model = pinocchio.buildModelFromMJCF(str(path))
    data, n = model.createData(), model.nv
    states = [(np.ascontiguousarray(row[:n]), np.ascontiguousarray(row[n : 2 * n])) for row in x]
    torque = np.zeros(n)

    def accelerate() -> None:
        for q, v in states:
            pinocchio.aba(model, data, q, v, torque)

    def call_nothing() -> None:
        for _ in states:
            pinocchio.checkVersionAtLeast(1, 0, 0)

    return {PINOCCHIO_ABA: (accelerate, STEPS), PINOCCHIO_CALL: (call_nothing, STEPS)}
