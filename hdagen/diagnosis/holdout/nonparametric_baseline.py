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
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.diagnosis.data.split import LogPortion, Mask
from hdagen.diagnosis.holdout.baseline_settings import BASELINE
from hdagen.diagnosis.inference.multiple_shooting import DRIVE_QUANTITIES
from hdagen.diagnosis.residuals.measured_motion import MeasuredMotion
from hdagen.diagnosis.residuals.torque_balance import TorqueBalance
from hdagen.log.column_map import name_command_channel
from hdagen.log.measured_log import Log
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.window_replay import Replay, replay

RIDGE_STRENGTHS = np.geomspace(*BASELINE.ridge_ends, BASELINE.ridge_count)


@dataclass(frozen=True, eq=False)
class RidgeRegression:
    """A ridge regression of features (F), clipped to the fitted range ``low`` to ``high`` and then standardized."""

    low: Array
    high: Array
    mean: Array
    scale: Array
    weights: Array
    offset: float

    @classmethod
    def fit(cls, features: Array, target: Array) -> RidgeRegression:
        """Fit ``target`` (K,) by ``features`` (K, F), with the ridge of the smallest cross-validation error."""
        mean, scale, level = features.mean(0), np.maximum(features.std(0), 1e-12), float(target.mean())
        X, y = features - mean, target - level
        X /= scale
        parts = list(
            zip(
                np.array_split(X, BASELINE.cross_validation_blocks),
                np.array_split(y, BASELINE.cross_validation_blocks),
                strict=True,
            )
        )
        grams, sums = [x.T @ x for x, _ in parts], [x.T @ part for x, part in parts]
        whole, all_, eye = np.sum(grams, 0), np.sum(sums, 0), np.eye(X.shape[1])
        losses = []
        for ridge in RIDGE_STRENGTHS:
            left_out = [
                _sum_squared_residuals(x, part, np.linalg.solve(whole - N + ridge * len(y) * eye, all_ - b))
                for (x, part), N, b in zip(parts, grams, sums, strict=True)
            ]
            losses.append(sum(left_out))
        best = int(np.argmin(losses))
        weights = np.zeros(len(eye))  # of the mean alone, which may predict unseen blocks better
        if losses[best] < float(y @ y):
            weights = np.linalg.solve(whole + RIDGE_STRENGTHS[best] * len(y) * eye, all_)
        return cls(features.min(0), features.max(0), mean, scale, weights, level)

    def __call__(self, features: Array) -> Array:
        """Predict the target (K,) from features (K, F)."""
        return self.offset + (np.clip(features, self.low, self.high) - self.mean) / self.scale @ self.weights


def _sum_squared_residuals(X: Array, y: Array, weights: Array) -> float:
    """Sum of squared residuals."""
    return float(np.sum((y - X @ weights) ** 2))


def fit_nonparametric_baseline(arm: Arm, shown: LogPortion, held_out: LogPortion, before: Replay) -> Replay:
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
    balance = held = _balance_torque(arm, held_out.log, before)
    if shown.log is not held_out.log:
        balance = _balance_torque(arm, shown.log, replay(arm, shown.log))
    kept = balance.motion.valid & shown.covers(balance.motion.time)
    raw = _stack_measurements(balance)
    basis = _draw_basis(raw)
    features = basis.compute_features(balance, raw)
    missing = balance.residual(arm.p)
    whole = missing.motor
    if missing.link is not None:
        whole = missing.motor + missing.link / balance.motion.ratio
    maps = [RidgeRegression.fit(features[j][kept], whole[kept, j]) for j in range(arm.n)]
    currents = [
        _fit_current_correction(shown, balance.motion.replays[0], name) for name in _name_input_readings(balance)
    ]
    fitted = _replay_corrected(balance, currents, [on(x) for on, x in zip(maps, features, strict=True)])
    errors = [_fit_encoder_correction(j, balance, kept, x, fitted) for j, x in enumerate(features, 1)]
    found = fitted
    if held is not balance:  # one log's features at a time, as they fill the memory
        features = basis.compute_features(held, _stack_measurements(held))
        found = _replay_corrected(held, currents, [on(x) for on, x in zip(maps, features, strict=True)])
    columns = dict(found.columns)
    for j, read in enumerate(errors, 1):
        if read is not None:
            more = np.interp(held.motion.log.time, held.motion.time, read(features[j - 1]))
            columns[f"joint_position_{j}"] = found.columns[f"joint_position_{j}"] + more
    return replace(found, columns=columns, noise=before.noise)


def _balance_torque(arm: Arm, log: Log, of: Replay) -> TorqueBalance:
    """The torque balance of a log on the robot file's model."""
    return TorqueBalance(MeasuredMotion(arm, log, (of, of)))


@dataclass(frozen=True, eq=False)
class FeatureBasis:
    """Scales (n, 1, M) of the measured quantities on the fitted motion, and the random features.

    ``ways`` (n M, WAVES) are the directions of these features, ``phases`` (WAVES,) their phases in rad.
    """

    scale: Array
    directions: Array
    phases: Array

    def compute_features(self, sight: TorqueBalance, raw: Array) -> list[Array]:
        """The features of each joint (K, F), from the measured quantities ``raw`` (n, K, M)."""
        raw = raw / self.scale
        all_ = np.concatenate(list(raw), 1)
        waves = np.cos(all_ @ self.directions + self.phases)
        found = []
        for j in range(sight.motion.n):
            q, v, _, load, u = raw[j].T
            d = np.tanh(v / BASELINE.direction_softness)
            theta = sight.motion.read_state("motor_position", j + 1)
            turns = [part for k in BASELINE.turn_harmonics for part in (np.sin(k * theta), np.cos(k * theta))]
            angle = sight.motion.read_state("joint_position", j + 1)
            time = sight.motion.time - sight.motion.time[0]
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


def _draw_basis(raw: Array) -> FeatureBasis:
    """Draw the random features for measured quantities ``raw`` (n, K, M), with a fixed seed."""
    rng = np.random.default_rng(0)
    scale = np.maximum(raw.std(1, keepdims=True), 1e-12)
    ways = rng.normal(size=(raw.shape[0] * raw.shape[2], BASELINE.fourier_features)) / np.sqrt(
        raw.shape[0] * raw.shape[2]
    )
    return FeatureBasis(scale, ways, rng.uniform(0, 2 * np.pi, BASELINE.fourier_features))


def _stack_measurements(sight: TorqueBalance) -> Array:
    """Angle, speed, acceleration, load and input of each joint (n, K, 5)."""
    load, inputs = sight.link_torque(sight.motion.arm.p), sight.inputs(sight.motion.arm.p)
    return np.stack(
        [
            np.column_stack(
                [
                    sight.motion.read_state("joint_position", j + 1),
                    sight.motion.read_state("motor_velocity", j + 1) / sight.motion.ratio[j],
                    sight.motion.acceleration[1][:, j],
                    load[:, j],
                    inputs[:, j],
                ]
            )
            for j in range(sight.motion.n)
        ]
    )


def _replay_corrected(sight: TorqueBalance, currents: list[RidgeRegression | None], torque: list[Array]) -> Replay:
    """The replay with a further torque (K,) at each motor and with the corrections of the currents.

    The current's sensor does not read the further torque; it does read the corrections.
    """
    arm, log = sight.motion.arm, sight.motion.log
    gains = compute_torque_per_input(arm)
    commands, _ = read_driving_inputs(arm, log, "command")
    columns = {k: v for k, v in log.columns.items() if not k.startswith(("motor_current", "motor_torque"))}
    shown = dict(sight.motion.replays[0].columns)  # the plain replay, for the readings of its current sensors
    names = _name_input_readings(sight)
    for j, (added, flows, name) in enumerate(zip(torque, currents, names, strict=True), 1):
        own = arm.input_names[j - 1]
        command = name_command_channel(own)
        columns[command] = commands[:, j - 1] + np.interp(log.time, sight.motion.time, added) / gains[j - 1]
        if flows is not None:  # a current that is read in one row flowed in the row before
            beside = flows(_lag_command(log[name_command_channel(name)]))
            acts = beside
            if name != own:
                acts = beside / gains[j - 1]
            columns[command] = columns[command] + np.append(acts[1:], acts[-1])
            shown[name] = shown[name] + beside
    found = replay(arm, replace(log, columns=columns, notes=()))
    return replace(found, columns={**found.columns, **{name: shown[name] for name in names}})


def _name_input_readings(sight: TorqueBalance) -> list[str]:
    """The columns of a replay that read each joint's input: a current, or the torque that the log has in its place."""
    plain = sight.motion.replays[0].columns
    names = []
    for j in range(1, sight.motion.n + 1):
        names.append(next(f"{kind}_{j}" for kind in DRIVE_QUANTITIES if f"{kind}_{j}" in plain))
    return names


def _fit_current_correction(shown: LogPortion, plain: Replay, name: str) -> RidgeRegression | None:
    """The correction of the input ``name``, measured less replayed; None where it is not measured."""
    log, rows, command = shown.log, shown.rows, name_command_channel(name)
    if name not in log or command not in log or name not in plain.columns:
        return None
    return RidgeRegression.fit(_lag_command(log[command])[rows], (log[name] - plain.columns[name])[rows])


def _lag_command(command: Array) -> Array:
    """A command, its last rows, and powers of it (T, F)."""
    last = [np.concatenate([np.full(k, command[0]), command[: len(command) - k]]) for k in range(BASELINE.command_lags)]
    return np.column_stack([*last, np.abs(command), command * np.abs(command), command**3])


def _fit_encoder_correction(
    j: int, seen: TorqueBalance, kept: Mask, features: Array, fitted: Replay
) -> RidgeRegression | None:
    """The correction of the encoder of joint j, in rad, against the motor's; None where one of the two is missing."""
    joint, motor = f"joint_position_{j}", f"motor_position_{j}"
    if joint not in seen.motion.log or motor not in seen.motion.log:
        return None
    error = {name: seen.motion.log[name] - fitted.columns[name] for name in (joint, motor)}
    beside = seen.motion.on_grid(error[joint] - error[motor] / seen.motion.ratio[j - 1])
    return RidgeRegression.fit(features[kept], beside[kept])
