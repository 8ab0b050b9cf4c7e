"""What only many logs show: parameters that drift over the dates of a robot's logs, and machines that stand out."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from hdagen.fleet.fleet_diagnosis import MachineResult

ERROR_RATE = 0.05  # chance that a fleet without any drift or outlier has one named, for each of both lists
LEAST_GROUP = 5  # machines of one kind from which one can stand out
_NORMAL_SCALE = 1.4826  # of the median absolute deviation, to the standard deviation of a normal distribution
_SECONDS_PER_DAY = 86_400.0


@dataclass(frozen=True)
class Drift:
    """A parameter of a robot over the dates of its logs.

    Attributes:
        robot: The robot, as fleet.toml names it.
        parameter: Name of the parameter, with the effect that it belongs to.
        unit: Of its values.
        days: Days since the first log, (n,).
        values: Estimates, (n,), in ``unit``.
        stds: Their standard deviations, (n,).
        slope: Change a day, least squares with these standard deviations.
        slope_std: Its standard deviation; scatter beyond the estimates' own widens it.
        is_sure: Whether the slope is no chance, among all that were looked at.

    """

    robot: str
    parameter: str
    unit: str
    days: tuple[float, ...]
    values: tuple[float, ...]
    stds: tuple[float, ...]
    slope: float
    slope_std: float
    is_sure: bool = False


def find_drifts(results: Sequence[MachineResult]) -> list[Drift]:
    """Estimate the drift of each parameter of each robot with logs of several days.

    Args:
        results: Results of all machines; those without a date are left out.

    Returns:
        The drifts, the surest first. Those named sure hold at ERROR_RATE for the whole list (Bonferroni).

    """
    found = []
    by_robot: dict[str, list[tuple[float, MachineResult]]] = {}
    for one in results:
        if one.row and one.machine.date:
            by_robot.setdefault(one.machine.robot, []).append((_count_days(one.machine.date), one))
    for robot, dated in by_robot.items():
        dated.sort(key=lambda entry: entry[0])
        names = dict.fromkeys(name for _, one in dated for name in (one.row or {})["parameters"])
        for name in names:
            drift = _fit_drift(robot, name, dated)
            if drift is not None:
                found.append(drift)
    limit = _find_sure_score(len(found))
    judged = [Drift(**{**vars(one), "is_sure": abs(_score_slope(one)) > limit}) for one in found]
    return sorted(judged, key=lambda one: -abs(_score_slope(one)))


def _count_days(date: str) -> float:
    """Days since 1970, of local dates as if they were UTC."""
    when = datetime.datetime.fromisoformat(date)
    if when.tzinfo is None:
        when = when.replace(tzinfo=datetime.UTC)
    return when.timestamp() / _SECONDS_PER_DAY


def _find_sure_score(count: int) -> float:
    """Standard deviations beyond which one of ``count`` looks is no chance."""
    if count == 0:
        return math.inf
    return -NormalDist().inv_cdf(ERROR_RATE / (2 * count))


def _score_slope(one: Drift) -> float:
    return one.slope / one.slope_std


def _fit_drift(robot: str, name: str, dated: Sequence[tuple[float, MachineResult]]) -> Drift | None:
    """The line through a parameter's estimates; None without two days or without standard deviations."""
    points = [(day, one.row["parameters"].get(name)) for day, one in dated if one.row]
    points = [(day, estimate) for day, estimate in points if estimate is not None and estimate[1] > 0]
    if len({day for day, _ in points}) < 2:
        return None
    days = np.array([day for day, _ in points])
    values, stds = (np.array([estimate[k] for _, estimate in points], float) for k in (0, 1))
    weights = stds**-2
    centre = np.average(days, weights=weights)
    spread = float(np.sum(weights * (days - centre) ** 2))
    slope = float(np.sum(weights * (days - centre) * values)) / spread
    left = values - np.average(values, weights=weights) - slope * (days - centre)
    scatter = 1.0
    if len(points) > 2:
        scatter = max(1.0, float(np.sum(weights * left**2)) / (len(points) - 2))
    return Drift(
        robot,
        name,
        str(points[0][1][2]),
        tuple(map(float, days - days[0])),
        tuple(map(float, values)),
        tuple(map(float, stds)),
        slope,
        math.sqrt(scatter / spread),
    )


def find_outliers(results: Sequence[MachineResult]) -> list[tuple[MachineResult, str]]:
    """Find machines that stand out among those of their kind, which have the same name in their robot file.

    A parameter stands out where it lies farther from the median of its kind than its own standard deviation and the
    scatter of the kind explain, at ERROR_RATE for the whole list (Bonferroni).

    Args:
        results: Results of all machines.

    Returns:
        Machines, each with a sentence, the farthest first.

    """
    kinds: dict[str, list[MachineResult]] = {}
    for one in results:
        if one.row:
            kinds.setdefault(str(one.row["robot_name"]), []).append(one)
    scored = [entry for members in kinds.values() for entry in _score_members(members)]
    limit = _find_sure_score(len(scored))
    far = sorted((entry for entry in scored if entry[0] > limit), key=lambda entry: -entry[0])
    return [(one, said) for _, one, said in far]


def _score_members(members: Sequence[MachineResult]) -> Iterator[tuple[float, MachineResult, str]]:
    """How far each parameter of each machine lies from the others' median, in standard deviations."""
    estimates: dict[str, list[tuple[MachineResult, list[float]]]] = {}
    for one in members:
        for name, estimate in (one.row or {})["parameters"].items():
            estimates.setdefault(name, []).append((one, estimate))
    for name, found in estimates.items():
        if len(found) < LEAST_GROUP:
            continue
        values = np.array([estimate[0] for _, estimate in found], float)
        median = float(np.median(values))
        scatter = _NORMAL_SCALE * float(np.median(np.abs(values - median)))
        for one, (value, std, unit) in found:
            width = math.hypot(scatter, std)
            if width > 0:
                said = f"{name} is {value:.3g} {unit}; the median of {len(found)} is {median:.3g} {unit}"
                yield abs(value - median) / width, one, said
