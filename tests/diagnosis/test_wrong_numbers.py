"""Numbers of the robot file that are wrong: put into a simulated machine they come back, with their factor."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
import wrist

from hdagen import adopt, diagnose
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.judged_search import JudgedSearch
from hdagen.diagnosis.report.effect_words import say_effect

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


def test_a_rotor_that_the_file_lacks_is_found_and_adopted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a URDF; an inertia of the link would have to be ten times the file's to do the same."""
    robot = tmp_path / "robot.toml"
    robot.write_text(ROBOT.replace("inertia = 0.03", "inertia = 0.004"))
    monkeypatch.setattr(JudgedSearch, "is_file_in_doubt", True)
    found = diagnose(robot, [wrist.move_wrist(robot, {}, 6.0, rotor=0.035)])
    assert found.verdict == ("motor_inertia@1",) and "factor" not in found.content["causes"][0]["parameters"]
    said = found.content["causes"][0]["parameters"]["motor_inertia"]
    assert abs(said["value"] - 0.035) < max(7e-4, 3.0 * said["std"])
    assert say_effect("motor_inertia@1", found.content).startswith("motor inertia on joint 1 is missing in the model (")
    adopt(found.content, robot, out=tmp_path / "new.toml")
    drive = tomllib.loads((tmp_path / "new.toml").read_text())["joint"][0]["drive"]
    assert drive["motor_inertia"] == pytest.approx(0.035, rel=0.05)
