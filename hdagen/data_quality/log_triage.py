"""Triage: the quality of a log before anything is computed from it, in words with numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality import frozen_channels, inputs, inputs_vs_motion, positions, ripple_lines, sampling
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.log_profile import LogProfile
from hdagen.log.channel_statistics import ChannelStatistics
from hdagen.log.measured_log import Log

__all__ = ["CHECKS", "Finding", "Severity", "Triage", "examine_log", "triage", "triage_for_robot"]

Check = Callable[[LogProfile, RobotFacts, Arm | None], list[Finding]]

# One mistake spoils the search for others, so each check leaves out the joints that those before it found wrong.
CHECKS: tuple[Check, ...] = (
    sampling.check_sampling,
    sampling.check_channels,
    positions.find_jumps,
    positions.find_lost_rows,
    frozen_channels.find_frozen_channels,
    frozen_channels.find_saturated_positions,
    positions.check_spans,
    positions.check_resolutions,
    inputs.check_current_sizes,
    positions.find_swapped_encoders,
    positions.compare_encoders,
    positions.check_velocities,
    positions.check_references,
    inputs.check_measured_inputs,
    inputs_vs_motion.find_input_skews,
    inputs_vs_motion.find_reversed_inputs,
    frozen_channels.find_saturated_inputs,
    positions.find_encoder_skews,
    ripple_lines.find_ripple_lines,
    inputs_vs_motion.find_swapped_inputs,  # last: encoders are right where only inputs are swapped
)


@dataclass(frozen=True, eq=False)
class Triage:
    """A log in numbers, and the findings in it.

    Attributes:
        source: The log's origin.
        rows: Its rows.
        duration: s.
        rate: Hz.
        jitter: Standard deviation of the time between stamps, without gaps, s.
        is_even: Whether rows are taken as evenly spaced instead of the stamps.
        time_uncertainty: Standard deviation of an instant, s.
        dropped: The number of rows that are missing.
        gaps: The number of gaps in which they are missing.
        channels: The channels' statistics.
        lags: Lags of measured inputs behind their commands, s, by the measured channel.
        findings: The findings, the gravest first.
        notes: The log's notes.

    """

    source: str
    rows: int
    duration: float
    rate: float
    jitter: float
    is_even: bool
    time_uncertainty: float
    dropped: int
    gaps: int
    channels: tuple[ChannelStatistics, ...]
    lags: dict[str, float]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def refusals(self) -> tuple[str, ...]:
        """The reasons why nothing right can be computed from the log; empty if it can be used."""
        return self._sentences(Severity.REFUSE)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings."""
        return self._sentences(Severity.WARN)

    @property
    def notices(self) -> tuple[str, ...]:
        """The notes, without those on missing channels and on skews, which stand elsewhere."""
        own = [finding for finding in self.findings if finding.name not in ("missing", "skew")]
        return tuple(dict.fromkeys(f.sentence for f in own if f.severity is Severity.NOTE))

    def _sentences(self, severity: Severity) -> tuple[str, ...]:
        return tuple(dict.fromkeys(finding.sentence for finding in self.findings if finding.severity is severity))

    def words(self) -> list[str]:
        """The whole triage as lines to print."""
        lines = [
            f"{self.source}: {self.rows} rows, {self.duration:.4g} s at {self.rate:.5g} Hz, jitter "
            f"{1e6 * self.jitter:.3g} us, {self.dropped} dropped in {self.gaps} gap(s)."
        ]
        for channel in self.channels:
            step = "no steps seen"
            if channel.step:
                step = f"steps of {channel.step:.3g}"
            lines.append(f"{channel.name}: {channel.low:.4g} to {channel.high:.4g}, noise {channel.noise:.2g}, {step}.")
        lines += [f"{name} lags its command by {1e3 * seconds:.3g} ms." for name, seconds in self.lags.items()]
        lines += self.notes
        return lines + [f"{finding.severity.value}: {finding.sentence}" for finding in self.findings]

    def to_json(self) -> dict[str, object]:
        """The same for a JSON file."""
        return {
            "source": self.source,
            "rows": self.rows,
            "duration": self.duration,
            "rate": self.rate,
            "jitter": self.jitter,
            "clock": {"even": self.is_even, "uncertainty": self.time_uncertainty},
            "dropped": self.dropped,
            "gaps": self.gaps,
            "channels": {
                c.name: {"noise": c.noise, "step": c.step, "low": c.low, "high": c.high} for c in self.channels
            },
            "lags": dict(self.lags),
            "repaired": list(self.notes),
            "missing": [f.sentence for f in self.findings if f.name == "missing"],
            "warnings": list(self.warnings),
            "refused": list(self.refusals),
        }


def triage(
    log: Log,
    ratios: Sequence[float],
    resolutions: Mapping[str, float] | None = None,
    max_currents: Sequence[float | None] | None = None,
    position_limits: Sequence[tuple[float, float] | None] | None = None,
    prismatic: Sequence[int] = (),
) -> Triage:
    """Examine a log of a robot.

    Args:
        log: The log.
        ratios: The gear ratio of each joint (rad/m where prismatic).
        resolutions: The encoders' resolutions by column name, rad or m, where they are known.
        max_currents: The largest current of each joint, A; None where it is not known.
        position_limits: The range of each joint, rad or m; None where it is not known.
        prismatic: The numbers of the prismatic joints.

    Returns:
        The log in numbers, with the findings.

    Raises:
        ValueError: The lengths differ from the log's number of joints.

    """
    n = log.n_joints
    none: tuple[None, ...] = (None,) * n
    machine = RobotFacts(
        tuple(float(ratio) for ratio in ratios),
        dict(resolutions or {}),
        none if max_currents is None else tuple(max_currents),
        none if position_limits is None else tuple(position_limits),
        tuple(joint in prismatic for joint in range(1, n + 1)),
    )
    return examine_log(LogProfile(log), machine)


def examine_log(profile: LogProfile, robot: RobotFacts) -> Triage:
    """Examine a log by its profile.

    Args:
        profile: of the log.
        robot: its facts, one entry a joint of the log.

    Returns:
        The log in numbers, with the findings.

    Raises:
        ValueError: The robot has another number of joints.

    """
    log, n = profile.log, profile.log.n_joints
    if not len(robot.ratios) == len(robot.max_currents) == len(robot.position_limits) == n:
        raise ValueError(f"the log has {n} joints; ratios, max_currents and position_limits must be as many")
    gap_rows, missing = profile.gaps
    checked = profile
    for check in CHECKS:
        checked = checked.with_findings(check(checked, robot, None))
    order, jitter = list(Severity), 0.0
    if len(log) - 1 > len(gap_rows):
        jitter = float(np.std(np.delete(np.diff(log.logged_time), gap_rows)))
    return Triage(
        source=log.source,
        rows=len(log),
        duration=float(log.time[-1] - log.time[0]),
        rate=1 / profile.period,
        jitter=jitter,
        is_even=log.stamps is not None,
        time_uncertainty=log.time_uncertainty,
        dropped=int(missing.sum()),
        gaps=len(gap_rows),
        channels=tuple(profile.channels.values()),
        lags={name: one.seconds for name, one in profile.lags.items()},
        findings=tuple(sorted(checked.findings, key=lambda finding: (order.index(finding.severity), finding.joint))),
        notes=log.notes,
    )


def triage_for_robot(log: Log, robot: Mapping[str, Any]) -> Triage:
    """Examine a log with all that a robot file states.

    Args:
        log: The log.
        robot: The robot, as a build's manifest describes it (`Arm.robot`).

    Returns:
        The log in numbers, with the findings, as `triage` gives it.

    """
    return examine_log(LogProfile(log), RobotFacts.from_robot(robot))
