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
from hdagen.arm.ratings import full_torque, full_torsion
from hdagen.log.measured_log import Log
from hdagen.prediction.measurement_model import BEYOND, Readings, Rows, complete, limits, mechanical, senses, unread
from hdagen.support.parallel import together

HORIZON = 0.15  # s of rows that the filters see: a few times the memory of the most trusting one
FEWEST, MOST = 12, 400  # rows of the horizon
# Standard deviations in each filter: of a motor's extra torque as a share of its input's bound, and of the joint
# encoder's error as a share of the torsion at the torque of that bound.
FILTERS = np.array(
    [(1e-2, 10), (1e-4, 10), (1e-2, 0.1), (1e-4, 0.1), (1e-6, 0), (1e-5, 0), (1e-4, 0), (1e-3, 0), (1e-2, 0), (1e-1, 0)]
)  # the first row is linearised about the first filter, which trusts the model least
LINK = 0.1  # a link's extra torque as a share of its motor's, at the joint
MEMORY = 0.1  # s, the correlation time of extra torques and encoder errors
BURN_IN = 1 / 3  # share of the horizon in which a filter is not judged: it still forgets its initial state
SLOPE = 8  # rows of the straight line from which a filter starts
TOGETHER = 16  # instants that one call of a thread filters
# In the order of the compiled bank
SHOWN = "motor_position", "motor_velocity", "joint_position", "joint_velocity"
# Share of the torsion at full torque, of a side of the gear that no channel shows; 100 times it a second
DOUBT = 0.2
FREE = 6.0  # widths of the smooth sign from standstill, beyond which dry friction has no slope


def estimate(arm: Arm, log: Log, readings: Readings, inputs: Array, rows: Rows, hidden: Array) -> Array:
    """Estimate the state of an arm at some rows of a log.

    Args:
        arm: The arm.
        log: The log.
        readings: Its channels.
        inputs: (T, nu), the inputs, each held from its row to the next.
        rows: (S), the rows, increasing and above 0.
        hidden: (T, nx − m), the effects' own states; each filter starts from them where its horizon begins.

    Returns:
        (S, nx), the states; NaN where no filter stayed within the bounds.

    Source:
        Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), 10.3, 8.2, 11.6.2.

    """
    back = int(np.clip(round(HORIZON / log.period), FEWEST, MOST))
    bank = Bank(arm, readings)

    def filtered(part: slice) -> Array:
        at = rows[part]
        noise = np.stack([readings.noise_before(int(row)) for row in at])
        first = np.maximum(at - back, 0)
        return bank.run(log.time, inputs, first, at, noise, hidden[first])

    return np.concatenate(together(filtered, (slice(k, k + TOGETHER) for k in range(0, len(rows), TOGETHER))))


class Bank:
    """The filters of one arm. Shapes: W instants, L filters, M channels; D entries of a filter's state: m positions and
    velocities as in x, then the extra torques of motors and of flexible links (as accelerations), then the errors of
    joint encoders."""

    def __init__(self, arm: Arm, readings: Readings) -> None:
        self.arm, self.readings = arm, readings
        flexible, n, p = arm.manifest["flexible"], arm.n, arm.parameters
        self.m, self.n = mechanical(arm), n
        self.doubly = [j for j in flexible if {("motor_position", j), ("joint_position", j)} <= set(readings.outputs)]
        self.D = self.m + n + len(flexible) + len(self.doubly)
        self.sliding, width = [], []
        for j in range(1, n + 1):
            if j in flexible:
                self.sliding.append(arm.index(f"motor_velocity_{j}"))
                width.append(p[f"friction_smoothing_{j}"])
            else:
                self.sliding.append(arm.index(f"joint_velocity_{j}"))
                width.append(p[f"friction_smoothing_{j}"] / abs(p[f"ratio_{j}"]))
        self.free = FREE * np.array(width)
        full = np.array([slot["bound"] for slot in arm.manifest["input"][:n]])
        at_joint = full_torque(arm)
        twist = self.twist = full_torsion(arm)
        inertia = arm.evaluate("mass_matrix", q=np.zeros(n))["M"].reshape(n, n).diagonal()
        push = [LINK * at_joint[j - 1] / inertia[j - 1] for j in flexible]
        trust, agree = FILTERS[:, :1], FILTERS[:, 1:]
        self.extra = np.hstack([trust * [*full, *push], agree * [twist[j - 1] for j in self.doubly]])  # (L, D − m)
        self.split = np.flatnonzero(FILTERS[:, 1] > 0)
        self.doubt = np.zeros(self.D)  # standard deviations of states that no channel shows
        for j in flexible:
            for side, size in (("motor", abs(p[f"ratio_{j}"])), ("joint", 1.0)):
                self.doubt[arm.index(f"{side}_position_{j}")] = DOUBT * twist[j - 1] * size
                self.doubt[arm.index(f"{side}_velocity_{j}")] = 100 * DOUBT * twist[j - 1] * size
        self.vague = BEYOND * np.array([slot["bound"] for slot in arm.manifest["state"]])[: self.m]
        self.read = np.zeros((len(readings.names), self.D))
        self.read[range(len(readings.names)), readings.places] = readings.factors
        if senses(arm):
            self.read[:, : self.m] = self._slopes()
        for k, j in enumerate(self.doubly, self.D - len(self.doubly)):
            self.read[readings.outputs.index(("joint_position", j)), k] = 1.0

    def _slopes(self) -> Array:
        """The derivative of the channels by positions and velocities (M, m), for a straight arm in slow motion."""
        x = np.zeros((2 * self.m, self.arm.nx))
        x[:, self.sliding] = self.free
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
        x, extra, P = self._begin(time, first, last, noise)
        x[..., self.m :] = hidden[:, None]
        places = [SHOWN.index(name) * self.n + j - 1 for name, j in s.outputs]
        places += [j - 1 for j in arm.manifest["flexible"]]
        ratios = [arm.parameters[f"ratio_{j}"] for j in range(1, self.n + 1)]
        settings = [MEMORY, BURN_IN, arm.stable_step, *limits(arm), *self.vague, *self.free, *ratios, *self.twist]
        found = np.empty((len(last), arm.nx))
        arm.module.filters(
            *(x, extra, P, np.stack([first, last], 1).astype(np.int32), inputs, time, arm.c, s.measured, noise**2),
            *(self.read, np.array(places, np.int32), self.extra, np.array(settings), found),
        )
        return found

    def _begin(self, time: Array, row: Rows, last: Rows, noise: Array) -> tuple[Array, Array, Array]:
        """The state (W, L, nx), extra torques and errors (W, L, D − m) and covariance (W, L, D, D) at ``row``, from
        rows up to ``last``."""
        W, L = len(row), len(FILTERS)
        x, P = self._line(time, row, last, noise, set())
        x, P = np.repeat(x[:, None], L, 1), np.repeat(P[:, None], L, 1)
        extra = np.zeros((W, L, self.D - self.m))
        spread = range(self.m, self.D)
        P[:, :, spread, spread] = self.extra**2
        if self.doubly:  # where the encoders may disagree the motor's alone begins
            places = {self.arm.index(f"joint_{what}_{j}") for j in self.doubly for what in ("position", "velocity")}
            alone, covariance = self._line(time, row, last, noise, places)
            x[:, self.split] = alone[:, None]
            P[:, self.split, : self.m, : self.m] = covariance[:, None, : self.m, : self.m]
            for k, j in enumerate(self.doubly, self.D - len(self.doubly)):
                q, channel = self.arm.index(f"joint_position_{j}"), self.readings.outputs.index(("joint_position", j))
                extra[:, self.split, k - self.m] = (self.readings.measured[row, channel] - alone[:, q])[:, None]
                P[:, self.split, k, k] = self.doubt[q] ** 2 + noise[:, channel, None] ** 2
                P[:, self.split, q, k] = P[:, self.split, k, q] = -(self.doubt[q] ** 2)
        return x, extra, P

    def _line(self, time: Array, row: Rows, last: Rows, noise: Array, ignored: set[int]) -> tuple[Array, Array]:
        """The state (W, nx) and covariance (W, D, D) at ``row``.

        Positions are as measured, velocities those of a straight line through the rows that follow; the states
        ``ignored`` follow from the others.
        """
        s = self.readings
        rows = np.minimum(row[:, None] + np.arange(SLOPE), last[:, None])
        t = time[rows] - time[row][:, None]
        weight = t - t.mean(1, keepdims=True)
        weight = weight / (weight**2).sum(1, keepdims=True)
        slope = np.einsum("wr,wrm->wm", weight, s.measured[rows]) / s.factors
        x, P = np.zeros((len(row), self.arm.nx)), np.zeros((len(row), self.D, self.D))
        P[:, range(self.D), range(self.D)] = self.doubt**2
        known = set()
        for k, place in enumerate(s.places):
            if place in ignored:
                continue
            error = noise[:, k] / abs(s.factors[k])
            x[:, place], P[:, place, place] = s.measured[row, k] / s.factors[k], error**2
            known.add(place)
            rate = self.arm.index(self.arm.state_names[place].replace("position", "velocity"))
            if rate not in s.places:
                x[:, rate] = slope[:, k]
                P[:, rate, rate] = error**2 * (weight**2).sum(1) + (0.2 * slope[:, k]) ** 2
                known.add(rate)
        joints = [j for j in s.encoders() if self.arm.index(f"joint_position_{j}") not in ignored]
        return complete(self.arm, unread(self.arm, x, joints), known), P
