"""Inertias that a body can have: of links in space whose fitted entries no distribution of mass gives.

An inertia I about the centre of mass is possible where its second moments S = ½ tr(I) 1 − I are positive: then the
moments of inertia are positive and none is above the sum of the others. A fit frees the entries one by one, so that it
may leave this cone; the nearest second moments inside are taken then.

Source: Wensing, Kim, Slotine, IEEE Robot. Autom. Lett. 3 (2018) 60 (physical consistency of inertial parameters).
"""

from __future__ import annotations

import numpy as np

from hdagen.arm.arm_parameters import VECTOR_ENTRIES
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.joint_names import list_joint_names

ENTRIES = VECTOR_ENTRIES["inertia"]
LEAST_MOMENT_SHARE = 1e-3  # of the largest second moment, that the least one has at least: a body is no plate


def make_inertias_possible(arm: Arm) -> tuple[dict[str, float], list[str]]:
    """Find the possible inertias nearest to those of an arm's links.

    Args:
        arm: The arm, with any parameters.

    Returns:
        The entries that have to change, by name; and a sentence for each link.

    """
    changed: dict[str, float] = {}
    notes: list[str] = []
    if not arm.moves_in_space:
        return changed, notes
    for j, name in enumerate(list_joint_names(arm), 1):
        names = [f"inertia_{entry}_{j}" for entry in ENTRIES]
        stated = _list_second_moments([arm.parameters.described[one].nominal for one in names])
        least = min(LEAST_MOMENT_SHARE, _find_least_share(stated))
        found = _list_second_moments([arm.parameters[one] for one in names])
        if _find_least_share(found) >= least * (1 - 1e-9):
            continue
        sizes, axes = np.linalg.eigh(found)
        near = axes * np.maximum(sizes, least * sizes[-1]) @ axes.T
        inertia = np.trace(near) * np.eye(3) - near
        changed |= dict(zip(names, _list_entries(inertia), strict=True))
        notes.append(f"inertia of {name or 'joint'} ({j}): no body has the fitted one; the nearest possible is taken.")
    return changed, notes


def _list_second_moments(entries: list[float]) -> Array:
    """The second moments of mass (3, 3) of an inertia, kg m²."""
    xx, yy, zz, xy, xz, yz = entries
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.asarray(np.trace(inertia) / 2 * np.eye(3) - inertia)


def _find_least_share(moments: Array) -> float:
    """The least second moment over the largest."""
    sizes = np.linalg.eigvalsh(moments)
    return float(sizes[0] / sizes[-1])


def _list_entries(inertia: Array) -> list[float]:
    return [float(inertia["xyz".index(entry[0]), "xyz".index(entry[1])]) for entry in ENTRIES]
