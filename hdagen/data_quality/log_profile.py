"""The profile of a log: everything about it that several checks need, computed once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from hdagen.data_quality.finding import Finding, Severity
from hdagen.data_quality.input_lags import Lag, estimate_lags
from hdagen.log.channel_statistics import ChannelStatistics, UniformGrid, compute_channel_statistics, make_uniform_grid
from hdagen.log.measured_log import Log, find_gaps

Computed = TypeVar("Computed")


@dataclass(frozen=True, eq=False)
class SmoothedMotion:
    """The smoothed motion of a log on an even grid; joints that do not move are left out.

    Position, velocity and acceleration are (n, K), in rad or m, and s.
    """

    grid: UniformGrid
    joints: tuple[int, ...]
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True, eq=False)
class LogProfile:
    """A log with its statistics, each of which is computed when it is first asked for.

    Attributes:
        log: The log, with finite values.
        findings: The findings so far. A check leaves a joint out that an earlier one found wrong.

    """

    log: Log
    findings: tuple[Finding, ...] = ()
    _computed: dict[Hashable, Any] = field(default_factory=dict, repr=False)  # by key, shared by `with_findings`

    @property
    def channels(self) -> dict[str, ChannelStatistics]:
        """Statistics of the channels, by name."""
        return {name: self.measure_channel(name) for name in self.log.columns}

    @property
    def period(self) -> float:
        """Median time between rows, s."""
        return self.compute_once("period", lambda: self.log.period)

    @property
    def gaps(self) -> tuple[np.ndarray, np.ndarray]:
        """The row before each gap (G,), and the number of rows that are missing in it (G,)."""
        return self.compute_once("gaps", lambda: find_gaps(self.log.time))

    @property
    def rows_after_gaps(self) -> np.ndarray:
        """Mask (T,) of the rows that come after a gap."""
        rows = np.zeros(len(self.log), bool)
        rows[self.gaps[0] + 1] = True
        return rows

    @property
    def lags(self) -> dict[str, Lag]:
        """Lags of measured inputs behind their commands, by the measured channel's name."""
        return self.compute_once("lags", lambda: estimate_lags(self.log))

    @property
    def grid(self) -> UniformGrid:
        """Even instants (K) over the log."""
        return self.compute_once("grid", lambda: make_uniform_grid(self.log.time))

    def measure_channel(self, name: str) -> ChannelStatistics:
        """Compute the statistics of a channel.

        Args:
            name: of the channel.

        Returns:
            The statistics.

        """
        return self.compute_once(("channel", name), lambda: compute_channel_statistics(name, self.log[name]))

    def smooth_channel(self, name: str) -> np.ndarray:
        """Smooth a channel on the even grid.

        Args:
            name: of the channel.

        Returns:
            Smoothed samples (K,).

        """
        return self.compute_once(("smooth", name), lambda: self.grid.smooth(self.log[name]))

    def sample_channel(self, name: str) -> np.ndarray:
        """Sample a channel as the terms of the fits are: smoothed, with one row a window.

        Args:
            name: of the channel.

        Returns:
            Values (rows,) that are about independent.

        """
        return self.smooth_channel(name)[:: self.grid.window_rows]

    def smooth_motion(self, ratios: Sequence[float], joints: Sequence[int]) -> SmoothedMotion:
        """Smooth the motion of joints, from the joint's encoder or, without one, the motor's.

        Args:
            ratios: of the gears, one a joint.
            joints: numbers of the joints that count.

        Returns:
            The motion of those among them that move.

        """
        key = ("motion", tuple(ratios), tuple(joints))
        return self.compute_once(key, lambda: self._smooth_motion(ratios, joints))

    def _smooth_motion(self, ratios: Sequence[float], joints: Sequence[int]) -> SmoothedMotion:
        used, positions = [], []
        for joint in joints:
            for name, scale in ((f"joint_position_{joint}", 1.0), (f"motor_position_{joint}", 1 / ratios[joint - 1])):
                if name in self.channels and self.channels[name].is_moving:
                    used.append(joint)
                    positions.append(scale * self.smooth_channel(name))
                    break
        velocities = [self.grid.differentiate(position) for position in positions]
        accelerations = [self.grid.differentiate(velocity) for velocity in velocities]
        return SmoothedMotion(
            self.grid, tuple(used), np.array(positions), np.array(velocities), np.array(accelerations)
        )

    def list_sound_joints(self, *names: str) -> list[int]:
        """List the joints without a finding that refuses the log.

        Args:
            names: of the findings that count.

        Returns:
            Numbers of the joints, from 1.

        """
        refused = [finding for finding in self.findings if finding.severity is Severity.REFUSE]
        spoilt = {finding.joint for finding in refused if finding.name in names}
        return [joint for joint in range(1, self.log.n_joints + 1) if joint not in spoilt]

    def with_findings(self, findings: Sequence[Finding]) -> LogProfile:
        """Take further findings into account.

        Args:
            findings: of a check.

        Returns:
            The profile with these findings after its own; what has been computed is not computed again.

        """
        return replace(self, findings=(*self.findings, *findings))

    def compute_once(self, key: Hashable, compute: Callable[[], Computed]) -> Computed:
        """Compute a part of the profile unless it has been computed.

        Args:
            key: of the part.
            compute: returns the part.

        Returns:
            The part.

        """
        if key not in self._computed:
            self._computed[key] = compute()
        return self._computed[key]
