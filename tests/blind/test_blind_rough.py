"""How robot files with wrong numbers are judged, and how families are pooled and compared."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdagen.blind import blind_page, label_seal, rates
from hdagen.blind.blind_report import make_report, render_report
from hdagen.blind.family_table import render_family_table, transfer_calibration
from hdagen.blind.realities.population import FAMILIES, Population
from hdagen.blind.required_rates import BARS, find_bars
from hdagen.blind.score_summary import summarize_rows
from hdagen.blind.scores import Row, is_factor_right, score_case
from hdagen.blind.sealed_check import Check
from hdagen.campaign.cluster_request import ClusterRequest

NUMBERS = {"motor_inertia@1": 1.6, "mass@2": 0.7}


def estimate(value: float, std: float = 0.01, **more: Any) -> dict[str, Any]:
    return {"value": value, "std": std, "unit": "1", "end": None, **more}


def cause(name: str, parameters: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    effect, _, joint = name.partition("@")
    return {"effect": effect, "joint": int(joint), "probability": 0.95, "parameters": dict(parameters), **more}


def row(causes: Sequence[Mapping[str, Any]], *effects: str, sure: bool = False) -> Row:
    """A rough file with `NUMBERS` wrong and these effects beside them, of which a diagnosis names these causes."""
    truth = [*NUMBERS, *effects]
    label = {"kind": "rough", "verdict": truth, "sizes": [1.0] * len(truth), "background": 0.0, "numbers": NUMBERS}
    told = {"snr": 9.0, "parameters": {name: {"factor": f} for name, f in NUMBERS.items()} | {e: {} for e in effects}}
    names = [f"{one['effect']}@{one['joint']}" for one in causes]
    said = {
        "verdict": names,
        "sure": sure,
        "gap": {"before": 90.0, "after": 3.0, "flexible": None},
        "where": [],
        "causes": list(causes),
        "hypotheses": [{"effects": names, "probability": 0.95}, {"effects": [], "probability": 0.05}],
    }
    return score_case("x", label, told, {"seconds": 1.0, "before": 90.0, "after": 3.0}, said)


RIGHT = cause("motor_inertia@1", {"motor_inertia": estimate(2e-4), "factor": estimate(1.62)})
MASS = cause("mass@2", {"mass": estimate(0.9), "factor": estimate(0.71)})


@pytest.mark.parametrize(
    ("found", "true", "right"),
    [
        ({"factor": estimate(1.9)}, 1.6, True),  # 19 % off
        ({"factor": estimate(1.95)}, 1.6, False),
        ({"factor": estimate(2.0, 0.19)}, 1.7, True),  # 1.63 to 2.37: holds it, and says enough
        ({"factor": estimate(2.1, 0.4)}, 1.6, False),  # 1.3 to 2.9 says too little
        ({"factor": estimate(0.1, 0.2)}, 1.6, False),
        ({"factor": {**estimate(1.7), "std": None}}, 1.6, True),
        ({"coulomb_friction": estimate(0.06, file=0.02)}, 3.1, True),  # a value beside the file's
        ({"coulomb_friction": estimate(0.06, file=0.02)}, 1.0, False),
        ({"stiffness_level": estimate(0.6)}, 0.62, True),
        ({"torque_gain": estimate(1.2)}, 1.25, True),
        ({"stribeck_torque": estimate(0.02)}, 1.0, False),  # tells no factor
        ({}, 1.6, True),  # another number stands for it, and has no factor to compare
    ],
)
def test_a_factor_is_right_near_the_truth_or_with_a_narrow_interval_about_it(
    found: dict[str, Any], true: float, right: bool
) -> None:
    assert is_factor_right(found, true) == right


def test_every_number_has_to_be_named_with_its_factor_and_the_effect_beside_them() -> None:
    backlash = cause("backlash@2", {"backlash_angle": estimate(5e-4)})
    whole = row([RIGHT, MASS, backlash], "backlash@2", sure=True)
    assert whole.is_right and set(whole.right_numbers) == set(NUMBERS) and whole.is_effect_beside_right
    one = row([RIGHT], "backlash@2")
    assert not one.is_right and one.right_numbers == ("motor_inertia@1",) and not one.is_effect_beside_right
    more = row([RIGHT, MASS, backlash], sure=True)
    assert not more.is_right and set(more.right_numbers) == set(NUMBERS)
    figures = summarize_rows([whole, one, more])
    assert figures["numbers_right"].value == pytest.approx(2 / 3)
    assert figures["number_right"].value == pytest.approx(5 / 6) and figures["number_right"].count == 6
    assert figures["effect_beside"].value == 0.5 and figures["effect_beside"].count == 2
    assert figures["sure_and_wrong"].value == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    "stand_in",
    [
        cause("inertia@2", {"factor": estimate(0.5)}, combination=["inertia@2", "mass@2"]),
        cause("payload@2", {"payload_mass": estimate(0.3)}),
    ],
    ids=["combination", "payload"],
)
def test_a_member_of_a_combination_and_a_payload_count_as_the_number(stand_in: dict[str, Any]) -> None:
    found = row([RIGHT, stand_in])
    assert found.is_right and set(found.right_numbers) == set(NUMBERS) and found.p_truth == pytest.approx(0.95)
    beside = row([RIGHT, MASS, stand_in])  # the number itself is named: what is beside it is one too many
    assert not beside.is_right
    other = cause("inertia@1", {"factor": estimate(0.5)}, combination=["inertia@1", "center_of_mass@1"])
    assert not row([RIGHT, other]).is_right


def test_the_bars_follow_family_and_background() -> None:
    effect = {name: find_bars(Population("single", background=name))[0].value for name in (0.0, 0.02, 0.04, 0.08)}
    assert effect == {0.0: 0.97, 0.02: 0.94, 0.04: 0.94, 0.08: 0.9}
    assert find_bars(Population("background", FAMILIES[1])) == BARS["background"]
    assert find_bars(Population("background", background=0.08))[0].value == 0.9
    assert [bar.figure for bar in find_bars(Population("rough", "joint"))][:2] == ["numbers_right", "effect_beside"]


def test_checks_are_pooled_by_family_kind_and_background(tmp_path: Path) -> None:
    """And their page and blind.json say which population it was."""

    def check(seed: str, family: str | None, background: float | None) -> dict[str, Any]:
        asked = Check(
            "rough", 2, seed, ClusterRequest(1), 10.0, tmp_path, family=family, background=background
        )  # fmt: skip
        found = make_report(asked, label_seal.Seal("ab" * 32, 2), [row([RIGHT, MASS]), row([RIGHT])])
        blind_page.write_page(tmp_path / "blind.html", found)
        return dict(json.loads(render_report(found)))

    parts = [check("a", None, None), check("b", "maxwell", None), check("c", "maxwell", None)]
    page = re.sub(r"<[^>]+>", "", (tmp_path / "blind.html").read_text())
    assert "--family maxwell --kind rough" in page and "arms of another simulator" in page
    parts.append(check("d", "joint", 0.08))
    together = rates.combine_checks(parts)
    assert {name: part["cases"] for name, part in together.items()} == {
        "rough": 2,
        "maxwell rough": 4,
        "joint rough 0.08": 2,
    }
    again = rates.combine_checks([rates.combine_checks(parts[:2]), parts[2], parts[3]])
    assert again["maxwell rough"]["summary"] == together["maxwell rough"]["summary"]
    table = rates.render_table(together)
    assert "| a robot file with wrong numbers, arms of another simulator | 4 |" in table
    assert "joints at joint scale, background 8 % | 2 |" in table
    assert "leave-one-family-out" in rates.render_families(together)


def test_a_calibration_of_other_families_is_measured_on_the_one_that_is_left_out() -> None:
    """Outcomes of stated probability: right as often as is said in one family, and far less often in another."""
    rng = np.random.default_rng(4)

    def rows(count: int, honest: bool) -> list[Row]:
        found = []
        for p in rng.uniform(0.55, 0.99, count):
            is_hit = rng.random() < (p if honest else p - 0.4)
            verdict = ("payload@2",) if is_hit else ("backlash@1",)
            found.append(
                Row(
                    "x", "single", ("payload@2",), (1.0,), 0.0, 9.0, {}, verdict=verdict, p_stated=p, p_top=p, p_truth=p
                )
            )
        return found

    honest, other, boastful = rows(600, True), rows(600, True), rows(600, False)
    good, bad = transfer_calibration(honest, other), transfer_calibration(honest, boastful)
    assert good is not None and good.value < 0.08
    assert bad is not None and bad.value > 0.2
    assert transfer_calibration(honest[:10], other) is None
    table = render_family_table({"drivetrain": honest, "maxwell": other, "joint": []})
    assert table.count("\n") == 4 and "too few" not in table
    assert "too few others" in render_family_table({"drivetrain": honest})
