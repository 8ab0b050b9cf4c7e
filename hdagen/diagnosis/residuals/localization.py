"""Where the gap lies: joint and place with their share of the gap that the verdict closes, and the regime in which it
shows.

A share is the gap that returns when one part is taken out of the model after the verdict: an effect, or the base
parameters of one place. Windows begin in the states of the replay after the verdict. Shares are taken of the logarithm
of the gap, as the gap itself is a geometric mean, and sum to 1.

Legend: T rows, W windows, K instants.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.arm import delayed_sensors
from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.diagnosis.residuals.regressor_tests import (
    EnergyConcentration,
    PeriodicShare,
    Regressor,
    explain_by_orders,
    explain_variance,
    find_concentrations,
)
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.residual_trace import trace_residual
from hdagen.diagnosis.residuals.spectra import compare_with_input, find_loudest_band
from hdagen.prediction.measurement_model import count_mechanical_states, get_state_limits

PLACES = ("input", "motor", "transmission", "link", "sensor")
MOTOR_ANGLE_NAME = "the angle within a turn of the motor"
MOTOR_ORDERS = range(1, EXPLANATION.largest_motor_order + 1)
_SPRING_PREFIXES = ("flexspline_", "wave_generator_", "torsional_")
_LINK_PREFIXES = ("mass_", "center_of_mass_", "inertia_", "length_", "gravity_", "payload_")


@dataclass(frozen=True, eq=False)
class RemovedPart:
    """The part that is taken out: its name, joint, place, and its places in p."""

    name: str
    joint: int
    place: str
    parameter_indices: tuple[int, ...]


def localize_gap(sight: ResidualTorque, effects: Sequence[str], rows: Mask) -> list[dict[str, Any]]:
    """Locate the gap: `where` of diagnosis.json.

    Args:
        sight: the torque balance before and after the verdict.
        effects: of the verdict, effect@joint.
        rows: mask of the log's rows (T) to count.

    Returns:
        The verdict's effects in its order, unknown ones last, then the places of base parameters that close a share.
        With unknown effects alone, these places are left out.

    """
    verdict = [entry for entry in effects if not entry.startswith("unknown@")]
    strange = [entry for entry in effects if entry not in verdict]
    left = [_locate_unknown(sight, int(entry.partition("@")[2]), rows) for entry in strange]
    if strange and not verdict:
        return left
    parts = _list_parts(sight, verdict)
    if not parts:
        return left
    shares, intervals, often = _compute_gap_shares(sight, parts, rows)
    named = [k for k, part in enumerate(parts) if part.name in verdict]
    others = sorted(
        (k for k in range(len(parts)) if k not in named and shares[k] >= EXPLANATION.least_place_share),
        key=lambda k: -shares[k],
    )
    entries = []
    for k in (*named, *others):
        part = parts[k]
        said = f"Base parameters, {part.name}, within their tolerance: {often[k]}."
        if k in named:
            said = _describe_regime(sight, part)
        share = {"share": round(shares[k], 4), "interval": intervals[k]}
        entries.append({"joint": part.joint, "place": part.place, **share, "when": said})
    return entries[: len(named)] + left + entries[len(named) :]


def find_place(sight: ResidualTorque, entry: str) -> str:
    """Return the place of an effect, as its equation states.

    Args:
        sight: the torque balance.
        entry: the effect, name@joint.

    """
    traits = sight.motion.arm.effects.get(entry.partition("@")[0])
    if traits is None:  # unknown
        return "motor"
    return traits.place


def _list_parts(sight: ResidualTorque, verdict: list[str]) -> list[RemovedPart]:
    parts = [
        RemovedPart(e, int(e.partition("@")[2]), find_place(sight, e), sight.parameter_indices.get(e, ()))
        for e in verdict
    ]
    taken = {place for part in parts for place in part.parameter_indices}
    groups: dict[tuple[int, str], list[int]] = {}
    for k, q in enumerate(sight.motion.arm.parameters.described.values()):
        if k not in taken and sight.before[k] != sight.after[k]:
            groups.setdefault((q.joint, _place_of_parameter(q.name)), []).append(k)
    names = list(sight.motion.arm.parameters.described)
    for (joint, place), own in groups.items():
        called = ", ".join(names[k].removesuffix(f"_{joint}").replace("_", " ") for k in own)
        parts.append(RemovedPart(called, joint, place, tuple(own)))
    return parts


def _place_of_parameter(name: str) -> str:
    if name.startswith(_SPRING_PREFIXES):
        return "transmission"
    if name.startswith(_LINK_PREFIXES):
        return "link"
    return "motor"


def _compute_gap_shares(
    sight: ResidualTorque, parts: list[RemovedPart], rows: Mask
) -> tuple[list[float], list[list[float] | None], list[str]]:
    """Compute the shares of the closed gap (one for each part, at least 0, sum 1), their intervals by a bootstrap of
    seconds, and a sentence on how much of the motion each one affects."""
    seconds = np.floor((sight.motion.log.time - sight.motion.log.time[0]) / EXPLANATION.counted_second).astype(int)
    whole = _sum_squares(sight, sight.after, rows, seconds)
    without = []
    for part in parts:
        p = sight.after.copy()
        p[list(part.parameter_indices)] = sight.before[list(part.parameter_indices)]
        without.append(_sum_squares(sight, p, rows, seconds))
    often = [_describe_sign_test(_log_gap(one) - _log_gap(whole)) for one in without]
    drawn = np.random.default_rng(0).integers(len(whole), size=(DATA.bootstrap_draws, len(whole)))
    shares = _normalize_shares(np.stack([_log_gap(one.sum(0)) - _log_gap(whole.sum(0)) for one in without], -1))
    intervals: list[list[float] | None] = [None] * len(parts)
    if len(whole) > 1:
        each = [_log_gap(one[drawn].sum(1)) - _log_gap(whole[drawn].sum(1)) for one in without]
        low, high = np.quantile(
            _normalize_shares(np.stack(each, -1)),
            ((1 - DATA.confidence_level) / 2, (1 + DATA.confidence_level) / 2),
            axis=0,
        )
        intervals = [[round(a, 4), round(b, 4)] for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    return shares.tolist(), intervals, often


def _normalize_shares(back: Array) -> Array:
    """Turn the returned part of the log gap into shares (…, parts); all of it is the first part's where nothing
    returns."""
    back = np.maximum(np.nan_to_num(back, posinf=EXPLANATION.infinite_log_gap), 0.0)
    total = back.sum(-1, keepdims=True)
    first = np.arange(back.shape[-1]) == 0
    return np.asarray(np.where(total > 0.0, back / np.maximum(total, 1e-300), first))


def _describe_sign_test(worse: Array) -> str:
    """Say in how many seconds of the motion a model is worse than another by ``worse`` (S), with the significance of a
    sign test."""
    up, down = int(np.count_nonzero(worse > 0)), int(np.count_nonzero(worse < 0))
    ways: int = sum(math.comb(up + down, k) for k in range(up, up + down + 1))
    return (
        f"without them {up} of {len(worse)} s of motion are told worse {_format_significance(ways / 2 ** (up + down))}"
    )


def _log_gap(squares: Array) -> Array:
    """Return the logarithm of the gap from sums of squared errors, in multiples of noise, and their counts (…,
    channels, 2)."""
    return np.asarray(0.5 * np.log(np.maximum(squares[..., 0] / squares[..., 1], 1.0)).mean(-1))


def _sum_squares(sight: ResidualTorque, p: Array, rows: Mask, seconds: np.ndarray) -> Array:
    """Sum the squared errors, in multiples of noise, and count them, in each second that has ``rows``: (S, channels,
    2). Windows begin in the states of the replay after the verdict."""
    arm, log, after = sight.motion.arm.with_parameters(p), sight.motion.log, sight.motion.replays[1]
    acting, shown = sight.balance.simulate_inputs(p)
    ends = np.append(after.starts[1:], len(log))
    dt = np.append(np.diff(log.time), log.period)
    begun = after.states[after.starts][:, : count_mechanical_states(arm)]
    x = arm.rollout_windows(
        begun, np.stack([after.starts, ends], 1), acting, dt, EXPLANATION.integration_step, get_state_limits(arm), None
    )
    seen = delayed_sensors.read_sensors(arm, log.time, x, shown)
    label = np.unique(seconds[rows], return_inverse=True)[1]
    found = []
    for name in after.counted_channels:
        quantity, _, j = name.rpartition("_")
        read = seen.get(quantity, shown)[:, int(j) - 1]
        if quantity == "motor_torque" and arm.input_names[int(j) - 1].startswith("motor_current"):
            read = read * arm.parameters.described[f"torque_constant_{j}"].nominal
        errors = ((read - log[name])[rows] / after.noise[name]) ** 2
        found.append(np.stack([np.bincount(label, errors), np.bincount(label)], 1))
    return np.stack(found, 1)


def _locate_unknown(sight: ResidualTorque, joint: int, rows: Mask) -> dict[str, Any]:
    """Describe a gap that no effect explains: its place is that of the largest residual torque, its share that of the
    remaining error."""
    left = sight.balance.residual(sight.after)
    place = "motor"
    if left.link is not None:
        sizes = [np.sqrt(np.mean(side[sight.motion.valid, joint - 1] ** 2)) for side in (left.motor, left.link)]
        if sizes[1] / abs(sight.motion.ratio[joint - 1]) > sizes[0]:
            place = "link"
    after = sight.motion.replays[1]
    squares: dict[int, float] = {}
    for name in after.counted_channels:
        j = int(name.rpartition("_")[2])
        error = (after.columns[name] - sight.motion.log[name])[rows] / after.noise[name]
        squares[j] = squares.get(j, 0.0) + float(error @ error)
    part = RemovedPart(f"unknown@{joint}", joint, place, ())
    share = squares.get(joint, 0.0) / max(sum(squares.values()), 1e-300)
    return {
        "joint": joint,
        "place": place,
        "share": round(share, 4),
        "interval": None,
        "when": _describe_regime(sight, part),
    }


def list_regressors(sight: ResidualTorque, joint: int, at: np.ndarray) -> list[Regressor]:
    """List the regressors that a residual may depend on.

    Args:
        sight: the torque balance.
        joint: the joint.
        at: mask of the instants (K).

    """
    column, torque = sight.motion.read_state, sight.balance.link_torque(sight.after)
    angle, speed = column("motor_position", joint), column("motor_velocity", joint)
    current = sight.balance.inputs(sight.after)[:, joint - 1]
    rate = sight.motion.grid.differentiate(sight.motion.grid.smooth(current))
    unit = sight.motion.input_unit(joint)
    listed = [
        Regressor("the motor's speed", "rad/s", speed, True),
        Regressor("the load on the transmission", "N m", torque[:, joint - 1], True),
        Regressor("the joint's angle", "rad", column("joint_position", joint)),
        Regressor(MOTOR_ANGLE_NAME, "rad", np.mod(angle, 2 * np.pi)),
        Regressor("the joint's acceleration", "rad/s²", sight.motion.acceleration[1][:, joint - 1], True),
        Regressor("the motor's input", unit, current, True),
        Regressor("the rate of the motor's input", f"{unit}/s", rate, True),
        Regressor("the time since the last reversal", "s", time_since_reversal(sight, joint)),
        Regressor("time", "s", sight.motion.time - sight.motion.time[0]),
    ]
    return [Regressor(r.name, r.unit, r.values[at], r.by_magnitude) for r in listed]


def time_since_reversal(sight: ResidualTorque, joint: int) -> Array:
    """Measure the time since the motor last changed its direction, or since the log's begin.

    Args:
        sight: the torque balance.
        joint: the joint.

    Returns:
        Time (K), s.

    """
    direction = sight.motion.direction[:, joint - 1]
    moving = np.flatnonzero(direction)
    turned = moving[1:][np.diff(direction[moving]) != 0]
    last = np.searchsorted(turned, np.arange(len(direction)), side="right") - 1
    begun = np.zeros(len(direction), int)
    begun[last >= 0] = turned[last[last >= 0]]
    return np.asarray(sight.motion.time - sight.motion.time[begun])


def _describe_regime(sight: ResidualTorque, part: RemovedPart) -> str:
    """Describe in one sentence the regressor that explains the residual, and where its energy lies, each with its
    significance."""
    joint = max(part.joint, 1)
    seen = trace_residual(sight, part.place, joint, part.name)
    unknown = part.name.startswith("unknown")
    quantity, energy = seen.after, seen.after**2
    if not unknown:
        quantity = seen.after + seen.effect_part
        energy = quantity**2 - seen.after**2
    around = list_regressors(sight, joint, seen.instants)
    clear = np.ones(len(quantity), bool)
    if part.place == "motor":
        clear = sight.motion.is_sliding(joint)[seen.instants]
    moving = [Regressor(r.name, r.unit, r.values[clear], r.by_magnitude) for r in around]
    goes = next(
        (
            e
            for e in explain_variance(quantity[clear], moving)
            if e.p <= EXPLANATION.significance_level and e.share >= EXPLANATION.least_explained_share
        ),
        None,
    )
    sits = next((c for c in find_concentrations(energy, around) if c.p <= EXPLANATION.significance_level), None)
    said = []
    if abs(quantity.mean()) > EXPLANATION.constant_share * _root_mean_square(quantity):
        said.append(f"is mostly the same throughout (mean {quantity.mean():.2g} {seen.unit})")
    orders = explain_by_orders(quantity, sight.motion.read_state("motor_position", joint)[seen.instants], MOTOR_ORDERS)
    turn = next(
        (e for e in orders if e.p <= EXPLANATION.significance_level and e.share >= EXPLANATION.least_explained_share),
        None,
    )
    if turn is not None and (goes is None or turn.share > goes.share):
        said.append(
            f"goes with {MOTOR_ANGLE_NAME}, {_describe_order(turn)}, which explains {100 * turn.share:.0f} % of it"
            f" {_format_significance(turn.p)}"
        )
    elif goes is not None:
        said.append(
            f"goes with {goes.regressor.name}, which explains {100 * goes.share:.0f} % of it"
            f" {_format_significance(goes.p)}"
        )
        if turn is not None and goes.regressor.name == MOTOR_ANGLE_NAME:
            said[-1] += f", {100 * turn.share:.0f} % {_describe_order(turn)} {_format_significance(turn.p)}"
    if sits is not None:
        said.append(_describe_concentration(sits))
    spread = (
        f"is spread over speeds, loads, angles and times: none explains"
        f" {100 * EXPLANATION.least_explained_share:.0f} % of it at p < {EXPLANATION.significance_level:g}"
    )
    words = f"The {seen.quantity} ({_root_mean_square(quantity):.2g} {seen.unit} rms) {', and '.join(said) or spread}."
    return words + _describe_spectrum(sight, joint, quantity, seen.instants)


def _describe_order(turn: PeriodicShare) -> str:
    return {1: "once", 2: "twice"}.get(turn.order, f"{turn.order} times") + " a turn"


def _describe_spectrum(sight: ResidualTorque, joint: int, quantity: Array, at: np.ndarray) -> str:
    """Add a sentence on the octave with most energy, and how much of it follows the input linearly; nothing where the
    motion is too short."""
    passed, (inputs, own) = compare_with_input(sight, joint, at, quantity)
    if own.degrees_of_freedom < 1.0:
        return ""
    band = find_loudest_band(own, inputs, passed)
    if band is None:
        return ""
    return (
        f" Of its energy, {100 * band.share:.0f} % lies between {band.low:.3g} and {band.high:.3g} Hz, where "
        f"{100 * band.coherence:.0f} % follows the motor's input in a straight line {_format_significance(band.p)}."
    )


def _describe_concentration(sits: EnergyConcentration) -> str:
    name, side = sits.regressor.name, "above"
    if sits.regressor.by_magnitude:
        name = f"the size of {name}"
    if sits.is_below:
        side = "below"
    return (
        f"has {min(100 * sits.share, 100):.0f} % of its energy where {name} is {side} {sits.edge:.3g} "
        f"{sits.regressor.unit}, {100 * sits.time_share:.0f} % of the time {_format_significance(sits.p)}"
    )


def _format_significance(p: float) -> str:
    return f"(p = {p:.2g})"


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
