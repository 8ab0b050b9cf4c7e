"""Inertias that a body can have: of links in space whose fitted entries no distribution of mass gives.

An inertia I about the centre of mass is possible where its second moments S = ½ tr(I) 1 − I are positive: then the
moments of inertia are positive and none is above the sum of the others. A fit frees the entries one by one, so that it
may leave this cone; the nearest second moments inside are taken then.

Source: Wensing, Kim, Slotine, IEEE Robot. Autom. Lett. 3 (2018) 60 (physical consistency of inertial parameters).
"""

from __future__ import annotations

import numpy as np

from hdagen.arm.arm_parameters import VECTOR_ENTRIES, Parameter
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.joint_names import list_joint_names

ENTRIES = VECTOR_ENTRIES["inertia"]
LEAST_MOMENT_SHARE = 1e-3  # of the largest second moment, that the least one has at least: a body is no plate


def make_inertias_possible(arm: Arm) -> tuple[dict[str, float], list[str]]:
    """Find possible inertias near to those of an arm's links, within the bounds of their parameters.

    The possible inertias form a convex set, and so do those within bounds: on the way from the robot file's inertia,
    which lies in both, to the nearest possible one every inertia is possible.

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
        own = [arm.parameters.described[one] for one in names]
        stated = _list_second_moments([q.nominal for q in own])
        least = min(LEAST_MOMENT_SHARE, _find_least_share(stated))
        found = _list_second_moments([arm.parameters[one] for one in names])
        if _find_least_share(found) >= least * (1 - 1e-9):
            continue
        sizes, axes = np.linalg.eigh(found)
        near = axes * np.maximum(sizes, least * sizes[-1]) @ axes.T
        inertia = np.trace(near) * np.eye(3) - near
        changed |= dict(zip(names, _approach_within_bounds(own, _list_entries(inertia)), strict=True))
        notes.append(
            f"inertia of {name or 'joint'} ({j}): no body has the fitted one; a possible one near it is taken."
        )
    return changed, notes


def _approach_within_bounds(own: list[Parameter], wanted: list[float]) -> list[float]:
    """The values farthest on the straight way from those of the robot file to the wanted ones that keep all bounds."""
    share = 1.0
    for q, value in zip(own, wanted, strict=True):
        if not q.low <= value <= q.high:
            share = min(share, (max(min(value, q.high), q.low) - q.nominal) / (value - q.nominal))
    reached = [q.nominal + share * (value - q.nominal) for q, value in zip(own, wanted, strict=True)]
    return [max(min(value, q.high), q.low) for q, value in zip(own, reached, strict=True)]


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
