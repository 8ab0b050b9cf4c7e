"""The profile of a log: each part is computed once, and every check sees the findings of those before it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality import log_profile, log_triage
from hdagen.data_quality.finding import Finding, RobotFacts, Severity
from hdagen.data_quality.log_profile import LogProfile
from hdagen.data_quality.log_repair import repair_log
from hdagen.log.channel_statistics import ChannelStatistics, compute_channel_statistics
from hdagen.log.measured_log import Log


def test_no_statistic_of_a_sound_log_is_computed_twice(good: Log, arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    computed: Counter[str] = Counter()

    def count(name: str, values: np.ndarray) -> ChannelStatistics:
        computed[name] += 1
        return compute_channel_statistics(name, values)

    monkeypatch.setattr(log_profile, "compute_channel_statistics", count)
    repair_log(good, arm)
    assert computed == Counter(list(good.columns))


def test_findings_are_added_and_what_was_computed_is_kept(good: Log) -> None:
    profile = LogProfile(good)
    motion = profile.smooth_motion((100.0, 100.0), [1, 2])
    refused = Finding(Severity.REFUSE, "wrapped", 1, "it wraps.")
    warned = Finding(Severity.WARN, "wrapped", 2, "it may wrap.")
    later = profile.with_findings([refused]).with_findings([warned])
    assert later.findings == (refused, warned) and profile.findings == ()
    assert later.list_sound_joints("wrapped") == [2] and later.list_sound_joints("jump") == [1, 2]
    assert later.smooth_motion((100.0, 100.0), [1, 2]) is motion
    assert later.smooth_motion((100.0, 100.0), [2]).joints == (2,)
    np.testing.assert_array_equal(motion.position[0], profile.grid.smooth(good["joint_position_1"]))


def test_a_check_that_is_added_is_asked_with_the_findings_before_it(
    good: Log, arm: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def check_name(profile: LogProfile, robot: RobotFacts, model: Arm | None) -> list[Finding]:
        seen.append(profile.findings)
        return [Finding(Severity.NOTE, "named", 2, f"{profile.log.source}, {robot.ratios[1]:g}, {model}.")]

    monkeypatch.setattr(log_triage, "CHECKS", (*log_triage.CHECKS, check_name))
    found = log_triage.triage_for_robot(good, arm.robot).findings
    (own,) = (finding for finding in found if finding.name == "named")
    assert sorted(map(str, seen[0])) == sorted(str(finding) for finding in found if finding is not own)


def test_a_robot_of_other_joints_is_refused(good: Log) -> None:
    with pytest.raises(ValueError, match="the log has 2 joints"):
        log_triage.examine_log(LogProfile(good), RobotFacts((1.0,), {}, (None,), (None,), (False,)))
