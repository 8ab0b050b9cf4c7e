"""One axis of a KUKA KR300 run as the log of a one-joint robot, with the encoders of motor and link.

    python docs/examples/kuka/convert.py data.mat 1 OUT.parquet

Axes 1 to 3 have an encoder on the link; it is zero for the others. The file's motor angle is at the joint's scale and
its torque at the motor. What gravity and the other axes' motion ask for is the authors' feed-forward model, which is in
the file, at the joint: `tau_g_init` at the start, and on the way `tau_g_all` (what gravity adds to that), `tau_a_all`
(the other axes' acceleration) and `tau_c_all` (speeds). All of it acts behind the gear and twists it, so it stands in
the log as a force at the end of the link that asks for as much, and one axis is left.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from hdagen.log import write
from hdagen.log.mat_file import read_mat

LENGTH = 1.0  # m, of the link in axis_1.toml to axis_3.toml


def columns(path: Path, axis: int) -> dict[str, np.ndarray]:
    """The columns of ``axis`` (1 to 3) by hdagen's names; the file's angles are in degrees."""
    file = read_mat(path)
    ratio = file["para.u"][axis - 1]

    def row(name: str) -> np.ndarray:
        return file[f"{name}({axis},:)"]

    others = file["tau_g_init"][axis - 1] + row("tau_g_all") + row("tau_a_all") + row("tau_c_all")
    angle = np.deg2rad(row("rec.act_pos_se_deg"))
    return {
        "time": file["rec.time_cont"],
        "tip_force_x": others / LENGTH * np.sin(angle),
        "tip_force_y": -others / LENGTH * np.cos(angle),
        "motor_torque_1": row("rec.act_torque_abs_nm"),
        "motor_position_1": np.deg2rad(row("rec.act_pos_mot_deg")) * ratio,
        "joint_position_1": angle,
        "joint_position_reference_1": np.deg2rad(row("rec.ref_pos_deg")),
    }


if __name__ == "__main__":
    if len(sys.argv) != 4 or sys.argv[2] not in "123":
        sys.exit(f"usage: {Path(sys.argv[0]).name} data.mat AXIS OUT.parquet, where AXIS is 1, 2 or 3.")
    write(columns(Path(sys.argv[1]), int(sys.argv[2])), sys.argv[3])
