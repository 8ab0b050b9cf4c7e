"""Triage: the quality of a log before anything is computed from it, in words with numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdagen.data_quality import frozen_channels, inputs, inputs_vs_motion, positions
from hdagen.data_quality import ripple_lines as lines
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.log.channel_statistics import ChannelStatistics, compute_channel_statistics
from hdagen.log.column_map import split_column_name
from hdagen.log.measured_log import Log, find_gaps

__all__ = ["Finding", "Severity", "Triage", "triage", "triage_for_robot"]

_DROPPED_SHARE_LIMITS = 0.005, 0.2  # share of missing rows above which a log is warned of, and is refused
_WARNED_GAP_TIME = 0.25  # s, the length of a window of the replay
_SHORT_LOG_TIME = 1.0  # s, below which a log is warned of
_SLOW_SAMPLE_RATE = 200.0  # Hz; joint resonances lie at 15 to 140 Hz
_MISSING_CHANNEL_COSTS = (  # the cost of a channel that a joint does not have
    ("motor_position", "in a flexible joint, torsion, backlash and kinematic error cannot be told apart"),
    ("joint_position", "what bends or errs behind the motor is seen only through the motor"),
    ("joint_position_reference", "the loop cannot be closed in a replay"),
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
        even: Whether rows are taken as evenly spaced instead of the stamps.
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
    if not len(machine.ratios) == len(machine.max_currents) == len(machine.position_limits) == n:
        raise ValueError(f"the log has {n} joints; ratios, max_currents and position_limits must be as many")
    channels = {name: compute_channel_statistics(name, values) for name, values in log.columns.items()}
    steps = np.diff(log.time)
    gap_rows, missing = find_gaps(log.time)
    lags = inputs.estimate_lags(log)
    findings = (
        _check_sampling(log, steps, gap_rows, missing)
        + _check_channels(log, channels)
        + _find_mistakes(log, channels, machine, lags)
    )
    order, jitter = list(Severity), 0.0
    if len(steps) > len(gap_rows):
        jitter = float(np.std(np.delete(np.diff(log.logged_time), gap_rows)))
    return Triage(
        source=log.source,
        rows=len(log),
        duration=float(log.time[-1] - log.time[0]),
        rate=1 / log.period,
        jitter=jitter,
        is_even=log.stamps is not None,
        time_uncertainty=log.time_uncertainty,
        dropped=int(missing.sum()),
        gaps=len(gap_rows),
        channels=tuple(channels.values()),
        lags={name: one.seconds for name, one in lags.items()},
        findings=tuple(sorted(findings, key=lambda finding: (order.index(finding.severity), finding.joint))),
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
    joints = robot["joints"]
    resolutions = {
        f"{side}_position_{j}": joint["sensor"][f"{side}_encoder_resolution"]
        for j, joint in enumerate(joints, 1)
        for side in ("motor", "joint")
    }
    return triage(
        log,
        [joint["drive"]["ratio"]["nominal"] for joint in joints],
        {name: value for name, value in resolutions.items() if value},
        [joint["drive"]["max_current"] for joint in joints],
        [joint["limits"]["position"] for joint in joints],
        [j for j, joint in enumerate(joints, 1) if joint["kind"] == "prismatic"],
    )


def _find_mistakes(
    log: Log, channels: Mapping[str, ChannelStatistics], machine: RobotFacts, lags: Mapping[str, inputs.Lag]
) -> list[Finding]:
    """Find mistakes. One spoils the search for others: a channel found wrong is left out of later comparisons."""
    findings = positions.find_jumps(log, channels) + positions.find_lost_rows(log, channels)
    findings += frozen_channels.find_frozen_channels(log, channels) + frozen_channels.find_saturated_positions(
        log, channels
    )
    sound = _find_sound_joints(log, findings)
    findings += positions.check_spans(channels, machine, sound) + positions.check_resolutions(channels, machine)
    findings += inputs.check_current_sizes(channels, machine)
    findings += positions.find_swapped_encoders(log, channels, sound)
    for joint in _find_sound_joints(log, findings, ("wrapped", "jump", "swapped")):
        findings += positions.compare_encoders(log, channels, machine, joint)
        findings += positions.check_velocities(log, channels, machine, joint) + positions.check_reference(
            log, channels, joint
        )
    moving = inputs_vs_motion.smooth_motion(
        log, channels, machine.ratios, _find_sound_joints(log, findings, ("wrapped", "jump", "swapped", "degrees"))
    )
    behind = inputs_vs_motion.measure_delay_rows(log, channels, moving)
    findings += inputs.check_measured_inputs(log, lags, machine, behind) + inputs_vs_motion.find_input_skews(
        behind, log.period
    )
    swapped = inputs_vs_motion.find_swapped_inputs(log, channels, moving)
    if not swapped:
        findings += inputs_vs_motion.find_reversed_inputs(
            log, channels, moving, lags
        ) + frozen_channels.find_saturated_inputs(log, channels, moving)
    sound = _find_sound_joints(
        log, findings, ("wrapped", "jump", "swapped", "degrees", "reversed", "joint_scale", "units")
    )
    return (
        findings
        + swapped
        + positions.find_encoder_skews(log, channels, machine, sound)
        + lines.find_ripple_lines(log, channels, machine, sound)
    )


def _find_sound_joints(log: Log, findings: list[Finding], names: tuple[str, ...] = ("wrapped", "jump")) -> list[int]:
    """The joints without a finding of ``names`` that refuses the log."""
    spoilt = {finding.joint for finding in findings if finding.severity is Severity.REFUSE and finding.name in names}
    return [joint for joint in range(1, log.n_joints + 1) if joint not in spoilt]


def _check_sampling(log: Log, steps: np.ndarray, rows: np.ndarray, missing: np.ndarray) -> list[Finding]:
    """Dropped rows, long gaps, and a log too short or too slow."""
    findings = []
    duration, lost = float(log.time[-1] - log.time[0]), int(missing.sum())
    share = lost / (len(log) + lost)
    if lost:
        k = int(rows[np.argmax(missing)])
        says = (
            f"{lost} row(s) are missing in {len(rows)} gap(s), {100 * share:.2g} % of the log, the longest of "
            f"{steps[k]:.3g} s after row {k + 1} ({log.time[k]:.6g} s)"
        )
        if share > _DROPPED_SHARE_LIMITS[1]:
            sentence = f"{says}: too many; record with a logger that keeps up, or at a lower rate."
            findings.append(Finding(Severity.REFUSE, "dropped", 0, sentence))
        elif steps[k] > _WARNED_GAP_TIME:
            sentence = f"{says}: nothing is known in between; cut the log there if it matters."
            findings.append(Finding(Severity.WARN, "dropped", 0, sentence))
        elif share > _DROPPED_SHARE_LIMITS[0]:
            findings.append(Finding(Severity.WARN, "dropped", 0, f"{says}: commands are held across them."))
    if duration < _SHORT_LOG_TIME:
        sentence = f"the log lasts {duration:.3g} s; a diagnosis needs several seconds of motion: record longer."
        findings.append(Finding(Severity.WARN, "short", 0, sentence))
    if 1 / log.period < _SLOW_SAMPLE_RATE:
        rate = f"{1 / log.period:.4g} Hz"
        sentence = f"{rate} is slow for joints that ring at 15 to 140 Hz: record at 500 Hz or more if possible."
        findings.append(Finding(Severity.NOTE, "slow", 0, sentence))
    return findings


def _check_channels(log: Log, channels: Mapping[str, ChannelStatistics]) -> list[Finding]:
    """Channels that are missing, constant or saturated, with the cost of each."""
    findings = []
    for joint in range(1, log.n_joints + 1):
        for base, cost in _MISSING_CHANNEL_COSTS:
            if f"{base}_{joint}" not in channels:
                findings.append(Finding(Severity.NOTE, "missing", joint, f"{base}_{joint} is not logged: {cost}."))
        for commanded, measured in inputs.COMMAND_MEASUREMENT_PAIRS:
            command, name = f"{commanded}_{joint}", f"{measured}_{joint}"
            absent = [one for one in (command, name) if one not in channels]
            if len(absent) == 1:
                sentence = f"{absent[0]} is not logged: delay, lag and saturation of the drive cannot be seen."
                findings.append(Finding(Severity.NOTE, "missing", joint, sentence))
    for name, channel in channels.items():
        _, joint = split_column_name(name) or (name, 0)
        if "_position_" in name and "reference" not in name and not channel.is_moving:
            sentence = (
                f"{name} stays between {channel.low:.5g} and {channel.high:.5g}: the joint was not moved, so nothing "
            )
            findings.append(
                Finding(Severity.WARN, "still", joint, sentence + "is learned about it; record a log that moves it.")
            )
        elif channel.is_constant and not name.startswith("tip_force"):
            findings.append(
                Finding(Severity.NOTE, "constant", joint, f"{name} stays at {channel.low:.5g}: it says nothing.")
            )
        if channel.saturated_share > 0.002 and name.rpartition("_")[0] in inputs.INPUT_QUANTITIES:
            sentence = (
                f"{name} sits at {channel.low:.4g} or {channel.high:.4g} in {100 * channel.saturated_share:.2g} % of"
                " the rows: saturated; record with less acceleration if that was not meant."
            )
            findings.append(Finding(Severity.WARN, "saturated", joint, sentence))
    return findings
