"""How fast a sudden force moves the tip before any torque answers; `limits.sudden` keeps this speed free.

The links give way on their flexsplines and come back, so that the tip's speed has a peak after a few milliseconds
whatever the motors do. A controller that learns of the force one to three ticks later cannot lower it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import solve_inverse_kinematics

OBSERVED_SECONDS, FORCE_DIRECTIONS = 0.012, 24  # s; directions of the force


@dataclass(frozen=True)
class SuddenForceResponse:
    """The tip's largest speed after a force, N, over places and its directions: the largest and the median, m/s, and
    when the largest came, s."""

    force: float
    largest: float
    median: float
    when: float


def measure_sudden_force(arm: Arm, places: Array, force: float) -> SuddenForceResponse:
    """Measure the speed of the tip after a sudden force on an arm at rest, whose torques stay unchanged.

    Args:
        arm: The arm.
        places: Places of the tip, (N, 2) m.
        force: Size of the force, N.

    Returns:
        The largest and the median speed over places and directions.

    Raises:
        PlantError: A place is out of reach.

    """
    peaks = [find_peak_speed(arm, place, force, angle) for place in places for angle in _list_force_angles()]
    speeds = np.array([speed for speed, _ in peaks])
    return SuddenForceResponse(force, float(speeds.max()), float(np.median(speeds)), peaks[int(speeds.argmax())][1])


def _list_force_angles() -> Sequence[float]:
    return [2 * np.pi * k / FORCE_DIRECTIONS for k in range(FORCE_DIRECTIONS)]


def find_peak_speed(arm: Arm, place: Array, force: float, angle: float) -> tuple[float, float]:
    """Find the tip's largest speed after a sudden force.

    Args:
        arm: The arm, at rest.
        place: Place of the tip, (2) m.
        force: Size of the force, N.
        angle: Direction of the force, rad.

    Returns:
        The speed, m/s, and its time, s.

    """
    x, u = arm.rest(solve_inverse_kinematics(arm, place, np.full(arm.n, 0.5))), np.zeros(arm.nu)
    for axis, share in (("x", np.cos(angle)), ("y", np.sin(angle))):
        u[arm.input_names.index(f"tip_force_{axis}")] = force * share
    speeds = []
    for _ in range(round(OBSERVED_SECONDS / arm.step_size)):
        x = arm.step(x, u, exact=True)
        speeds.append(float(np.linalg.norm(arm.outputs(x, u)["tip_velocity"])))
    at = int(np.argmax(speeds))
    return speeds[at], (at + 1) * arm.step_size


def format_sudden_force(found: SuddenForceResponse) -> str:
    """Format the response for a terminal.

    Args:
        found: The response.

    Returns:
        One line of text.

    """
    return (
        f"a force of {found.force:g} N that comes at once moves the tip by at most {found.largest:.3f} m/s "
        f"(median {found.median:.3f}) after {1e3 * found.when:.1f} ms, whatever the torques"
    )
