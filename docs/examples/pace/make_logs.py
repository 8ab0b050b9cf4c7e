"""Logs of a harmonic-drive joint whose robot file says rigid, simulated by MuJoCo under a PD loop.

    python docs/examples/pace/make_logs.py OUT

writes OUT/log.parquet (a chirp), OUT/hold_out.parquet (three sines and a pause) and both again with one encoder only:
OUT/motor_only.parquet, OUT/motor_only_hold_out.parquet, OUT/joint_only.parquet, OUT/joint_only_hold_out.parquet.

The case is that of PACE, which identifies the joints of legged robots in simulation: a fit of delay, friction and
inertia to a joint with a harmonic drive ended at a delay of 9.5 ms and no friction, because its structure has no
spring. Here the spring is there, the delay is not, and the friction is known. MuJoCo knows the joint as two hinges, the
rotor's and the torsion's, integrates with its own implicit integrator, and its dry friction is a constraint. Nothing of
the generated model is in it.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hdagen.log import write

ROBOT = Path(__file__).with_name("robot.toml")
STIFFNESS = 2600.0  # N m/rad at the joint: with this link a resonance at 19 Hz against the rotor
DAMPING = 1.5  # N m s/rad of the torsion
STEP = 2e-5  # s, of MuJoCo
CREEP = 2e-4  # s, time constant of MuJoCo's dry friction; its default of 0.02 s lets a drive creep that should stick
PERIOD = 1e-3  # s, of the controller and of the log
SECONDS = 12.0
HANGING = -np.pi / 2
BANDWIDTH, DECAY = 45.0, 0.8  # rad/s and damping ratio of the PD loop on the motor
CUTOFF = 80.0  # Hz, of the controller's filtered difference of the encoder
CURRENT_COUNT = 1e-3  # A
SEED = 19


def chirp(t: np.ndarray) -> np.ndarray:
    """Wanted joint angle: from 0.2 to 12 Hz, the amplitude falling as the frequency rises."""
    low, high, span = 0.2, 12.0, SECONDS - 1.0
    s = np.clip(t - 0.5, 0.0, span)
    frequency = low * (high / low) ** (s / span)
    phase = 2 * np.pi * (frequency - low) * span / np.log(high / low)
    return HANGING + _eased(t) * np.minimum(0.4, 0.36 / frequency) * np.sin(phase)


def sines(t: np.ndarray) -> np.ndarray:
    """Wanted joint angle: three sines, and a hold between 5 and 6 s."""
    waves = (
        0.35 * np.sin(2 * np.pi * 0.43 * t) + 0.08 * np.sin(2 * np.pi * 2.3 * t) + 0.03 * np.sin(2 * np.pi * 7.1 * t)
    )
    moving = 1.0 - _rise((t - 4.5) / 0.5) + _rise((t - 6.0) / 0.5)
    return HANGING + _eased(t) * moving * waves


def _eased(t: np.ndarray) -> np.ndarray:
    """0 at both ends of the log, 1 within."""
    return _rise(np.minimum(t - 0.5, SECONDS - 0.5 - t))


def _rise(s: np.ndarray) -> np.ndarray:
    """From 0 to 1 without a jump in acceleration."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def mjcf(joint: dict[str, Any]) -> str:
    """The joint: the rotor's hinge at the joint's scale, then the torsion's hinge with the link on it."""
    drive = joint["drive"]
    N = drive["ratio"]
    rotor = f"armature='{N**2 * drive['motor_inertia']}' damping='{N**2 * drive['viscous_friction']}'"
    friction = f"frictionloss='{N * drive['coulomb_friction']}' solreffriction='{CREEP} 1'"
    inertia = f"{joint['inertia']} " * 3  # only the one about z counts in the plane
    return f"""<mujoco><compiler angle='radian'/>
      <option timestep='{STEP}' gravity='0 -9.81 0' integrator='implicitfast' iterations='50' tolerance='1e-12'/>
      <worldbody><body>
        <inertial pos='0 0 0' mass='1e-6' diaginertia='1e-9 1e-9 1e-9'/>
        <joint name='rotor' axis='0 0 1' {rotor} {friction}/>
        <body>
          <inertial pos='{joint["center_of_mass"]} 0 0' mass='{joint["mass"]}' diaginertia='{inertia}'/>
          <joint name='torsion' axis='0 0 1' stiffness='{STIFFNESS}' damping='{DAMPING}'/>
        </body>
      </body></worldbody></mujoco>"""


def simulate(joint: dict[str, Any], motion: Callable[[np.ndarray], np.ndarray], seed: int) -> dict[str, np.ndarray]:
    """The columns of the log, row by row as the PD loop samples and commands; noise from ``seed``."""
    drive, sensor, random = joint["drive"], joint["sensor"], np.random.default_rng(seed)
    N, k_t, most = drive["ratio"], drive["torque_constant"], drive["max_current"]
    model = mujoco.MjModel.from_xml_string(mjcf(joint))
    data = mujoco.MjData(model)
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    wanted = motion(t)
    data.qpos[0] = wanted[0]
    counts = sensor["motor_encoder_resolution"], sensor["joint_encoder_resolution"]
    last, omega, held = _counted(N * wanted[0], counts[0]), 0.0, 0.0
    inertia = drive["motor_inertia"] + (joint["inertia"] + joint["mass"] * joint["center_of_mass"] ** 2) / N**2
    rows = []
    for k in range(len(t)):
        theta = _counted(N * data.qpos[0], counts[0])
        q = _counted(data.qpos[0] + data.qpos[1], counts[1])
        omega += (1 - np.exp(-2 * np.pi * CUTOFF * PERIOD)) * ((theta - last) / PERIOD - omega)
        pull = BANDWIDTH**2 * (N * wanted[k] - theta) - 2 * DECAY * BANDWIDTH * omega
        command = _counted(float(np.clip(inertia * pull / k_t, -most, most)), CURRENT_COUNT)
        rows.append(
            (command, _counted(held + sensor["current_noise"] * random.standard_normal(), CURRENT_COUNT), theta, q)
        )
        last, held = theta, command
        data.qfrc_applied[0] = N * k_t * command
        mujoco.mj_step(model, data, round(PERIOD / STEP))
    command, current, theta, q = np.array(rows).T
    return {
        "time": t,
        "motor_current_command_1": command,
        "motor_current_1": current,
        "motor_position_1": theta,
        "joint_position_1": q,
        "joint_position_reference_1": wanted,
    }


def _counted(value: float, count: float) -> float:
    """``value`` in whole counts."""
    return round(value / count) * count


def make(out: Path) -> None:
    """Write the six logs into ``out``."""
    joint = tomllib.loads(ROBOT.read_text(encoding="utf-8"))["joint"][0]
    for k, (name, motion) in enumerate((("log", chirp), ("hold_out", sines))):
        columns = simulate(joint, motion, SEED + k)
        write(columns, out / f"{name}.parquet")
        for kept, left_out in (("motor", "joint_position_1"), ("joint", "motor_position_1")):
            part = {key: values for key, values in columns.items() if key != left_out}
            write(part, out / f"{kept}_only{'' if name == 'log' else '_' + name}.parquet")


if __name__ == "__main__":
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_dir():
        sys.exit(f"usage: {Path(sys.argv[0]).name} OUT, where OUT is a folder that exists.")
    make(Path(sys.argv[1]))
