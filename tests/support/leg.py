"""A leg of hip and knee in MuJoCo: the model that its user has, the leg as it is, and what it logs under a PD law."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.log.measured_log import write

RATE = 500.0  # Hz, of the law and of the log
DELAY = 0.006  # s, from a command to its torque
PROPORTIONAL, DERIVATIVE = (60.0, 40.0), (1.5, 0.8)  # N m/rad and N m s/rad
RESOLUTION = 2 * np.pi / 2**17  # rad, of the encoders
STATED = {"armature": (0.01, 0.01), "damping": (0.1, 0.1), "frictionloss": (0.05, 0.05)}
TRUE = {"armature": (0.013, 0.012), "damping": (0.25, 0.18), "frictionloss": (0.25, 0.40)}

MODEL = """<?xml version="1.0" encoding="utf-8"?>
<!-- The leg of a small walker, as its user has it. -->
<mujoco model="leg">
  <compiler angle="degree" autolimits="true"/>
  <option timestep="{step}" gravity="0 0 -9.81"/>
  <default>
    <default class="drive">
      <joint axis="0 -1 0" armature="0.01" damping="0.1"/>
      <motor ctrlrange="-25 25"/>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="thigh" pos="0 0 1">  <!-- 1.5 kg: motor of the knee included -->
      <joint name="hip" class="drive" range="-90 90" {hip}/>
      <inertial pos="0 0 -0.12" mass="1.5" diaginertia="0.012 0.012 0.002"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" contype="0" conaffinity="0"/>
      <body name='shank' pos='0 0 -0.3'>
        <joint name='knee' class='drive'
               {knee} range='-140 140'/>
        <inertial pos="0 0 -0.14" mass="0.6" diaginertia="0.006 0.006 0.0008"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="hip_motor" class="drive" joint="hip"{delay}/>
    <motor name="knee_motor" class="drive" joint="knee"{delay}/>
  </actuator>
</mujoco>
"""
ROBOT = """# The leg in the plane: x points down, the joints turn from it.
name = "leg"
gravity = [9.81, 0.0]
step = 0.0005

[[joint]]
name = "hip"
length = 0.3
mass = {{value = 1.5, tolerance = 0.02}}
center_of_mass = {{value = 0.12, tolerance = 0.02}}
inertia = {{value = 0.012, tolerance = 0.05}}
[joint.drive]
rigid = true
ratio = 1.0
motor_inertia = {{value = 0.01, tolerance = {trust}}}
viscous_friction = {{value = 0.1, tolerance = {trust}}}
coulomb_friction = {{value = 0.05, tolerance = {trust}}}
[joint.limits]
torque = 25.0
[joint.sensor]
joint_encoder_resolution = {count}

[[joint]]
name = "knee"
length = 0.3
mass = {{value = 0.6, tolerance = 0.02}}
center_of_mass = {{value = 0.14, tolerance = 0.02}}
inertia = {{value = 0.006, tolerance = 0.05}}
[joint.drive]
rigid = true
ratio = 1.0
motor_inertia = {{value = 0.01, tolerance = {trust}}}
viscous_friction = {{value = 0.1, tolerance = {trust}}}
coulomb_friction = {{value = 0.05, tolerance = {trust}}}
[joint.limits]
torque = 25.0
[joint.sensor]
joint_encoder_resolution = {count}
"""


def write_model(numbers: dict[str, tuple[float, float]], step: float, delay: float = 0.0) -> str:
    """The text of a model with these numbers."""
    joints = [" ".join(f'{name}="{values[j]}"' for name, values in numbers.items()) for j in (0, 1)]
    late = ""
    if delay:
        late = f' delay="{delay}" nsample="{round(delay / step) + 1}" interp="linear"'
    return MODEL.format(step=step, hip=joints[0], knee=joints[1], delay=late)


def write_robot(trust: float = 3.0) -> str:
    """The text of the leg's robot.toml."""
    return ROBOT.format(trust=trust, count=repr(RESOLUTION))


def write_controller() -> str:
    """The text of the controller.toml of the law."""
    return "\n".join(
        f"[[joint]]\nproportional = {p}\nderivative = {d}\nlimit = 25.0\n"
        for p, d in zip(PROPORTIONAL, DERIVATIVE, strict=True)
    )


def draw_reference(time: np.ndarray, seed: int) -> np.ndarray:
    """Position targets (T, 2), rad, that begin at rest."""
    rng = np.random.default_rng(seed)
    share = np.clip(time / 0.5, 0, 1)[:, None] ** 3
    targets = np.zeros((len(time), 2))
    for frequency in rng.uniform(0.2, 1.8, 5):
        targets += rng.uniform(0.08, 0.22, 2) * np.sin(2 * np.pi * frequency * time[:, None] + rng.uniform(0, 6.3, 2))
    return share * (targets - targets[0])


def make_log(seconds: float, seed: int) -> dict[str, np.ndarray]:
    """What the leg as it is logs: the law runs at `RATE`, MuJoCo steps four times as fast."""
    import mujoco

    step, time = 0.25 / RATE, np.arange(round(seconds * RATE)) / RATE
    model = mujoco.MjModel.from_xml_string(write_model(TRUE, step, DELAY))
    data, reference = mujoco.MjData(model), draw_reference(time, seed)
    seen, rows = np.zeros(2), []
    for k in range(len(time)):
        read = np.round(data.qpos / RESOLUTION) * RESOLUTION
        speed, seen = (read - seen) * RATE, read
        torque = np.clip(np.array(PROPORTIONAL) * (reference[k] - read) - np.array(DERIVATIVE) * speed, -25, 25)
        rows.append(np.concatenate([torque, read]))
        data.ctrl[:] = torque
        mujoco.mj_step(model, data, nstep=4)
    table = np.array(rows)
    columns = {"time": time}
    for j in (1, 2):
        columns[f"motor_torque_command_{j}"] = np.ascontiguousarray(table[:, j - 1])
        columns[f"joint_position_{j}"] = np.ascontiguousarray(table[:, j + 1])
        columns[f"joint_position_reference_{j}"] = np.ascontiguousarray(reference[:, j - 1])
    return columns


def describe_truth(identity: str | None = None) -> dict[str, Any]:
    """A diagnosis.json that states the leg as it is."""
    causes = []
    for j in (1, 2):
        for effect, key, value in (
            ("coulomb_friction", "coulomb_friction", TRUE["frictionloss"][j - 1]),
            ("viscous_friction", "viscous_friction", TRUE["damping"][j - 1]),
            ("command_delay", "command_delay", DELAY),
        ):
            parameters = {key: {"value": value, "std": 0.01 * value}}
            causes.append({"effect": effect, "joint": j, "probability": 1.0, "parameters": parameters})
    names = [f"{cause['effect']}@{cause['joint']}" for cause in causes]
    inertia = {f"motor_inertia_{j}": {"value": TRUE["armature"][j - 1], "std": 1e-4} for j in (1, 2)}
    content = {"schema": 2, "verdict": names, "causes": causes, "parameters": inertia}
    content["hypotheses"] = [{"effects": names, "probability": 0.9}, {"effects": names[:-1], "probability": 0.1}]
    if identity is not None:
        content["robot"] = {"name": "leg", "identity": identity, "sha256": None}
    return content


def write_leg(folder: Path, seconds: tuple[float, float] = (12.0, 6.0), trust: float = 3.0) -> None:
    """The files that the user of the leg has: leg.xml, leg.toml, log.parquet, held.parquet and controller.toml,
    and a diagnosis.json that states the truth."""
    (folder / "leg.xml").write_text(write_model({"frictionloss": STATED["frictionloss"]}, 0.001), encoding="utf-8")
    (folder / "leg.toml").write_text(write_robot(trust), encoding="utf-8")
    (folder / "controller.toml").write_text(write_controller(), encoding="utf-8")
    write(make_log(seconds[0], 1), folder / "log.parquet")
    write(make_log(seconds[1], 2), folder / "held.parquet")
    (folder / "diagnosis.json").write_text(json.dumps(describe_truth()), encoding="utf-8")
