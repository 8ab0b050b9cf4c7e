"""The initial guess from a log, before any search: walls near the ends of the range, sizes of input effects, and
estimates from the joints' encoders.

The linear model of an effect is a difference over the step of its parameter. Where an effect has a corner (a limit, a
delay of whole rows, a wall), the step has to be near the true size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord, measure_usual_torque
from hdagen.diagnosis.initialization.encoder_regression import estimate_from_encoders
from hdagen.diagnosis.initialization.initialization_settings import INITIALIZATION
from hdagen.diagnosis.initialization.wall_starts import list_wall_starts

INPUT_SIZE_GRID = np.geomspace(*INITIALIZATION.input_size_ends, INITIALIZATION.input_size_count)
INPUT_SHARE_GRID = np.linspace(*INITIALIZATION.input_share_ends, INITIALIZATION.input_share_count)
SCANNED_TERMS = ("joint_speed", "torque_sign")  # terms between encoders that show a size well enough to step by it
FRICTION_BY_UNIT = {
    "N m": "coulomb_friction",
    "N m s/rad": "viscous_friction",
    "N m s²/rad²": "viscous_friction",
}  # by unit, the key of the drive that says whether the robot file states friction of that kind


@dataclass(frozen=True)
class InitialGuess:
    """``shapes``: starting values by shape parameter, in place of the model's; ``column_steps``: step of an amplitude
    for its column, in its unit; ``seen``: estimates by parameter, from which every hypothesis starts within nuisance
    sizes; ``units``: typical sizes of torques and friction at a motor, by parameter, where the robot file states
    none."""

    shapes: dict[str, tuple[float, ...]]
    column_steps: dict[str, float]
    values: dict[str, float]
    units: dict[str, float] = field(default_factory=dict)


def guess_from_log(arm: Arm, record: WindowedRecord) -> InitialGuess:
    """Make the initial guess of a log.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        The initial guess.

    """
    twisted = estimate_from_encoders(arm, record)
    estimates = {name: value for twist in twisted for name, value in twist.sizes.items()}
    scanned = [q for q in arm.parameters.described.values() if q.encoder_term in SCANNED_TERMS and q.name in estimates]
    sized = {
        q.name: estimates[q.name]
        for q in scanned
        if abs(estimates[q.name]) > INITIALIZATION.least_scanned_guess * (q.typical or np.inf)
    }
    seen_walls = {name: angle for twist in twisted for name, angle in twist.shapes.items()}
    shapes = list_wall_starts(arm, record, seen_walls)
    return InitialGuess(shapes, _input_effect_sizes(arm, record) | sized, estimates, _friction_units(arm, record))


def _friction_units(arm: Arm, record: WindowedRecord) -> dict[str, float]:
    """Choose typical torques at motors whose robot file states no dry friction, and typical viscous friction where it
    states none. The manifest gives these as shares of the largest input; here the same shares apply to the log's usual
    input."""
    described, usual, found = arm.parameters.described, measure_usual_torque(arm, record), {}
    for effect in arm.manifest["effects"]:
        for j in effect["joints"]:
            if effect["place"] != "motor" or not j or not usual[j - 1] > 0.0:
                continue
            scale = (
                INITIALIZATION.friction_share
                * usual[j - 1]
                / float(described[f"coulomb_friction_{j}"].typical or np.inf)
            )
            for name in (f"{amplitude}_{j}" for amplitude in effect["amplitudes"]):
                q = described.get(name)
                if q is None or not q.typical or q.unit not in FRICTION_BY_UNIT:
                    continue
                if not described[f"{FRICTION_BY_UNIT[q.unit]}_{j}"].nominal:
                    found[name] = scale * q.typical
    return found


def _input_effect_sizes(arm: Arm, record: WindowedRecord) -> dict[str, float]:
    """List the size of each input effect with which the commands alone explain the measured inputs best."""
    described = arm.parameters.described
    return {
        name: value - described[name].nominal
        for _, name, _, value, share in fit_input_effects(arm, record)
        if share < INITIALIZATION.largest_error_ratio
    }


def fit_input_effects(arm: Arm, record: WindowedRecord) -> Iterator[tuple[str, str, int, float, float]]:
    """Fit each input effect by itself to the measured input of its joint, from the commands alone.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Yields:
        The effect's name, its amplitude's name, the joint, the best value, and the error (rms) as a share of the error
        without the effect.

    """
    names = [
        (effect["name"], f"{a}_{j}", j)
        for effect in arm.manifest["effects"]
        if effect["place"] == "input"
        for j in effect["joints"]
        for a in effect["amplitudes"]
    ]
    for effect, name, j in names:
        if arm.input_names[j - 1] not in record.names:
            continue
        described, place = arm.parameters.described[name], list(arm.parameters.described).index(name)
        tried = [described.nominal + float(s) * (described.typical or 0.0) for s in INPUT_SIZE_GRID]
        tried = [value for value in tried if described.low <= value <= described.high]
        points = np.tile(arm.p, (1 + len(tried), 1))
        points[:, place] = described.nominal, *tried
        errors = [_input_error(arm, record, p, j) for p in points]
        best = int(np.argmin(errors[1:]))
        yield effect, name, j, tried[best], errors[1 + best] / max(errors[0], np.finfo(float).tiny)


def split_input_effects(
    arm: Arm, record: WindowedRecord, p: Array, there: str, beside: str, j: int
) -> tuple[float, float]:
    """Split one input effect into two that may both be there. The one that a fit found may have stood in for both.

    Args:
        arm: the compiled model.
        record: the log in windows.
        p: parameters (np) with the effect found.
        there: amplitude of that effect.
        beside: amplitude of the second effect.
        j: the joint.

    Returns:
        The values of both with which the commands explain the measured input best.

    """
    described = arm.parameters.described
    places = [list(described).index(name) for name in (there, beside)]
    q, base = described[beside], described[there].nominal
    error, best = np.inf, (float(p[places[0]]), q.nominal)
    for share in INPUT_SHARE_GRID:
        for size in INPUT_SIZE_GRID[:: len(INPUT_SIZE_GRID) // 8] * (q.typical or 0.0):
            moved = p.copy()
            moved[places] = base + share * (p[places[0]] - base), np.clip(q.nominal + size, q.low, q.high)
            left = _input_error(arm, record, moved, j)
            if left < error:
                error, best = left, (float(moved[places[0]]), float(moved[places[1]]))
    return best


def _input_error(arm: Arm, record: WindowedRecord, p: Array, j: int) -> float:
    """Return the error (rms) of joint j's input as the commands give it under parameters ``p`` (np)."""
    _, at = arm.with_parameters(p).apply_input_stage(
        record.command[:, : arm.n], record.time_steps, record.initial_input
    )
    return float(np.sqrt(np.mean((at[:, j - 1] - record.log[arm.input_names[j - 1]])[record.visible_rows] ** 2)))
