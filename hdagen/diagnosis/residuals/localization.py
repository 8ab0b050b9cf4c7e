"""Where the gap lies: joint and place with their share of the gap that the verdict closes, and the regime in which it
shows.

A share is the gap that returns when one part is taken out of the model after the verdict: an effect, or the base
parameters of one place. Windows begin in the states of the replay after the verdict. Shares are taken of the logarithm
of the gap, as the gap itself is a geometric mean, and sum to 1.

Legend: T rows, W windows, K instants.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.arm import delayed_sensors
from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.gap import DRAWS, LEVEL
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.residuals.regressor_tests import (
    LEAST,
    Concentrated,
    Periodic,
    Regressor,
    concentrated,
    explained,
    periodic,
)
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.diagnosis.residuals.spectra import beside_input, loudest
from hdagen.prediction.measurement_model import limits, mechanical

PLACES = ("input", "motor", "transmission", "link", "sensor")
APART = 1e3  # replaces the logarithm of an infinite gap
FEW = 0.01  # share of the closed gap, below which the base parameters of a place are not named
CONSTANT = 0.8  # of the rms: with a larger mean a quantity is mostly constant
MUCH = 0.2  # of a variance: a regressor that explains less is not named
STEP = 1e-3  # s, of integration
TURN = "the angle within a turn of the motor"
ORDERS = range(1, 25)  # cycles in a turn of the motor
SECOND = 1.0  # s, length of the blocks that the share's interval and the test of signs count
_SPRINGS = ("flexspline_", "wave_generator_", "torsional_")
_LINKS = ("mass_", "center_of_mass_", "inertia_", "length_", "gravity_", "payload_")


@dataclass(frozen=True, eq=False)
class Part:
    """The part that is taken out: its name, joint, place, and its places in p."""

    name: str
    joint: int
    place: str
    own: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Trace:
    """The residual that shows a place best: ``before`` and ``after`` the verdict, and the part ``adds`` that the
    verdict's effect adds (K each), at the valid instants ``at`` of the torque balance."""

    words: str
    unit: str
    before: Array
    after: Array
    adds: Array
    at: np.ndarray


def where(sight: Sight, content: Mapping[str, Any], rows: Mask) -> list[dict[str, Any]]:
    """Locate the gap: `where` of diagnosis.json.

    Args:
        sight: the torque balance before and after the verdict.
        content: content of a diagnosis.json.
        rows: mask of the log's rows (T) to count.

    Returns:
        The verdict's effects in its order, unknown ones last, then the places of base parameters that close a share.
        With unknown effects alone, these places are left out.

    """
    verdict = [entry for entry in content["verdict"] if not entry.startswith("unknown@")]
    strange = [entry for entry in content["verdict"] if entry not in verdict]
    left = [_unknown(sight, int(entry.partition("@")[2]), rows) for entry in strange]
    if strange and not verdict:
        return left
    parts = _parts(sight, verdict)
    if not parts:
        return left
    shares, intervals, often = _shares(sight, parts, rows)
    effects = [k for k, part in enumerate(parts) if part.name in verdict]
    others = sorted((k for k in range(len(parts)) if k not in effects and shares[k] >= FEW), key=lambda k: -shares[k])
    entries = []
    for k in (*effects, *others):
        part = parts[k]
        said = f"Base parameters, {part.name}, within their tolerance: {often[k]}."
        if k in effects:
            said = _when(sight, part)
        share = {"share": round(shares[k], 4), "interval": intervals[k]}
        entries.append({"joint": part.joint, "place": part.place, **share, "when": said})
    return entries[: len(effects)] + left + entries[len(effects) :]


def place_of(sight: Sight, entry: str) -> str:
    """Return the place of an effect, as its equation states.

    Args:
        sight: the torque balance.
        entry: the effect, name@joint.

    """
    effect = entry.partition("@")[0]
    return next((str(e["place"]) for e in sight.arm.manifest["effects"] if e["name"] == effect), "motor")


def _parts(sight: Sight, verdict: list[str]) -> list[Part]:
    parts = [Part(e, int(e.partition("@")[2]), place_of(sight, e), sight.own.get(e, ())) for e in verdict]
    taken = {place for part in parts for place in part.own}
    groups: dict[tuple[int, str], list[int]] = {}
    for k, q in enumerate(sight.arm.parameters.described.values()):
        if k not in taken and sight.before[k] != sight.after[k]:
            groups.setdefault((q.joint, _base_place(q.name)), []).append(k)
    names = list(sight.arm.parameters.described)
    for (joint, place), own in groups.items():
        called = ", ".join(names[k].removesuffix(f"_{joint}").replace("_", " ") for k in own)
        parts.append(Part(called, joint, place, tuple(own)))
    return parts


def _base_place(name: str) -> str:
    if name.startswith(_SPRINGS):
        return "transmission"
    if name.startswith(_LINKS):
        return "link"
    return "motor"


def _shares(sight: Sight, parts: list[Part], rows: Mask) -> tuple[list[float], list[list[float] | None], list[str]]:
    """Compute the shares of the closed gap (one for each part, at least 0, sum 1), their intervals by a bootstrap of
    seconds, and a sentence on how much of the motion each one affects."""
    seconds = np.floor((sight.log.time - sight.log.time[0]) / SECOND).astype(int)
    whole = _squares(sight, sight.after, rows, seconds)
    without = []
    for part in parts:
        p = sight.after.copy()
        p[list(part.own)] = sight.before[list(part.own)]
        without.append(_squares(sight, p, rows, seconds))
    often = [_told(_gap(one) - _gap(whole)) for one in without]
    drawn = np.random.default_rng(0).integers(len(whole), size=(DRAWS, len(whole)))
    shares = _parted(np.stack([_gap(one.sum(0)) - _gap(whole.sum(0)) for one in without], -1))
    intervals: list[list[float] | None] = [None] * len(parts)
    if len(whole) > 1:
        each = [_gap(one[drawn].sum(1)) - _gap(whole[drawn].sum(1)) for one in without]
        low, high = np.quantile(_parted(np.stack(each, -1)), ((1 - LEVEL) / 2, (1 + LEVEL) / 2), axis=0)
        intervals = [[round(a, 4), round(b, 4)] for a, b in zip(low.tolist(), high.tolist(), strict=True)]
    return shares.tolist(), intervals, often


def _parted(back: Array) -> Array:
    """Turn the returned part of the log gap into shares (…, parts); all of it is the first part's where nothing
    returns."""
    back = np.maximum(np.nan_to_num(back, posinf=APART), 0.0)
    total = back.sum(-1, keepdims=True)
    first = np.arange(back.shape[-1]) == 0
    return np.asarray(np.where(total > 0.0, back / np.maximum(total, 1e-300), first))


def _told(worse: Array) -> str:
    """Say in how many seconds of the motion a model is worse than another by ``worse`` (S), with the significance of a
    sign test."""
    up, down = int(np.count_nonzero(worse > 0)), int(np.count_nonzero(worse < 0))
    ways: int = sum(math.comb(up + down, k) for k in range(up, up + down + 1))
    return f"without them {up} of {len(worse)} s of motion are told worse {_p(ways / 2 ** (up + down))}"


def _gap(squares: Array) -> Array:
    """Return the logarithm of the gap from sums of squared errors, in multiples of noise, and their counts (…,
    channels, 2)."""
    return np.asarray(0.5 * np.log(np.maximum(squares[..., 0] / squares[..., 1], 1.0)).mean(-1))


def _squares(sight: Sight, p: Array, rows: Mask, seconds: np.ndarray) -> Array:
    """Sum the squared errors, in multiples of noise, and count them, in each second that has ``rows``: (S, channels,
    2). Windows begin in the states of the replay after the verdict."""
    arm, log, after = sight.arm.at(p), sight.log, sight.replays[1]
    acting, shown = sight.commanded(p)
    ends = np.append(after.starts[1:], len(log))
    dt = np.append(np.diff(log.time), log.period)
    begun = after.states[after.starts][:, : mechanical(arm)]
    x = arm.windows(begun, np.stack([after.starts, ends], 1), acting, dt, STEP, limits(arm), None)
    seen = delayed_sensors.read(arm, log.time, x, shown)
    label = np.unique(seconds[rows], return_inverse=True)[1]
    found = []
    for name in after.channels:
        quantity, _, j = name.rpartition("_")
        read = seen.get(quantity, shown)[:, int(j) - 1]
        if quantity == "motor_torque" and arm.input_names[int(j) - 1].startswith("motor_current"):
            read = read * arm.parameters.described[f"torque_constant_{j}"].nominal
        errors = ((read - log[name])[rows] / after.noise[name]) ** 2
        found.append(np.stack([np.bincount(label, errors), np.bincount(label)], 1))
    return np.stack(found, 1)


def _unknown(sight: Sight, joint: int, rows: Mask) -> dict[str, Any]:
    """Describe a gap that no effect explains: its place is that of the largest residual torque, its share that of the
    remaining error."""
    left = sight.missing(sight.after)
    place = "motor"
    if left.link is not None:
        sizes = [np.sqrt(np.mean(side[sight.kept, joint - 1] ** 2)) for side in (left.motor, left.link)]
        if sizes[1] / abs(sight.ratio[joint - 1]) > sizes[0]:
            place = "link"
    after = sight.replays[1]
    squares: dict[int, float] = {}
    for name in after.channels:
        j = int(name.rpartition("_")[2])
        error = (after.columns[name] - sight.log[name])[rows] / after.noise[name]
        squares[j] = squares.get(j, 0.0) + float(error @ error)
    part = Part(f"unknown@{joint}", joint, place, ())
    share = squares.get(joint, 0.0) / max(sum(squares.values()), 1e-300)
    return {"joint": joint, "place": place, "share": round(share, 4), "interval": None, "when": _when(sight, part)}


def trace(sight: Sight, place: str, joint: int, entry: str) -> Trace:
    """Compute the residual as it shows at one place of a joint, and the part of an effect in it.

    Args:
        sight: the torque balance.
        place: input, motor, transmission, link or sensor.
        joint: the joint.
        entry: the effect, name@joint.

    Returns:
        The residual before and after the verdict.

    """
    j, less, ok = joint - 1, sight.without(entry), sight.kept
    if place == "input" and sight.driven(joint):
        return _of_input(sight, joint, less)
    if entry.startswith("torque_sensor") and f"joint_torque_{joint}" in sight.log:
        read = sight.smooth(sight.on_grid(sight.log[f"joint_torque_{joint}"])[:, None])[ok, 0]
        first, last, none = (sight.sensed_torque(p)[ok, j] for p in (sight.before, sight.after, less))
        return Trace(
            f"reading of the torque sensor of joint {joint}", "N m", read - first, read - last, last - none, ok
        )
    before, after, added = sight.missing(sight.before), sight.missing(sight.after), sight.added(sight.after, less)
    if before.link is None or added.link is None or place in ("input", "motor"):
        words = f"torque missing at motor {joint}"
        return Trace(words, "N m", before.motor[ok, j], after.motor[ok, j], added.motor[ok, j], ok)
    assert after.link is not None  # as before's, which is of the same log
    if place == "sensor":
        slope = sight.slope(sight.after)[ok, j]
        read = sight.read_error(sight.after, less)[ok, j]
        words = f"angle that the encoder of joint {joint} reads too much"
        left = after.link[ok, j] / slope
        return Trace(words, "rad", before.link[ok, j] / slope, left, read, ok)
    if entry.startswith("kinematic_error"):
        slope = sight.slope(sight.after)[ok, j]
        words = f"angle missing in the transmission of joint {joint}"
        first, last, more = (side[ok, j] / slope for side in (before.link, after.link, added.link))
        return Trace(words, "rad", first, last, more, ok)
    words = f"torque missing at link {joint}"
    return Trace(words, "N m", before.link[ok, j], after.link[ok, j], added.link[ok, j], ok)


def _of_input(sight: Sight, joint: int, less: Array) -> Trace:
    """Compute the measured input less the model's response to the command."""
    name, log, ok = sight.arm.input_names[joint - 1], sight.log, sight.kept

    def seen(values: Array) -> Array:
        return sight.smooth(sight.on_grid(values)[:, None])[ok, 0]

    before, after = (seen(log[name] - r.columns[name]) for r in sight.replays)
    adds = seen(sight.commanded(sight.after)[1][:, joint - 1] - sight.commanded(less)[1][:, joint - 1])
    words = f"{sight.input_word(joint)} of motor {joint} beyond the model's"
    return Trace(words, sight.input_unit(joint), before, after, adds, ok)


def regressors(sight: Sight, joint: int, at: np.ndarray) -> list[Regressor]:
    """List the regressors that a residual may depend on.

    Args:
        sight: the torque balance.
        joint: the joint.
        at: mask of the instants (K).

    """
    column, torque = sight.column, sight.link_torque(sight.after)
    angle, speed = column("motor_position", joint), column("motor_velocity", joint)
    current = sight.inputs(sight.after)[:, joint - 1]
    rate = sight.grid.rate(sight.grid.smooth(current))
    unit = sight.input_unit(joint)
    listed = [
        Regressor("the motor's speed", "rad/s", speed, True),
        Regressor("the load on the transmission", "N m", torque[:, joint - 1], True),
        Regressor("the joint's angle", "rad", column("joint_position", joint)),
        Regressor(TURN, "rad", np.mod(angle, 2 * np.pi)),
        Regressor("the joint's acceleration", "rad/s²", sight.acceleration[1][:, joint - 1], True),
        Regressor("the motor's input", unit, current, True),
        Regressor("the rate of the motor's input", f"{unit}/s", rate, True),
        Regressor("the time since the last reversal", "s", since_reversal(sight, joint)),
        Regressor("time", "s", sight.time - sight.time[0]),
    ]
    return [Regressor(r.name, r.unit, r.values[at], r.size) for r in listed]


def since_reversal(sight: Sight, joint: int) -> Array:
    """Measure the time since the motor last changed its direction, or since the log's begin.

    Args:
        sight: the torque balance.
        joint: the joint.

    Returns:
        Time (K), s.

    """
    direction = sight.direction[:, joint - 1]
    moving = np.flatnonzero(direction)
    turned = moving[1:][np.diff(direction[moving]) != 0]
    last = np.searchsorted(turned, np.arange(len(direction)), side="right") - 1
    begun = np.zeros(len(direction), int)
    begun[last >= 0] = turned[last[last >= 0]]
    return np.asarray(sight.time - sight.time[begun])


def _when(sight: Sight, part: Part) -> str:
    """Describe in one sentence the regressor that explains the residual, and where its energy lies, each with its
    significance."""
    joint = max(part.joint, 1)
    seen = trace(sight, part.place, joint, part.name)
    unknown = part.name.startswith("unknown")
    quantity, energy = seen.after, seen.after**2
    if not unknown:
        quantity = seen.after + seen.adds
        energy = quantity**2 - seen.after**2
    around = regressors(sight, joint, seen.at)
    clear = np.ones(len(quantity), bool)
    if part.place == "motor":
        clear = sight.slides(joint)[seen.at]
    moving = [Regressor(r.name, r.unit, r.values[clear], r.size) for r in around]
    goes = next((e for e in explained(quantity[clear], moving) if e.p <= LEAST and e.share >= MUCH), None)
    sits = next((c for c in concentrated(energy, around) if c.p <= LEAST), None)
    said = []
    if abs(quantity.mean()) > CONSTANT * _rms(quantity):
        said.append(f"is mostly the same throughout (mean {quantity.mean():.2g} {seen.unit})")
    orders = periodic(quantity, sight.column("motor_position", joint)[seen.at], ORDERS)
    turn = next((e for e in orders if e.p <= LEAST and e.share >= MUCH), None)
    if turn is not None and (goes is None or turn.share > goes.share):
        said.append(f"goes with {TURN}, {_often(turn)}, which explains {100 * turn.share:.0f} % of it {_p(turn.p)}")
    elif goes is not None:
        said.append(f"goes with {goes.regressor.name}, which explains {100 * goes.share:.0f} % of it {_p(goes.p)}")
        if turn is not None and goes.regressor.name == TURN:
            said[-1] += f", {100 * turn.share:.0f} % {_often(turn)} {_p(turn.p)}"
    if sits is not None:
        said.append(_lies(sits))
    spread = f"is spread over speeds, loads, angles and times: none explains {100 * MUCH:.0f} % of it at p < {LEAST:g}"
    words = f"The {seen.words} ({_rms(quantity):.2g} {seen.unit} rms) {', and '.join(said) or spread}."
    return words + _over_frequency(sight, joint, quantity, seen.at)


def _often(turn: Periodic) -> str:
    return {1: "once", 2: "twice"}.get(turn.order, f"{turn.order} times") + " a turn"


def _over_frequency(sight: Sight, joint: int, quantity: Array, at: np.ndarray) -> str:
    """Add a sentence on the octave with most energy, and how much of it follows the input linearly; nothing where the
    motion is too short."""
    passed, (inputs, own) = beside_input(sight, joint, at, quantity)
    if own.free < 1.0:
        return ""
    band = loudest(own, inputs, passed)
    if band is None:
        return ""
    return (
        f" Of its energy, {100 * band.share:.0f} % lies between {band.low:.3g} and {band.high:.3g} Hz, where "
        f"{100 * band.coherence:.0f} % follows the motor's input in a straight line {_p(band.p)}."
    )


def _lies(sits: Concentrated) -> str:
    name, side = sits.regressor.name, "above"
    if sits.regressor.size:
        name = f"the size of {name}"
    if sits.below:
        side = "below"
    return (
        f"has {min(100 * sits.share, 100):.0f} % of its energy where {name} is {side} {sits.edge:.3g} "
        f"{sits.regressor.unit}, {100 * sits.part:.0f} % of the time {_p(sits.p)}"
    )


def _p(p: float) -> str:
    return f"(p = {p:.2g})"


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
