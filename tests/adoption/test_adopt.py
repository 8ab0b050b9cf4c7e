"""Adopting a diagnosis: the new robot file is the model of the replay with that diagnosis, and the old one's text."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from replayed import FLEXIBLE, MEMORY, RIGID, diagnosis, simulated, smooth
from uncompiled import load_uncompiled

from hdagen.adoption.robot_file import NumberPlace, RobotFile
from hdagen.adoption.robot_update import AdoptedRobot, adopt
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.cli import adopt as adopt_command
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay

ROOT = Path(__file__).parents[2]
BIAS = {"effect": "current_bias", "joint": 1, "parameters": {"bias": {"value": 0.02, "std": 0.004}}}
PAYLOAD = {"effect": "payload", "joint": 2, "parameters": {"payload_mass": {"value": 0.4, "std": 0.001}}}
DAHL = {
    "effect": "presliding_friction",
    "joint": 1,
    "parameters": {"presliding_share": {"value": 0.8, "std": 0.01}, "presliding_angle": {"value": 0.02}},
}
COULOMB = {"effect": "coulomb_friction", "joint": 1, "parameters": {"coulomb_friction": {"value": 0.05}}}
LUMPED = FLEXIBLE.replace("inertia = 0.08", "inertia_about_joint = 0.1448 # lumped", 1)
GEARED = arms.arm("R").replace(arms.SPRINGS, 'torsional_damping = 6.0\ncatalogue = "CSG-17-100" # the gear\n')


@pytest.fixture(autouse=True)
def builds(build: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    """All builds of a session lie in one folder."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(arms.SMALL).folder.parent))


def adopted(folder: Path, text: str, stated: dict) -> AdoptedRobot:
    """``text`` with ``stated`` adopted; robot.toml, diagnosis.json and new.toml then lie in ``folder``."""
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    (folder / "diagnosis.json").write_text(json.dumps(stated))
    return adopt(folder / "diagnosis.json", folder / "robot.toml", folder / "new.toml", force=True)


def same(folder: Path, log: Log) -> float:
    """The largest difference in any channel, in multiples of its noise, between a replay of the new file and one of the
    old file with the diagnosis."""
    stated = json.loads((folder / "diagnosis.json").read_text())
    effects = {entry.split("@")[0] for entry in stated["verdict"]}
    extra = MEMORY if effects.intersection(MEMORY) else ()  # the build of the log
    expected = replay(load(folder / "robot.toml", effects=extra), log, with_=stated)
    found = replay(load(folder / "new.toml"), log)
    assert found.errors.keys() == expected.errors.keys()
    return max(
        float(np.abs(found.columns[name] - expected.columns[name]).max()) / expected.noise[name]
        for name in found.errors
    )


@pytest.fixture(scope="module")
def log(build: Callable) -> Log:
    """A log of the flexible arm with hysteresis at joint 1 and a heavier link."""
    truth = Arm(build(FLEXIBLE, "portable", MEMORY).folder)
    truth.parameters.update({"hysteresis_torque_1": 2.0, "hysteresis_angle_1": 2e-4, "mass_1": 4.6})
    return simulated(truth, 1.0)


@pytest.mark.parametrize(
    "text, changes",
    [
        (
            FLEXIBLE,
            {
                "verdict": ["transmission_hysteresis@1", "coulomb_friction@2", "payload@2", "current_bias@1"],
                "causes": [*diagnosis()["causes"], PAYLOAD, BIAS],
                "parameters": {"mass_1": 9.0, "inertia_2": 0.051, "flexspline_stiffening_1": 0.09},
            },
        ),
        (LUMPED, {"verdict": [], "parameters": {"mass_1": 4.6, "center_of_mass_1": 0.118, "inertia_1": 0.083}}),
        (RIGID, {"verdict": [], "parameters": {"coulomb_friction_2": 0.032, "mass_2": 2.6}}),
    ],
    ids=["effects and base", "lumped inertia", "rigid"],
)
def test_the_new_file_replays_as_the_old_one_with_the_diagnosis(
    text: str, changes: dict, log: Log, build: Callable, tmp_path: Path
) -> None:
    measured = smooth(Arm(build(RIGID).folder)) if text is RIGID else log
    assert adopted(tmp_path, text, diagnosis(**changes)).changes
    assert same(tmp_path, measured) < 1e-3
    before, after = (replay(load(tmp_path / name), measured).gap for name in ("robot.toml", "new.toml"))
    assert abs(after / before - 1) > 1e-3  # and it did change the model


def test_adopting_closes_the_gap(log: Log, tmp_path: Path) -> None:
    adopted(tmp_path, FLEXIBLE, diagnosis())
    before, after = (replay(load(tmp_path / name), log).gap for name in ("robot.toml", "new.toml"))
    assert after < 0.7 * before


@pytest.mark.usefixtures("uncompiled")
def test_a_gear_that_differs_is_no_longer_the_catalogue_s(tmp_path: Path) -> None:
    changed = adopted(tmp_path, GEARED, diagnosis(verdict=[], parameters={"flexspline_stiffness_1": 1.0e4}))
    assert "began as CSG-17-100 of the catalogue" in changed.text
    old, new = (load_uncompiled(tmp_path / name) for name in ("robot.toml", "new.toml"))
    differ = {name for name, value in old.parameters.items() if new.parameters[name] != value}
    assert differ == {"flexspline_stiffness_1"} and new.parameters["flexspline_stiffness_1"] == 1.0e4
    assert new.robot["joints"][0]["drive"]["hysteresis_loss"] == 2.9e-4
    assert new.robot["joints"][0]["limits"] == old.robot["joints"][0]["limits"]
    kept = adopted(tmp_path, GEARED, diagnosis(verdict=[], parameters={"mass_1": 4.6}))
    assert 'catalogue = "CSG-17-100" # the gear' in kept.text


@pytest.mark.usefixtures("uncompiled")
def test_only_what_the_diagnosis_says_is_changed(tmp_path: Path) -> None:
    text = arms.SMALL.replace("mass = 4.5\n", "mass = {value = 4.5, tolerance = 0.1}   # weighed, with the cable\n")
    text = "# the arm in the cellar\n" + text.replace("coulomb_friction = 0.03", "coulomb_friction = 0.03\t# by hand")
    stated = diagnosis(verdict=["presliding_friction@1", "coulomb_friction@1"], causes=[COULOMB, DAHL])
    found = adopted(tmp_path, text, stated)
    old, new = text.splitlines(), found.text.splitlines()
    assert [(a, b) for a, b in zip(old, new, strict=False) if a != b] == [
        (
            "mass = {value = 4.5, tolerance = 0.1}   # weighed, with the cable",
            "mass = {value = 4.6, tolerance = 0.1}   # weighed, with the cable",
        ),
        ("coulomb_friction = 0.03\t# by hand", "coulomb_friction = 0.05\t# by hand"),
    ]
    assert [line for line in new[len(old) :] if line] == [
        "[[effect]]",
        'name = "presliding_friction"',
        "joint = 1",
        "presliding_share = 0.8",
        "presliding_angle = 0.02 # rad",
    ]
    assert [(change.where, change.before, change.after) for change in found.changes] == [
        ("joint[1].mass", 4.5, 4.6),
        ("joint[1].drive.coulomb_friction", 0.03, 0.05),
        ("presliding_friction@1.presliding_share", None, 0.8),
        ("presliding_friction@1.presliding_angle", None, 0.02),
    ]


@pytest.mark.usefixtures("uncompiled")
def test_line_ends_marks_and_odd_spellings_are_kept(tmp_path: Path) -> None:
    text = arms.SMALL.replace(
        "gravity = [0.0, -9.81]", "gravity = [\n  0.0,  # x\n  {value = -9.81, tolerance = 0.01},\n]"
    )
    (tmp_path / "robot.toml").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").rstrip().encode())
    stated = diagnosis(verdict=[], parameters={"gravity_y": {"value": -9.7}})
    (tmp_path / "diagnosis.json").write_text(json.dumps(stated))
    adopt(tmp_path / "diagnosis.json", tmp_path / "robot.toml", tmp_path / "new.toml")
    raw = (tmp_path / "new.toml").read_bytes()
    assert raw.startswith(b"\xef\xbb\xbf") and b"{value = -9.7, tolerance = 0.01},\r\n" in raw
    assert raw.count(b"\n") == raw.count(b"\r\n") and b"  0.0,  # x\r\n" in raw
    assert load_uncompiled(tmp_path / "new.toml").parameters["gravity_y"] == -9.7


@pytest.mark.usefixtures("uncompiled")
def test_an_effect_that_is_little_known_keeps_its_width_and_one_that_is_there_is_changed(tmp_path: Path) -> None:
    stated = diagnosis(verdict=["current_bias@1", "payload@1"], causes=[BIAS, {**PAYLOAD, "joint": 1}], parameters={})
    first = adopted(tmp_path, arms.SMALL, stated)
    assert "bias = {value = 0.02, tolerance = 0.2} # N m" in first.text  # std 0.004 is beyond the file's 5 %
    assert "payload_mass = 0.4 # kg" in first.text
    again = {**BIAS, "parameters": {"bias": {"value": 0.03, "std": 0.004}}}
    second = adopted(tmp_path, first.text, diagnosis(verdict=["current_bias@1"], causes=[again], parameters={}))
    assert "bias = {value = 0.03, tolerance = 0.2} # N m" in second.text
    assert [(change.before, change.after) for change in second.changes] == [(0.02, 0.03)]
    assert len(tomllib.loads(second.text)["effect"]) == 2


@pytest.mark.usefixtures("uncompiled")
def test_what_is_beyond_the_tolerance_and_what_is_unknown_is_said(tmp_path: Path) -> None:
    found = adopted(tmp_path, arms.SMALL, diagnosis(verdict=["unknown@1"], parameters={"mass_1": {"value": 9.0}}))
    assert found.changes[0].after == pytest.approx(4.5 * 1.15)
    assert any(note.startswith("unknown@1") and "nothing is adopted for it" in note for note in found.notes)
    assert any(note.startswith("mass_1") and "beyond 3 times" in note for note in found.notes)
    nothing = adopted(tmp_path, arms.SMALL, diagnosis(verdict=["unknown@1"], parameters={}))
    assert nothing.changes == () and "changes nothing" in nothing.notes[-1]
    assert (tmp_path / "new.toml").read_text() == arms.SMALL


def small(**changes: object) -> dict:
    """A diagnosis of the robot of one joint."""
    return diagnosis(**{"verdict": ["presliding_friction@1"], "causes": [DAHL]} | changes)


ROBOT = {"name": "test arm", "sha256": hashlib.sha256(arms.SMALL.encode()).hexdigest()}


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"robot": {**ROBOT, "name": "another arm"}}, "is of the robot 'another arm'"),
        ({"robot": {**ROBOT, "sha256": "0" * 64}}, "knows its robot file by its bytes alone"),
        ({"robot": {**ROBOT, "sha256": "0" * 64, "identity": "0" * 64}}, "has changed since"),
        ({"robot": "test arm"}, "an object with name and sha256"),
        ({"schema": 3}, "schema is 3"),
        ({"parameters": {"mass_1": {"value": math.inf}}}, "possible is a finite number"),
        ({"parameters": {"mass_1": {"value": math.nan}}}, "possible is a finite number"),
        ({"parameters": {"mass_3": 1.0}}, "no parameter mass_3"),
        ({"verdict": ["coulomb_friction@1"], "causes": []}, "no parameters here"),
        ({"verdict": ["unknown@3"]}, "of another robot"),
        (
            {"verdict": ["no_such@1"], "causes": [{"effect": "no_such", "joint": 1, "parameters": {"x": 1.0}}]},
            "no_such",
        ),
    ],
)
def test_a_diagnosis_that_does_not_fit_changes_nothing(changes: dict, words: str, tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=re.escape(words)):
        adopted(tmp_path, arms.SMALL, small(**changes))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagnosis.json", "robot.toml"]
    assert (tmp_path / "robot.toml").read_text() == arms.SMALL


@pytest.mark.usefixtures("uncompiled")
@pytest.mark.parametrize("robot", [ROBOT, {**ROBOT, "identity": "0" * 64}], ids=["bytes alone", "hashed otherwise"])
def test_the_robot_that_was_diagnosed_is_accepted(robot: dict, tmp_path: Path) -> None:
    """Its bytes alone tell it, also where an older version made another hash of its numbers."""
    assert adopted(tmp_path, arms.SMALL, small(robot=robot)).changes


def test_a_file_that_no_model_can_be_built_from_is_never_put_in_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RobotFile, "to_bytes", lambda self: arms.SMALL.replace("mass", "mess").encode())
    with pytest.raises(PlantError, match=r"new\.toml: no model can be built") as raised:
        adopted(tmp_path, arms.SMALL, small())
    assert "mess" in str(raised.value)
    monkeypatch.setattr(RobotFile, "to_bytes", lambda self: arms.SMALL.encode())
    with pytest.raises(PlantError, match=r"mass_1 is 4\.5 and should be 4\.6"):
        adopted(tmp_path, arms.SMALL, small(verdict=[]))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagnosis.json", "robot.toml"]


@pytest.fixture
def command() -> Callable[..., int]:
    """command(*arguments) -> exit code of `hdagen adopt`; a refusal is printed."""

    def run(*arguments: str | Path) -> int:
        parser = argparse.ArgumentParser()
        adopt_command.add_parser(parser.add_subparsers())
        try:
            return adopt_command.run(parser.parse_args(["adopt", *map(str, arguments)]))
        except PlantError as error:
            print(error)
            return 2

    return run


def test_the_command_writes_prints_and_keeps_what_is_there(
    command: Callable, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    robot, stated, out = (tmp_path / name for name in ("robot.toml", "diagnosis.json", "new.toml"))
    robot.write_text(arms.SMALL)
    stated.write_text(json.dumps(small()))
    assert command(stated, robot, "--out", out) == 0
    shown = capsys.readouterr().out
    for words in ("joint[1]\n", "  mass ", "presliding_friction@1\n", "  presliding_share ", "written:"):
        assert words in re.sub(" +\n", "\n", shown)
    assert "…" not in shown  # every number is whole
    for arguments, words in (
        ((stated, robot, "--out", robot), "is there already"),
        ((stated, robot, "--out", out), "is there already"),
        ((stated, robot, "--out", tmp_path / "new.json"), "possible is .toml"),
        ((stated, robot, "--out", tmp_path / "none" / "new.toml"), "there is no folder"),
        ((stated, tmp_path / "absent.toml", "--out", tmp_path / "b.toml"), "there is no such file"),
        ((tmp_path / "absent.json", robot, "--out", tmp_path / "b.toml"), "cannot be read"),
    ):
        assert command(*arguments) == 2, arguments
        assert words in capsys.readouterr().out
    assert robot.read_text() == arms.SMALL
    new = out.read_bytes()
    assert command(stated, robot, "--out", robot, "--force") == 0
    assert robot.read_bytes() == new
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagnosis.json", "new.toml", "robot.toml"]


def test_gen_takes_the_new_file(tmp_path: Path) -> None:
    adopted(tmp_path, arms.SMALL, small())
    command = [sys.executable, "-m", "gen", "check", str(tmp_path / "new.toml")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "presliding_friction" in done.stdout


SPELLINGS = st.sampled_from(["{}", "{{value = {}, tolerance = 0.07}}", "{{ value={} }}", "  {}", "+{}"])


@given(
    spelling=st.tuples(SPELLINGS, SPELLINGS, SPELLINGS),
    values=st.tuples(*[st.floats(1e-3, 1e3)] * 3),
    layout=st.sampled_from(["tables", "dotted", "inline", "mixed"]),
    effects=st.sampled_from(["", "tables", "list"]),
    end=st.sampled_from(["\n", "", "\n# the end\n", "\n\n\n"]),
)
def test_any_layout_gets_the_number_and_keeps_the_rest(
    arm: Arm, spelling: tuple, values: tuple, layout: str, effects: str, end: str
) -> None:
    """The file as TOML reads it differs in what was put, and in nothing else; every comment is still there."""
    mass, friction, gravity = (form.format(old) for form, old in zip(spelling, (2.0, 0.25, 9.5), strict=True))
    drives = {
        "tables": f"mass = {mass} # m\n[joint.drive] # d\nratio = 50 # N\ncoulomb_friction = {friction} # c\n",
        "dotted": f"drive.ratio = 50 # N\nmass = {mass} # m\ndrive.coulomb_friction = {friction} # c\n",
        "inline": f"drive = {{ratio = 50, coulomb_friction = {friction}}} # d\nmass = {mass} # m\n",
        "mixed": f"mass={mass}# m\n  [joint.drive] # d\n  coulomb_friction={friction}\n  # why\n  ratio = 50\n",
    }
    joints = f"[[joint]] # one\n{drives[layout]}"
    stated = {"": "", "tables": '[[effect]] # e\nname = "payload"\njoint = 1\npayload_mass = 0.1\n'}.get(effects, "")
    head = '# head\nname = "x"\n' + (
        'effect = [{name = "payload", joint = 1, payload_mass = 0.1}] # e\n' if effects == "list" else ""
    )
    text = f"{head}gravity = [ 0.0 ,{gravity}] # g\n{joints}{stated}".rstrip("\n") + end
    expected = tomllib.loads(text)
    file = RobotFile(text.encode(), arm)
    for name, value in zip(("mass_1", "coulomb_friction_1", "gravity_y"), values, strict=True):
        file.set_number(file.locate_parameter(name), value)
    file.set_number(file.locate_parameter("bias_1", "current_bias"), 0.5, "N m")
    file.set_number(NumberPlace("top", 0, "step"), 1e-4, "s")
    result = file.to_bytes().decode()
    found = tomllib.loads(result)
    _number(expected["joint"][0], "mass", values[0])
    _number(expected["joint"][0]["drive"], "coulomb_friction", values[1])
    _number(expected["gravity"], 1, values[2])
    expected.setdefault("effect", []).append({"name": "current_bias", "joint": 1, "bias": 0.5})
    assert found == expected | {"step": 1e-4}
    assert sorted(re.findall(r"#.*", text)) == sorted(
        c for c in re.findall(r"#.*", result) if c not in ("# N m", "# s")
    )


def _number(table: dict, key: str | int, value: float) -> None:
    """Set a number in a parsed file as `RobotFile` must."""
    if isinstance(table[key], dict):
        table[key]["value"] = value
    else:
        table[key] = value


@pytest.fixture(scope="module")
def arm(build: Callable) -> Arm:
    """An arm of one joint."""
    return Arm(build(arms.SMALL).folder)
