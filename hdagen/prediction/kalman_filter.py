"""Estimates of the arm's state at given rows, from the measurements up to each row and none later.

A bank of extended Kalman filters runs over the last rows before each instant, the filters of all instants side by side.
In a filter the log's inputs drive the model, with an extra torque at every motor and every flexible link, and with an
error of the joint's encoder where a flexible joint has two. These extras are Ornstein-Uhlenbeck processes. The
filters of a bank differ in the size of these processes, and the one that predicted the rows best is taken: a right
model is used to the full, and a wrong model or a late encoder hardly distorts the state. Extra torque and error end
with the filter; a replay does not contain them.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 10.3 (extended
filter), 8.2 (coloured noise) and 11.6.2 (static multiple-model estimator). Dry friction is the model's own and
set-valued in the mean; its slope is left out of the covariance, where a joint at rest is as free to move as one in
motion.
"""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_rated_torque, compute_rated_torsion
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import (
    Readings,
    Rows,
    complete_state,
    count_mechanical_states,
    get_state_limits,
    has_sensor_effects,
    undo_sensor_effects,
)
from hdagen.prediction.prediction_settings import PREDICTION
from hdagen.support.parallel import map_in_threads

FILTER_DEVIATIONS = np.array(PREDICTION.filter_deviations)
INSTANTS_PER_CALL = 16  # instants that one call of a thread filters
# In the order of the compiled bank
BANK_CHANNELS = "motor_position", "motor_velocity", "joint_position", "joint_velocity"


def estimate_states(
    arm: Arm, log: Log, readings: Readings, inputs: Array, rows: Rows, hidden: Array, earliest: Rows | int = 0
) -> Array:
    """Estimate the state of an arm at some rows of a log.

    Args:
        arm: The arm.
        log: The log.
        readings: Its channels.
        inputs: (T, nu), the inputs, each held from its row to the next.
        rows: (S), the rows, increasing and above 0.
        hidden: (T, nx − m), the effects' own states; each filter starts from them where its horizon begins.
        earliest: (S) or one number, the row before which no filter looks.

    Returns:
        (S, nx), the states; NaN where no filter stayed within the bounds.

    Source:
        Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 10.3, 8.2, 11.6.2.

    """
    back = int(
        np.clip(
            round(PREDICTION.filter_horizon / log.period), PREDICTION.least_horizon_rows, PREDICTION.most_horizon_rows
        )
    )
    bank, begins = FilterBank(arm, readings), np.maximum(rows - back, earliest)

    def filtered(part: slice) -> Array:
        at, first = rows[part], begins[part]
        noise = np.stack([readings.noise_before(int(row)) for row in at])
        return bank.run(log.time, inputs, first, at, noise, hidden[first])

    return np.concatenate(
        map_in_threads(filtered, (slice(k, k + INSTANTS_PER_CALL) for k in range(0, len(rows), INSTANTS_PER_CALL)))
    )


class FilterBank:
    """The filters of one arm. Shapes: W instants, L filters, M channels; D entries of a filter's state: m positions and
    velocities as in x, then the extra torques of motors and of flexible links (as accelerations), then the errors of
    joint encoders."""

    def __init__(self, arm: Arm, readings: Readings) -> None:
        self.arm, self.readings = arm, readings
        flexible, n, p = arm.manifest["flexible"], arm.n, arm.parameters
        self.m, self.n = count_mechanical_states(arm), n
        self.doubly_measured_joints = [
            j for j in flexible if {("motor_position", j), ("joint_position", j)} <= set(readings.outputs)
        ]
        self.D = self.m + n + len(flexible) + len(self.doubly_measured_joints)
        self.sliding_velocities, width = [], []
        for j in range(1, n + 1):
            if j in flexible:
                self.sliding_velocities.append(arm.index(f"motor_velocity_{j}"))
                width.append(p[f"friction_smoothing_{j}"])
            else:
                self.sliding_velocities.append(arm.index(f"joint_velocity_{j}"))
                width.append(p[f"friction_smoothing_{j}"] / abs(p[f"ratio_{j}"]))
        self.free_speeds = PREDICTION.free_sliding_widths * np.array(width)
        full = np.array([slot["bound"] for slot in arm.manifest["input"][:n]])
        at_joint = compute_rated_torque(arm)
        twist = self.rated_torsions = compute_rated_torsion(arm)
        inertia = arm.evaluate("mass_matrix", q=np.zeros(n))["M"].reshape(n, n).diagonal()
        push = [PREDICTION.link_torque_share * at_joint[j - 1] / inertia[j - 1] for j in flexible]
        trust, agree = FILTER_DEVIATIONS[:, :1], FILTER_DEVIATIONS[:, 1:]
        self.disturbance_deviations = np.hstack(
            [trust * [*full, *push], agree * [twist[j - 1] for j in self.doubly_measured_joints]]
        )  # (L, D − m)
        self.filters_with_encoder_error = np.flatnonzero(FILTER_DEVIATIONS[:, 1] > 0)
        self.unseen_deviations = np.zeros(self.D)  # standard deviations of states that no channel shows
        for j in flexible:
            for side, size in (("motor", abs(p[f"ratio_{j}"])), ("joint", 1.0)):
                self.unseen_deviations[arm.index(f"{side}_position_{j}")] = (
                    PREDICTION.unseen_side_torsion_share * twist[j - 1] * size
                )
                self.unseen_deviations[arm.index(f"{side}_velocity_{j}")] = (
                    100 * PREDICTION.unseen_side_torsion_share * twist[j - 1] * size
                )
        self.state_bounds = (
            PREDICTION.state_bound_factor * np.array([slot["bound"] for slot in arm.manifest["state"]])[: self.m]
        )
        self.output_matrix = np.zeros((len(readings.names), self.D))
        self.output_matrix[range(len(readings.names)), readings.state_indices] = readings.factors
        if has_sensor_effects(arm):
            self.output_matrix[:, : self.m] = self._compute_output_slopes()
        for k, j in enumerate(self.doubly_measured_joints, self.D - len(self.doubly_measured_joints)):
            self.output_matrix[readings.outputs.index(("joint_position", j)), k] = 1.0

    def _compute_output_slopes(self) -> Array:
        """The derivative of the channels by positions and velocities (M, m), for a straight arm in slow motion."""
        x = np.zeros((2 * self.m, self.arm.nx))
        x[:, self.sliding_velocities] = self.free_speeds
        size = 1e-3 * np.array([slot["bound"] for slot in self.arm.manifest["state"]])[: self.m]
        for sign, rows in ((1, slice(0, self.m)), (-1, slice(self.m, None))):
            x[rows, : self.m] += sign * np.diag(size)
        outputs = self.arm.evaluate("outputs", x=x, u=np.zeros(self.arm.nu))
        seen = np.stack([outputs[name][:, j - 1] for name, j in self.readings.outputs], 1)
        return np.asarray((seen[: self.m] - seen[self.m :]).T / (2 * size))

    def run(self, time: Array, inputs: Array, first: Rows, last: Rows, noise: Array, hidden: Array) -> Array:
        """Run the filters from some rows to others.

        Args:
            time: (T), s.
            inputs: (T, nu), the inputs.
            first: (W), the rows at which the filters begin.
            last: (W), the rows at which they end.
            noise: (W, M), standard deviations of the channels' noise.
            hidden: (W, nx − m), the effects' own states at ``first``.

        Returns:
            (W, nx), the states at ``last``.

        """
        arm, s = self.arm, self.readings
        x, extra, P = self._compute_initial_states(time, first, last, noise)
        x[..., self.m :] = hidden[:, None]
        places = [BANK_CHANNELS.index(name) * self.n + j - 1 for name, j in s.outputs]
        places += [j - 1 for j in arm.manifest["flexible"]]
        ratios = [arm.parameters[f"ratio_{j}"] for j in range(1, self.n + 1)]
        settings = [
            PREDICTION.disturbance_correlation_time,
            PREDICTION.burn_in_share,
            arm.stable_step,
            *get_state_limits(arm),
            *self.state_bounds,
            *self.free_speeds,
            *ratios,
            *self.rated_torsions,
        ]
        found = np.empty((len(last), arm.nx))
        arm.module.filters(
            *(x, extra, P, np.stack([first, last], 1).astype(np.int32), inputs, time, arm.c, s.measured, noise**2),
            *(self.output_matrix, np.array(places, np.int32), self.disturbance_deviations, np.array(settings), found),
        )
        return found

    def _compute_initial_states(self, time: Array, row: Rows, last: Rows, noise: Array) -> tuple[Array, Array, Array]:
        """The state (W, L, nx), extra torques and errors (W, L, D − m) and covariance (W, L, D, D) at ``row``, from
        rows up to ``last``."""
        W, L = len(row), len(FILTER_DEVIATIONS)
        x, P = self._fit_initial_line(time, row, last, noise, set())
        x, P = np.repeat(x[:, None], L, 1), np.repeat(P[:, None], L, 1)
        extra = np.zeros((W, L, self.D - self.m))
        spread = range(self.m, self.D)
        P[:, :, spread, spread] = self.disturbance_deviations**2
        if self.doubly_measured_joints:  # where the encoders may disagree the motor's alone begins
            places = {
                self.arm.index(f"joint_{what}_{j}")
                for j in self.doubly_measured_joints
                for what in ("position", "velocity")
            }
            alone, covariance = self._fit_initial_line(time, row, last, noise, places)
            x[:, self.filters_with_encoder_error] = alone[:, None]
            P[:, self.filters_with_encoder_error, : self.m, : self.m] = covariance[:, None, : self.m, : self.m]
            for k, j in enumerate(self.doubly_measured_joints, self.D - len(self.doubly_measured_joints)):
                q, channel = self.arm.index(f"joint_position_{j}"), self.readings.outputs.index(("joint_position", j))
                extra[:, self.filters_with_encoder_error, k - self.m] = (
                    self.readings.measured[row, channel] - alone[:, q]
                )[:, None]
                P[:, self.filters_with_encoder_error, k, k] = (
                    self.unseen_deviations[q] ** 2 + noise[:, channel, None] ** 2
                )
                P[:, self.filters_with_encoder_error, q, k] = P[:, self.filters_with_encoder_error, k, q] = -(
                    self.unseen_deviations[q] ** 2
                )
        return x, extra, P

    def _fit_initial_line(
        self, time: Array, row: Rows, last: Rows, noise: Array, ignored: set[int]
    ) -> tuple[Array, Array]:
        """The state (W, nx) and covariance (W, D, D) at ``row``.

        Positions are as measured, velocities those of a straight line through the rows that follow; the states
        ``ignored`` follow from the others.
        """
        s = self.readings
        rows = np.minimum(row[:, None] + np.arange(PREDICTION.slope_rows), last[:, None])
        t = time[rows] - time[row][:, None]
        weight = t - t.mean(1, keepdims=True)
        weight = weight / (weight**2).sum(1, keepdims=True)
        slope = np.einsum("wr,wrm->wm", weight, s.measured[rows]) / s.factors
        x, P = np.zeros((len(row), self.arm.nx)), np.zeros((len(row), self.D, self.D))
        P[:, range(self.D), range(self.D)] = self.unseen_deviations**2
        known = set()
        for k, place in enumerate(s.state_indices):
            if place in ignored:
                continue
            error = noise[:, k] / abs(s.factors[k])
            x[:, place], P[:, place, place] = s.measured[row, k] / s.factors[k], error**2
            known.add(place)
            rate = self.arm.index(self.arm.state_names[place].replace("position", "velocity"))
            if rate not in s.state_indices:
                x[:, rate] = slope[:, k]
                P[:, rate, rate] = error**2 * (weight**2).sum(1) + (0.2 * slope[:, k]) ** 2
                known.add(rate)
        joints = [j for j in s.joints_with_encoder() if self.arm.index(f"joint_position_{j}") not in ignored]
        return complete_state(self.arm, undo_sensor_effects(self.arm, x, joints), known), P
