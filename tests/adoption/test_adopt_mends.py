"""What a fit finds the new file holds: adopt mends step, smoothing and rounding, and does not refuse for them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import arms
import pytest
from replayed import SENSORS, diagnosis, simulated
from uncompiled import load_uncompiled

from hdagen.__main__ import main
from hdagen.adoption.robot_identity import compute_robot_identity
from hdagen.adoption.robot_update import AdoptedRobot, adopt
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.held_out_rows import name_rows
from hdagen.diagnosis.data.split import split_logs
from hdagen.log.measured_log import write
from hdagen.prediction.window_replay import replay

AT_JOINT_SCALE = arms.arm("R", rigid="r").replace("ratio = 20.0", "ratio = 1.0").replace("step = 0.0005\n", "")


@pytest.fixture(autouse=True)
def builds(build: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    """All builds of a session lie in one folder."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(arms.SMALL).folder.parent))


def adopted(folder: Path, text: str, stated: dict) -> AdoptedRobot:
    (folder / "robot.toml").write_text(text)
    (folder / "diagnosis.json").write_text(json.dumps(stated))
    return adopt(folder / "diagnosis.json", folder / "robot.toml", folder / "new.toml", force=True)


def named(entry: str, base: dict | None = None, **values: float) -> dict:
    """A diagnosis that names one effect."""
    effect, _, joint = entry.partition("@")
    cause = {"effect": effect, "joint": int(joint), "parameters": {k: {"value": v} for k, v in values.items()}}
    return diagnosis(verdict=[entry], causes=[cause], parameters=base or {})


@pytest.mark.usefixtures("uncompiled")
def test_friction_that_its_smoothing_does_not_carry_gets_a_wider_one(tmp_path: Path) -> None:
    text = AT_JOINT_SCALE.replace("coulomb_friction = 0.03", "coulomb_friction = 1.0").replace("0.00013", "0.1")
    found = adopted(tmp_path, text + "friction_smoothing = 0.02\n", named("coulomb_friction@1", coulomb_friction=20.0))
    changes = {change.where: change for change in found.changes}
    smoothing = changes["joint[1].drive.friction_smoothing"]
    assert smoothing.before == 0.02 and smoothing.after > 0.02
    assert any("friction_smoothing: 0.02 rad/s does not carry the corrected model" in note for note in found.notes)
    new = load_uncompiled(tmp_path / "new.toml")
    assert new.parameters["coulomb_friction_1"] == 20.0
    assert new.parameters["friction_smoothing_1"] == pytest.approx(smoothing.after)


@pytest.mark.usefixtures("uncompiled")
def test_smoothing_that_the_file_leaves_open_is_said_to_widen(tmp_path: Path) -> None:
    text = AT_JOINT_SCALE.replace("coulomb_friction = 0.03", "coulomb_friction = 1.0").replace("0.00013", "0.1")
    found = adopted(tmp_path, text, named("coulomb_friction@1", coulomb_friction=20.0))
    assert "friction_smoothing" not in found.text
    said = [note for note in found.notes if "friction_smoothing: left open, and widens from" in note]
    assert len(said) == 1
    unchanged = adopted(tmp_path, text, named("current_bias@1", bias=0.01))
    assert not any("friction_smoothing" in note for note in unchanged.notes)


@pytest.mark.usefixtures("uncompiled")
def test_damping_that_its_step_does_not_carry_gets_a_smaller_one(tmp_path: Path) -> None:
    text = "# base\n" + arms.arm("R").replace("step = 0.0005\n", "").replace("damping = 6.0", "damping = 60.0")
    found = adopted(tmp_path, text, named("joint_damping@1", torsional_damping=1000.0))
    step = next(change for change in found.changes if change.where == "step")
    assert step.before == 5e-4 and step.after < 5e-4
    lines = found.text.splitlines()
    assert lines[lines.index("gravity = [0.0, -9.81]") + 1] == f"step = {step.after} # s"
    assert load_uncompiled(tmp_path / "new.toml").step_size == step.after
    assert any(line.startswith("+step = ") for line in found.difference)


@pytest.mark.usefixtures("uncompiled")
def test_a_step_that_does_what_a_refusal_says_leaves_the_robot_the_one_that_was_diagnosed(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(arms.SMALL)
    own = load_uncompiled(tmp_path / "robot.toml").robot
    stated = named("current_bias@1", bias=0.02) | {
        "robot": {"name": own["name"], "identity": compute_robot_identity(own), "sha256": "0" * 64}
    }
    other = "# by hand\n" + arms.SMALL.replace("step = 0.0005", "step = 0.0002")
    assert [change.after for change in adopted(tmp_path, other, stated).changes] == [0.02]
    with pytest.raises(PlantError, match="has another number or tolerance"):
        adopted(tmp_path, arms.SMALL.replace("mass = 4.5", "mass = 4.6"), stated)


@pytest.mark.usefixtures("uncompiled")
@pytest.mark.parametrize(("beyond", "said"), [(-2e-10, False), (-5.0, True)])
def test_what_lies_beyond_an_end_of_its_range_is_taken_there(beyond: float, said: bool, tmp_path: Path) -> None:
    least = load_uncompiled(_written(tmp_path)).parameters.described["mass_1"].low
    base = {"mass_1": {"value": least * (1 + beyond), "std": 1e-3}}
    text = arms.SMALL.replace("mass = 4.5", "mass = {value = 4.5, tolerance = 0.5}")
    found = adopted(tmp_path, text, named("payload@1", base, payload_mass=-1e-12 if not said else beyond))
    changes = {change.where: change.after for change in found.changes}
    assert changes["joint[1].mass"] == pytest.approx(least) and changes["payload@1.payload_mass"] == 0.0
    assert any("is not within" in note for note in found.notes) == said


def _written(folder: Path) -> Path:
    (folder / "robot.toml").write_text(arms.SMALL)
    return folder / "robot.toml"


@pytest.mark.usefixtures("uncompiled")
def test_a_parameter_of_which_the_log_told_nothing_keeps_its_number(tmp_path: Path) -> None:
    prior = 0.05 * 4.5
    said = {"value": 4.5 + 0.05 * prior, "std": 0.97 * prior, "unit": "kg"}
    told = {  # a width that shrank, or a number that moved together with others
        "inertia_1": {"value": 0.0802, "std": 0.5 * 0.05 * 0.08},
        "center_of_mass_1": {"value": 0.12 * (1 + 0.05 * 0.8), "std": 0.95 * 0.05 * 0.12},
    }
    found = adopted(tmp_path, arms.SMALL, diagnosis(verdict=[], parameters={"mass_1": said} | told))
    assert {change.where for change in found.changes} == {"joint[1].inertia", "joint[1].center_of_mass"}
    assert tomllib.loads(found.text)["joint"][0]["mass"] == 4.5


@pytest.mark.usefixtures("uncompiled")
def test_a_spring_goes_into_the_joint_that_it_was_found_in_and_no_other(tmp_path: Path) -> None:
    text = arms.arm("RR", rigid="rr", drive="friction_smoothing = 1.0")
    stated = named("missing_compliance@2", missing_compliance=2e-4, missing_damping=3.0)
    assert len(adopted(tmp_path, text, stated).changes) == 2
    new = load_uncompiled(tmp_path / "new.toml")
    assert new.manifest["flexible"] == [2]
    assert new.parameters["missing_compliance_2"] == 2e-4 and "missing_compliance_1" not in new.parameters


def test_a_dry_run_writes_nothing_and_shows_the_difference(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    _written(tmp_path)
    (tmp_path / "diagnosis.json").write_text(json.dumps(named("current_bias@1", {"mass_1": 4.6}, bias=0.02)))
    given = ["adopt", str(tmp_path / "diagnosis.json"), str(tmp_path / "robot.toml"), "--dry-run"]
    assert main(given) == 0
    shown = capsys.readouterr().out
    assert "-mass = 4.5\n" in shown and "+mass = 4.6\n" in shown and "+bias = 0.02 # N m" in shown
    assert main([*given, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["out"] is None and "+mass = 4.6" in said["difference"]
    mass = next(change for change in said["changes"] if change["where"] == "joint[1].mass")
    assert (mass["before"], mass["after"], mass["unit"]) == (4.5, 4.6, "kg")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagnosis.json", "robot.toml"]


TRUTHS = {
    "an effect": ({"presliding_share_1": 0.8, "presliding_angle_1": 0.02}, "presliding_friction@1"),
    "a friction": ({"coulomb_friction_1": 0.06}, "coulomb_friction@1"),
    "a base parameter": ({"mass_1": 4.8}, None),
}


@pytest.mark.parametrize("which", TRUTHS)
def test_the_adopted_file_leaves_the_gap_that_the_diagnosis_said(
    which: str, build: Callable, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    drive = f"friction_smoothing = 1.0\n{SENSORS}\n[joint.limits]\ntorque = 30.0"
    text = arms.arm("R", rigid="r", drive=drive)
    truth, entry = TRUTHS[which]
    arm = Arm(build(text, effects=("presliding_friction",)).folder)
    arm.parameters.update(truth)
    log = replace(simulated(arm, 3.0), source=str(tmp_path / "log.csv"))
    write(log, tmp_path / "log.csv")
    (tmp_path / "robot.toml").write_text(text)
    values = {name.removesuffix("_1"): value for name, value in truth.items()}
    base = {"mass_1": {"value": 4.8, "std": 0.01}, "inertia_1": {"value": 0.0801, "std": 0.95 * 0.05 * 0.08}}
    stated = diagnosis(verdict=[], parameters=base) if entry is None else named(entry, None, **values)
    stated |= {"robot": {"name": arm.robot["name"], "identity": compute_robot_identity(arm.robot), "sha256": None}}
    arm.parameters.reset()
    held = split_logs([log], [])[1]
    told = evaluate_gap(replay(arm, log), replay(arm, log, with_=stated), held)
    stated |= {"gap": told, "data": {"hold_out": name_rows(held, [log])}}
    (tmp_path / "diagnosis.json").write_text(json.dumps(stated))
    (tmp_path / "robot.toml").write_text("# weighed again\n" + text.replace("step = 0.0005", "step = 0.0004"))
    paths = {name: str(tmp_path / name) for name in ("diagnosis.json", "robot.toml", "new.toml", "log.csv")}
    assert main(["adopt", paths["diagnosis.json"], paths["robot.toml"], "--out", paths["new.toml"]]) == 0
    capsys.readouterr()
    counted = ["--rows-of", paths["diagnosis.json"], "--json"]
    for robot in ([paths["new.toml"]], [paths["robot.toml"], "--with", paths["diagnosis.json"]]):
        assert main(["replay", robot[0], paths["log.csv"], *robot[1:], *counted]) == 0
        assert json.loads(capsys.readouterr().out)["gap"] == pytest.approx(told["after"], rel=0.02)
    assert told["after"] < 0.8 * told["before"]
