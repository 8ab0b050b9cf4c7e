"""The log that ships with hdagen, made again: MuJoCo simulates the arm of preset `paper` under PD control and a push.

    python docs/examples/mujoco_log/make_log.py [OUT]

OUT is hdagen/data/mujoco_log.parquet if not stated; the `test` extra brings MuJoCo. Nothing of the generated model is
in it: MuJoCo knows the arm as bodies and hinges and integrates with its own implicit integrator. The numbers are those
of gen/presets/paper.toml, but where a user of MuJoCo has no choice or would choose otherwise, and this is the gap that
a replay shows: each spring is linear, at the catalogue's first stiffness K1, where the model's stiffens from a softer
start, and dry friction is MuJoCo's regularised constraint, which creeps, where the model's sticks.
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
ROBOT = ROOT / "gen" / "presets" / "paper.toml"
LOG = ROOT / "hdagen" / "data" / "mujoco_log.parquet"
SEED = 20240229
STEP = 1e-4  # s, of MuJoCo
PERIOD = 1e-3  # s, of the controller and of the log
SECONDS = 8.0
STIFFNESS = 1.0e4  # N m/rad: K1 of the CSG-17-100's catalogue, as one linear spring
CURRENT_COUNT = 1e-3  # A: drives take and report whole mA
CREEP = 0.005  # s, time constant of MuJoCo's friction; its default of 0.02 s lets a drive creep that should stick
FORCE_NOISE = 0.2  # N, standard deviation
FORCE_COUNT = 0.01  # N
BANDWIDTH = 60.0  # rad/s, of the PD loop on the motors
CUTOFF = 80.0  # Hz, of the controller's filtered difference of the encoder
MIDDLE = (0.4, 1.2)  # rad, about which the joints move
WAVES = (  # (amplitude in rad, frequency in Hz) of each joint: slow turns, fast ones that wind the springs
    ((0.45, 0.31), (0.12, 1.3)),
    ((0.55, 0.43), (0.10, 1.9)),
)
PUSH = (4.5, 5.5, (6.0, -8.0))  # s, s, N at the tip in the base frame
COLUMNS = (
    "time",
    *(f"motor_current_command_{j}" for j in (1, 2)),
    *(f"motor_current_{j}" for j in (1, 2)),
    *(f"motor_position_{j}" for j in (1, 2)),
    *(f"joint_position_{j}" for j in (1, 2)),
    *(f"joint_position_reference_{j}" for j in (1, 2)),
    "tip_force_x",
    "tip_force_y",
)


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Wanted joint positions and velocities (T, 2): waves that begin and end at rest, each within a second."""
    s = np.clip(np.minimum(t - 0.25, SECONDS - 0.25 - t), 0, 1)
    share = s**3 * (10 - 15 * s + 6 * s**2)
    waves = [sum(a * np.sin(2 * np.pi * f * (t - 0.25)) for a, f in joint) for joint in WAVES]
    q = np.array(MIDDLE) + share[:, None] * np.stack(waves, axis=1)
    return q, np.gradient(q, t, axis=0)


def mjcf(joints: Sequence[dict[str, Any]]) -> str:
    """The arm: for each joint a rotor's hinge at the joint's scale, then the torsion's hinge with the link on it."""
    inner = ""
    for j in reversed(range(len(joints))):
        joint, drive = joints[j], joints[j]["drive"]
        N = drive["ratio"]
        place = f"{joints[j - 1]['length'] if j else 0} 0 0"
        friction = f"solreffriction='{CREEP} 1'"
        inertia = f"{joint['inertia']} " * 3  # only the one about z counts in the plane
        rotor = f"armature='{N**2 * drive['motor_inertia']}' damping='{N**2 * drive['viscous_friction']}'"
        inner = f"""
        <body pos='{place}'>
          <inertial pos='0 0 0' mass='1e-6' diaginertia='1e-9 1e-9 1e-9'/>
          <joint name='rotor_{j + 1}' axis='0 0 1' {rotor} {friction} frictionloss='{N * drive["coulomb_friction"]}'/>
          <body>
            <inertial pos='{joint["center_of_mass"]} 0 0' mass='{joint["mass"]}' diaginertia='{inertia}'/>
            <joint name='torsion_{j + 1}' axis='0 0 1' stiffness='{STIFFNESS}' damping='{drive["torsional_damping"]}'/>
            {inner or f"<site name='tip' pos='{joint['length']} 0 0'/>"}
          </body>
        </body>"""
    return f"""<mujoco><compiler angle='radian'/>
      <option timestep='{STEP}' gravity='0 0 0' integrator='implicitfast' iterations='50' tolerance='1e-12'/>
      <worldbody>{inner}</worldbody></mujoco>"""


class Machine:
    """The arm in MuJoCo with its encoders, at rest at ``start`` (2, rad)."""

    def __init__(self, joints: Sequence[dict[str, Any]], start: np.ndarray) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(joints))
        self.data = mujoco.MjData(self.model)
        self.rotor, self.torsion = (
            [self.model.joint(f"{k}_{j}").dofadr[0] for j in (1, 2)] for k in ("rotor", "torsion")
        )
        self.tip = self.model.site("tip").id
        self.ratio = np.array([joint["drive"]["ratio"] for joint in joints])
        self.constant = np.array([joint["drive"]["torque_constant"] for joint in joints])
        self.motor_count = np.array([joint["sensor"]["motor_encoder_resolution"] for joint in joints])
        self.joint_count = np.array([joint["sensor"]["joint_encoder_resolution"] for joint in joints])
        self.data.qpos[self.rotor] = start

    def encoders(self) -> tuple[np.ndarray, np.ndarray]:
        """Motor and joint angles (2 each, rad) in whole counts."""
        rotor, torsion = self.data.qpos[self.rotor], self.data.qpos[self.torsion]
        return counted(self.ratio * rotor, self.motor_count), counted(rotor + torsion, self.joint_count)

    def hold(self, current: np.ndarray, push: np.ndarray) -> None:
        """One period with currents (2, A) and the force on the tip (2, N) held."""
        force, body = np.array([*push, 0.0]), int(self.model.site_bodyid[self.tip])
        for _ in range(round(PERIOD / STEP)):
            mujoco.mj_step1(self.model, self.data)
            applied = np.zeros(self.model.nv)
            point = self.data.site_xpos[self.tip]
            mujoco.mj_applyFT(self.model, self.data, force, np.zeros(3), point, body, applied)
            applied[self.rotor] += self.ratio * self.constant * current
            self.data.qfrc_applied[:] = applied
            mujoco.mj_step2(self.model, self.data)


def simulate(joints: Sequence[dict[str, Any]], seed: int = SEED) -> dict[str, np.ndarray]:
    """The columns of the log, row by row as the PD loop samples and commands; noise from ``seed``."""
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    wanted, speed = motion(t)
    machine, random = Machine(joints, wanted[0]), np.random.default_rng(seed)
    N, constant, noise = machine.ratio, machine.constant, np.array([j["sensor"]["current_noise"] for j in joints])
    largest = np.array([j["drive"]["max_current"] for j in joints])
    inertia = np.array([j["drive"]["motor_inertia"] for j in joints])
    last, omega, held = machine.encoders()[0], np.zeros(2), np.zeros(2)
    rows = []
    for k, now in enumerate(t):
        theta, q = machine.encoders()
        omega = omega + (1 - np.exp(-2 * np.pi * CUTOFF * PERIOD)) * ((theta - last) / PERIOD - omega)
        pull = BANDWIDTH**2 * (N * wanted[k] - theta) + 2 * BANDWIDTH * (N * speed[k] - omega)
        command = counted(np.clip(inertia * pull / constant, -largest, largest), CURRENT_COUNT)
        push = np.array(PUSH[2]) if PUSH[0] <= now < PUSH[1] else np.zeros(2)
        current = counted(held + noise * random.normal(size=2), CURRENT_COUNT)
        force = counted(push + FORCE_NOISE * random.normal(size=2), FORCE_COUNT)
        rows.append(np.concatenate([[now], command, current, theta, q, wanted[k], force]))
        machine.hold(command, push)
        last, held = theta, command
    return dict(zip(COLUMNS, np.array(rows).T, strict=True))


def counted(value: np.ndarray, count: np.ndarray | float) -> np.ndarray:
    """``value`` in whole counts."""
    return np.round(value / count) * count


def main(arguments: Sequence[str]) -> None:
    """Simulate and write."""
    joints = tomllib.loads(ROBOT.read_text("utf-8"))["joint"]
    write(simulate(joints), Path(arguments[0]) if arguments else LOG)


if __name__ == "__main__":
    main(sys.argv[1:])
