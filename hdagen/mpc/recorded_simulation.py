"""`hdagen simulate --controller mpc`: a closed loop with its record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.control.reference_motion import Reference
from hdagen.log import data_table
from hdagen.log.measured_log import write
from hdagen.mpc.closed_loop_trial import Trial, TrialOutcome, evaluate_trial, run_trial
from hdagen.mpc.configuration import Configuration
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.tick_record import build_record, find_record_path
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, SpacePush


def simulate_with_record(
    arm: Arm,
    c: Configuration,
    path: Reference,
    pushes: Sequence[Push | SpacePush],
    sensors: Sensors,
    seed: int,
    out: Path,
    start: Array | None = None,
) -> tuple[Trial, TrialOutcome | None]:
    """Simulate a closed loop, and write its log and the controller's record beside it.

    Args:
        arm: An arm that was built for the configuration.
        c: The configuration.
        path: The path to follow.
        pushes: Forces on the tip.
        sensors: The sensors.
        seed: Seed of the sensors' noise.
        out: Where the log goes.
        start: Positions of the joints next to the start, (n); None: those of the simulator.

    Returns:
        The run, and its numbers; None in their place where the controller follows joints.

    Raises:
        PlantError: The controller refuses its configuration.
        LogError: A file cannot be written.

    """
    controller = MPC(arm, c)
    found = run_trial(arm, controller, path, pushes, sensors, c.walls, seed, start)
    write(found.simulation.log, out)
    data_table.write_table(build_record(arm, found, path, c.grid), find_record_path(out))
    if c["mpc.space"] != "tip":
        return found, None
    return found, evaluate_trial(arm, c, path, found, controller)


def format_simulated_run(found: Trial, result: TrialOutcome | None) -> list[str]:
    """Format a run for a terminal.

    Args:
        found: The run.
        result: Its numbers, or None.

    Returns:
        Lines of text.

    """
    times = 1e6 * found.times.sum(1)
    active = np.mean([sum(r.active.values()) for r in found.reports])
    out = [
        f"ticks: {np.median(times):.0f} µs in the median, {np.quantile(times, 0.99):.0f} µs at 99 %; "
        f"{active:.1f} limits active"
    ]
    if result is not None:
        out.append(
            f"tip against the ideal mass-damper-spring motion: {1e3 * result.distance:.3f} mm in the median, "
            f"{1e3 * result.largest:.2f} mm at most"
        )
        broken = [f"{name} by {value:.3g}" for name, value in result.violated.items() if value > 0]
        out.append(f"limits exceeded: {', '.join(broken) or 'none'}; contact force at most {result.contact:.1f} N")
    refused = found.simulation.status < 0
    out.append(f"ticks refused: {int(refused.sum())}")
    return out
