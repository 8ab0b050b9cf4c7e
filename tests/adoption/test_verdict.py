"""The verdict of a diagnosis in a replay: it closes the gap, and what does not fit is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from replayed import FLEXIBLE, HYSTERESIS, MEMORY, diagnosis, simulated

from hdagen.adoption import verdict
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.prediction.window_replay import replay


@pytest.fixture(scope="module")
def made(build: Callable) -> Callable[..., Arm]:
    """made(text, effects=()) -> a fresh Arm."""
    return lambda robot, effects=(): Arm(build(robot, "portable", effects).folder)


def test_the_verdict_closes_the_gap_and_without_the_effect_it_comes_back(made: Callable) -> None:
    truth = made(FLEXIBLE, MEMORY)
    truth.parameters.update(HYSTERESIS | {"mass_1": 4.6})
    log = simulated(truth, 3.0)
    arm = made(FLEXIBLE, MEMORY)
    before = replay(arm, log).gap
    after = replay(arm, log, with_=diagnosis()).gap
    effect_out = replay(arm, log, with_=diagnosis(verdict=[])).gap
    assert after < 3.0 < effect_out / 3 and effect_out <= 1.2 * before
    assert arm.parameters["hysteresis_torque_1"] == 0.0 and arm.parameters["mass_1"] == 4.5  # a copy was changed


def test_base_parameters_stay_near_their_tolerance_and_effects_do_not(made: Callable) -> None:
    arm = made(FLEXIBLE)
    stated = diagnosis(
        verdict=["coulomb_friction@2", "unknown@1"],
        parameters={"mass_1": {"value": 9.0}, "coulomb_friction_2": {"value": 0.03}, "length_1": 0.3},
    )
    changed, notes = verdict.apply_verdict(arm, verdict.read_verdict(stated))
    assert changed.parameters["mass_1"] == pytest.approx(4.5 * 1.15)  # 3 times 5 %
    assert changed.parameters["coulomb_friction_2"] == 0.05 and changed.parameters["length_1"] == 0.3
    assert [note.split(":")[0] for note in notes] == ["unknown@1 has no equation", "mass_1"]


@pytest.mark.parametrize("robot_file", [(0.0, 0.0), (0.0, -9.81)])
@pytest.mark.parametrize("leans", [0.03, -0.1, 5.0, -5.0])
def test_gravity_may_lean_a_little_even_where_the_robot_file_states_none(
    robot_file: tuple[float, float], leans: float, made: Callable
) -> None:
    arm = made(FLEXIBLE.replace("gravity = [0.0, -9.81]", f"gravity = [{robot_file[0]}, {robot_file[1]}]"))
    nominal = arm.parameters["gravity_x"], arm.parameters["gravity_y"]
    assert nominal == robot_file
    stated = diagnosis(verdict=[], parameters={f"gravity_{axis}": nominal[k] + leans for k, axis in enumerate("xy")})
    changed, notes = verdict.apply_verdict(arm, verdict.read_verdict(stated))
    for k, axis in enumerate("xy"):
        moved = changed.parameters[f"gravity_{axis}"] - nominal[k]
        assert moved == pytest.approx(math.copysign(min(abs(leans), verdict.MOST_GRAVITY_CHANGE), leans))
    assert len(notes) == (2 if abs(leans) > verdict.MOST_GRAVITY_CHANGE else 0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": 3}, "schema is 3, possible are 1 and 2"),
        ({"schema": True}, "schema is True"),
        ({"verdict": "stribeck"}, "possible is a list of effects"),
        ({"verdict": ["stribeck_friction"]}, "possible is name@joint"),
        ({"verdict": ["x; rm -rf@1"]}, "possible is name@joint"),
        ({"verdict": ["stribeck_friction@1"]}, "no parameters here"),
        ({"parameters": {"mass_1": {"value": math.nan}}}, "possible is a finite number"),
        ({"robot": "elbow"}, "possible is an object with name and sha256"),
        ({"parameters": {"mass_1": {"value": 10**400}}}, "possible is a finite number"),
        ({"parameters": {"mass_1": {"value": True}}}, "possible is a finite number"),
        ({"parameters": {"Mass-1": 1.0}}, "no name of a parameter"),
        ({"verdict": [], "parameters": {"mass_7": 1.0}}, "no parameter mass_7"),
        ({"causes": [{"effect": 3}]}, "object with effect and joint"),
        ({"verdict": ["unknown@5"]}, "at a joint that test arm does not have"),
        ({}, "load it with hdagen.load_robot"),
    ],
)
def test_a_diagnosis_that_does_not_fit_is_refused(changes: dict, words: str, made: Callable) -> None:
    with pytest.raises(PlantError, match=words):
        verdict.apply_verdict(made(FLEXIBLE), verdict.read_verdict(diagnosis(**changes)))


@pytest.mark.parametrize("text", ["", "[1]", "{", "nonsense", "[" * 100_000])
def test_a_file_that_is_no_diagnosis_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(PlantError, match=r"diagnosis\.json"):
        verdict.read_verdict(tmp_path / "diagnosis.json")
    with pytest.raises(PlantError, match="cannot be read"):
        verdict.read_verdict(tmp_path / "absent.json")
