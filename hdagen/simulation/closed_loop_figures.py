"""Figures of a simulated closed loop: how far it was from the motion that its law promises, and what the guard did."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guarded_controller import Controller
from hdagen.control.pose_kinematics import find_rotation_gap
from hdagen.control.reference_motion import Reference
from hdagen.simulation.ideal_admittance import simulate_ideal_admittance
from hdagen.simulation.simulator import Simulation


def summarize_run(arm: Arm, controller: Controller, path: Reference, result: Simulation) -> dict[str, Any]:
    """Compare a run with the motion that its law promises.

    Args:
        arm: The arm.
        controller: The controller.
        path: The motion that it followed, of the tip or the joints.
        result: The run.

    Returns:
        The figures by name: gaps in m (of joints rad or m), in space those of the orientation too, rad, and the guard's
        statuses.

    """
    against, moved = "the path", np.zeros_like(path.position)
    q = result.state[:, [arm.index(f"joint_position_{j + 1}") for j in range(arm.n)]]
    if path.space == "joint":
        against = "the joints' motion"
    elif "mass_x" in controller.gains:
        against = "the ideal mass-damper-spring motion"
        moved = simulate_ideal_admittance(controller, result.push, path.period)
    shown = q if path.space == "joint" else result.tip
    size = shown.shape[1]
    gap = np.linalg.norm(shown - path.position[:, :size] - moved[:, :size], axis=1)
    refused, first = result.status[result.status < 0], None
    if len(refused):
        first = controller.sentence(int(refused[0]))
    figures = {"against": against, "largest_gap": float(gap.max()), "rms_gap": _find_rms(gap)}
    figures["largest_ideal_displacement"] = float(np.linalg.norm(moved[:, :size], axis=1).max())
    if path.space == "tip" and arm.moves_in_space:
        turned = np.linalg.norm(_find_turn_gaps(arm, path, moved, q), axis=1)
        figures |= {"largest_turn_gap": float(turned.max()), "rms_turn_gap": _find_rms(turned)}
    return figures | {
        "ticks_limited": int((result.status > 0).sum()),
        "ticks_refused": len(refused),
        "first_refusal": first,
        "rows_beyond_spring_law": result.beyond_law,
    }


def _find_turn_gaps(arm: Arm, path: Reference, moved: Array, q: Array) -> Array:
    """Rotation vectors from the tip's orientation to the promised one, (T, 3), rad."""
    from scipy.spatial.transform import Rotation

    wanted = (Rotation.from_rotvec(moved[:, 3:]) * Rotation.from_rotvec(path.position[:, 3:])).as_rotvec()
    return find_rotation_gap(wanted, arm.evaluate("tip_pose", q=q)["rotation"])


def _find_rms(gap: Array) -> float:
    return float(np.sqrt(np.mean(gap**2)))
