"""Adopt is no dead end: whatever effect a diagnosis names, at any size that it may have, the file takes it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from replayed import diagnosis, simulated
from uncompiled import UncompiledArm

from gen.effects import ALL, NOMINAL_NAMES
from gen.effects.file_numbers import FILE_NUMBERS
from hdagen.adoption import verdict
from hdagen.adoption.robot_update import AdoptedRobot, adopt, describe_change
from hdagen.arm.arm_parameters import Parameter
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import load
from hdagen.prediction.window_replay import replay

RIGID, SPRUNG = arms.SMALL, arms.arm("R")
SPRING = '[[effect]]\nname = "missing_compliance"\njoint = 1\nmissing_compliance = 2e-4\nmissing_damping = 3.0\n'
NAMES = tuple(effect.name for effect in ALL)


def cause(name: str, joint: int, **values: float) -> dict:
    """A cause with its estimates."""
    estimates = {
        key: {"value": value, "std": 0.02 * abs(value), "conditional_std": 0.003 * abs(value)}
        for key, value in values.items()
    }
    return {"effect": name, "joint": joint, "parameters": estimates}


def named(*causes: dict, **changes: object) -> dict:
    """A diagnosis that names all of these causes."""
    entries = [f"{one['effect']}@{one['joint']}" for one in causes]
    return diagnosis(**{"verdict": entries, "causes": list(causes), "parameters": {}} | changes)


def suited(name: str) -> str:
    """A robot of one joint that can have this effect."""
    return RIGID if name == "missing_compliance" or next(e for e in ALL if e.name == name).suits_rigid_drive else SPRUNG


def sizes(name: str, arm: UncompiledArm) -> tuple[int, dict[str, dict[str, float]]]:
    """The effect's joint, and its parameters at their usual size, and at both ends of their ranges."""
    effect = next(one for one in arm.manifest["effects"] if one["name"] == name)
    joint = effect["joints"][0]
    suffix = f"_{joint}" if joint else ""
    keys = [*effect["amplitudes"], *effect["shapes"]]
    own: dict[str, Parameter] = {key: arm.parameters.described[key + suffix] for key in keys}
    usual = {key: min(max(q.nominal + (q.typical or 0.01 * abs(q.nominal)), q.low), q.high) for key, q in own.items()}
    return joint, {
        "usual": usual,
        "low": {key: q.low for key, q in own.items()},
        "high": {key: q.high for key, q in own.items()},
    }


STATED_NUMBERS = {"motor_inertia": 1.3e-4, "mass": 4.5, "center_of_mass": 0.12, "inertia": 0.08}  # of the rigid robot
BEYOND_ALL_STEPS = {"viscous_friction", "contact"}  # at the upper ends: 1e6 N m s/rad, and 1e5 N m/rad times 20 s


def check_adopted(values: dict[str, float], new: UncompiledArm, joint: int) -> None:
    """Compare an effect's parameters with those of the new file, rounded as the log allows."""
    for key, value in values.items():
        full = f"{key}_{joint}" if joint else key
        assert new.parameters.get(full, 0.0) == pytest.approx(value, rel=2e-5, abs=1e-300), full


@pytest.mark.parametrize("text", [RIGID, SPRUNG], ids=["rigid", "with springs"])
def test_all_effects_of_a_drive_can_be_adopted_together(text: str, uncompiled: None, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(text)
    names = tuple(name for name in NAMES if suited(name) == text or (text == SPRUNG and name in NOMINAL_NAMES))
    arm = UncompiledArm(tmp_path / "robot.toml", tuple(name for name in names if name not in NOMINAL_NAMES))
    found = {name: sizes(name, arm) for name in names}
    stated = named(*(cause(name, joint, **sized["usual"]) for name, (joint, sized) in found.items()))
    adopt(stated, tmp_path / "robot.toml", tmp_path / "new.toml")
    new = UncompiledArm(tmp_path / "new.toml")
    for joint, sized in found.values():
        check_adopted(sized["usual"], new, joint)
    assert len(names) > 10


@pytest.mark.parametrize("number", [one.name for one in FILE_NUMBERS if one.name in STATED_NUMBERS])
def test_a_number_that_the_verdict_calls_wrong_is_written_as_found(
    number: str, uncompiled: None, tmp_path: Path
) -> None:
    (tmp_path / "robot.toml").write_text(RIGID)
    before = STATED_NUMBERS[number]
    wrong = cause(number, 1, **{number: 1.8 * before, "factor": 1.8})
    written = adopt(named(wrong), tmp_path / "robot.toml", None)
    assert [(change.before, change.after) for change in written.changes] == [(before, pytest.approx(1.8 * before))]


@pytest.mark.campaign
@pytest.mark.parametrize("name", NAMES)
def test_every_effect_can_be_adopted(name: str, uncompiled: None, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(suited(name))
    joint, found = sizes(name, UncompiledArm(tmp_path / "robot.toml", (name,)))
    for size, values in found.items():
        stated = named(cause(name, joint, **values))
        if size == "high" and name in BEYOND_ALL_STEPS:
            with pytest.raises(PlantError, match="beyond all that a machine has; diagnose again"):
                adopt(stated, tmp_path / "robot.toml", None)
            continue
        adopt(stated, tmp_path / "robot.toml", tmp_path / "new.toml", force=True)
        check_adopted(values, UncompiledArm(tmp_path / "new.toml"), joint)
        again = adopt(stated, tmp_path / "new.toml", None)
        assert [change for change in again.changes if change.where != "step"] == []


@pytest.mark.parametrize(
    ("text", "causes", "expected"),
    [
        (
            RIGID,
            [
                cause("missing_compliance", 1, missing_compliance=2e-4, missing_damping=3.0),
                cause("joint_damping", 1, torsional_damping=40.0),
            ],
            (2e-4, 43.0),
        ),
        (RIGID + SPRING, [cause("joint_damping", 1, torsional_damping=40.0)], (2e-4, 43.0)),
        (RIGID + SPRING, [cause("stiffness", 1, stiffness_level=1.25)], (1.6e-4, 3.0)),
        (RIGID + SPRING, [cause("stiffness", 1, stiffness_level=0.0)], (0.1, 3.0)),
    ],
    ids=["found with the spring", "damping of a spring in the file", "its level", "no stiffness at all"],
)
def test_level_and_damping_of_a_spring_in_a_rigid_drive_go_into_the_spring(
    text: str, causes: list, expected: tuple[float, float], uncompiled: None, tmp_path: Path
) -> None:
    (tmp_path / "robot.toml").write_text(text)
    written = adopt(named(*causes), tmp_path / "robot.toml", None)
    (tmp_path / "new.toml").write_text(written.text)
    new = UncompiledArm(tmp_path / "new.toml").parameters
    assert (new["missing_compliance_1"], new["missing_damping_1"]) == pytest.approx(expected)
    assert (new["stiffness_level_1"], new["torsional_damping_1"]) == (1.0, 0.0)


def test_a_stiffer_spring_moves_as_its_level_does(
    build: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(build(arms.SMALL).folder.parent))
    (tmp_path / "robot.toml").write_text(RIGID + SPRING)
    stated = named(cause("stiffness", 1, stiffness_level=1.25), cause("joint_damping", 1, torsional_damping=4.0))
    adopt(stated, tmp_path / "robot.toml", tmp_path / "new.toml")
    old, new = load(tmp_path / "robot.toml"), load(tmp_path / "new.toml")
    log = simulated(old, 0.5)
    expected = replay(old, log, with_=stated)
    found = replay(new, log)
    for name in found.errors:
        assert np.abs(found.columns[name] - expected.columns[name]).max() < 1e-3 * expected.noise[name]
    assert np.abs(replay(old, log).columns["joint_position_1"] - found.columns["joint_position_1"]).max() > 1e-5


def test_links_that_no_mass_matrix_can_have_keep_the_numbers_of_the_file(uncompiled: None, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(RIGID.replace("inertia = 0.08", "inertia_about_joint = 0.02"))
    described = UncompiledArm(tmp_path / "robot.toml").parameters.described
    low = {
        name: {"value": described[name].nominal - 0.15 * abs(described[name].nominal), "std": 1e-3}
        for name in ("mass_1", "center_of_mass_1")
    }
    stated = named(cause("current_bias", 1, bias=0.01), parameters=low)
    written = adopt(stated, tmp_path / "robot.toml", None)
    assert [change.where for change in written.changes] == ["current_bias@1.bias"]
    assert any("the links keep the numbers of the file" in note for note in written.notes)


def test_an_effect_without_numbers_is_named_and_nothing_is_adopted_for_it(uncompiled: None, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(RIGID)
    written = adopt(named(cause("coulomb_friction", 1)), tmp_path / "robot.toml", None)
    assert written.changes == () and written.text == RIGID
    assert any(note.startswith("coulomb_friction@1 has no numbers") for note in written.notes)


def test_friction_beyond_the_widest_smoothing_gets_a_smaller_step_too(uncompiled: None, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(SPRUNG)
    written = adopt(named(cause("coulomb_friction", 1, coulomb_friction=1e5)), tmp_path / "robot.toml", None)
    after = {change.where: change.after for change in written.changes}
    assert after["joint[1].drive.friction_smoothing"] == 1e4 and after["step"] < 5e-4


def test_tables_in_any_order_are_taken(uncompiled: None, tmp_path: Path) -> None:
    head, first, second = arms.arm("RR").split("[[joint]]\n")
    bias = '[[effect]] # of joint {0}\nname = "current_bias"\njoint = {0}\nbias = 0.1\n'
    text = f"{head}[[joint]]\n{first}{bias.format(1)}[[joint]]\n{second}{bias.format(2)}"
    (tmp_path / "robot.toml").write_text(text)
    stated = named(cause("current_bias", 1, bias=0.02), cause("payload", 2, payload_mass=0.3))
    written = adopt(stated, tmp_path / "robot.toml", tmp_path / "new.toml")
    new = UncompiledArm(tmp_path / "new.toml").parameters
    assert (new["bias_1"], new["bias_2"], new["payload_mass_2"]) == (0.02, 0.1, 0.3)
    assert written.text.count("# of joint") == 2


def test_a_preset_is_adopted_into_a_file_of_its_own(uncompiled: None, tmp_path: Path) -> None:
    written = adopt(named(cause("payload", 2, payload_mass=0.3)), "paper", tmp_path / "new.toml")
    assert [change.where for change in written.changes] == ["payload@2.payload_mass"]
    assert (tmp_path / "new.toml").read_text() == written.text
    assert UncompiledArm(tmp_path / "new.toml").parameters["payload_mass_2"] == 0.3


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (None, 1.0, "new"),
        (1.0, 1.12, "+12 %"),
        (1.0, 0.995, "-0.5 %"),
        (1.0, 2.6, "× 2.6"),
        (4.0, 1.0, "× 0.25"),
        (0.0, 0.3, "+0.3"),
        (0.1, -0.1, "-0.2"),
    ],
)
def test_a_change_is_said_as_people_say_it(before: float | None, after: float, words: str) -> None:
    assert describe_change(before, after) == words


@pytest.mark.campaign
@pytest.mark.parametrize("name", NAMES)
def test_the_new_file_replays_as_the_old_one_with_every_effect(
    name: str, build: Callable, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(build(arms.SMALL).folder.parent))
    (tmp_path / "robot.toml").write_text(suited(name))
    joint, found = sizes(name, UncompiledArm(tmp_path / "robot.toml", (name,)))
    stated = named(cause(name, joint, **found["usual"]))
    (tmp_path / "diagnosis.json").write_text(json.dumps(stated))
    old = verdict.load_with_effects(tmp_path / "robot.toml", "portable", verdict.read_verdict(stated))
    machine = verdict.apply_verdict(old, verdict.read_verdict(stated))[0]
    machine.parameters["coulomb_friction_1"] *= 1.2  # of which the diagnosis says nothing: a gap remains
    log = simulated(machine, 0.8)
    expected = replay(old, log, with_=stated)
    assert expected.gap > 1.2
    written: AdoptedRobot = adopt(tmp_path / "diagnosis.json", tmp_path / "robot.toml", tmp_path / "new.toml")
    assert written.changes
    found_gap, said_gap = replay(load(tmp_path / "new.toml"), log).gap, expected.gap
    assert found_gap == pytest.approx(said_gap, rel=0.02)
