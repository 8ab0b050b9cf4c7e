"""Smooth friction of drives that leave its width open: every robot of the family of joints builds, and no file that
builds with the usual width gets another."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from arms import arm
from planar_links import get_planar_link

from gen.builder.build import assemble_library
from gen.builder.step_stability import StepExamination
from gen.presets import find_presets
from gen.robot.description import Robot
from gen.robot.load_robot import load
from gen.robot.schema import keys_of
from gen.robot.smoothing_width import USUAL_WIDTH
from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.joint_arms import JointArmCase
from hdagen.blind.realities.population import JOINT, Population

WIDEST = keys_of("joint.drive")["friction_smoothing"].range.high


def examined(path: Path, text: str) -> tuple[Robot, StepExamination]:
    path.write_text(text)
    robot = load(path)
    return robot, assemble_library(str(path), robot, ())[2]


def drawn(kind: str, count: int) -> list[str]:
    """Robot files of the family of joints, none of which states a width."""
    cases = draw_cases("joint scale", Population(kind, JOINT), count)
    texts = [case.robot.toml() for case in cases if isinstance(case, JointArmCase)]
    assert len(texts) == count and not any("friction_smoothing" in text for text in texts)
    return texts


def test_robots_at_joint_scale_build_and_only_refused_ones_get_another_width(tmp_path: Path) -> None:
    """One of rigid drives and one of drives with springs, each where the usual width does and where it does not do."""
    chosen: dict[tuple[bool, bool], str] = {}
    for text in drawn("none", 40):
        (tmp_path / "robot.toml").write_text(text)
        drives = [joint.drive for joint in load(tmp_path / "robot.toml").joints]
        is_wider = any(drive.friction_smoothing.nominal > USUAL_WIDTH for drive in drives)
        chosen.setdefault((drives[0].rigid, is_wider), text)
    assert len(chosen) == 4
    for (_, is_wider), text in chosen.items():
        _, found = examined(tmp_path / "robot.toml", text)
        assert not found.refusals("robot.toml")
        if is_wider:
            stated = text.replace("[joint.drive]\n", f"[joint.drive]\nfriction_smoothing = {USUAL_WIDTH}\n")
            _, refused = examined(tmp_path / "stated.toml", stated)
            assert set(refused.width) == {USUAL_WIDTH} and refused.refusals("stated.toml"), "it was not carried"


@pytest.mark.parametrize("kind", ["single", "rough", "unknown+one"])
def test_forty_robots_at_joint_scale_stop_no_motor_faster_than_the_step(tmp_path: Path, kind: str) -> None:
    """By the friction of rotors that stand alone, and of the last link with all other joints held."""
    for text in drawn(kind, 40):
        (tmp_path / "robot.toml").write_text(text)
        robot = load(tmp_path / "robot.toml")
        for joint in robot.joints:
            inertia = joint.drive.motor_inertia.nominal
            if joint.drive.rigid and joint is robot.joints[-1]:
                link = get_planar_link(joint)
                inertia += link.inertia.nominal + joint.mass.nominal * link.center_of_mass.nominal**2
            elif joint.drive.rigid:
                continue
            rate = joint.drive.coulomb_friction.nominal / (inertia * joint.drive.friction_smoothing.nominal)
            assert 0.0 < robot.step * rate <= 1.0


def test_widths_that_the_step_carries_stay() -> None:
    for name in find_presets():
        robot = load(name)
        stated = tomllib.loads(find_presets()[name].read_text())["joint"]
        for joint, own in zip(robot.joints, stated, strict=True):
            width = own["drive"].get("friction_smoothing", USUAL_WIDTH * joint.drive.ratio.nominal)
            assert joint.drive.friction_smoothing.nominal == width


@pytest.mark.parametrize("rigid", ["r", "f"])
def test_friction_that_no_width_carries_is_refused_as_before(tmp_path: Path, rigid: str) -> None:
    text = arm("R", rigid=rigid).replace("coulomb_friction = 0.03", "coulomb_friction = 9e4")
    assert "coulomb_friction = 9e4" in text
    robot, found = examined(tmp_path / "robot.toml", text)
    assert robot.joints[0].drive.friction_smoothing.nominal <= WIDEST
    (refused,) = found.refusals("robot.toml")
    assert f"friction_smoothing: found {WIDEST:.4g} rad/s" in refused
