"""A nonparametric baseline: the gap that a flexible correction without structure leaves on the same data.

The diagnosis compares its verdict with this baseline. Each joint has three ridge regressions, all fitted to the motion
that the diagnosis saw. The first predicts the measured current less the model's current, from the last commands. The
second predicts the torque that is missing at the motor, of the whole joint. The third is fitted once both are in the
model, and predicts how the joint's encoder differs from the motor's. The features of the second and third regression
are the measured quantities, directions, harmonics of the angles, and random Fourier features of all joints together.
On held-out motion the current and the torque are added to the model's input, the angle to the model's reading.

Legend: T rows, K even instants, F features; θ motor angle.
Source: Rahimi, Recht, NIPS 20 (2007) 1177 (random features).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import torque_per_input
from hdagen.diagnosis.data.split import Mask, Portion
from hdagen.diagnosis.inference.multiple_shooting import DRIVES
from hdagen.diagnosis.residuals.residual_torque import Sight
from hdagen.log.column_map import commanded
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import driven_by
from hdagen.prediction.window_replay import Replay, replay

WAVES = 100  # random Fourier features
TURNS = (1, 2, 4)  # harmonics of the motor's angle
SLOW = 0.02  # of the usual speed, scale of the tanh that smooths a direction
LAGS = 8  # rows of the command among the features of the current's correction
RIDGES = np.geomspace(1e-6, 1e2, 9)  # ridges that are tried, of the mean square of the features
BLOCKS = 8  # of time, each left out once in the cross-validation


@dataclass(frozen=True, eq=False)
class Map:
    """A ridge regression of features (F), clipped to the fitted range ``low`` to ``high`` and then standardized."""

    low: Array
    high: Array
    mean: Array
    scale: Array
    weights: Array
    level: float

    @classmethod
    def of(cls, features: Array, target: Array) -> Map:
        """Fit ``target`` (K,) by ``features`` (K, F), with the ridge of the smallest cross-validation error."""
        mean, scale, level = features.mean(0), np.maximum(features.std(0), 1e-12), float(target.mean())
        X, y = features - mean, target - level
        X /= scale
        parts = list(zip(np.array_split(X, BLOCKS), np.array_split(y, BLOCKS), strict=True))
        grams, sums = [x.T @ x for x, _ in parts], [x.T @ part for x, part in parts]
        whole, all_, eye = np.sum(grams, 0), np.sum(sums, 0), np.eye(X.shape[1])
        losses = []
        for ridge in RIDGES:
            left_out = [
                _left(x, part, np.linalg.solve(whole - N + ridge * len(y) * eye, all_ - b))
                for (x, part), N, b in zip(parts, grams, sums, strict=True)
            ]
            losses.append(sum(left_out))
        best = int(np.argmin(losses))
        weights = np.zeros(len(eye))  # of the mean alone, which may predict unseen blocks better
        if losses[best] < float(y @ y):
            weights = np.linalg.solve(whole + RIDGES[best] * len(y) * eye, all_)
        return cls(features.min(0), features.max(0), mean, scale, weights, level)

    def __call__(self, features: Array) -> Array:
        """Predict the target (K,) from features (K, F)."""
        return self.level + (np.clip(features, self.low, self.high) - self.mean) / self.scale @ self.weights


def _left(X: Array, y: Array, weights: Array) -> float:
    """Sum of squared residuals."""
    return float(np.sum((y - X @ weights) ** 2))


def corrected(arm: Arm, shown: Portion, held_out: Portion, before: Replay) -> Replay:
    """Replay held-out motion with corrections that were fitted to the shown motion.

    Args:
        arm: the robot file's model.
        shown: the rows of a log (T,) that the corrections are fitted to.
        held_out: the rows that are replayed, of the same log or of another one.
        before: the replay of the held-out log on ``arm``.

    Returns:
        The replay with the corrections, in the noise of ``before``.

    Raises:
        PlantError: a log cannot be replayed.

    Source: Rahimi, Recht, NIPS 20 (2007) 1177 (random features).

    """
    seen = held = _sight(arm, held_out.log, before)
    if shown.log is not held_out.log:
        seen = _sight(arm, shown.log, replay(arm, shown.log))
    kept = seen.kept & shown.at(seen.time)
    raw = _raw(seen)
    basis = _basis(raw)
    features = basis.features(seen, raw)
    missing = seen.missing(seen.before)
    whole = missing.motor
    if missing.link is not None:
        whole = missing.motor + missing.link / seen.ratio
    maps = [Map.of(features[j][kept], whole[kept, j]) for j in range(arm.n)]
    currents = [_current(shown, seen.replays[0], name) for name in _read(seen)]
    fitted = _replayed(seen, currents, [on(x) for on, x in zip(maps, features, strict=True)])
    errors = [_encoder_map(j, seen, kept, x, fitted) for j, x in enumerate(features, 1)]
    found = fitted
    if held is not seen:  # one log's features at a time, as they fill the memory
        features = basis.features(held, _raw(held))
        found = _replayed(held, currents, [on(x) for on, x in zip(maps, features, strict=True)])
    columns = dict(found.columns)
    for j, read in enumerate(errors, 1):
        if read is not None:
            more = np.interp(held.log.time, held.time, read(features[j - 1]))
            columns[f"joint_position_{j}"] = found.columns[f"joint_position_{j}"] + more
    return replace(found, columns=columns, noise=before.noise)


def _sight(arm: Arm, log: Log, of: Replay) -> Sight:
    """The residual torque of a log on the robot file's model, before and after being the same."""
    return Sight(arm, log, (of, of), arm.p, arm.p, {})


@dataclass(frozen=True, eq=False)
class Basis:
    """Scales (n, 1, M) of the measured quantities on the fitted motion, and the random features.

    ``ways`` (n M, WAVES) are the directions of these features, ``phase`` (WAVES,) their phases in rad.
    """

    scale: Array
    ways: Array
    phase: Array

    def features(self, sight: Sight, raw: Array) -> list[Array]:
        """The features of each joint (K, F), from the measured quantities ``raw`` (n, K, M)."""
        raw = raw / self.scale
        all_ = np.concatenate(list(raw), 1)
        waves = np.cos(all_ @ self.ways + self.phase)
        found = []
        for j in range(sight.n):
            q, v, _, load, u = raw[j].T
            d = np.tanh(v / SLOW)
            theta = sight.column("motor_position", j + 1)
            turns = [part for k in TURNS for part in (np.sin(k * theta), np.cos(k * theta))]
            angle = sight.column("joint_position", j + 1)
            time = sight.time - sight.time[0]
            own = [
                d,
                d * np.abs(v),
                d * np.abs(load),
                d * v**2,
                d * q,
                d * u,
                np.abs(v),
                q**2,
                q**3,
                v * load,
                d * time,
            ]
            found.append(np.column_stack([all_, *own, *turns, np.sin(angle), np.cos(angle), waves]))
        return found


def _basis(raw: Array) -> Basis:
    """Draw the random features for measured quantities ``raw`` (n, K, M), with a fixed seed."""
    rng = np.random.default_rng(0)
    scale = np.maximum(raw.std(1, keepdims=True), 1e-12)
    ways = rng.normal(size=(raw.shape[0] * raw.shape[2], WAVES)) / np.sqrt(raw.shape[0] * raw.shape[2])
    return Basis(scale, ways, rng.uniform(0, 2 * np.pi, WAVES))


def _raw(sight: Sight) -> Array:
    """Angle, speed, acceleration, load and input of each joint (n, K, 5)."""
    load, inputs = sight.link_torque(sight.before), sight.inputs(sight.before)
    return np.stack(
        [
            np.column_stack(
                [
                    sight.column("joint_position", j + 1),
                    sight.column("motor_velocity", j + 1) / sight.ratio[j],
                    sight.acceleration[1][:, j],
                    load[:, j],
                    inputs[:, j],
                ]
            )
            for j in range(sight.n)
        ]
    )


def _replayed(sight: Sight, currents: list[Map | None], torque: list[Array]) -> Replay:
    """The replay with a further torque (K,) at each motor and with the corrections of the currents.

    The current's sensor does not read the further torque; it does read the corrections.
    """
    arm, log = sight.arm, sight.log
    gains = torque_per_input(arm)
    commands, _ = driven_by(arm, log, "command")
    columns = {k: v for k, v in log.columns.items() if not k.startswith(("motor_current", "motor_torque"))}
    shown = dict(sight.replays[0].columns)  # the plain replay, for the readings of its current sensors
    names = _read(sight)
    for j, (added, flows, name) in enumerate(zip(torque, currents, names, strict=True), 1):
        own = arm.input_names[j - 1]
        command = commanded(own)
        columns[command] = commands[:, j - 1] + np.interp(log.time, sight.time, added) / gains[j - 1]
        if flows is not None:  # a current that is read in one row flowed in the row before
            beside = flows(_lagged(log[commanded(name)]))
            acts = beside
            if name != own:
                acts = beside / gains[j - 1]
            columns[command] = columns[command] + np.append(acts[1:], acts[-1])
            shown[name] = shown[name] + beside
    found = replay(arm, replace(log, columns=columns, notes=()))
    return replace(found, columns={**found.columns, **{name: shown[name] for name in names}})


def _read(sight: Sight) -> list[str]:
    """The columns of a replay that read each joint's input: a current, or the torque that the log has in its place."""
    plain = sight.replays[0].columns
    names = []
    for j in range(1, sight.n + 1):
        names.append(next(f"{kind}_{j}" for kind in DRIVES if f"{kind}_{j}" in plain))
    return names


def _current(shown: Portion, plain: Replay, name: str) -> Map | None:
    """The correction of the input ``name``, measured less replayed; None where it is not measured."""
    log, rows, command = shown.log, shown.rows, commanded(name)
    if name not in log or command not in log or name not in plain.columns:
        return None
    return Map.of(_lagged(log[command])[rows], (log[name] - plain.columns[name])[rows])


def _lagged(command: Array) -> Array:
    """A command, its last rows, and powers of it (T, F)."""
    last = [np.concatenate([np.full(k, command[0]), command[: len(command) - k]]) for k in range(LAGS)]
    return np.column_stack([*last, np.abs(command), command * np.abs(command), command**3])


def _encoder_map(j: int, seen: Sight, kept: Mask, features: Array, fitted: Replay) -> Map | None:
    """The correction of the encoder of joint j, in rad, against the motor's; None where one of the two is missing."""
    joint, motor = f"joint_position_{j}", f"motor_position_{j}"
    if joint not in seen.log or motor not in seen.log:
        return None
    error = {name: seen.log[name] - fitted.columns[name] for name in (joint, motor)}
    beside = seen.on_grid(error[joint] - error[motor] / seen.ratio[j - 1])
    return Map.of(features[kept], beside[kept])
