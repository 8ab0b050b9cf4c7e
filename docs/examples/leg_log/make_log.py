"""The log of `hdagen demo`, made again: MuJoCo simulates a leg whose knee rubs more than its robot file says.

    python docs/examples/leg_log/make_log.py [OUT]

OUT is hdagen/data/leg_log.parquet if not stated; the `mujoco` extra brings MuJoCo. The numbers are those of
hdagen/data/leg.toml except one: the dry friction of the knee. Nothing of the generated model is in the log.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hdagen.log import write

ROOT = Path(__file__).resolve().parents[3]
ROBOT = ROOT / "hdagen" / "data" / "leg.toml"
LOG = ROOT / "hdagen" / "data" / "leg_log.parquet"
KNEE_FRICTION = 3.0  # times the robot file's: the effect that is hidden in the log
STEP = 2e-4  # s, of MuJoCo
PERIOD = 4e-3  # s, of the controller and of the log
SECONDS = 3.0
TORQUE_COUNT = 1e-4  # N m at the motor
STIFFNESS, DAMPING = np.array([60.0, 40.0]), np.array([2.5, 1.5])  # N m/rad, N m s/rad at the joints: the PD law
LARGEST_TORQUE = 30.0  # N m at the joints
MIDDLE = np.array([0.3, -0.6])  # rad, about which the joints move
WAVES = (((0.45, 0.5), (0.12, 2.1)), ((0.6, 0.7), (0.15, 2.9)))  # (amplitude in rad, frequency in Hz) of each joint
FRICTION = f"solreffriction='{2 * STEP} 1' solimpfriction='0.99 0.99 0.001 0.5 2'"  # holds, with little creep
JOINTS = (1, 2)
COLUMNS = (
    "time",
    *(f"motor_torque_command_{j}" for j in JOINTS),
    *(f"motor_position_{j}" for j in JOINTS),
    *(f"joint_position_{j}" for j in JOINTS),
    *(f"joint_position_reference_{j}" for j in JOINTS),
)


def plan_motion(t: np.ndarray) -> np.ndarray:
    """Wanted joint positions (T, 2), rad: waves that begin and end at rest."""
    s = np.clip(np.minimum(t - 0.2, SECONDS - 0.2 - t) / 0.6, 0, 1)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    waves = [sum(a * np.sin(2 * np.pi * f * (t - 0.2)) for a, f in joint) for joint in WAVES]
    return MIDDLE + share[:, None] * np.stack(waves, axis=1)


def write_mjcf(joints: Sequence[dict[str, Any]], knee_friction: float) -> str:
    """The leg: a hinge and a body for each joint, motor and gear counted at the joint."""
    inner = ""
    for j in reversed(range(len(joints))):
        joint, drive = joints[j], joints[j]["drive"]
        ratio, inertia = drive["ratio"], f"{joint['inertia']} " * 3  # only the one about z counts in the plane
        level = ratio * drive["coulomb_friction"] * (knee_friction if j == 1 else 1.0)
        place = joints[j - 1]["length"] if j else 0
        inner = f"""
        <body pos='{place} 0 0'>
          <inertial pos='{joint["center_of_mass"]} 0 0' mass='{joint["mass"]}' diaginertia='{inertia}'/>
          <joint axis='0 0 1' armature='{ratio**2 * drive["motor_inertia"]}' frictionloss='{level}' {FRICTION}
                 damping='{ratio**2 * drive["viscous_friction"]}'/>{inner}
        </body>"""
    return f"""<mujoco><option timestep='{STEP}' gravity='9.81 0 0' integrator='implicitfast'/>
      <worldbody>{inner}</worldbody></mujoco>"""


def count_steps(value: np.ndarray, size: np.ndarray | float) -> np.ndarray:
    """``value`` in whole counts of that size."""
    return np.round(value / size) * size


def simulate(joints: Sequence[dict[str, Any]], knee_friction: float = KNEE_FRICTION) -> dict[str, np.ndarray]:
    """The columns of the log, row by row as the PD law samples and commands."""
    model = mujoco.MjModel.from_xml_string(write_mjcf(joints, knee_friction))
    data, time = mujoco.MjData(model), np.arange(round(SECONDS / PERIOD)) * PERIOD
    wanted = plan_motion(time)
    ratio = np.array([joint["drive"]["ratio"] for joint in joints])
    motor_count = np.array([joint["sensor"]["motor_encoder_resolution"] for joint in joints])
    joint_count = np.array([joint["sensor"]["joint_encoder_resolution"] for joint in joints])
    data.qpos[:] = wanted[0]
    last, rows = count_steps(ratio * wanted[0], motor_count), []
    for k, now in enumerate(time):
        theta, q = count_steps(ratio * data.qpos, motor_count), count_steps(data.qpos, joint_count)
        pull = STIFFNESS * (wanted[k] - theta / ratio) - DAMPING * (theta - last) / PERIOD / ratio
        command = count_steps(np.clip(pull, -LARGEST_TORQUE, LARGEST_TORQUE) / ratio, TORQUE_COUNT)
        rows.append(np.concatenate([[now], command, theta, q, wanted[k]]))
        data.qfrc_applied[:] = ratio * command
        mujoco.mj_step(model, data, nstep=round(PERIOD / STEP))
        last = theta
    return dict(zip(COLUMNS, np.array(rows).T, strict=True))


def main(arguments: Sequence[str]) -> None:
    """Simulate and write."""
    joints = tomllib.loads(ROBOT.read_text("utf-8"))["joint"]
    write(simulate(joints), Path(arguments[0]) if arguments else LOG)


if __name__ == "__main__":
    main(sys.argv[1:])
