"""Where the walls of an effect may stand: starting angles near the ends of a joint's range.

A wall that the motion would meet, and that is not there, costs a hypothesis log evidence: its stiffness is known to be
0. So each wall is tried alone, with the other one out of reach.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.effect_catalogue import Wall
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.prediction.measurement_model import read_joint_angles


def list_wall_starts(arm: Arm, record: WindowedRecord, seen: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
    """List the starting angles of each joint's walls.

    Args:
        arm: the compiled model.
        record: the log in windows.
        seen: angles of walls that the encoders show, by parameter.

    Returns:
        By parameter, as many angles for each wall of an effect; those at one place belong together.

    """
    starts: dict[str, tuple[float, ...]] = {}
    described = arm.parameters.described
    angles = read_joint_angles(arm, record.log)[record.visible_rows]
    for walls in (traits.walls for traits in arm.effects.values() if traits.walls):
        for j in range(1, arm.n + 1):
            names = [f"{wall.edge}_{j}" for wall in walls]
            if described.keys().isdisjoint(names):
                continue
            rows = _combine_walls(angles[:, j - 1], walls)
            if not seen.keys().isdisjoint(names):
                outermost = dict(zip(names, rows[0].tolist(), strict=True))
                rows.insert(0, np.array([seen.get(name, outermost[name]) for name in names]))
            for name, tried in zip(names, np.transpose(rows), strict=True):
                starts[name] = tuple(np.clip(tried, described[name].low, described[name].high).tolist())
    return starts


def _combine_walls(angle: Array, walls: Sequence[Wall]) -> list[Array]:
    """Combine the angles of an effect's walls: all of them outermost, then each alone at the angles further in."""
    ends = [_list_angles_from_end(angle, wall.side) for wall in walls]
    out_of_reach = [end[0] + wall.side * 2.0 * np.ptp(angle) for end, wall in zip(ends, walls, strict=True)]
    rows = [np.array([end[0] for end in ends])]
    for k, end in enumerate(ends):
        for edge in end[1:]:
            alone = np.array(out_of_reach)
            alone[k] = edge
            rows.append(alone)
    return rows


def _list_angles_from_end(angle: Array, side: int) -> Array:
    """List the angles beyond which some shares of the rows are, at one end of the range; the outermost first."""
    tails = np.array(INITIALIZATION.wall_tail_shares)
    return np.quantile(angle, 1.0 - tails if side > 0 else tails)
