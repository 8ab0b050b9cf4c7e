"""The leg beside MuJoCo's own identification: both get the model and the log, and MuJoCo replays both in closed loop.

MuJoCo fits armature, damping and dry friction of both joints, the numbers of the model's structure; the delay, which
the structure lacks, is left to whoever looks for causes. `pip install 'mujoco[sysid]'` brings it.
"""

from __future__ import annotations

from pathlib import Path

import leg
import mujoco
import numpy as np
import pytest

from hdagen.__main__ import main
from hdagen.log import read

WINDOW = 250  # rows of a replay that begins in a measured state
SENSORS = '<sensor><jointpos name="hip" joint="hip"/><jointpos name="knee" joint="knee"/></sensor></mujoco>'
LEAST_TIMES_BETTER = 1.5


def identify_by_mujoco(log: dict[str, np.ndarray]) -> mujoco.MjModel:
    """The user's model with the numbers that MuJoCo's identification finds in a log."""
    sysid = pytest.importorskip("mujoco.sysid")
    assert hasattr(sysid, "optimize"), "pip install 'mujoco[sysid]'"
    text = Path("leg.xml").read_text(encoding="utf-8").replace("</mujoco>", SENSORS)
    spec = mujoco.MjSpec.from_string(text)
    spec.option.timestep = 1.0 / leg.RATE
    model = spec.compile()
    parameters = sysid.ParameterDict()
    for joint in ("hip", "knee"):
        for name, most in (("armature", 0.1), ("damping", 2.0), ("frictionloss", 2.0)):
            stated = leg.STATED[name][0]

            def change(changed: mujoco.MjSpec, parameter: object, joint: str = joint, name: str = name) -> None:
                value = parameter.value[0]  # type: ignore[attr-defined]
                setattr(changed.joint(joint), name, [value, 0.0, 0.0] if name == "damping" else value)

            parameters.add(sysid.Parameter(f"{joint}_{name}", stated, 0.0, most, modifier=change))
    windows = []
    position = np.column_stack([log[f"joint_position_{j}"] for j in (1, 2)])
    torque = np.column_stack([log[f"motor_torque_command_{j}"] for j in (1, 2)])
    speed = np.gradient(position, 1.0 / leg.RATE, axis=0)
    for first in range(WINDOW, len(position) - WINDOW, WINDOW):
        rows = slice(first, first + WINDOW)
        times = np.arange(WINDOW) / leg.RATE
        windows.append(
            sysid.ModelSequences(
                f"leg_{first}",
                spec,
                "log",
                sysid.create_initial_state(model, position[first], speed[first], np.zeros(model.na)),
                sysid.TimeSeries(times, torque[rows]),
                sysid.TimeSeries.from_names(times[1:], position[rows][1:], model),
            )
        )
    found, _ = sysid.optimize(
        parameters, sysid.build_residual_fn(models_sequences=windows), optimizer="mujoco", verbose=False
    )
    sysid.apply_param_modifiers_spec(found, spec)
    return spec.compile()


def measure_error(model: mujoco.MjModel, held: dict[str, np.ndarray]) -> np.ndarray:
    """Root mean square of each joint's position error, rad, where MuJoCo drives a model by the law (2)."""
    model.opt.timestep = 0.25 / leg.RATE
    data, seen, errors = mujoco.MjData(model), np.zeros(2), []
    for k in range(len(held["time"])):
        read_position = np.round(data.qpos / leg.RESOLUTION) * leg.RESOLUTION
        speed, seen = (read_position - seen) * leg.RATE, read_position
        reference, measured = (
            np.array([held[f"{name}_{j}"][k] for j in (1, 2)])
            for name in ("joint_position_reference", "joint_position")
        )
        errors.append(data.qpos - measured)
        torque = np.array(leg.PROPORTIONAL) * (reference - read_position) - np.array(leg.DERIVATIVE) * speed
        data.ctrl[:] = np.clip(torque, -25, 25)
        mujoco.mj_step(model, data, nstep=4)
    return np.sqrt(np.mean(np.square(errors), axis=0))


@pytest.mark.campaign
def test_the_leg_is_nearer_than_by_mujocos_identification(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leg.write_leg(tmp_path, (8.0, 4.0))
    monkeypatch.chdir(tmp_path)
    log, held = ({"time": one.time, **one.columns} for one in (read(Path("log.parquet")), read(Path("held.parquet"))))
    fitted = identify_by_mujoco(log)
    found = ("--with", "diagnosis/diagnosis.json")
    assert main(["diagnose", "leg.toml", "log.parquet", "--hold-out", "held.parquet", "--out", "diagnosis"]) == 0
    assert main(["export", "mjcf", "leg.toml", *found, "--into", "leg.xml", "--out", "new.xml"]) == 0
    models = {
        "stated": mujoco.MjModel.from_xml_path("leg.xml"),
        "MuJoCo's identification": fitted,
        "diagnosis": mujoco.MjModel.from_xml_path("new.xml"),
    }
    errors = {name: measure_error(model, held) for name, model in models.items()}
    for name, error in errors.items():
        print(f"{name}: hip {1e3 * error[0]:.2f} mrad, knee {1e3 * error[1]:.2f} mrad")
    assert np.all(LEAST_TIMES_BETTER * errors["diagnosis"] < errors["MuJoCo's identification"])
