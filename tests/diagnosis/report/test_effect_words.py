"""Words that fit the sign: too small or too large in the file, by how much, or missing; units and digits."""

from __future__ import annotations

from typing import Any

import pytest

from hdagen.diagnosis.report.effect_groups import say_many_effects
from hdagen.diagnosis.report.effect_words import (
    SizeChange,
    format_change,
    format_estimate,
    join_effects,
    name_joint,
    say_effect,
)


def told(effect: str, file: float | None, value: float, *channels: str, **more: Any) -> str:
    """The clause on one effect at joint 1."""
    one = {"value": value, "std": 0.01 * abs(value), "unit": "N m", "end": None, "file": file}
    cause = {"effect": effect, "joint": 1, "parameters": {effect: one}}
    return say_effect(f"{effect}@1", {"causes": [cause], "data": {"channels": dict.fromkeys(channels)}, **more})


@pytest.mark.parametrize(
    ("file", "value", "words"),
    [
        (0.05, 0.13, "Coulomb friction on joint 1 is too small in the file by 2.6 times (file 0.05, found 0.1300 ± "),
        (0.04, 0.02, "Coulomb friction on joint 1 is too large in the file by 2 times"),
        (1.0, 1.12, "too small in the file by 12 %"),
        (1.0, 0.9, "too large in the file by 10 %"),
        (1.0, -0.5, "of the other sign in the file"),
        (1.0, 0.001, "in the file, and the log has hardly any of it"),
        (0.0, 0.13, "Coulomb friction on joint 1 is missing in the model (found 0.1300 ± 0.0013 N m)"),
        (None, 0.13, "Coulomb friction on joint 1 is missing in the model (found 0.1300 ± 0.0013 N m)"),
    ],
)
def test_the_words_fit_the_sign(file: float | None, value: float, words: str) -> None:
    assert words in told("coulomb_friction", file, value)


def test_a_gain_of_commands_is_said_as_one_where_no_current_is_logged() -> None:
    said = told("torque_constant", 1.0, 2.56, "motor_torque_command_1", "joint_position_1")
    assert said.startswith("commands act on joint 1 2.56 times as strongly as the file says")
    said = told("torque_constant", 1.0, 2.56, "motor_current_1", "joint_position_1")
    assert said.startswith("torque constant on joint 1 is too small in the file by 2.6 times")


def test_joints_are_known_by_name() -> None:
    assert name_joint(2, (None, "elbow_joint")) == "elbow_joint (2)" and name_joint(2) == "joint 2"
    assert "on hip (1) is" in told("coulomb_friction", 1.0, 3.0, joints=["hip", None])
    assert (
        join_effects(["stiffness@2", "stiffness@1", "payload@2"])
        == "stiffness on joints 1 and 2 and payload on joint 2"
    )
    assert (
        join_effects(["stiffness@2", "stiffness@1"], ("hip", "knee"))
        == "stiffness on knee (2) and stiffness on hip (1)"
    )


def list_causes(**numbers: list[tuple[float, float]]) -> dict[str, Any]:
    """Causes of diagnosis.json: of each effect, file and found value at the joints from 1 on."""
    causes = []
    for effect, pairs in numbers.items():
        for joint, (file, value) in enumerate(pairs, 1):
            one = {"value": value, "std": 0.01, "unit": "N m", "end": None, "file": file}
            causes.append({"effect": effect, "joint": joint, "parameters": {effect: one}})
    return {"causes": causes, "data": {"channels": {}}}


def test_many_effects_of_a_kind_are_said_together() -> None:
    content = list_causes(motor_inertia=[(0.0, 0.1)] * 3, viscous_friction=[(0.1, 1.3), (0.1, 0.88), (0.1, 0.05)])
    entries = [f"{effect}@{joint}" for effect in ("motor_inertia", "viscous_friction") for joint in (1, 2, 3)]
    assert say_many_effects(entries, content) == [
        "motor inertia on joints 1, 2 and 3 is missing in the model",
        "viscous friction on joints 1 and 2 is too small in the file by 8.8 to 13 times",
        "viscous friction on joint 3 is too large in the file by 2 times",
    ]
    named = content | {"joints": ["hip", "knee", None]}
    assert say_many_effects(entries, named)[0] == (
        "motor inertia on hip (1), knee (2) and joint 3 is missing in the model"
    )


def test_both_values_of_a_change_are_readable() -> None:
    assert format_change(4.52e-3, 7.15e-5, "rad") == "4.52 → 0.0715 mrad"
    assert format_change(1.36, 1.21e-3, "rad", " to ") == "1360 to 1.21 mrad"
    assert format_change(0.43, 1.65e-4, "rad") == "430 → 0.165 mrad"
    assert format_change(0.349, 4.45e-4, "rad") == "349 → 0.445 mrad"
    assert format_change(12.0, 0.05, "rad") == "12 → 0.05 rad"
    assert format_change(0.0, 0.0, "m") == "0 → 0 m"
    assert format_change(2.0, 3.0, "1") == "2 → 3"


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [(2.49, 0.0278, ("2.490", "0.028")), (83.0, 15.2, ("83", "15")), (0.3, None, ("0.3", "")), (0.0, 0.1, ("0", ""))],
)
def test_digits_are_those_that_the_deviation_bears(value: float, std: float | None, shown: tuple[str, str]) -> None:
    assert format_estimate(SizeChange("x", 1.0, value, std, "N m"))[1:3] == shown
