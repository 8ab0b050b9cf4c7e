"""Scores of a blind check: against hand counts, against the script by which the project is judged, and bent files."""

from __future__ import annotations

import json
import math
import os
import random
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import chromium
import numpy as np
import pytest
from hostile_names import NAME, check_escaped
from scipy.special import ndtri

from hdagen.blind import blind_page, calibrate, label_seal, rates
from hdagen.blind.blind_report import make_report, render_report
from hdagen.blind.case_tasks import measure_replay_gap
from hdagen.blind.confidence_intervals import estimate_mean, estimate_median, estimate_rate
from hdagen.blind.parameter_errors import PARAMETER_COMPARISONS, compare_parameters
from hdagen.blind.realities.effect_sizes import EFFECT_SIZES
from hdagen.blind.score_summary import accuracy_by_coverage, bin_by_confidence, count_confusions, summarize_rows
from hdagen.blind.scores import Row, merge_equivalent, score_case
from hdagen.blind.sealed_check import Check, _claim_folder
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.diagnosis.decision import calibration
from hdagen.log.measured_log import write

JUDGE = Path(os.environ.get("HDAGEN_DATA", Path(__file__).parents[3] / "shared" / "data")).parent / "check"


def label(*truth: str) -> dict[str, Any]:
    unknown = [one for one in truth if one.startswith("unknown")]
    kinds = {0: "none", 1: "unknown" if unknown else "single", 2: "unknown+one" if unknown else "pair"}
    return {"kind": kinds[len(truth)], "verdict": list(truth), "sizes": [1.0] * len(truth), "background": 0.0}


def told(*truth: str) -> dict[str, Any]:
    return {"snr": 12.0, "parameters": {one: {} for one in truth}}


def diagnosis(verdict: list[str], p: float, place: str = "motor", **more: Any) -> dict[str, Any]:
    causes = [
        {"effect": one.split("@")[0], "joint": int(one.split("@")[1]), "probability": p, "parameters": {}}
        for one in verdict
    ]
    rest = [{"effects": [], "probability": 1 - p}] if verdict else []
    return {
        "schema": 1,
        "verdict": verdict,
        "sure": p > 0.9,
        "gap": {"before": 9.0, "after": 3.0, "flexible": 4.0, "shrink": 0.75},
        "where": [{"joint": 1, "place": place, "share": 1.0, "when": ""}],
        "causes": causes,
        "hypotheses": [{"effects": verdict, "probability": p if verdict else 1.0}, *rest],
        "parameters": {},
        "data": {},
    } | more


def row(truth: list[str], said: dict[str, Any] | None, **result: Any) -> Row:
    return score_case("x", label(*truth), told(*truth), {"seconds": 1.0, "before": 9.0, "after": 2.0} | result, said)


# -- figures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "hits, count, low, high",
    [(8, 10, 0.4902, 0.9433), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (1, 300, 0.0006, 0.0186)],
)
def test_wilson_s_interval(hits: int, count: int, low: float, high: float) -> None:
    found = estimate_rate([k < hits for k in range(count)])
    assert (found.value, found.count) == (hits / count, count)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-4)


def test_wilson_s_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    for share in (0.05, 0.5, 0.95):
        inside = [(f := estimate_rate(list(rng.random(60) < share))).low <= share <= f.high for _ in range(2000)]
        assert 0.92 < np.mean(inside) < 0.985


def test_the_median_s_interval_holds_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    inside = [(f := estimate_median(list(rng.exponential(size=40)))).low <= math.log(2) <= f.high for _ in range(1500)]
    assert 0.93 < np.mean(inside) < 0.99
    assert (
        math.isnan(estimate_mean([3.0]).low) and estimate_mean([1.0, 3.0]).value == 2.0 and estimate_rate([]).count == 0
    )


# -- rows and their sums ----------------------------------------------------------------------------------------------


def test_a_right_verdict_scores_everywhere() -> None:
    found = summarize_rows([row(["payload@2"], diagnosis(["payload@2"], 0.9, "link"))])
    for name in ("effect", "effect_and_joint", "joint", "place", "top3"):
        assert found[name].value == 1.0
    assert found["p_truth"].value == 0.9 and found["brier"].value == pytest.approx(2 * 0.1**2)
    assert found["calibration_error"].value == pytest.approx(0.1) and found["failed"].value == 0.0
    assert found["closed"].value == pytest.approx(7 / 8) and found["worse"].value == 0.0
    assert found["achieved"].value == pytest.approx(6 / 5)  # 9 to 3, a flexible correction to 4
    nothing = diagnosis(["payload@2"], 0.9) | {"gap": {"before": 1.2, "after": 1.1, "flexible": 1.0}}
    assert "achieved" not in summarize_rows([row(["payload@2"], nothing), row([], diagnosis([], 1.0))])


def test_each_kind_of_wrong_is_told_apart() -> None:
    joint = row(["backlash@2"], diagnosis(["backlash@1"], 0.8, "transmission"))
    place = row(["backlash@2"], diagnosis(["backlash@2"], 0.8, "motor"))
    more = row(["backlash@2"], diagnosis(["backlash@2", "payload@2"], 0.8, "transmission"))
    assert (joint.is_effect_right, joint.is_joint_right, joint.is_right, joint.is_place_right) == (
        True,
        False,
        False,
        True,
    )
    assert (place.is_effect_right, place.is_right, place.is_place_right) == (True, True, False)
    assert (more.is_effect_right, more.is_right, more.is_joint_right) == (False, False, True)


def test_what_may_be_named_neither_counts_for_nor_against() -> None:
    sealed = label("backlash@2") | {"optional": ["missing_compliance@2"]}
    known = told("backlash@2", "missing_compliance@2")
    for verdict, right in (
        (["backlash@2"], True),
        (["backlash@2", "missing_compliance@2"], True),
        (["missing_compliance@2"], False),
        (["backlash@2", "missing_compliance@1"], False),
    ):
        found = score_case("x", sealed, known, {}, diagnosis(verdict, 0.9))
        assert (found.is_effect_right, found.is_right) == (right, right), verdict


def test_names_that_count_as_the_same_do_and_their_probabilities_add_up() -> None:
    said = diagnosis(["current_bias@1"], 0.6)
    said["causes"].append({"effect": "asymmetric_friction", "joint": 1, "probability": 0.3})
    found = row(["asymmetric_friction@1"], said)
    assert found.is_right and found.p_truth == pytest.approx(0.9) and merge_equivalent("payload@2") == "payload@2"
    assert not row(["asymmetric_friction@1"], diagnosis(["current_bias@2"], 0.6)).is_right


def test_the_arm_as_a_whole_has_no_joint_to_miss() -> None:
    found = row(["gravity_tilt@0"], diagnosis(["gravity_tilt@1"], 0.9, "link"))
    assert found.is_joint_right and found.is_right


def test_none_unknown_and_pairs() -> None:
    rows = [
        row([], diagnosis([], 1.0)),
        row([], diagnosis(["payload@2"], 0.7)),
        row(["unknown@1"], diagnosis(["unknown@1"], 0.9)),
        row(["unknown@1"], diagnosis(["unknown@2"], 0.9)),
        row(["payload@2", "stiffness@1"], diagnosis(["payload@2"], 0.9)),
        row(["payload@2", "stiffness@1"], diagnosis(["stiffness@1", "payload@2"], 0.9)),
    ]
    found = summarize_rows(rows)
    assert found["false_alarm"].value == 0.5 and found["false_alarm"].count == 2
    assert found["unknown_found"].value == 1.0 and found["unknown_found_at_joint"].value == 0.5
    assert found["pair_f1"].value == pytest.approx((2 / 3 + 1) / 2) and found["pair_both"].value == 0.5
    assert rows[0].p_truth == 1.0 and rows[1].p_truth == pytest.approx(0.3)
    assert "effect" not in found
    assert count_confusions(rows) == {"none": {"none": 1, "payload": 1}, "unknown": {"unknown": 2}}


def test_what_is_unknown_beside_named_effects_is_no_part_of_the_verdict() -> None:
    said = diagnosis(["payload@2"], 0.9, "link") | {"verdict": ["payload@2", "unknown@1"]}
    said["hypotheses"][0]["effects"] = said["verdict"]
    single, none, unknown = row(["payload@2"], said), row([], said), row(["unknown@1"], said)
    assert single.is_right and single.verdict == ("payload@2",) and single.remainder == ("unknown@1",)
    assert single.p_truth == 0.9 and single.p_stated == 0.9 and single.brier == pytest.approx(2 * 0.1**2)
    assert summarize_rows([none])["false_alarm"].value == 1.0
    assert summarize_rows([unknown])["unknown_found_at_joint"].value == 0.0  # it has to be unknown alone
    assert summarize_rows([single, row(["payload@2"], diagnosis(["payload@2"], 0.9))])["remainder"].value == 0.5
    pair = row(["payload@2", "stiffness@1"], diagnosis(["stiffness@1", "payload@2", "unknown@2"], 0.9))
    assert summarize_rows([pair])["pair_f1"].value == 1.0 and summarize_rows([pair])["pair_both"].value == 1.0
    alone = row([], diagnosis(["unknown@1"], 0.9))
    assert (
        alone.verdict == ("unknown@1",) and not alone.remainder and summarize_rows([alone])["false_alarm"].value == 1.0
    )


@pytest.mark.parametrize(
    "said, named, unknown",
    [
        (["payload@2", "unknown@1"], True, True),
        (["payload@2", "unknown@2", "unknown@1"], True, True),
        (["payload@2", "unknown@2"], True, False),
        (["payload@2"], True, False),
        (["unknown@1"], False, True),
        (["payload@1", "unknown@1"], False, True),
        (["payload@2", "backlash@1", "unknown@1"], False, True),
        ([], False, False),
    ],
)
def test_both_are_said_where_the_effect_is_named_and_unknown_stands_at_its_joint(
    said: list[str], named: bool, unknown: bool
) -> None:
    found = summarize_rows([row(["payload@2", "unknown@1"], diagnosis(said, 0.95))])
    assert found["effect_and_joint"].value == named and found["unknown_said_at_joint"].value == unknown
    assert found["both_said"].value == (named and unknown)
    assert found["sure_and_wrong"].value == (not named)  # it speaks of what is named
    assert "pair_f1" not in found and "unknown_found" not in found


def test_unknown_among_the_hypotheses_alone_has_their_probability() -> None:
    said = diagnosis([], 1.0)
    said.update(verdict=["unknown@2"], hypotheses=[{"effects": ["unknown@2"], "probability": 0.8}])
    assert row(["unknown@2"], said).p_truth == pytest.approx(0.8)


def test_what_a_log_cannot_show_counts_where_nothing_is_named() -> None:
    none, unknown = diagnosis([], 0.0), diagnosis([], 0.0)
    unknown.update(verdict=["unknown@2"], hypotheses=[{"effects": ["unknown@2"], "probability": 0.8}])
    for said in (none, unknown):
        said["undetectable"] = ["backlash@2"]
        assert row(["backlash@2"], said).confounded == ("backlash@2",)
    named = diagnosis(["payload@2"], 0.9) | {"undetectable": ["backlash@2"]}
    assert "backlash@2" not in row(["backlash@2"], named).confounded


def test_what_is_confounded_counts_where_the_verdict_is_wrong() -> None:
    said = diagnosis(["payload@2"], 0.9)
    said["causes"][0]["confounded_with"] = ["torque_constant@2"]
    right = diagnosis(["torque_constant@2"], 0.9)
    found = summarize_rows(
        [row(["torque_constant@2"], said), row(["stiffness@2"], said), row(["torque_constant@2"], right)]
    )
    assert found["confounded_where_wrong"].value == 0.5 and found["confounded_where_wrong"].count == 2


@pytest.mark.parametrize(
    "bent",
    [
        {"verdict": None},
        {"causes": [{"effect": "x"}]},
        {"causes": [{"effect": "payload", "joint": 2, "probability": 1.2}]},
        {"hypotheses": {}},
        {"where": [{}]},
        {"verdict": [3]},
    ],
)
def test_a_bent_diagnosis_counts_as_failed_and_wrong(bent: dict[str, Any]) -> None:
    found = row(["payload@2"], diagnosis(["payload@2"], 0.9) | bent)
    if "hypotheses" in bent:
        assert not found.failed and found.brier == 1.0  # none at all is none on the truth
        return
    assert found.failed.startswith("diagnosis.json is not") and not found.is_effect_right
    assert summarize_rows([found])["failed"].value == 1.0 and summarize_rows([found])["effect"].value == 0.0


def test_no_diagnosis_is_wrong_raises_no_alarm_and_has_no_gap() -> None:
    found = summarize_rows([row(["payload@2"], None, failed="it crashed"), row([], None, failed="it crashed")])
    assert found["effect"].value == 0.0 and "false_alarm" not in found and "closed" not in found


def test_reliability_and_coverage() -> None:
    rng = random.Random(3)
    rows = []
    for _ in range(4000):
        p = rng.uniform(0.3, 1.0)
        said = ["payload@2"] if rng.random() < p else ["stiffness@1"]
        rows.append(row(["payload@2"], diagnosis(said, p)))
    assert summarize_rows(rows)["calibration_error"].value < 0.03
    assert all(right.low - 0.03 <= said.value <= right.high + 0.03 for said, right in bin_by_confidence(rows))
    share, right = accuracy_by_coverage(rows)
    assert share[-1] == 1.0 and right[400] > 0.93 > right[-1]
    assert right[-1] == pytest.approx(summarize_rows(rows)["effect_and_joint"].value)
    louder = [replace(one, p_top=min(1.0, one.p_top + 0.2)) for one in rows]
    assert summarize_rows(louder)["calibration_error"].value > 0.1


# -- the script by which the project is judged ------------------------------------------------------------------------

STAND_IN = """#!{python}
import json, shutil, sys
from pathlib import Path
folder = Path(sys.argv[2]).parent
out = sys.argv[sys.argv.index("--out") + 1]
name = (folder / "robot.toml").read_text().strip()
said = json.loads(Path({said!r}).read_text())[name]
if sys.argv[1] == "diagnose":
    if said is None:
        sys.exit("no")
    Path(out).mkdir()
    Path(out, "diagnosis.json").write_text(json.dumps(said))
else:
    shutil.copy(Path({said!r}).parent / (name + ("-after" if "--with" in sys.argv else "-before") + ".parquet"), out)
"""


def test_the_summary_is_that_of_the_script_by_which_it_is_judged(tmp_path: Path) -> None:
    judge = JUDGE / "score_diagnosis.py"
    if not judge.is_file():
        pytest.skip(f"{judge} is not there, the script by which diagnoses are judged")
    rng, effects = np.random.default_rng(5), list(EFFECT_SIZES)
    names = ("motor_current", "motor_position", "joint_position")
    time = np.arange(50) * 1e-3
    labels, saids, rows = {}, {}, []
    robot = _robot()
    for k in range(40):
        folder = tmp_path / "cases" / f"case-{k:03d}"
        folder.mkdir(parents=True)
        (folder / "robot.toml").write_text(folder.name)
        truth = _truth(k, rng, effects)
        said = _said(truth, rng, effects)
        labels[folder.name], saids[folder.name] = {"verdict": truth, "snr": 12.0}, said
        scale = dict(zip(names, (0.01, 4.4e-4, 1.7e-6), strict=True))
        columns = {f"{name}_{j}": rng.standard_normal(50) * scale[name] * 9 for name in names for j in (1, 2)}
        held = {"time": time, **columns}
        write(held, folder / "hold_out.parquet")
        write({name: held[name] for name in held}, folder / "log.parquet")
        for which, factor in (("before", 20.0), ("after", rng.uniform(1.0, 25.0))):
            moved = {n: v + factor * scale[n.rpartition("_")[0]] * np.sin(60 * time) for n, v in columns.items()}
            write({"time": time, **moved}, tmp_path / f"{folder.name}-{which}.parquet")
        if said is None:
            continue  # the script leaves failures out of its rates
        gaps = {
            w: measure_replay_gap(tmp_path / f"{folder.name}-{w}.parquet", folder / "hold_out.parquet", robot.noise())
            for w in WHICH
        }
        rows.append(score_case(folder.name, label(*truth), told(*truth), {"seconds": 1.0} | gaps, said))
    (tmp_path / "cases" / "labels.json").write_text(json.dumps(labels))
    (tmp_path / "said.json").write_text(json.dumps(saids))
    program = tmp_path / "hdagen"
    program.write_text(STAND_IN.format(python=sys.executable, said=str(tmp_path / "said.json")))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    out = tmp_path / "scores.json"
    done = subprocess.run(
        [sys.executable, judge, program, tmp_path / "cases", "--json", out], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    expected, found = json.loads(out.read_text())["summary"], summarize_rows(rows)
    assert expected["failed"] == sum(said is None for said in saids.values()) > 0
    shared = set(expected) - {"cases", "failed", "seconds", "p_truth"}
    assert shared >= {"effect", "joint", "place", "top3", "false_alarm", "unknown_found", "pair_f1", "closed", "worse"}
    for name in shared:
        assert round(found[name].value, 4) == pytest.approx(expected[name], abs=1.1e-4), name


WHICH = ("before", "after")


def _robot() -> Any:
    from hdagen.blind.realities.two_joint_arms import draw_robots

    return draw_robots("any")[0]


def _truth(k: int, rng: np.random.Generator, effects: list[str]) -> list[str]:
    if k % 8 == 0:
        return []
    if k % 8 == 1:
        return [f"unknown@{rng.integers(1, 3)}"]
    chosen = rng.choice(effects, 2 if k % 8 == 2 else 1, replace=False)
    return [f"{one}@{0 if one == 'gravity_tilt' else rng.integers(1, 3)}" for one in chosen]


def _said(truth: list[str], rng: np.random.Generator, effects: list[str]) -> dict[str, Any] | None:
    if rng.random() < 0.1:
        return None
    verdict = truth if rng.random() < 0.5 else [f"{rng.choice([*effects, 'unknown'])}@{rng.integers(1, 3)}"]
    if rng.random() < 0.1:
        verdict = []
    place = (
        EFFECT_SIZES.get(truth[0].split("@")[0], EFFECT_SIZES["payload"]).place
        if truth and rng.random() < 0.7
        else "input"
    )
    said = diagnosis(verdict, round(float(rng.uniform(0.35, 0.99)), 3), place)
    said["causes"].append({"effect": "stiffness", "joint": 1, "probability": 0.01, "parameters": {}})
    if verdict and verdict[0].startswith("asymmetric"):
        said["causes"].append({"effect": "current_bias", "joint": int(verdict[0][-1]), "probability": 0.2})
    return said


# -- parameters, seal, calibration, page ------------------------------------------------------------------------------


def test_true_and_found_parameters_are_put_side_by_side() -> None:
    ripple = {"ripple_order": 7.0, "ripple_sine": 3e-3, "ripple_cosine": 4e-3}
    said = diagnosis(["torque_ripple@1"], 0.9)
    said["causes"][0]["parameters"] = {name: {"value": value, "std": 1e-3} for name, value in ripple.items()}
    truth = {"torque_ripple@1": {"order": 7.0, "torque": 4e-3}}
    right = score_case("x", label("torque_ripple@1"), {"snr": 1.0, "parameters": truth}, {}, said)
    wrong = replace(right, verdict=("payload@2",))
    lines = {line.compared.words: line for line in compare_parameters([right, wrong])}
    assert lines["order"].error.value == 0.0 and lines["order"].within.value == 1.0
    assert lines["torque"].pairs == ((4e-3, pytest.approx(5e-3)),) and lines["torque"].error.count == 1
    assert {one.effect for one in PARAMETER_COMPARISONS} >= set(EFFECT_SIZES) - {"asymmetric_friction", "current_bias"}


@pytest.mark.parametrize("stated", [0.02, 0.354])
def test_a_change_is_that_from_the_number_of_its_own_robot_file(stated: float) -> None:
    said = diagnosis(["viscous_friction@1"], 0.9)
    said["causes"][0]["parameters"] = {
        "viscous_friction": {"value": stated + 0.11, "std": 0.01, "unit": "N m s/rad", "file": stated}
    }
    truth = {"viscous_friction@1": {"coefficient": 0.1}}
    right = score_case("x", label("viscous_friction@1"), {"snr": 1.0, "parameters": truth}, {}, said)
    (line,) = compare_parameters([right])
    assert line.pairs == ((0.1, pytest.approx(0.11)),) and line.error.value == pytest.approx(0.1)


def test_a_seal_opens_for_its_labels_only() -> None:
    labels = {"a": label("payload@2"), "b": label()}
    closed = label_seal.seal_labels(labels, "s")
    label_seal.verify_seal(json.loads(json.dumps(labels)), "s", closed)
    assert label_seal.seal_labels(labels, "t") != closed and len(closed.digest) == 64
    with pytest.raises(label_seal.SealError, match="not those that were sealed"):
        label_seal.verify_seal(labels | {"b": label("payload@2")}, "s", closed)


@pytest.mark.parametrize(("true", "lapse"), [(0.5, 0.0), (1.0, 0.05), (3.0, 0.0), (3.0, 0.1)])
def test_temperature_and_lapse_are_found_again(true: float, lapse: float, tmp_path: Path) -> None:
    """Outcomes come from an even sequence, and are then as exact as many times as many drawn by chance."""
    case = np.random.default_rng(2).permutation(4000)
    log_odds = 4.0 + 3.0 * ndtri((case + 0.5) / 4000)
    right = case * (math.sqrt(5) - 1) / 2 % 1 < (1 - lapse) / (1 + np.exp(-log_odds / true))
    temperature, missed = calibrate.fit_calibration(log_odds, right)
    assert temperature == pytest.approx(max(true, 1.0), rel=0.1) and missed == pytest.approx(lapse, abs=0.02)
    assert calibrate.mean_log_loss(log_odds, right, temperature, missed) <= calibrate.mean_log_loss(
        log_odds, right, 1.0, 1e-3
    )
    rows = [
        row(["payload@2"], diagnosis(["payload@2" if hit else "stiffness@1"], float(1 / (1 + np.exp(-x)))))
        for x, hit in zip(log_odds[:400], right[:400], strict=True)
    ]
    source, out = tmp_path / "data.json", tmp_path / "calibration.json"
    source.write_text(calibrate.render_calibration_data(rows, "single", label_seal.hash_seed("s")))
    frozen = calibrate.freeze_calibration([source], out)
    assert frozen.temperature == pytest.approx(max(true, 1.0), rel=0.4) and frozen.temperature >= 1.0
    assert frozen.lapse == pytest.approx(lapse, abs=0.05) and frozen.lapse >= 1 / 402 and frozen.cases == 400
    assert frozen.loss_after <= frozen.loss_before - math.log1p(-1 / 402) and frozen.seeds == (
        label_seal.hash_seed("s"),
    )
    out.write_text(out.read_text().replace('"cases": 400', '"cases": 401'))
    with pytest.raises(calibration.CalibrationError, match="not as it was frozen"):
        calibration.read(out)


def test_few_cases_that_are_nearly_all_right_are_no_proof_of_more() -> None:
    log_odds, right = np.full(40, 12.0), np.ones(40, bool)
    assert calibrate.fit_calibration(log_odds, right)[1] == pytest.approx(1 / 42)


def test_too_little_to_calibrate_on_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "data.json"
    right = [row(["payload@2"], diagnosis(["payload@2"], 0.9))]
    for rows, words in ((right * 3, "too few"), (right * 40, "no temperature is best")):
        source.write_text(calibrate.render_calibration_data(rows, "single", label_seal.hash_seed("s")))
        with pytest.raises(calibration.CalibrationError, match=words):
            calibrate.freeze_calibration([source], tmp_path / "out.json")
    source.write_text('{"schema": 1}')
    with pytest.raises(calibration.CalibrationError, match="cannot be read"):
        calibrate.freeze_calibration([source], tmp_path / "out.json")
    assert not (tmp_path / "out.json").exists()


def _many(kind: str) -> list[Row]:
    rng, effects = np.random.default_rng(8), list(EFFECT_SIZES)
    truths = {"none": 0, "unknown": 1, "pair": 2, "unknown+one": 1}
    rows = []
    for k in range(24):
        truth = _truth(truths[kind], rng, effects) if kind in truths else [f"{effects[k]}@{k % 2 + 1}"]
        truth = [f"{effects[k]}@1", *truth] if kind == "unknown+one" else truth
        said = _said(truth, rng, effects)
        rows.append(row(truth, said, **({} if said else {"failed": "exit code 3: <b>no</b>"})))
    return rows


@pytest.mark.parametrize("kind", ["single", "none", "unknown", "unknown+one", "pair", "task"])
def test_the_page_and_the_json_of_every_kind(kind: str, tmp_path: Path) -> None:
    found = make_report(
        Check(kind, 24, "s", ClusterRequest(2), 10.0, tmp_path), label_seal.Seal("ab" * 32, 24), _many(kind)
    )
    content = json.loads(render_report(found), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert content["kind"] == kind and len(content["rows"]) == 24 and content["seal"] == "ab" * 32
    assert {bar["figure"] for bar in content["bars"]} <= set(content["summary"])
    blind_page.write_page(tmp_path / "blind.html", found)
    text = (tmp_path / "blind.html").read_text()
    assert "abab" in text and "<b>no</b>" not in text and text.count("<figure") >= 3


def test_what_a_kill_left_of_the_seal_is_no_other_check(tmp_path: Path) -> None:
    (tmp_path / ".seal.part-0123456789abcdef.json").write_text('{"seal": "ab')
    _claim_folder(Check("single", 1, "s", ClusterRequest(1), 10.0, tmp_path), label_seal.Seal("ab" * 32, 1))
    assert [path.name for path in tmp_path.iterdir()] == ["seal.json"]


def test_names_that_are_html_are_text(tmp_path: Path) -> None:
    rows = [replace(row, name=f"{row.name} {NAME}", failed=row.failed and NAME) for row in _many("single")]
    blind_page.write_page(
        tmp_path / "x.html",
        make_report(Check("single", 24, NAME, ClusterRequest(2), 10.0, Path(NAME)), label_seal.Seal(NAME, 24), rows),
    )
    check_escaped((tmp_path / "x.html").read_text(), 2)


@pytest.mark.parametrize("kind", ["single", "none", "unknown+one", "pair"])
def test_checks_of_one_kind_are_counted_together(kind: str, tmp_path: Path) -> None:
    rows = _many(kind)

    def check(some: list[Row], seed: str, kind: str = kind) -> dict[str, Any]:
        asked = Check(kind, len(some), seed, ClusterRequest(2), 10.0, tmp_path)
        return dict(json.loads(render_report(make_report(asked, label_seal.Seal("ab" * 32, len(some)), some))))

    def but_for_time(combined: dict[str, Any]) -> dict[str, Any]:
        return {name: figure for name, figure in combined["summary"].items() if name != "seconds"}

    slower = [replace(one, seconds=3.0) for one in rows[10:]]
    whole, parts = check(rows, "s"), [check(rows[:10], "a"), check(slower, "b")]
    together = rates.combine_checks([*parts, check(_many("task"), "c", "task")])
    assert rates.combine_checks([whole])[kind]["summary"] == whole["summary"]
    assert but_for_time(together[kind]) == but_for_time(whole)
    assert together[kind]["summary"]["seconds"]["value"] == 3.0  # of the last check
    assert together[kind]["summary"]["seconds"]["count"] == 14
    assert together[kind]["cases"] == 24 and [one["seed"] for one in together[kind]["checks"]] == ["a", "b"]
    grown = rates.combine_checks([rates.combine_checks([parts[0]]), parts[1]])
    assert grown[kind]["summary"] == together[kind]["summary"] and grown[kind]["rows"] == together[kind]["rows"]
    bare = {kind: {key: value for key, value in grown[kind].items() if key not in ("rows", "without_rows")}}
    more = check(_many(kind)[3:], "more")
    for first in (rates.combine_checks([bare]), bare):  # an earlier file that held no cases
        of_both = rates.combine_checks([first, more])[kind]
        exact = summarize_rows([*rows, *_many(kind)[3:]])
        assert of_both["cases"] == 45 and len(of_both["rows"]) == 21
        for name, figure in of_both["summary"].items():
            if name == "seconds":
                assert figure["value"] == 1.0 and figure["count"] == 21
            elif name in rates.UNPOOLED_FIGURES:
                assert figure == whole["summary"][name]  # of those that are more
            else:
                assert figure["count"] == exact[name].count
                assert [figure[key] for key in ("value", "low", "high")] == pytest.approx(
                    [exact[name].value, exact[name].low, exact[name].high], abs=1e-12
                )
    assert (
        set(together) == {kind, "task"} and rates.render_table(together).count("\n| one effect on a circle task |") >= 3
    )
    with pytest.raises(ValueError, match="a seed stands twice"):
        rates.combine_checks([whole, whole])
    with pytest.raises(ValueError, match="the probabilities were calibrated on s;"):
        rates.combine_checks([whole | {"seed_hash": calibration.read().seeds[0]}])


@pytest.mark.skipif(
    chromium.PROGRAM is None,
    reason="no Chromium is installed; `apt-get install chromium` brings what this test looks with",
)
@pytest.mark.parametrize("width", [400, 1000])
def test_the_page_opens_in_silence(tmp_path: Path, width: int) -> None:
    path = tmp_path / "blind.html"
    blind_page.write_page(
        path,
        make_report(
            Check("single", 24, "s", ClusterRequest(2), 10.0, tmp_path), label_seal.Seal("0" * 64, 24), _many("single")
        ),
    )
    with chromium.browser() as tab:
        tab.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        tab.open(path.as_uri())
        assert tab.run("document.documentElement.scrollWidth") <= width
        assert tab.run("document.querySelectorAll('figure').length") >= 7
        assert tab.messages == [] and tab.requests == [path.as_uri()]
