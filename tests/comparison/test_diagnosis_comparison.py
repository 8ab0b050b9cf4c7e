"""Two diagnoses side by side: what is compared, where they agree, and the command, its JSON and its page."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdagen
from hdagen.__main__ import main
from hdagen.comparison.diagnosis_comparison import (
    BASE_PARAMETER,
    DiagnosisComparison,
    Estimate,
    ParameterPair,
    compare_contents,
)

STORED: dict[str, Any] = json.loads((files("hdagen.data") / "pendulum_diagnosis.json").read_text(encoding="utf-8"))


def changed(change: Callable[[dict[str, Any]], object] = lambda d: None) -> dict[str, Any]:
    """The stored diagnosis with a change."""
    document = copy.deepcopy(STORED)
    change(document)
    return document


def pair(found: DiagnosisComparison, name: str) -> ParameterPair:
    """The parameter of a name."""
    return next(one for one in found.parameters if one.name == name)


def test_a_diagnosis_agrees_with_itself() -> None:
    found = compare_contents(STORED, STORED)
    judged = [one for one in found.parameters if one.do_agree is not None]
    assert judged and all(one.do_agree and one.difference == 0.0 for one in judged)
    assert found.sentence.startswith("Both name Coulomb friction on joint 1;")
    assert f"{len(judged)} of {len(judged)} parameters agree" in found.sentence
    assert any("of the same log" in note for note in found.notes)
    columns = found.table().columns
    assert columns["first"] == columns["second"]


@pytest.mark.parametrize(("deviations", "agree"), [(1.9, True), (-1.9, True), (2.0, False), (-2.0, False)])
def test_estimates_agree_within_the_interval_of_their_difference(deviations: float, agree: bool) -> None:
    first, second = Estimate(1.0, 0.3), Estimate(1.0 + 0.5 * deviations, 0.4)
    one = ParameterPair("mass_1", BASE_PARAMETER, "kg", first, second)
    assert one.deviations == pytest.approx(deviations) and one.do_agree is agree
    other = ParameterPair("mass_1", BASE_PARAMETER, "kg", second, first)
    assert other.deviations == pytest.approx(-deviations) and other.do_agree is agree


def test_one_in_twenty_pairs_of_equal_truths_disagrees() -> None:
    rng = np.random.default_rng(0)
    draws = [(Estimate(rng.normal(0, 0.2), 0.2), Estimate(rng.normal(0, 0.7), 0.7)) for _ in range(20_000)]
    disagree = np.mean([not ParameterPair("m", BASE_PARAMETER, "1", *both).do_agree for both in draws])
    assert disagree == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize(
    ("first", "second", "agree"),
    [
        (Estimate(1.0, None), Estimate(1.0, 0.1), None),
        (None, Estimate(1.0, 0.1), None),
        (Estimate(1.0, 0.0), Estimate(1.0, 0.0), True),
        (Estimate(1.0, 0.0), Estimate(1.1, 0.0), False),
    ],
)
def test_what_has_no_deviation_is_not_judged(
    first: Estimate | None, second: Estimate | None, agree: bool | None
) -> None:
    assert ParameterPair("m", BASE_PARAMETER, "1", first, second).do_agree is agree


def test_what_only_one_names_is_said() -> None:
    def name_other(document: dict[str, Any]) -> None:
        cause = {"effect": "payload", "joint": 1, "probability": 0.9}
        document["causes"] = [one for one in document["causes"] if one["effect"] != "payload"]
        document["causes"].append(cause | {"parameters": {"payload_mass": {"value": 0.3, "std": 0.01, "unit": "kg"}}})
        document["verdict"] = ["payload@1"]

    found = compare_contents(STORED, changed(name_other))
    assert found.sentence.startswith(
        "Only the first names Coulomb friction on joint 1; only the second names payload on joint 1;"
    )
    assert [one.effect for one in found.effects[:2]] == ["payload@1", "coulomb_friction@1"]
    payload, friction = (pair(found, name) for name in ("payload_mass_1", "coulomb_friction_1"))
    assert payload.first is None and payload.second == Estimate(0.3, 0.01) and payload.unit == "kg"
    assert friction.first is not None and friction.second is not None  # its cause is in both
    assert (found.effects[0].first_probability or 0.0) < 1e-3 and found.effects[0].second_probability == 0.9


def test_a_number_that_is_wrong_counts_once() -> None:
    def name_mass(document: dict[str, Any]) -> None:
        estimates = {
            "mass": {"value": 0.8, "std": 0.01, "unit": "kg"},
            "factor": {"value": 1.5, "std": 0.02, "unit": "1"},
        }
        cause = {"effect": "mass", "joint": 1, "probability": 0.9, "parameters": estimates}
        document["causes"].append(cause)
        document["verdict"] = ["mass@1"]

    found = compare_contents(changed(name_mass), changed(name_mass))
    assert [one.name for one in found.parameters if one.effect == "mass@1"] == ["mass_1"]


def test_what_limits_the_comparison_is_said() -> None:
    def record_anew(document: dict[str, Any]) -> None:
        document["data"]["log"] = "another.csv"
        document["data"]["hold_out"] = []
        document["robot"]["identity"] = "0" * 64
        document["sure"] = True

    found = compare_contents(STORED, changed(record_anew))
    assert "The robot files differ" in found.notes[0] and "held-out rows differ" in found.notes[1]
    assert found.notes[2:] == ("The first diagnosis is not sure of its verdict.",)


def test_none_is_none() -> None:
    empty = {"schema": 2, "verdict": [], "causes": [], "parameters": {}}
    found = compare_contents(empty, empty)
    assert found.sentence == "Neither names an effect." and found.parameters == () and found.effects == ()
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["effects"] == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d.pop("gap"),
        lambda d: d.update(gap=[1, 2]),
        lambda d: d["gap"].update(before="much"),
        lambda d: d.update(data=None, robot=None),
        lambda d: d["causes"][0].update(probability="high"),
        lambda d: d.update(hypotheses=[3, {"effects": "unknown@1"}]),
        lambda d: d["parameters"]["mass_1"].update(std=-1.0),
        lambda d: d["parameters"]["mass_1"].update(std=10**400),
        lambda d: d["parameters"].update(mass_1=0.7),
    ],
)
def test_what_a_diagnosis_lacks_is_left_open(spoil: Callable[[dict[str, Any]], object], tmp_path: Path) -> None:
    found = compare_contents(STORED, changed(spoil))
    assert str(found) and found._repr_html_()
    json.dumps(found.to_dict(), allow_nan=False)


def test_python_takes_files_folders_contents_and_diagnoses(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps(STORED))
    saved = hdagen.read_diagnosis(tmp_path)
    for source in (tmp_path, tmp_path / "diagnosis.json", STORED, saved):
        found = hdagen.compare(source, STORED)
        assert pair(found, "mass_1").do_agree is True
    with pytest.raises(hdagen.PlantError, match="schema is 9"):
        hdagen.compare(STORED, STORED | {"schema": 9})
    with pytest.raises(hdagen.PlantError, match=r"absent\.json"):
        hdagen.compare(tmp_path / "absent.json", STORED)


def test_the_command_prints_json_and_writes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for name, document in (("a", STORED), ("b", changed(lambda d: d["parameters"]["mass_1"].update(value=0.95)))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "diagnosis.json").write_text(json.dumps(document))
    given = ["compare", str(tmp_path / "a"), str(tmp_path / "b"), "--out", str(tmp_path / "page.html")]
    assert main(given) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "Both name Coulomb friction on joint 1" in shown and "mass_1" in shown and "written:" in shown
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for text in ("Two diagnoses side by side", "mass_1", "coulomb_friction@1", "95 %", "hdagen compare"):
        assert text in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")
    assert main([*given[:3], "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    mass = next(one for one in said["parameters"] if one["name"] == "mass_1")
    assert mass["agree"] is False and mass["difference"] == pytest.approx(0.95 - mass["first"]["value"])
    assert math.isfinite(mass["deviations"]) and said["out"] is None
    assert said["first"]["verdict"] == ["coulomb_friction@1"]


def test_a_command_that_cannot_be_done_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps(STORED))
    for arguments, words in (
        ((tmp_path, tmp_path / "absent", "--out", tmp_path / "page.html"), "absent"),
        ((tmp_path, tmp_path, "--out", tmp_path / "page.txt"), "possible is .html"),
        ((tmp_path, tmp_path, "--out", tmp_path / "none" / "page.html"), "cannot be written"),
    ):
        assert main(["compare", *map(str, arguments)]) == 2
        assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["diagnosis.json"]
