"""Arms in space: MuJoCo has friction that the robot file lacks; it is named at its joint, adopted, and on the page."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import space_robots

import hdagen
from hdagen.__main__ import main
from hdagen.log.measured_log import write

mujoco = pytest.importorskip("mujoco", reason="MuJoCo makes the logs: pip install 'hdagen[mujoco]'")

from hdagen.blind.realities.model_arms import ModelRobot, draw_space_motion  # noqa: E402
from hdagen.blind.realities.model_effects import Values  # noqa: E402
from hdagen.blind.realities.model_reality import simulate_space_arm  # noqa: E402

LIMITS = "\n[joint.limits]\nposition = [-2.0, 2.0]\nspeed = 3.0\ntorque = 20.0\n"
TEXT = re.sub(  # as `hdagen robot import` writes it: no rotor, damping a guess
    r"viscous_friction = (\S+)",
    r'viscous_friction = {value = \1, source = "guess"}',
    re.sub(r"motor_inertia = \S+", "motor_inertia = 0.0", space_robots.chain("RR", 3)),
).replace("coulomb_friction = 0.0", f"coulomb_friction = 0.0{LIMITS}")
FRICTION = 1.0  # N m


def make_log(text: str, seconds: float, effects: dict[tuple[str, int], Values]) -> dict[str, np.ndarray]:
    """A log of an arm whose links are those of its file."""
    table, rng = ModelRobot(text).table, np.random.default_rng(5)
    return simulate_space_arm(table, table, draw_space_motion(rng, table, seconds), rng, effects)


def test_friction_in_space_is_named_adopted_and_drawn(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(ModelRobot(TEXT).toml())
    log = make_log(TEXT, 8.0, {("coulomb_friction", 2): {"torque": FRICTION}})
    named = {re.sub(r"_(\d)$", r"_axis_\1", name): values for name, values in log.items()}
    found = hdagen.diagnose(robot, named)
    assert found.verdict == ("coulomb_friction@2",) and found.sure
    assert found.gap["after"] < 2.0 < 0.1 * found.gap["before"]
    cause = next(one for one in found.content["causes"] if (one["effect"], one["joint"]) == ("coulomb_friction", 2))
    assert cause["parameters"]["coulomb_friction"]["value"] == pytest.approx(FRICTION, rel=0.03)
    assert found.content["joints"] == ["axis_1", "axis_2"] and "before" in found.content["control"]["tracking"]
    found.save(tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert 'data-kind="space_arm"' in page and "Coulomb friction on axis_2 (2)" in page

    stated = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    stated["verdict"] = ["coulomb_friction@axis_2"]  # a name is as good as a number
    changed = hdagen.adopt(stated, robot, out=tmp_path / "new.toml")
    assert "joint[2].drive.coulomb_friction" in {change.where for change in changed.changes}
    new, old = (tomllib.loads(path.read_text()) for path in (tmp_path / "new.toml", robot))
    assert new["joint"][1]["drive"]["coulomb_friction"] == pytest.approx(FRICTION, rel=0.03)
    assert [joint["origin"] for joint in new["joint"]] == [joint["origin"] for joint in old["joint"]]
    assert hdagen.replay(tmp_path / "new.toml", log).gap < 0.1 * hdagen.replay(robot, log).gap


@pytest.mark.campaign
@pytest.mark.parametrize("joint", [1, 4])
def test_friction_of_a_panda_is_named(joint: int, tmp_path: Path) -> None:
    """6 N m of Coulomb friction, from a URDF and a log by joint names."""
    from hdagen.model_import.robot_writing import import_model

    shared = Path(pytest.importorskip("cmeel").__file__).parents[1] / "cmeel.prefix" / "share"
    model = shared / "example-robot-data" / "robots" / "panda_description" / "urdf" / "panda.urdf"
    if not model.is_file():
        pytest.skip("example-robot-data is not installed, which has a Panda")
    text = import_model(str(model)).text
    log = make_log(text, 20.0, {("coulomb_friction", joint): {"torque": 6.0}})
    write(log, tmp_path / "log.parquet")
    assert main(["diagnose", str(model), str(tmp_path / "log.parquet"), "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["verdict"] == [f"coulomb_friction@{joint}"] and found["sure"]
    cause = next(one for one in found["causes"] if (one["effect"], one["joint"]) == ("coulomb_friction", joint))
    assert cause["parameters"]["coulomb_friction"]["value"] == pytest.approx(6.0, rel=0.03)
    assert f"panda_joint{joint} ({joint})" in (tmp_path / "out" / "report.html").read_text()
