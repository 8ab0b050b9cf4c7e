"""The leg: from a robot file, the user's MJCF and a log to a corrected MJCF that closes the gap in MuJoCo."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

import leg
import mujoco
import numpy as np
import pytest

from hdagen.__main__ import main

Export = Callable[..., tuple[int, str]]
WITH, INTO, PROVE = ("--with", "diagnosis.json"), ("--into", "leg.xml"), ("--prove", "held.parquet")
LOOP = ("--closed-loop", "controller.toml")
MOST_ERROR = 1.5e-3  # rad, held-out, in closed loop


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("leg")
    leg.write_leg(folder, (1.0, 4.0))
    return folder


@pytest.fixture
def export(files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Export:
    """export(format, *options) -> (exit code, what was printed), in a folder with copies of the leg's files, which a
    command leaves as they are."""
    for file in files.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str]:
        kept = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
        code = main(["export", *arguments])
        assert {path: path.read_bytes() for path in kept} == kept
        assert not [path for path in Path().iterdir() if ".part-" in path.name]
        said = capsys.readouterr()
        return code, said.out + "\n".join(line for line in said.err.splitlines() if not line.startswith("building"))

    return run


def refuse(export: Export, *arguments: str) -> str:
    """The one sentence of a refusal, which writes nothing."""
    code, said = export(*arguments, "--out", "new.xml")
    assert code in (2, 3) and not Path("new.xml").exists(), said
    assert said.count("\n") <= 1 and said.strip().endswith("."), said
    return said


# -- what is written --------------------------------------------------------------------------------------------------


def test_the_corrected_model_closes_the_gap_in_mujoco(export: Export) -> None:
    code, said = export("mjcf", "leg.toml", *WITH, *INTO, *PROVE, *LOOP, "--out", "new.xml", "--json")
    proof = json.loads(said)["proof"]
    assert code == 0
    before = max(one["mujoco_before"] for one in proof["channels"])
    after = max(one["mujoco_after"] for one in proof["channels"])
    assert before > 5e-3 and after <= MOST_ERROR
    assert proof["closed_share"] > 0.9


def test_only_the_named_attributes_change(export: Export) -> None:
    """Comments, order, quotes and blanks stay; MuJoCo then has the numbers of the diagnosis, defaults included."""
    code, said = export("mjcf", "leg.toml", *WITH, *INTO, "--out", "new.xml")
    assert code == 0 and "hip.armature" in said and "solreffriction" in said
    added = r' (armature|damping|delay|nsample|interp)="[^"]*"|frictionloss="[^"]*"'
    old, new = Path("leg.xml").read_text(), Path("new.xml").read_text()
    assert re.sub(added, "", new) == re.sub(added, "", old)
    assert new.splitlines()[1] == old.splitlines()[1]
    model = mujoco.MjModel.from_xml_path("new.xml")
    assert model.dof_armature == pytest.approx(leg.TRUE["armature"])
    assert model.dof_damping == pytest.approx(leg.TRUE["damping"])
    assert model.dof_frictionloss == pytest.approx(leg.TRUE["frictionloss"])
    assert model.actuator_delay == pytest.approx([leg.DELAY] * 2)


def test_nothing_changes_without_a_diagnosis(export: Export) -> None:
    assert export("mjcf", "leg.toml", *INTO, "--out", "new.xml")[0] == 0
    assert Path("new.xml").read_bytes() == Path("leg.xml").read_bytes()


def test_joints_are_found_by_the_names_that_are_given(export: Export) -> None:
    assert export("mjcf", "leg.toml", *WITH, *INTO, "--joints", "knee, hip", "--out", "new.xml")[0] == 0
    model = mujoco.MjModel.from_xml_path("new.xml")
    assert model.dof_armature == pytest.approx(leg.TRUE["armature"][::-1])


def test_a_motor_takes_gain_lag_limit_and_bias(export: Export) -> None:
    """A <motor> becomes the <general> that it stands for."""
    content = {"schema": 2, "verdict": ["torque_constant@1", "current_loop_lag@1", "current_bias@1"], "causes": []}
    values = {"torque_constant": {"torque_gain": 1.2}, "current_loop_lag": {"current_lag": 0.004}}
    values |= {"current_bias": {"bias": 0.3}, "current_saturation": {"saturation_inverse": 0.1}}
    content["verdict"] = [f"{effect}@1" for effect in values]
    content["causes"] = [
        {"effect": effect, "joint": 1, "parameters": {key: {"value": number} for key, number in parameters.items()}}
        for effect, parameters in values.items()
    ]
    Path("motor.json").write_text(json.dumps(content))
    code, said = export("mjcf", "leg.toml", "--with", "motor.json", *INTO, "--out", "new.xml")
    assert code == 0, said
    model = mujoco.MjModel.from_xml_path("new.xml")
    assert model.actuator_gainprm[:, 0] == pytest.approx([1.2, 1.0])
    assert model.actuator_biasprm[0, 0] == pytest.approx(0.3)
    assert model.actuator_ctrlrange[0] == pytest.approx([-10, 10]) and model.actuator_ctrlrange[1, 1] == 25
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    for _ in range(4):
        mujoco.mj_step(model, data)
    assert data.act[0] == pytest.approx(1 - np.exp(-1.0), rel=1e-6)


def test_json_has_the_numbers_by_joint_name_and_draws_of_them(export: Export) -> None:
    code, _ = export("json", "leg.toml", *WITH, "--joints", "hip,knee", "--samples", "200", "--out", "leg.json")
    content = json.loads(Path("leg.json").read_text(encoding="utf-8"))
    assert code == 0
    hip = content["joints"]["hip"]
    assert (hip["armature"], hip["damping"], hip["frictionloss"]) == pytest.approx((0.013, 0.25, 0.25))
    assert hip["delay"] == leg.DELAY and {"mujoco", "isaac_lab", "pybullet"} <= set(content["conventions"])
    drawn = [sample["joints"]["hip"]["frictionloss"] for sample in content["samples"]]
    assert np.mean(drawn) == pytest.approx(0.25, abs=0.001) and np.std(drawn) == pytest.approx(0.0025, rel=0.3)
    late = [sample["joints"]["knee"]["delay"] > 0 for sample in content["samples"]]
    assert 0.8 < np.mean(late) < 0.97  # the set without that delay has a probability of a tenth


def test_urdf_says_what_it_does_not_hold(export: Export) -> None:
    code, said = export("urdf", "leg.toml", *WITH, "--out", "leg.urdf")
    assert code == 0 and "hip.delay" in said and "reflected inertia" in said
    model = mujoco.MjModel.from_xml_path("leg.urdf")
    assert model.dof_frictionloss == pytest.approx(leg.TRUE["frictionloss"])


# -- bad input: one sentence, and every file as it was ----------------------------------------------------------------


def test_a_model_with_other_numbers_is_refused(export: Export) -> None:
    text = Path("leg.xml").read_text()
    Path("leg.xml").write_text(text.replace('frictionloss="0.05"', 'frictionloss="0.07"', 1))
    said = refuse(export, "mjcf", "leg.toml", *WITH, *INTO)
    assert "has changed since the diagnosis" in said and "frictionloss" in said
    Path("leg.xml").write_text(text.replace("<!-- The leg", "<!-- My leg"))  # another comment is the same model
    assert export("mjcf", "leg.toml", *WITH, *INTO, "--out", "new.xml")[0] == 0


@pytest.mark.parametrize(
    "change, expected",
    [
        (('name="hip" class', 'name="hüfte" class'), "MuJoCo cannot load it"),
        (("<mujoco ", "<!DOCTYPE mujoco><mujoco "), "document type"),
        (("</worldbody>", ""), "cannot be read as XML"),
        (('<motor name="hip_motor"', '<position kp="9" name="hip_motor"'), "servo"),
    ],
)
def test_a_model_that_does_not_fit_is_refused(export: Export, change: tuple[str, str], expected: str) -> None:
    Path("leg.xml").write_text(Path("leg.xml").read_text().replace(*change))
    assert expected in refuse(export, "mjcf", "leg.toml", *WITH, *INTO, *PROVE)


def test_a_joint_that_is_not_there_is_named(export: Export) -> None:
    said = refuse(export, "mjcf", "leg.toml", *WITH, *INTO, "--joints", "hip,ankle")
    assert "'ankle'" in said and "knee" in said
    assert "name each" in refuse(export, "mjcf", "leg.toml", *WITH, *INTO, "--joints", "hip")


def test_a_joint_in_an_included_file_changes_there(export: Export) -> None:
    """Under a name of its own, which the new model includes; the user's files stay."""
    text = Path("leg.xml").read_text()
    begin, end = text.index("<worldbody>"), text.index("</worldbody>") + len("</worldbody>")
    inner, outer = (
        f"<mujocoinclude>{text[begin:end]}</mujocoinclude>",
        text[:begin] + '<include file="legs.xml"/>' + text[end:],
    )
    Path("legs.xml").write_text(inner)
    Path("leg.xml").write_text(outer)
    assert export("mjcf", "leg.toml", *WITH, *INTO, "--out", "new.xml")[0] == 0
    assert (Path("legs.xml").read_text(), Path("leg.xml").read_text()) == (inner, outer)
    assert '<include file="legs_new.xml"/>' in Path("new.xml").read_text()
    assert mujoco.MjModel.from_xml_path("new.xml").dof_armature == pytest.approx(leg.TRUE["armature"])


def test_a_verdict_that_no_attribute_holds_is_refused(export: Export) -> None:
    cause = {"effect": "payload", "joint": 2, "parameters": {"payload_mass": {"value": 0.2}}}
    Path("payload.json").write_text(json.dumps({"schema": 2, "verdict": ["payload@2"], "causes": [cause]}))
    said = refuse(export, "mjcf", "leg.toml", "--with", "payload.json", *INTO)
    assert "nothing of the verdict" in said and "without --into" in said


def test_a_log_of_another_robot_is_refused(export: Export) -> None:
    Path("other.csv").write_text("time,motor_torque_1,joint_position_1\n0,0,0\n0.001,0,0\n0.002,0,0\n")
    assert "1 joint(s), the robot 2" in refuse(export, "mjcf", "leg.toml", *WITH, "--prove", "other.csv")


def test_a_diagnosis_of_another_robot_is_refused(export: Export) -> None:
    Path("other.json").write_text(json.dumps(leg.describe_truth("0" * 64)))
    assert "not the robot that was diagnosed" in refuse(export, "mjcf", "leg.toml", "--with", "other.json", *INTO)


def test_without_mujoco_the_extra_is_named(export: Export, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for options in (INTO, PROVE):
        assert "hdagen[mujoco]" in refuse(export, "mjcf", "leg.toml", *WITH, *options)
    assert export("mjcf", "leg.toml", *WITH, "--out", "new.xml")[0] == 0  # a whole model needs none


@pytest.mark.parametrize(
    "arguments, expected",
    [
        (("json", "leg.toml", *INTO), "--into"),
        (("mjcf", "leg.toml", "--samples", "3"), "--samples"),
        (("mjcf", "leg.toml", *LOOP), "--prove"),
        (("mjcf", "leg.toml", "--prove", "nothing.parquet"), "nothing.parquet"),
        (("mjcf", "leg.toml", *PROVE, "--closed-loop", "leg.toml"), "unknown key"),
    ],
)
def test_options_that_do_not_fit_are_refused(export: Export, arguments: tuple[str, ...], expected: str) -> None:
    out = "new.json" if arguments[0] == "json" else "new.xml"
    code, said = export(*arguments, "--out", out)
    assert code in (2, 3) and expected in said and not Path(out).exists()


def test_a_model_that_is_not_there_is_told_before_anything_is_built(
    export: Export, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hdagen.model_export.corrected_robot.load_corrected_robot", None)
    said = refuse(export, "mjcf", "leg.toml", *WITH, "--into", "nowhere.xml")
    assert "nowhere.xml" in said and "there is no such file" in said


def test_a_place_that_is_taken_or_read_only_is_refused(export: Export, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "would be lost" in export("mjcf", "leg.toml", *WITH, "--out", "leg.xml")[1]
    assert "there is no folder" in export("mjcf", "leg.toml", *WITH, "--out", "nowhere/new.xml")[1]

    def fail(*_: object) -> None:
        raise OSError(30, "Read-only file system", "new.xml")

    monkeypatch.setattr("os.replace", fail)
    assert "cannot be written" in refuse(export, "mjcf", "leg.toml", *WITH)


@pytest.mark.campaign
def test_three_commands_lead_from_the_log_to_a_proved_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing typed but names of files: diagnose, export into the user's model, proof in closed loop."""
    leg.write_leg(tmp_path, (8.0, 4.0))
    monkeypatch.chdir(tmp_path)
    found = ("--with", "diagnosis/diagnosis.json")
    assert main(["diagnose", "leg.toml", "log.parquet", "--hold-out", "held.parquet", "--out", "diagnosis"]) == 0
    assert main(["export", "mjcf", "leg.toml", *found, *INTO, "--out", "new.xml"]) == 0
    capsys.readouterr()
    last = ("--out", "proved.xml", "--json")
    assert main(["export", "mjcf", "leg.toml", *found, *INTO, *PROVE, *LOOP, *last]) == 0
    proof = json.loads(capsys.readouterr().out)["proof"]
    assert Path("proved.xml").read_bytes() == Path("new.xml").read_bytes()
    before = [one["mujoco_before"] for one in proof["channels"]]
    after = [one["mujoco_after"] for one in proof["channels"]]
    assert max(before) > 5e-3 and max(after) <= MOST_ERROR, (before, after)
