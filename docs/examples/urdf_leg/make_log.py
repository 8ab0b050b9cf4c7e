"""The log of a leg that is not as its URDF says, simulated by MuJoCo.

Run it by `python docs/examples/urdf_leg/make_log.py OUT`.

The URDF of the Go1 comes from the package `example-robot-data`; the `mujoco` extra brings MuJoCo. OUT gets leg.toml, as
`hdagen robot import` writes it, and log.parquet: 15 s at 500 Hz, with commanded and measured torques and joint angles.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path

import numpy as np

from hdagen.blind.realities.model_arms import ModelRobot, draw_space_motion
from hdagen.blind.realities.model_reality import simulate_space_arm
from hdagen.log import write
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model

URDF = "cmeel.prefix/share/example-robot-data/robots/go1_description/urdf/go1.urdf"
TIP = "FR_foot"
ROTORS = (0.006, 0.006, 0.012)  # kg m² at the joints; the URDF states none
COULOMB = (0.3, 0.3, 0.3)  # N m more than the URDF's 0.2
VISCOUS = (0.08, 0.08, 0.12)  # N m s/rad more than the URDF's 0.01
SECONDS = 15.0
SEED = 7


def main(arguments: Sequence[str]) -> None:
    """Import the leg, simulate it with the true numbers, and write both files."""
    parser = argparse.ArgumentParser(
        description="Import the leg of a Go1, and simulate one that is not as its URDF says."
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder of leg.toml and log.parquet")
    out: Path = parser.parse_args(arguments).out
    out.mkdir(parents=True, exist_ok=True)
    model = str(distribution("example-robot-data").locate_file(URDF))
    text = import_model(model, ChainRequest(tip=TIP)).text
    (out / "leg.toml").write_text(text)
    table, rng = ModelRobot(text).table, np.random.default_rng(SEED)
    machine = copy.deepcopy(table)
    effects = {}
    for j, (rotor, coulomb, viscous) in enumerate(zip(ROTORS, COULOMB, VISCOUS, strict=True), 1):
        machine["joint"][j - 1]["drive"]["motor_inertia"] = rotor
        effects["coulomb_friction", j] = {"torque": coulomb}
        effects["viscous_friction", j] = {"coefficient": viscous}
    motion = draw_space_motion(rng, table, SECONDS)
    write(simulate_space_arm(machine, table, motion, rng, effects), out / "log.parquet")


if __name__ == "__main__":
    main(sys.argv[1:])
