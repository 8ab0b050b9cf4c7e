"""Motions that excite an arm, and the limits that they keep: drawn in the joints, tried on the compiled arm under its
position controller, and made smaller until every limit is kept with a margin.

Legend: T rows, n joints; a shape is a motion about the middle posture in [−1, 1], at rest at both ends.
Sources: Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85 (phases of a multisine); Swevers et al., IEEE Trans. Robot.
Autom. 13 (1997) 730 (periodic excitation of robots).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.control import Controller, Guard, Safe
from hdagen.plant import Arm, Array, PlantError
from hdagen.reference import Reference, smooth_step
from hdagen.simulation import Sensors, Simulation, run
from hdagen.torques import full_torque, torque_per_input

MARGIN = 0.9  # of a limit that the nominal arm may reach; an arm with an effect may reach all of it
DRAWN = 0.8  # of a limit to which a motion is drawn before it is tried
HELD = 0.6  # of torque and current that gravity may take in the middle posture
TRIES = 8  # times that a motion is made smaller
SMALLEST = 0.02  # of the first drawing below which a motion is given up
ASSUMED = {"revolute": (0.5, 1.0), "prismatic": (0.05, 0.2)}  # to each side of the start, rad (m); rad/s (m/s)
START = 0.6  # rad: where a joint without a range starts; of a prismatic one 0
STOPPED = {"simulation": "the simulated arm leaves all bounds", "controller": "the controller's guard stops it"}
RISE = 0.01  # s from no torque to all of it where no rate is stated
STEPS = 1.5e-5, 6e-6  # rad or m at the joint: of the motor's and the joint's encoder where none are stated
NOISE = 1e-3  # of the largest current, standard deviation where none is stated


@dataclass(frozen=True, eq=False)
class Limits:
    """What a motion keeps: position (n, 2) rad or m; speed (n); torque (n) at the joint, N m; current (n) in the
    motors' unit of input; tip (2, 2) m, of x and y in the base frame. ``notes``: what is assumed, in sentences."""

    position: Array
    speed: Array
    torque: Array
    current: Array
    tip: Array
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion of the joints in words, and its shape (T, n)."""

    name: str
    shape: Array


@dataclass(frozen=True, eq=False)
class Kept:
    """A motion that keeps the limits: its reference, the run on the nominal arm, the largest share of each limit that
    is reached by any arm that was tried, and by how much it was made smaller."""

    motion: Motion
    reference: Reference
    simulation: Simulation
    shares: Mapping[str, float]
    scale: float


# -- limits -----------------------------------------------------------------------------------------------------------


def limits_of(arm: Arm, given: Mapping[str, tuple[float, ...]] | None = None) -> Limits:
    """The robot file's limits, narrowed by ``given``: position[_j], tip_x, tip_y (low, high), speed[_j], torque[_j],
    current[_j] (one number). Raises PlantError with every problem."""
    stated, assumed = _stated(arm)
    position, tip = stated.position.copy(), stated.tip.copy()
    most = {"speed": stated.speed.copy(), "torque": stated.torque.copy(), "current": stated.current.copy()}
    problems: list[str] = []
    for name, values in (given or {}).items():
        kind, _, number = name.rpartition("_") if name[-1:].isdigit() else (name, "", "")
        if name in ("tip_x", "tip_y"):
            kind = "tip"
        if kind not in ("position", "tip", *most) or (number and not 1 <= int(number) <= arm.n):
            problems.append(
                f"--limits {name}: no such limit; there are position, speed, torque, current (of all joints, or _1 to "
                f"_{arm.n} of one), tip_x and tip_y."
            )
            continue
        ranged = kind in ("position", "tip")
        if len(values) != 1 + ranged or not np.isfinite(values).all() or (ranged and not values[0] < values[1]):
            problems.append(f"--limits {name}: give {'LOW:HIGH, low first' if ranged else 'one number'}.")
        elif not ranged and not values[0] > 0:
            problems.append(f"--limits {name}={values[0]:g}: admits no motion; give a number above 0.")
        elif kind == "tip":
            tip["xy".index(name[-1])] = values
        else:
            chosen = [int(number) - 1] if number else list(range(arm.n))
            for j in chosen:
                problems += _narrow(arm, j, name, kind, values, position, most)
                assumed.pop((kind, j), None)
    if problems:
        raise PlantError("\n".join(problems))
    return Limits(position, most["speed"], most["torque"], most["current"], tip, tuple(assumed.values()))


def _narrow(
    arm: Arm, j: int, name: str, kind: str, values: tuple[float, ...], position: Array, most: Mapping[str, Array]
) -> list[str]:
    """Sets one limit of joint ``j`` (from 0), or says why not."""
    joint = arm.robot["joints"][j]
    file = joint["drive"]["max_current"] if kind == "current" else joint["limits"][kind]
    if kind == "position":
        if file and (values[0] < file[0] or values[1] > file[1]):
            return [
                f"--limits {name}: wider than the robot file's {file[0]:g} to {file[1]:g}; it may be narrower only."
            ]
        position[j] = values
    elif file and values[0] > file:
        return [f"--limits {name}={values[0]:g}: above the robot file's {file:g}; it may be narrower only."]
    else:
        most[kind][j] = values[0]
    return []


def units(arm: Arm, j: int) -> dict[str, str]:
    """Unit of each kind of limit of joint j (from 0)."""
    length, effort = ("rad", "N m") if arm.robot["joints"][j]["kind"] == "revolute" else ("m", "N")
    return {
        "position": length,
        "speed": f"{length}/s",
        "torque": effort,
        "current": arm.manifest["input"][j]["unit"],
    }


def _stated(arm: Arm) -> tuple[Limits, dict[tuple[str, int], str]]:
    """The robot file's limits, and where it states none what is assumed: a sentence by (kind, joint from 0)."""
    n, assumed, full = arm.n, {}, full_torque(arm)
    position = np.empty((n, 2))
    most = {kind: np.empty(n) for kind in ("speed", "torque", "current")}
    for j, joint in enumerate(arm.robot["joints"]):
        own, drive, slot, unit = joint["limits"], joint["drive"], arm.manifest["input"][j], units(arm, j)
        middle = START if joint["kind"] == "revolute" else 0.0
        reach, fast = ASSUMED[joint["kind"]]
        position[j] = own["position"] or (middle - reach, middle + reach)
        if not own["position"]:
            low, high = position[j]
            taken = f"{low:.3g} to {high:.3g} {unit['position']}"
            assumed["position", j] = f"position of joint {j + 1}: no limit is stated; {taken} is assumed."
        for kind, stated, without in (
            ("speed", own["speed"], fast),
            ("torque", own["torque"], full[j]),
            ("current", drive["max_current"], slot["bound"]),
        ):
            most[kind][j] = stated or without
            if not stated:
                assumed[kind, j] = (
                    f"{kind} of joint {j + 1}: no limit is stated; {without:.3g} {unit[kind]} is assumed."
                )
    return Limits(position, most["speed"], most["torque"], most["current"], np.array([[-np.inf, np.inf]] * 2)), assumed


def middle(arm: Arm, limits: Limits) -> Array:
    """The posture (n) about which to move: nearest to the middle of the ranges among those that gravity lets hold,
    with the tip well within its workspace. Raises PlantError where there is none."""
    center, half = limits.position.mean(1), np.diff(limits.position)[:, 0] / 2
    random = np.random.default_rng(0)
    tried = np.vstack([np.zeros(arm.n), random.uniform(-0.7, 0.7, (400, arm.n))]) * half + center
    held = np.abs(arm.evaluate("gravity_torque", q=tried)["g"])
    ratio = np.array([abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)])
    load = np.maximum(held / limits.torque, held / (ratio * torque_per_input(arm) * limits.current)).max(1) / HELD
    tip = arm.evaluate("points", q=tried)["points"][:, -2:]
    inside = np.minimum(tip - limits.tip[:, 0], limits.tip[:, 1] - tip).min(1)
    able = np.flatnonzero((load < 1) & (inside > 0))
    if not len(able):
        light = int(np.argmin(np.where(inside > 0, load, np.inf)))
        why = (
            f"gravity alone takes {100 * HELD * load[light]:.0f} % of torque or current in the lightest posture"
            if (inside > 0).any()
            else f"in none of {len(tried)} postures within the joints' ranges is the tip inside tip_x and tip_y"
        )
        raise PlantError(f"the limits admit no motion: {why}; widen them.")
    away = np.linalg.norm((tried - center) / half, axis=1)
    room = np.minimum(inside, 0.3 * inside[able].max()) if np.isfinite(limits.tip).any() else np.zeros(len(tried))
    return tried[min(able, key=lambda k: (-room[k], away[k]))]


# -- motions ----------------------------------------------------------------------------------------------------------


def motions(arm: Arm, joint: int, duration: float, period: float) -> list[Motion]:
    """The motions that are tried, for an effect of ``joint`` (0: of the whole arm)."""
    count = round(duration / period)
    t: Array = np.arange(count, dtype=float) * period
    ends = smooth_step(np.minimum(t, t[-1] - t) / min(0.5, duration / 8))[0][:, None]
    alone = np.array([float(joint in (0, j)) for j in range(1, arm.n + 1)])
    gentle = np.where(alone > 0, 1.0, 0.3)  # the other joints change inertia and load meanwhile
    found = [
        Motion(f"multisine to {band:g} Hz", ends * _multisine(t, arm.n, duration / 2, 0.5 * band / 8, band))
        for band in (1.5, 6.0, 25.0)
        if band < 0.1 / period
    ]
    slow = _joints(lambda j: _ramps(t, (1, -1, 0.5, -0.5, 0.25, -0.25, 0.1, -0.1), j), arm.n)
    fine = _joints(lambda j: _ramps(t, (0.1, -0.1, 0.06, -0.06, 0.03, -0.03, 0.015, -0.015), j), arm.n)
    speeds = _joints(lambda j: _speeds(t, j), arm.n)
    holds = _joints(lambda j: _holds(t, j), arm.n)
    fast = _multisine(t, arm.n, duration / 2, 1.0, min(25.0, 0.1 / period))
    third = (3 * t / duration).astype(int)[:, None]
    parts = smooth_step(np.minimum(3 * t / duration % 1, 1 - 3 * t / duration % 1) / 0.1)[0][:, None]
    turns = _joints(lambda j: _ramps(3 * t % duration, (1, -1, 0.3, -0.3), j), arm.n)
    rests = _joints(lambda j: _holds(3 * t % duration, j), arm.n)
    found += [
        Motion("slow reversals of falling amplitude", ends * slow * gentle),
        Motion("fine reversals", ends * fine * gentle),
        Motion("ramps of rising speed", ends * speeds * gentle),
        Motion("holds at nine poses", ends * holds),
        Motion("slow reversals with a fast multisine", ends * (0.9 * slow * gentle + 0.02 * fast)),
        Motion(
            "multisine, reversals, holds", parts * np.where(third == 0, 0.1 * fast, np.where(third == 1, turns, rests))
        ),
    ]
    if joint and arm.n > 1:
        found.append(Motion("slow reversals, the other joints at rest", ends * slow * alone))
    return found


def _joints(shape: Callable[[int], Array], n: int) -> Array:
    return np.stack([shape(j) for j in range(n)], 1)


def _multisine(t: Array, n: int, base: float, low: float, high: float) -> Array:
    """Each joint its own harmonics of 1/base Hz from ``low`` to ``high``, none above the speed of the first."""
    harmonics = np.unique(np.round(np.geomspace(max(low * base, 1), high * base, 12 * n)).astype(int))
    shapes = []
    for j in range(n):
        own = harmonics[j::n] if len(harmonics) >= n else harmonics
        size = 1.0 / own
        phase = -np.pi * np.arange(len(own)) * (np.arange(len(own)) + 1 + j) / len(own)
        wave = np.sin(2 * np.pi * np.outer(t, own) / base + phase) @ size
        shapes.append(wave / np.abs(wave).max())
    return np.stack(shapes, 1)


def _ramps(t: Array, turns: Sequence[float], j: int) -> Array:
    """Ramps from turning point to turning point at one speed, corners rounded; joint after joint the other way."""
    corners = np.array([0.0, *turns, 0.0]) * (-1) ** j
    when = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))])
    return _rounded(np.interp(t, when / when[-1] * t.max(), corners))


def _speeds(t: Array, j: int) -> Array:
    """To and fro, each time faster: the speeds of the ramps as 1 : 2 : 4 : 8 : 16."""
    lasting = np.repeat([1.0, 0.5, 0.25, 0.125, 0.0625], 2)
    corners = np.array([-1.0, 1.0] * 5 + [-1.0]) * (-1) ** j
    lead = 0.1
    when = np.concatenate([[0.0], lead + np.concatenate([[0.0], np.cumsum(lasting)]), [lead + lasting.sum() + lead]])
    return _rounded(np.interp(t, when / when[-1] * t[-1], np.concatenate([[0.0], corners, [0.0]])))


def _holds(t: Array, j: int) -> Array:
    """Nine poses, each held for two thirds of its time."""
    poses = np.array([0.0, 0.5, 1.0, 0.3, -0.4, -1.0, -0.6, 0.1, 0.7, 0.0])
    if j % 2:
        poses = np.array([0.0, -0.8, 0.2, 0.9, -0.3, 0.6, 1.0, -0.5, -1.0, 0.0])
    place = np.clip(t / t.max() * 9, 0, 9 - 1e-9)
    k = place.astype(int)
    return poses[k] + (poses[k + 1] - poses[k]) * smooth_step(3 * (place - k))[0]


def _rounded(wave: Array) -> Array:
    """Corners rounded over a hundredth of the whole, without a jump in acceleration."""
    width = max(3, len(wave) // 100)
    kernel = np.hanning(width + 2)[1:-1]
    padded = np.pad(wave, (width, width), mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="same")[width:-width]


# -- trying -----------------------------------------------------------------------------------------------------------


def drawn(arm: Arm, limits: Limits, motion: Motion, center: Array, period: float, scale: float) -> Reference:
    """The reference: the shape as large as range, speed, and what inertia asks of torque and current let it, times
    ``scale``."""
    v, ratio = np.gradient(motion.shape, period, axis=0), [arm.parameters[f"ratio_{j}"] for j in range(1, arm.n + 1)]
    a = np.gradient(v, period, axis=0)
    mass = np.diag(arm.evaluate("mass_matrix", q=center)["M"].reshape(arm.n, arm.n))
    rotor = np.array([arm.parameters[f"motor_inertia_{j}"] for j in range(1, arm.n + 1)]) * np.square(ratio)
    room = np.minimum(center - limits.position[:, 0], limits.position[:, 1] - center)
    peak = [np.maximum(np.abs(x).max(0), 1e-12) for x in (motion.shape, v, a)]
    drive = np.abs(ratio) * torque_per_input(arm) * limits.current
    sizes = DRAWN * np.min(
        [room, limits.speed / peak[1], limits.torque / (mass * peak[2]), drive / ((mass + rotor) * peak[2])], axis=0
    )
    q = center + scale * sizes * motion.shape
    return Reference("joint", period, q, scale * sizes * v, scale * sizes * a)


def shares(arm: Arm, limits: Limits, run: Simulation, current: Array) -> dict[str, float]:
    """The largest share of each limit, by name, that a run reaches; of a range the distance from its middle."""
    at = {
        what: run.state[:, [arm.index(f"joint_{what}_{j}") for j in range(1, arm.n + 1)]]
        for what in ("position", "velocity")
    }
    half = np.diff(limits.position)[:, 0] / 2
    reached = {
        "position": np.abs(at["position"] - limits.position.mean(1)) / half,
        "speed": np.abs(at["velocity"]) / limits.speed,
        "torque": np.abs(run.joint_torque) / limits.torque,
        "current": np.abs(current) / limits.current,
    }
    found = {f"{kind}_{j + 1}": float(x[:, j].max()) for kind, x in reached.items() for j in range(arm.n)}
    for axis, (low, high) in zip("xy", limits.tip, strict=True):
        if np.isfinite([low, high]).all():
            tip = run.tip[:, "xy".index(axis)]
            found[f"tip_{axis}"] = float(np.abs(tip - (low + high) / 2).max() / ((high - low) / 2))
    return found if (run.status >= 0).all() and np.isfinite(run.state).all() else {"controller": np.inf}


def follow(arm: Arm, plant: Arm, reference: Reference, limits: Limits) -> tuple[Simulation | None, dict[str, float]]:
    """``plant`` driven along the reference by the position controller of ``arm``, with the robot file's sensors, and
    the shares of the limits that it reaches; None where the simulation leaves all bounds."""
    constants = torque_per_input(arm)
    most = constants * limits.current
    rates = [joint["limits"]["motor_torque_rate"] for joint in arm.robot["joints"]]
    rate = tuple(float(r or m / RISE) for r, m in zip(rates, most, strict=True))
    guard = Guard(Safe.ZERO, reference.period, torque_limit=tuple(most.tolist()), torque_rate=rate)
    controller = Controller(arm, "position", guard)
    try:
        result = run(plant, controller, reference, sensors=_sensors(arm), start=reference.position[0])
    except PlantError:  # the reference fits and the controller stands: what is left is a state that is not finite
        return None, {"simulation": np.inf}
    return result, shares(plant, limits, result, result.torque / constants)


def _sensors(arm: Arm) -> Sensors:
    """The robot file's, and usual ones where it states none."""
    sensor = [joint["sensor"] for joint in arm.robot["joints"]]
    largest = [arm.manifest["input"][j]["bound"] for j in range(arm.n)]
    ratio = [abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)]
    return Sensors(
        tuple(s["motor_encoder_resolution"] or STEPS[0] * k for s, k in zip(sensor, ratio, strict=True)),
        tuple(s["joint_encoder_resolution"] or STEPS[1] for s in sensor),
        tuple(s["current_noise"] or NOISE * m for s, m in zip(sensor, largest, strict=True)),
        force_noise=0.0,  # nothing touches the arm
    )


def seen(arm: Arm, position: Array) -> Array:
    """By how many steps of its finer encoder each joint moves along ``position`` (T, n)."""
    sensors, ratio = _sensors(arm), [abs(arm.parameters[f"ratio_{j}"]) for j in range(1, arm.n + 1)]
    assert sensors.motor_resolution and sensors.joint_resolution
    step = np.minimum(np.divide(sensors.motor_resolution, ratio), sensors.joint_resolution)
    return np.asarray(np.ptp(position, axis=0) / step)


def keep(arm: Arm, others: Sequence[Arm], limits: Limits, motion: Motion, center: Array, period: float) -> Kept | str:
    """The motion, made smaller until the nominal arm keeps the limits with a margin and ``others`` (arms with an
    effect) keep them; else why not."""
    scale, why = 1.0, ""
    for _ in range(TRIES):
        reference = drawn(arm, limits, motion, center, period, scale)
        result, reached = follow(arm, arm, reference, limits)
        over = {name: share / MARGIN for name, share in reached.items()}
        if max(over.values()) <= 1:
            for other in others:
                for name, share in follow(arm, other, reference, limits)[1].items():
                    reached[name], over[name] = max(reached.get(name, 0), share), max(over.get(name, 0), share)
            if result is not None and max(over.values()) <= 1:
                return Kept(motion, reference, result, reached, scale)
        name = max(over, key=lambda key: over[key])
        why = STOPPED.get(name) or f"{name} at {100 * reached[name]:.0f} % of its limit"
        scale *= float(np.clip(0.97 / over[name], 0.3, 0.9))
        if scale < SMALLEST:
            break
    return why


def with_size(arm: Arm, sizes: Mapping[str, float]) -> Arm:
    """A second arm of the same build with parameters changed, each kept within its bounds."""
    other = arm.at(arm.p)
    described = other.parameters.described
    other.parameters.update({k: min(max(v, described[k].low), described[k].high) for k, v in sizes.items()})
    return other
