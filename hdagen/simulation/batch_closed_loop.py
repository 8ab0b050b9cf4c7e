"""Closed loops by the thousand: one controller with many sets of gains on the compiled arm.

As many sets are simulated at once as a vector has lanes, controller and sensors inside. A set is simulated as
`hdagen.simulation.simulator.run` does it, with encoders that count, a force sensor with noise, delays, the input
effects of the model and the guard's limits of torque and rate; dry friction has the smooth sign, and faults of the
guard are not looked for. Sets share reference, pushes and noise, so that differences come from the gains.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.arm.ratings import compute_torque_per_input
from hdagen.control.guarded_controller import Controller, convert_to_law_space
from hdagen.control.reference_motion import Reference
from hdagen.simulation.simulated_sensors import Sensors, resolve_sensor_errors
from hdagen.simulation.simulator import Push, SpacePush, find_start, sum_push_forces
from hdagen.support.messages import join_nearest_names

MOST_DELAY_TICKS = 16  # ticks of delay at most, by the compiled library
Criterion = Callable[[Array, Array], Array]  # tip (T, W, 2 or 3, m) and torques sent (T, W, n, N m) -> (W, k)


def closed_loops(
    arm: Arm,
    controller: Controller,
    reference: Reference,
    gains: Mapping[str, ArrayLike],
    judge: Criterion,
    pushes: Sequence[Push | SpacePush] = (),
    sensors: Sensors | None = None,
    seed: int = 0,
    start: ArrayLike | None = None,
    threads: int = 2,
) -> Array:
    """Simulate closed loops with many sets of gains and judge each.

    Args:
        arm: The arm.
        controller: Its law, guard, model of the arm, and the gains that do not vary.
        reference: The motion that it follows.
        gains: (B,) each, by name: the gains that vary.
        judge: Called with tips (T, W, 2 or in space 3, m) and torques sent (T, W, n, N m) of W sets at once, from
            several threads; returns (W, k).
        pushes: Forces on the tip.
        sensors: The sensors' errors; None: from the robot file.
        seed: The seed of all noise, from 0.
        start: (n), joint positions near which the motion begins; None: a bent arm.
        threads: The number of threads.

    Returns:
        (B, k), the judgement of each set.

    Raises:
        PlantError: A gain, the motion or the sensors do not fit the controller.

    """
    table = _tabulate_gains(controller, gains)
    scheme = resolve_sensor_errors(arm, sensors or Sensors())
    _check_lanes(arm, controller, scheme.delay)
    q0 = find_start(arm, reference, start)
    rows = controller.rows(convert_to_law_space(controller, reference, q0))
    push = sum_push_forces(pushes, reference.time, arm.nu - arm.n)
    felt = _measure_force(push, seed, scheme.force_noise)
    period = controller.guard.period
    steps = arm.count_steps(period)
    limits = np.concatenate(controller.torque_limits())
    settings = np.concatenate([[period, steps, scheme.delay], scheme.resolution, limits, compute_torque_per_input(arm)])
    noise = scheme.draw_encoder_noise(len(push), seed)
    group = _LaneGroup(arm, controller, rows, (push, felt, noise), arm.rest(q0), settings)
    width = arm.module.batch_width
    firsts = range(0, len(table), width)
    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(lambda first: judge(*group.run(table[first : first + width])), firsts))
    return np.concatenate(found)


def _check_lanes(arm: Arm, controller: Controller, delay: int) -> None:
    """Refuse a controller of another build, and a delay (ticks) that lanes do not hold."""
    if controller.arm.folder != arm.folder:
        raise PlantError(
            f"the controller's model is of another build, {controller.arm.folder.name}, than the arm, "
            f"{arm.folder.name}; closed loops in lanes take one, with other parameters where they differ."
        )
    if delay > MOST_DELAY_TICKS:
        raise PlantError(f"a delay of {delay} ticks is more than closed loops in lanes take, {MOST_DELAY_TICKS}.")


def _measure_force(push: Array, seed: int, noise: float) -> Array:
    """The force sensor's reading; a moment is measured without noise."""
    felt, forces = push.copy(), min(push.shape[1], 3)
    felt[:, :forces] += np.random.default_rng(seed).normal(size=(len(push), forces)) * noise
    return felt


def _tabulate_gains(controller: Controller, gains: Mapping[str, ArrayLike]) -> Array:
    """The gains of every set, (B, number of the law's gains)."""
    bounds = {gain["name"]: gain for gain in controller.described["gains"]}
    columns = {name: np.atleast_1d(np.asarray(values, float)) for name, values in gains.items()}
    problems = [
        f"{controller.law}: no gain named {name}; there are {join_nearest_names([name], list(bounds))}."
        for name in columns
        if name not in bounds or name == "period"
    ]
    sizes = {column.shape for column in columns.values()}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1 or not next(iter(sizes))[0]:
        problems.append("closed loops take one or more sets: arrays of one length, one for each gain that varies.")
    for name, values in columns.items():
        if name in bounds:
            low, high, unit = (bounds[name][key] for key in ("low", "high", "unit"))
            if not ((values >= low) & (values <= high)).all():
                problems.append(f"{controller.law}: gain {name} leaves {low:g} to {high:g} {unit}; keep it inside.")
    if problems:
        raise PlantError("\n".join(problems))
    count = len(next(iter(columns.values())))
    every = {**{name: np.full(count, value) for name, value in controller.gains.items()}, **columns}
    return np.stack([every[name] for name in controller.gains], axis=1)


class _LaneGroup:
    """The sets that share a vector, from beginning to end."""

    def __init__(
        self,
        arm: Arm,
        controller: Controller,
        rows: Array,
        world: tuple[Array, Array, Array],
        x0: Array,
        settings: Array,
    ) -> None:
        self.arm, self.number, self.x0, self.settings = arm, controller.number, x0, settings
        module = arm.module
        self.controller_constants = controller.arm.c.copy()
        self.disturbances = world  # push (T, w), the force sensor's reading of it (T, w), noise of the encoders (T, 2n)
        self.tip_size = 3 if arm.moves_in_space else 2
        self.lane_count = module.length("loops_tick", "tip") // self.tip_size
        self.gain_count = module.length("loops_begin", "gains") // self.lane_count
        self.reference_rows = np.zeros((len(rows), module.length("loops_tick", "reference")))
        self.reference_rows[:, : rows.shape[1]] = rows

    def run(self, table: Array) -> tuple[Array, Array]:
        """Tip (T, W, 2 or 3) and torques sent (T, W, n) of the sets in ``table`` (W, gains)."""
        module, count = self.arm.module, len(self.reference_rows)
        context = np.zeros(module.length("loops_tick", "loops"), np.uint8)
        own = np.zeros((self.lane_count, self.gain_count))
        own[:, : table.shape[1]] = table[np.minimum(np.arange(self.lane_count), len(table) - 1)]
        status, law = np.zeros(1, np.int32), np.array([self.number], np.int32)
        begin = (context, law, self.x0, own.ravel(), self.settings, self.arm.c, status)
        module.bind("loops_begin", *begin).run()
        assert status[0] == 0
        tip = np.empty((count, self.lane_count, self.tip_size))
        sent = np.empty((count, self.lane_count, self.arm.n))
        module.map(
            "loops_tick",
            count,
            context,
            self.reference_rows,
            *self.disturbances,
            self.arm.c,
            self.controller_constants,
            tip,
            sent,
        )
        return tip[:, : len(table)], sent[:, : len(table)]
