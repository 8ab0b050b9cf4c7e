"""The estimator in numbers: whether its innovations agree with its covariance, how late and how wrong it sees a step of
force, how soon it calls a collision, and how often it calls one where there is none.

The normalised innovations of k readings have the mean k where the filter is consistent, and 95 % of them lie below the
quantile of chi-square with k degrees of freedom. Source: Bar-Shalom, Li, Kirubarajan, Estimation (2001), 5.4.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.control.reference_motion import circle
from hdagen.mpc.benchmark.law_comparison import (
    CIRCLE_CENTER,
    COURSE_WALLS,
    SECONDS_PER_TURN,
    make_table_configuration,
    vary_parameters,
)
from hdagen.mpc.closed_loop_trial import Trial, run_trial
from hdagen.mpc.predictive_controller import MPC
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push

SENSING_RADIUS = 0.03  # m, of the circle that the arm moves on meanwhile
SETTLING_TICKS = 200  # ticks after which the filter is judged
STEP_FORCES, HIT_FORCES = (5.0, 10.0, 20.0), (8.0, 10.0, 15.0, 25.0)  # N
LONGEST_DETECTION = 0.1  # s after a hit: a collision that is called later was not detected
VARIED_PLANTS, CONTACT_FREE_SECONDS = 40, 6.0  # arms off by 10 %, and how long each moves without a contact


@dataclass(frozen=True)
class InnovationStatistics:
    """Normalised innovations of ``readings`` encoders over a run: mean, the share below chi-square's 95 % quantile, and
    the correlation of one tick's with the next."""

    plant: str
    readings: int
    mean: float
    below: float
    correlation: float


@dataclass(frozen=True)
class ForceStepResponse:
    """A step of force as it was seen: delay to half and to nine tenths of it, s, and bias once it stands, N."""

    by: str
    size: float
    half: float
    nine: float
    bias: float


@dataclass(frozen=True)
class CollisionDetection:
    """Hits of one size, N: the share that was called a collision, and the time that took, s."""

    size: float
    hits: int
    share: float
    median: float
    largest: float


@dataclass(frozen=True)
class SensingResult:
    """All measurements. ``alarms``: collisions called in ``seconds`` of motion without any, parameters off by up to
    10 %."""

    consistency: tuple[InnovationStatistics, ...]
    steps: tuple[ForceStepResponse, ...]
    detections: tuple[CollisionDetection, ...]
    threshold: float
    alarms: int
    seconds: float


def measure_sensing(
    profile: str = "native", say: Callable[[str], None] = lambda _: None, plants: int = VARIED_PLANTS
) -> SensingResult:
    """Measure innovations, steps of force, collisions and false alarms.

    Args:
        profile: Profile of the builds.
        say: Hears the name of each measurement as it begins.
        plants: Count of arms, off by up to 10 %, that move without contact.

    Returns:
        All measurements.

    Raises:
        PlantError: A build fails, or the controller refuses its configuration.

    """
    c = make_table_configuration().with_changes(
        tuple(replace(w, offset=10.0) for w in COURSE_WALLS), limits__tip_speed=1.0, limits__sudden=0.0
    )
    arm, plant = load("paper", profile, mpc=c), load("paper", profile, mpc=c)
    controller = MPC(arm, c)
    say("innovations")
    consistency = [summarize_innovations("as modelled", arm, _move_on_circle(arm, controller, 4.0, seed=1))]
    say("steps of force")
    controller.configure_with(c.with_changes(c.walls, admittance__force="estimate"))
    steps = [step for size in STEP_FORCES for step in _measure_force_steps(arm, controller, size)]
    controller.configure_with(c)
    say("collisions")
    detections = [measure_detection(arm, controller, size) for size in HIT_FORCES]
    alarms, felt = 0, []
    for seed in range(plants):
        say(f"motion without contact {seed + 1} of {plants}")
        vary_parameters(plant, np.random.default_rng(seed))
        found = _move_on_circle(plant, controller, CONTACT_FREE_SECONDS, seed)
        felt.append(summarize_innovations("", arm, found))
        called = np.array([r.collision for r in found.reports])
        alarms += int(np.sum(called[1:] & ~called[:-1]))
    if felt:
        median = np.median([(one.mean, one.below, one.correlation) for one in felt], axis=0).tolist()
        consistency.append(InnovationStatistics(f"{plants} arms off by 10 %, median", felt[0].readings, *median))
    threshold = float(c["estimator.collision"])
    return SensingResult(
        tuple(consistency), tuple(steps), tuple(detections), threshold, alarms, plants * CONTACT_FREE_SECONDS
    )


def _move_on_circle(plant: Arm, controller: MPC, seconds: float, seed: int, pushes: Sequence[Push] = ()) -> Trial:
    path = circle(
        SENSING_RADIUS, CIRCLE_CENTER, SECONDS_PER_TURN, seconds, float(controller.configuration["mpc.period"])
    )
    return run_trial(plant, controller, path, pushes, Sensors(), (), seed)


def summarize_innovations(name: str, arm: Arm, found: Trial) -> InnovationStatistics:
    """Compare the innovations of a run with chi-square.

    Args:
        name: Name of the plant.
        arm: The controller's arm.
        found: The run.

    Returns:
        Mean, share below the 95 % quantile, and correlation of neighbours.

    Source: Bar-Shalom, Li, Kirubarajan, Estimation (2001), 5.4.

    """
    from scipy.stats import chi2

    readings = sum(name.startswith(("motor_position", "joint_position")) for name in arm.state_names)
    seen = np.array([r.innovation for r in found.reports])[SETTLING_TICKS:]
    next_one = float(np.corrcoef(seen[1:], seen[:-1])[0, 1])
    return InnovationStatistics(
        name, readings, float(seen.mean()), float(np.mean(seen < chi2.ppf(0.95, readings))), next_one
    )


def _measure_force_steps(arm: Arm, controller: MPC, size: float) -> list[ForceStepResponse]:
    """A step along each axis, without a force sensor, as the filter and as the observer saw it."""
    rows: dict[str, list[tuple[float, float, float]]] = {"filter": [], "observer": []}
    period = float(controller.configuration["mpc.period"])
    start, end = 1.0, 1.5
    for axis, force in enumerate(((size, 0.0), (0.0, size))):
        found = _move_on_circle(arm, controller, end, 3 + axis, [Push(start, end, force)])
        seen = {
            "filter": np.array([r.tip_force[axis] for r in found.reports]),
            "observer": np.array([r.observed_force[axis] for r in found.reports]),
        }
        for by, values in seen.items():
            rows[by].append(_measure_delay(values, round(start / period), size, period))
    return [ForceStepResponse(by, size, *np.mean(rows[by], axis=0).tolist()) for by in rows]


def _measure_delay(seen: Array, at: int, size: float, period: float) -> tuple[float, float, float]:
    after = seen[at:]
    half, nine = (period * int(np.argmax(after > share * size)) for share in (0.5, 0.9))
    return half, nine, float(np.mean(after[len(after) // 2 :]) - size)


def measure_detection(arm: Arm, controller: MPC, size: float, hits: int = 24) -> CollisionDetection:
    """Hit the moving arm in random directions and count the hits that are called collisions.

    Args:
        arm: The arm.
        controller: Its controller.
        size: Force of a hit, N.
        hits: Count of hits, about a second apart.

    Returns:
        Share and times of the detections.

    """
    random, period = np.random.default_rng(round(size)), float(controller.configuration["mpc.period"])
    begun = [round(float(1.0 + k + 0.2 * random.random()), 3) for k in range(hits)]
    angles = random.uniform(0, 2 * np.pi, hits)
    pushes = [
        Push(t, t + 0.3, (size * float(np.cos(a)), size * float(np.sin(a)))) for t, a in zip(begun, angles, strict=True)
    ]
    found = _move_on_circle(arm, controller, hits + 1.5, 5, pushes)
    called = np.array([r.collision for r in found.reports])
    times = []
    for t in begun:
        at = round(t / period)
        within = np.flatnonzero(called[at : at + round(LONGEST_DETECTION / period)])
        if not called[at - 1] and len(within):
            times.append(within[0] * period)
    share = len(times) / hits
    if not times:
        return CollisionDetection(size, hits, share, np.nan, np.nan)
    return CollisionDetection(size, hits, share, float(np.median(times)), max(times))


def format_sensing(found: SensingResult) -> list[str]:
    """Format the measurements for a terminal.

    Args:
        found: The measurements.

    Returns:
        Lines of text.

    """
    out = ["innovations, normalised:"]
    for one in found.consistency:
        out.append(
            f"  {one.plant}: mean {one.mean:.2f} of {one.readings} expected, {one.below:.1%} below the 95 % quantile, "
            f"correlation of neighbours {one.correlation:.2f}"
        )
    out.append("step of force, without a force sensor: seen by, size, half after, nine tenths after, bias")
    for step in found.steps:
        after = f"{1e3 * step.half:5.1f} ms {1e3 * step.nine:5.1f} ms"
        out.append(f"  {step.by:9}{step.size:5.0f} N {after} {step.bias:+7.2f} N")
    out.append(f"collision, called at {found.threshold:g} N: size, share detected, median, largest time")
    for d in found.detections:
        times = f"{1e3 * d.median:5.1f} ms {1e3 * d.largest:5.1f} ms"
        out.append(f"  {d.size:5.0f} N {d.share:7.0%} of {d.hits} {times}")
    hours = found.seconds / 3600
    if hours > 0:
        rate = f"with 95 % fewer than {3 / hours:.0f}"
        if found.alarms:
            rate = f"about {found.alarms / hours:.0f}"
        out.append(
            f"false alarms: {found.alarms} in {found.seconds:.0f} s of motion without contact, arms off by 10 %: "
            f"{rate} an hour"
        )
    return out
