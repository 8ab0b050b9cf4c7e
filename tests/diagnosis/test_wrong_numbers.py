"""Numbers of the robot file that are wrong: put into a simulated machine they come back, with their factor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import wrist

from hdagen import diagnose
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.judged_search import JudgedSearch

ROBOT = wrist.ROBOT.replace("step = 1e-3", "step = 1e-3\ntolerance = 0.1")


def find_factors(found: Diagnosis) -> dict[str, tuple[float, float]]:
    """Factor and standard deviation of each number in the verdict."""
    causes: dict[str, Any] = {f"{c['effect']}@{c['joint']}": c["parameters"] for c in found.content["causes"]}
    return {
        name: (causes[name]["factor"]["value"], causes[name]["factor"]["std"])
        for name in found.verdict
        if "factor" in causes[name]
    }


@pytest.mark.parametrize(
    ("stated", "truth"),
    [
        ("inertia_about_joint = 0.045", {}),  # a point mass, whose inertia about itself is 0 up to rounding
        ("inertia = 0.03", {"inertia_1": 2.5}),
    ],
    ids=["right", "inertia"],
)
def test_a_wrong_number_comes_back_and_a_right_one_stays(
    tmp_path: Path, stated: str, truth: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the second search, as if the first had left many times the noise."""
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT.replace("inertia = 0.03", stated))
    monkeypatch.setattr(JudgedSearch, "is_file_in_doubt", True)
    found = diagnose(robot, [wrist.move_wrist(robot, truth, 6.0)])
    factors = find_factors(found)
    assert sorted(factors) == sorted(found.verdict)
    assert sorted(name.replace("@", "_") for name in factors) == sorted(truth)
    for name, (factor, std) in factors.items():
        assert abs(factor - truth[name.replace("@", "_")]) < max(0.02 * factor, 3.0 * std)
