"""The structure of an MPC, fixed when it is compiled: number of nodes, number of walls, space of the target."""

from __future__ import annotations

import json
from dataclasses import dataclass

TARGET_SPACES = ("tip", "joint")
MOST_NODES, MOST_WALLS = 400, 8
LARGEST_MEMORY = 32 << 20  # bytes that a controller and OSQP's workspace may take, static


class StructureError(ValueError):
    """A structure that cannot be built; one sentence."""


@dataclass(frozen=True)
class Structure:
    """``nodes`` of the horizon, ``walls`` as half-planes for the tip, ``space`` of the target."""

    nodes: int = 20
    walls: int = 2
    space: str = "tip"

    @property
    def text(self) -> str:
        """As `parse_structure` reads it."""
        return f"nodes={self.nodes},walls={self.walls},space={self.space}"


def parse_structure(text: str) -> Structure | None:
    """Read a structure.

    Args:
        text: As in ``nodes=20,walls=2,space=tip``; a missing part has that value.

    Returns:
        The structure; None where the text is empty.

    Raises:
        StructureError: The text is no structure.

    """
    if not text.strip():
        return None
    found: dict[str, str] = {}
    for part in text.split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        if key not in ("nodes", "walls", "space") or key in found:
            raise StructureError(f"--mpc: found {json.dumps(part[:40])}, possible is nodes=20,walls=2,space=tip.")
        found[key] = value
    space = found.get("space", "tip")
    if space not in TARGET_SPACES:
        raise StructureError(f"--mpc: space is {json.dumps(space[:40])}, possible is {' or '.join(TARGET_SPACES)}.")
    return Structure(
        _read_whole_number(found, "nodes", 20, 2, MOST_NODES),
        _read_whole_number(found, "walls", 2, 0, MOST_WALLS),
        space,
    )


def _read_whole_number(found: dict[str, str], key: str, default: int, low: int, high: int) -> int:
    text = found.get(key, str(default))
    if not text.isascii() or not text.isdigit() or len(text) > 6 or not low <= int(text) <= high:
        raise StructureError(f"--mpc: {key} is {json.dumps(text[:40])}, possible is a whole number {low} to {high}.")
    return int(text)


def memory_needed(structure: Structure, n: int, nx: int) -> int:
    """Estimate the memory of a controller and of OSQP's workspace.

    Args:
        structure: The controller's structure.
        n: Number of joints.
        nx: Number of states.

    Returns:
        Bytes.

    Source:
        Fitted to builds of 1 to 6 joints, within a tenth.

    """
    rows = 4 * n + nx // 2 - n + 1 + structure.walls
    return structure.nodes * (170 * nx * nx + 45 * nx * rows + 1600 * rows)


def check_memory(structure: Structure, n: int, nx: int) -> None:
    """Refuse a horizon that memory does not allow.

    Args:
        structure: The controller's structure.
        n: Number of joints.
        nx: Number of states.

    Raises:
        StructureError: The controller takes more than MEMORY.

    """
    needed = memory_needed(structure, n, nx)
    if needed > LARGEST_MEMORY:
        most = structure.nodes * LARGEST_MEMORY // needed
        raise StructureError(
            f"mpc.nodes: {structure.nodes} nodes of {nx} states take {needed / 2**20:.0f} MiB, possible are "
            f"{LARGEST_MEMORY >> 20} MiB; take at most {most} nodes."
        )
