"""Where a gap lies and the report: truths put into simulated logs must be found at their place, with their size, in the
regime that they act in; statistics against independent references; the page in a browser."""

from __future__ import annotations

import base64
import json
import re
from collections import Counter
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import chromium
import numpy as np
import pytest
from catalogue import EFFECTS
from compiled import Compiled
from hostile_names import NAME, check_escaped
from replayed import FLEXIBLE, RIGID, RIGID_SEVERAL, simulated

from gen.effects import ALL
from gen.effects.file_numbers import FILE_NUMBERS
from gen.presets import find_presets
from hdagen.adoption.diagnosis_schema import SCHEMA
from hdagen.adoption.verdict import read_verdict
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion, mark_holdout_blocks
from hdagen.diagnosis.decision import separating_experiments
from hdagen.diagnosis.diagnosis_content import BLOCKS_TEXT
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.report import report_page
from hdagen.diagnosis.report.confounding import explain_confounding
from hdagen.diagnosis.report.effect_plots import draw_effect
from hdagen.diagnosis.report.effect_words import name_effect as in_words
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.report.residual_curves import average_in_bins
from hdagen.diagnosis.report.sentences import write_verdict
from hdagen.diagnosis.residuals.explanation_settings import EXPLANATION
from hdagen.diagnosis.residuals.localization import localize_gap
from hdagen.diagnosis.residuals.regressor_tests import (
    Regressor,
    explain_by_orders,
    explain_variance,
    find_concentrations,
)
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque, see_residual_torque
from hdagen.diagnosis.residuals.residual_trace import trace_residual
from hdagen.diagnosis.residuals.spectra import Spectra, find_loudest_band
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay, replay

Builder = Callable[..., Compiled]
NAMES = (*(one.name for one in ALL), *(one.name for one in FILE_NUMBERS))
TRUTHS = {  # what is put into a log, as name@joint, and in which words its regime must be named
    "coulomb_friction@2": ({"coulomb_friction": 0.045}, "motor's speed"),
    "stribeck_friction@2": ({"stribeck_torque": 0.02, "stribeck_speed": 5.0}, "motor's speed"),
    "torque_ripple@2": ({"ripple_sine": 0.008, "ripple_order": 2.0}, "angle within a turn of the motor"),
    "torque_constant@2": ({"torque_constant": 0.055}, "motor's input"),
    "current_bias@1": ({"bias": 0.01}, "same throughout"),
    "command_delay@1": ({"command_delay": 3e-3}, "rate of the motor's input"),
    "stiffness@2": ({"stiffness_level": 0.7}, "load on the transmission"),
    "transmission_hysteresis@2": ({"hysteresis_torque": 1.0, "hysteresis_angle": 1e-4}, "."),
    "cable_spring@2": ({"cable_stiffness": 10.0, "cable_rest": 0.0}, "joint's angle"),
    "gravity_tilt@0": ({"tilt_x": 0.8, "tilt_y": 0.3}, "."),
    "encoder_eccentricity@2": ({"eccentricity_sine": 5e-4}, "joint's angle"),
}
PLACES = {
    "coulomb_friction": "motor",
    "stribeck_friction": "motor",
    "torque_ripple": "motor",
    "torque_constant": "motor",
    "current_bias": "motor",
    "command_delay": "input",
    "stiffness": "transmission",
    "transmission_hysteresis": "transmission",
    "cable_spring": "link",
    "gravity_tilt": "link",
    "encoder_eccentricity": "sensor",
}


@pytest.fixture(scope="module")
def arm(build: Builder) -> Arm:
    """The flexible arm with every effect."""
    return Arm(build(FLEXIBLE, effects=tuple(effect.name for effect in ALL)).folder)


def content(arm: Arm, entries: dict[str, dict[str, float]], base: dict[str, float] | None = None) -> dict[str, Any]:
    """A diagnosis.json's content with a verdict and its parameters, and all that a report reads."""
    causes, verdict = [], list(entries)
    for k, (entry, values) in enumerate(entries.items()):
        effect, _, joint = entry.partition("@")
        other = ["backlash@2"] if not k else []
        parameters = {name: {"value": v, "std": 0.01 * abs(v), "unit": "1", "end": None} for name, v in values.items()}
        causes.append({"effect": effect, "joint": int(joint), "probability": 0.9, "parameters": parameters})
        causes[-1] |= {
            "confounded_with": other,
            "separate_by": separating_experiments.suggest_experiments(EFFECTS, entry, other),
        }
    return {
        "schema": SCHEMA,
        "verdict": verdict,
        "sure": True,
        "causes": causes,
        "hypotheses": [{"effects": verdict, "probability": 0.9}, {"effects": ["backlash@2"], "probability": 0.1}],
        "parameters": {
            name: {"value": v, "std": 0.01 * abs(v), "unit": "1", "end": None} for name, v in (base or {}).items()
        },
        "undetectable": ["torque_constant@2"],
        "doubts": None,
        "contradicted": None,
        "moments": [],
        "direct_evidence": [],
        "nuisance_effects": [],
        "small": [],
        "remains": [],
        "as_good_as_it_gets": False,
        "ranking": [
            {"model": "robot file", "effects": [], "probability": None, "gap": 20.0, "interval": [18.0, 22.0]},
            {"model": "hypothesis", "effects": [], "probability": 0.1, "gap": 12.0, "interval": [11.0, 13.0]},
            {"model": "verdict", "effects": verdict, "probability": 0.9, "gap": 2.0, "interval": None},
        ],
        "control": {
            "law": "impedance_joint",
            "tracking": {"before": 5.76e-4, "after": 4.22e-4},
            "contact_force": {"before": 2.7, "after": 2.68},
        },
        "robot": {"name": "test <arm>", "sha256": "0" * 64},
        "method": {"calibrated": False},
        "data": {
            "log": "log.csv",
            "rate": 1e3,
            "duration": 1.0,
            "held_out": BLOCKS_TEXT,
            "notes": ["a note <b>"],
            "warnings": ["a warning"],
            "repaired": [{"log": "log.csv", "name": "wrap", "joint": 1, "what": "a repair"}],
            "missing": ["joint_torque_1 is not logged"],
            "channels": {"motor_position_1": {"low": -1.0, "high": 1.0, "noise": 1e-3, "step": 0.0}},
            "lags": {"motor_current_1": 1e-3},
        },
    }


def seen(
    arm: Arm,
    truth: dict[str, dict[str, float]],
    seconds: float = 1.5,
    keep: str = ".",
    base: dict[str, float] | None = None,
) -> tuple[ResidualTorque, dict[str, Any], Log, Replay, Replay]:
    """A log with ``truth`` and ``base`` in it, of the channels that ``keep`` matches, diagnosed as it is."""
    arm.parameters.reset()
    for entry, values in truth.items():
        joint = entry.partition("@")[2]
        arm.parameters.update({f"{k}_{joint}" if joint != "0" else k: v for k, v in values.items()})
    arm.parameters.update(base or {})
    log = simulated(arm, seconds)
    log = Log(log.time, {k: v for k, v in log.columns.items() if re.search(keep, k)}, log.n_joints, log.source)
    arm.parameters.reset()
    return judge(arm, truth, log, base)


def judge(
    arm: Arm, truth: dict[str, dict[str, float]], log: Log, base: dict[str, float] | None = None
) -> tuple[ResidualTorque, dict[str, Any], Log, Replay, Replay]:
    """A log, diagnosed as ``truth`` and ``base``."""
    said = content(arm, truth, base)
    before, after = replay(arm, log), replay(arm, log, with_=said)
    multiples = {
        name: {when: r.errors[name] / r.noise[name] for when, r in (("before", before), ("after", after))}
        | {"noise": before.noise[name]}
        for name in before.errors
        if before.noise[name]
    }
    said["gap"] = {
        "before": before.gap,
        "after": after.gap,
        "floor": 1.0,
        "flexible": 1.2,
        "achievable": 1.1,
        "shrink": 0.95,
    }
    said["gap"] |= {"interval": [0.9, 0.97], "by_channel": multiples}
    sight = see_residual_torque(arm, read_verdict(said), log, before, after)
    said["where"] = localize_gap(sight, said["verdict"], np.ones(len(sight.motion.log), bool))
    return sight, said, log, before, after


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


# -- where ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", TRUTHS)
def test_a_truth_is_where_it_was_put_and_its_balance_closes(arm: Arm, entry: str) -> None:
    values, regime = TRUTHS[entry]
    effect, _, joint = entry.partition("@")
    sight, said, *_ = seen(arm, {entry: values})
    found = said["where"]
    assert [(w["joint"], w["place"], w["share"]) for w in found] == [(int(joint), PLACES[effect], 1.0)]
    assert re.search(regime, found[0]["when"]), found[0]["when"]
    assert "rms" in found[0]["when"] and found[0]["when"].endswith(".")
    shown = trace_residual(sight, PLACES[effect], max(int(joint), 1), entry)
    assert rms(shown.after) < 0.5 * rms(shown.before)
    assert np.corrcoef(shown.before - shown.after, shown.effect_part)[0, 1] > 0.99 or np.ptp(shown.effect_part) < 1e-3
    assert rms(shown.before - shown.after - shown.effect_part) < 0.1 * rms(shown.effect_part)


def test_shares_sum_to_one_and_base_parameters_have_theirs(arm: Arm) -> None:
    mass = arm.parameters.described["mass_2"].nominal
    truth = {"coulomb_friction@1": {"coulomb_friction": 0.06}, "cable_spring@2": {"cable_stiffness": 10.0}}
    _, said, *_ = seen(arm, truth, base={"mass_2": 1.1 * mass})
    found = said["where"]
    assert [(w["joint"], w["place"]) for w in found] == [(1, "motor"), (2, "link"), (2, "link")]
    assert sum(w["share"] for w in found) == pytest.approx(1.0, abs=1e-3)
    assert all(w["share"] > 0.02 for w in found)
    assert "mass" in found[2]["when"] and "tolerance" in found[2]["when"]
    assert re.search(r"without them \d of 2 s of motion are told worse \(p = ", found[2]["when"])


def test_what_comes_back_with_the_motor_has_its_order_and_its_band(arm: Arm) -> None:
    """Of six waves a turn, the means over an eighth of a turn each show nothing."""
    ripple = {"ripple_sine": 0.008, "ripple_order": 6.0}
    _, said, *_ = seen(arm, {"torque_ripple@2": ripple}, seconds=4.0)
    when = said["where"][0]["when"]
    assert "goes with the angle within a turn of the motor, 6 times a turn, which explains " in when
    assert re.search(r"Of its energy, \d+ % lies between [\d.]+ and [\d.]+ Hz, where \d+ % follows .* \(p = ", when)


def test_nothing_named_and_nothing_moved_has_no_place(arm: Arm) -> None:
    assert seen(arm, {})[1]["where"] == []


def test_an_unknown_gap_has_the_side_that_misses_torque(arm: Arm) -> None:
    for entry, values, place in (
        ("coulomb_friction@2", {"coulomb_friction": 0.08}, "motor"),
        ("cable_spring@2", {"cable_stiffness": 30.0}, "link"),
    ):
        _, said, log, before, _ = seen(arm, {entry: values})
        said |= {"verdict": ["unknown@2"], "parameters": {}}
        sight = see_residual_torque(arm, read_verdict(said), log, before, before)
        (found,) = localize_gap(sight, said["verdict"], np.ones(len(sight.motion.log), bool))
        assert (found["joint"], found["place"]) == (2, place)
        assert 0.3 < found["share"] <= 1.0
        assert draw_effect(sight, "unknown@2", place)


@pytest.mark.parametrize(
    ("entry", "values"),
    [
        ("cable_spring@2", {"cable_stiffness": 30.0}),
        ("viscous_friction@2", {"viscous_friction": 1e-3}),
        ("stiffness@2", {"stiffness_level": 0.6}),
    ],
)
def test_a_picture_tells_how_far_the_effect_is_what_it_shows(arm: Arm, entry: str, values: dict[str, float]) -> None:
    sight, said, log, before, _ = seen(arm, {entry: values}, seconds=3.0)
    (place,) = (one["place"] for one in said["where"])
    (picture,) = draw_effect(sight, entry, place)
    shown = picture.markup
    right = float(re.findall(r"R² = (-?[0-9.]+)", shown)[0])
    assert right > 0.5 and "Warning" not in shown
    nominal = {name: arm.parameters.described[f"{name}_{entry[-1]}"].nominal for name in values}
    quarter = {name: nominal[name] + 0.25 * (value - nominal[name]) for name, value in values.items()}
    said = content(arm, {entry: quarter})
    (picture,) = draw_effect(
        see_residual_torque(arm, read_verdict(said), log, before, replay(arm, log, with_=said)), entry, place
    )
    shown = picture.markup
    assert "Warning: the log shows" in shown and picture.agreement and picture.agreement.is_contradicted
    assert float(re.findall(r"R² = (-?[0-9.]+)", shown)[0]) < right


def test_one_encoder_a_joint_gives_the_balance_of_the_whole_joint(arm: Arm) -> None:
    entry, values = "coulomb_friction@2", {"coulomb_friction": 0.08}
    sight, said, *_ = seen(arm, {entry: values}, keep="motor|force")
    assert not sight.motion.has_both_sides
    assert (said["where"][0]["joint"], said["where"][0]["place"]) == (2, "motor")
    shown = trace_residual(sight, "motor", 2, entry)
    excess = 0.08 - arm.parameters.described["coulomb_friction_2"].nominal
    slides = sight.motion.is_sliding(2)[shown.instants]
    direction = sight.motion.direction[shown.instants, 1][slides]
    assert -np.mean(shown.before[slides] * direction) == pytest.approx(excess, rel=0.15)


def test_a_rigid_arm_has_its_balance(build: Builder, tmp_path: Path) -> None:
    arm = Arm(build(RIGID, effects=RIGID_SEVERAL).folder)
    sight, said, *_ = all_ = seen(arm, {"cable_spring@1": {"cable_stiffness": 3.0, "cable_rest": -1.5}})
    assert (said["where"][0]["joint"], said["where"][0]["place"]) == (1, "link")
    shown = trace_residual(sight, "link", 1, "cable_spring@1")
    assert np.corrcoef(shown.before - shown.after, shown.effect_part)[0, 1] > 0.99
    write(all_, arm, tmp_path / "report.html")


# -- regimes ----------------------------------------------------------------------------------------------------------


def slow(rng: np.random.Generator, count: int, width: int = 40) -> Array:
    """Noise with a memory, as signals of an arm have it."""
    kernel = np.ones(width) / width
    return np.asarray(np.convolve(rng.standard_normal(count + width - 1), kernel, "valid") * np.sqrt(width))


def test_the_regressor_that_made_a_quantity_explains_it() -> None:
    rng = np.random.default_rng(0)
    speed, load, time = slow(rng, 4000), slow(rng, 4000), np.linspace(0, 1, 4000)
    quantity = np.sign(speed) + 0.2 * rng.standard_normal(4000)
    given = [Regressor("load", "N m", load, True), Regressor("speed", "rad/s", speed, True)]
    given.append(Regressor("t", "s", time))
    best = explain_variance(quantity, [*given, Regressor("none", "1", np.ones(4000))])
    assert best[0].regressor.name == "speed" and len(best) == 3
    assert best[0].share > 0.8 and best[0].p == pytest.approx(4 / 1000)
    assert all(e.p > 0.05 for e in best[1:])
    energy = np.where(np.abs(load) > np.quantile(np.abs(load), 0.9), 1.0, 0.0)
    sits = find_concentrations(energy, given)[0]
    assert (sits.regressor.name, sits.is_below) == ("load", False) and sits.p == pytest.approx(3 / 1000)
    assert sits.share == pytest.approx(0.1 * 4000 / energy.sum(), rel=0.05)
    assert sits.edge == pytest.approx(np.quantile(np.abs(load), 7 / 8), rel=0.05)


def test_a_quantity_that_goes_with_nothing_is_rarely_said_to() -> None:
    false = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        tried = [Regressor("x", "1", slow(rng, 2000)) for _ in range(5)]
        false += min(e.p for e in explain_variance(slow(rng, 2000), tried)) <= 0.05
        false += min(c.p for c in find_concentrations(slow(rng, 2000) ** 2, tried)) <= 0.05
    assert false <= 14  # of 120; 6 are expected, and more than 14 have a chance of 1 in 1000


def test_samples_that_are_fewer_than_what_is_fitted_tell_nothing() -> None:
    """Each in a bin of its own would be explained in full, and so would three by a sine, a cosine and a mean."""
    rng = np.random.default_rng(5)
    for count in (2, 3, 8):
        values, angle = rng.standard_normal(count), 7.0 * np.arange(count).astype(float)
        assert explain_variance(values, [Regressor("x", "1", angle)]) == []
        assert explain_by_orders(values, angle, [1, 2]) == []
    shares = [
        explain_variance(rng.standard_normal(10), [Regressor("x", "1", np.arange(10.0))])[0].share for _ in range(20)
    ]
    assert max(shares) < 0.9  # two bins


@pytest.mark.parametrize("count", [64, 300, 500, 501, 1000])
def test_few_samples_tell_what_they_can(count: int) -> None:
    """As many shifts as samples, none of them twice."""
    x = np.arange(float(count))
    tried = [Regressor("x", "1", x), Regressor("y", "1", (7 * x) % 5)]
    best = explain_variance(np.where(x >= count // 2, 1.0, -1.0), tried)[0]
    assert best.regressor.name == "x" and best.share > 0.9
    assert 2 / count <= best.p <= (1.0 if count < 65 else 0.05)
    sits = find_concentrations(np.where(x > 0.9 * count, 1.0, 0.0), tried)
    assert [one.regressor.name for one in sits[:1]] == (["x"] if count > 2 else [])


def test_energy_that_is_not_there_concentrates_nowhere() -> None:
    assert find_concentrations(-np.ones(100), [Regressor("x", "1", np.arange(100.0))]) == []


# -- spectra, means ----------------------------------------------------------------------------------------


def test_a_spectrum_has_the_density_of_its_noise_and_the_coherence_of_its_source() -> None:
    rng = np.random.default_rng(2)
    source, own = rng.standard_normal((2, 60_000))
    found, of_source = Spectra.from_series(2.0 * source + own, 1e-3), Spectra.from_series(source, 1e-3)
    inside = (found.frequency > 5) & (found.frequency < 495)
    assert np.mean(found.density[inside] ** 2) == pytest.approx(2 * 5.0 * 1e-3, rel=0.03)
    assert np.mean(found.coherence(of_source)[inside]) == pytest.approx(0.8, abs=0.02)
    assert np.mean(Spectra.from_series(own, 1e-3).coherence(of_source)[inside]) < 0.03


def test_the_loudest_octave_and_its_chance_are_those_of_what_is_there() -> None:
    """A sine in noise that follows the source, and one that does not."""
    rng, time = np.random.default_rng(4), np.arange(20_000) / 1e3
    source = rng.standard_normal(20_000)
    passed = (Spectra.from_series(source, 1e-3).frequency > 0) & (Spectra.from_series(source, 1e-3).frequency <= 25.0)
    tone = np.sin(2 * np.pi * 5.0 * time)
    for own, follows in ((source + 3.0 * tone, True), (source, False)):
        band = find_loudest_band(
            Spectra.from_series(tone + 0.01 * rng.standard_normal(20_000), 1e-3), Spectra.from_series(own, 1e-3), passed
        )
        assert band is not None and (band.low, band.high) == (4.0, 8.0) and band.share > 0.95
        assert (band.p < 1e-6 and band.coherence > 0.9) if follows else band.p > 0.05
    assert (
        find_loudest_band(Spectra.from_series(np.zeros(20_000), 1e-3), Spectra.from_series(source, 1e-3), passed)
        is None
    )
    chances = []
    for _ in range(200):
        one, other = (Spectra.from_series(rng.standard_normal(10_000), 1e-3) for _ in range(2))
        band = find_loudest_band(one, other, passed)
        assert band is not None
        chances.append(band.p)
    assert np.mean(np.array(chances) < 0.05) < 0.06  # never surer than it is


def test_the_order_of_what_comes_back_with_an_angle_is_found_and_nothing_in_what_does_not() -> None:
    rng = np.random.default_rng(6)
    angle = np.cumsum(0.02 * (1.0 + 0.5 * slow(rng, 6000, 400)))
    quantity = 0.4 * np.cos(3 * angle + 0.7) + 0.1 * slow(rng, 6000)
    first, *rest = explain_by_orders(quantity, angle, range(1, 13))
    assert first.order == 3 and first.p < 0.02 and first.share == pytest.approx(0.08 / 0.09, abs=0.05)
    assert all(one.share < 0.3 for one in rest)
    hits = sum(
        explain_by_orders(slow(rng, 2000), np.cumsum(np.full(2000, 0.02)), range(1, 13))[0].p
        <= EXPLANATION.significance_level
        for _ in range(60)
    )
    assert hits <= 6
    assert explain_by_orders(quantity, 0.001 * angle, range(1, 13)) == []  # no two turns: nothing can come back


def test_means_keep_the_two_sides_of_standstill_apart() -> None:
    x = np.linspace(-1, 2, 20_001)
    middle, mean = average_in_bins(x, np.sign(x), split=True)
    told = ~np.isnan(mean)
    assert np.array_equal(mean[told], np.sign(middle[told])) and np.isnan(mean[middle == 0]).all()
    assert told.sum() > 30


# -- what separates ---------------------------------------------------------------------------------------------------


def test_any_two_effects_have_an_experiment_that_parts_them() -> None:
    """Of their group, else what shows either, with both by name; asked from the other one's side, too."""
    for pair in combinations(NAMES, 2):
        one, other = (f"{name}@1" for name in pair)
        said = separating_experiments.suggest_experiments(EFFECTS, one, [other])
        assert said.startswith(f"Against {other}: ") and said.endswith(".")
        if EFFECTS.find_group_experiment(*pair) is None:
            back = separating_experiments.suggest_experiments(EFFECTS, other, [one])
            for name in pair:
                experiment = EFFECTS[name].experiment
                told = f"{experiment.action} ({name.replace('_', ' ')} {experiment.observation})"
                assert told in said and told in back
    said = separating_experiments.suggest_experiments(
        EFFECTS, "contact@1", ["command_delay@1", "payload@2", "command_delay@2"]
    )
    assert said.count("Against") == 1 and said.count("command delay") == 1 == said.count("(contact ")


def test_each_effect_shows_in_a_way_of_its_own() -> None:
    assert set(EFFECTS) == set(NAMES)
    assert len({traits.experiment.observation for traits in EFFECTS.values()}) == len(NAMES)


def test_what_is_not_confounded_needs_no_experiment_and_each_stands_once() -> None:
    assert separating_experiments.suggest_experiments(EFFECTS, "payload@2", []) == ""
    said = separating_experiments.suggest_experiments(EFFECTS, "payload@2", ["torque_constant@1", "torque_constant@2"])
    assert said.count("payload") == 1 and "torque_constant@1, torque_constant@2" in said
    assert separating_experiments.SAME_EFFECT_EXPERIMENT in separating_experiments.suggest_experiments(
        EFFECTS, "coulomb_friction@1", ["coulomb_friction@2"]
    )


def test_every_effect_that_another_one_names_exists_and_every_group_has_two() -> None:
    named = {name for traits in EFFECTS.values() for name in (*traits.twins, traits.presupposes) if name}
    assert named <= set(NAMES)
    members = Counter(group for traits in EFFECTS.values() for group in traits.confusion_groups)
    assert set(members) == set(EFFECTS.group_experiments) and min(members.values()) > 1


# -- the page ---------------------------------------------------------------------------------------------------------


def write(
    all_: tuple[ResidualTorque, dict[str, Any], Log, Replay, Replay],
    arm: Arm,
    path: Path,
    robot: str = "robot.toml",
    log_name: str = "log.csv",
) -> str:
    sight, said, log, before, after = all_
    held_out = LogPortion(log, mark_holdout_blocks(log.time))
    seen = HoldoutMotion(held_out, lambda _: before, before, before, before)
    held = SimpleNamespace(content=said, after=after, holdout=seen)
    held.residual_torque = sight
    files = DiagnosedFiles(robot, (log_name,), (), path.parent)
    report_page.write_report(held, path, files)  # type: ignore[arg-type]
    return path.read_text(encoding="utf-8")


def test_names_that_are_html_are_text(arm: Arm, tmp_path: Path) -> None:
    all_ = seen(arm, {"cable_spring@2": TRUTHS["cable_spring@2"][0]})
    _, said, *_ = all_
    said["robot"]["name"] = said["data"]["log"] = NAME
    said["data"]["repaired"] = [
        {"log": NAME, "name": "contradicted", "joint": 1, "what": f"column {NAME} is left out."}
    ]
    for kind in ("notes", "warnings", "missing"):
        said["data"][kind] = [f"column {NAME} is read as motor_position_1"]
    said["joints"] = [NAME, NAME]
    write(all_, arm, tmp_path / "report.html", NAME, NAME)
    check_escaped((tmp_path / "report.html").read_text(encoding="utf-8"), 6)


@pytest.mark.parametrize(
    "entry", ["stribeck_friction@2", "command_delay@1", "transmission_hysteresis@2", "gravity_tilt@0"]
)
def test_a_report_says_and_shows_it_all(arm: Arm, tmp_path: Path, entry: str) -> None:
    all_ = seen(arm, {entry: TRUTHS[entry][0]})
    page = write(all_, arm, tmp_path / "report.html")
    name = entry.partition("@")[0].replace("_", " ").capitalize()
    for words in (  # of every part
        "All channels over time",
        "not calibrated",
        "Windows of 0.25 s decided which known effect is the most probable",
        "correction without structure",
        "The leading models on held-out motion",
        "refitted numbers alone (0.10)",
        "12 [11, 13]",
        "Where and when",
        "The effect itself",
        "hdagen adopt",
        "hdagen export mjcf",
        "a repair",
        name,
    ):
        assert words in page
    assert "Against backlash on joint 2" in page and "test &lt;arm&gt;" in page
    assert "p = " not in re.sub("<script.*?</script>", "", page, flags=re.DOTALL)
    assert "a note &lt;b&gt;" in page
    assert "[90, 97]" in write_verdict(json.loads(json.dumps(seen(arm, {})[1]))) and len(page) < 5_000_000


def test_a_page_of_ten_seconds_of_two_joints_has_at_most_1200_kilobytes(arm: Arm, tmp_path: Path) -> None:
    write(seen(arm, {"coulomb_friction@2": {"coulomb_friction": 0.045}}, seconds=10.0), arm, tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 1.2e6


@pytest.mark.campaign
def test_a_page_of_a_minute_of_seven_joints_has_at_most_three_megabytes(build: Builder, tmp_path: Path) -> None:
    """A Panda with friction in its fourth joint, by MuJoCo."""
    pytest.importorskip("mujoco")
    from hdagen.blind.realities.model_arms import ModelRobot, draw_space_motion
    from hdagen.blind.realities.model_reality import simulate_space_arm

    text, rng = ModelRobot(find_presets()["panda"].read_text()), np.random.default_rng(2)
    friction = {("coulomb_friction", 4): {"torque": 6.0}}
    motion = draw_space_motion(rng, text.table, 60.0)
    columns = simulate_space_arm(text.table, text.table, motion, rng, friction)
    log = Log(columns.pop("time"), columns, 7, "a minute")
    panda = Arm(build(text.toml()).folder)
    write(judge(panda, {"coulomb_friction@4": {"coulomb_friction": 6.0}}, log), panda, tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size < 3e6


def test_only_what_long_windows_told_says_so(arm: Arm, tmp_path: Path) -> None:
    told = seen(arm, {"coulomb_friction@2": {"coulomb_friction": 0.045}})
    told[1]["method"]["calibrated"] = True
    page = write(told, arm, tmp_path / "report.html")
    assert "decided which known" not in page and "not calibrated" not in page


def test_a_report_without_a_verdict_says_so_and_shows_what_is_left(arm: Arm, tmp_path: Path) -> None:
    none = seen(arm, {})
    page = write(none, arm, tmp_path / "report.html")
    assert "No effect above the size that counts was found" in page and "by what it goes with" in page
    assert "On held-out motion the gap goes from" in write_verdict(none[1])
    mass = {"mass_1": {"value": 1.0, "std": 0.1, "unit": "kg", "end": None}}
    assert "Base parameters within their tolerance take the gap on held-out motion from" in write_verdict(
        none[1] | {"parameters": mass}
    )


@pytest.mark.parametrize(
    ("verdict", "says"),
    [
        (
            ["payload@2"],
            ": of the known effects, payload on joint 2 explains most of the log, but leaves 95 % of what this joint",
        ),
        (
            [],
            ": the model that explains most of the log names none and leaves 95 % of what this joint errs by on held-",
        ),
    ],
)
def test_what_did_not_stand_on_held_out_motion_is_said(arm: Arm, verdict: list[str], says: str) -> None:
    said = seen(arm, {})[1] | {"verdict": ["unknown@2"], "sure": False}
    assert write_verdict(said).startswith("Joint 2 misses something that no known effect explains; this is not sure.")
    doubted = write_verdict(said | {"doubts": {"verdict": verdict, "joint": 2, "left": 0.95}})
    assert doubted.startswith(f"Joint 2 misses something that no known effect explains{says}")


def test_what_is_sure_beside_something_unknown_is_said_and_has_its_place(arm: Arm, tmp_path: Path) -> None:
    named = "sensor_delay@2"
    sight, said, log, before, after = seen(arm, {named: {"sensor_delay": 4e-3}})
    read_off = {"effect": "sensor_delay", "joint": 2, "parameters": {"sensor_delay": 4e-3}, "left": 0.07}
    said |= {"verdict": [named, "unknown@2"], "sure": False, "direct_evidence": [read_off]}
    assert write_verdict(said).startswith("Sensor delay on joint 2 is missing in the model (found 0.004000 ± 0.000040")
    said["where"] = localize_gap(sight, said["verdict"], np.ones(len(sight.motion.log), bool))
    assert [(w["joint"], w["place"]) for w in said["where"][:2]] == [(2, "sensor"), (2, "motor")]
    page = write((sight, said, log, before, after), arm, tmp_path / "page.html")
    assert (
        "Sensor delay on joint 2 is missing in the model (found 0.004000 ± 0.000040" in page
        and "What commands and encoders show by themselves" in page
    )


def test_a_parameter_at_the_end_of_its_range_is_said(arm: Arm, tmp_path: Path) -> None:
    all_ = seen(arm, {"payload@2": {"payload_mass": 1.2}})
    assert "the end of" not in write_verdict(all_[1]) and "at the end of its range" not in write(
        all_, arm, tmp_path / "1.html"
    )
    all_[1]["causes"][0]["parameters"]["payload_mass"]["end"] = "high"
    said = "At the end of what it may be: payload mass of payload on joint 2, 1.2. There may be more of it"
    assert said in write_verdict(all_[1]) and "at the end of its range" in write(all_, arm, tmp_path / "2.html")


def test_what_is_tolerated_and_closes_more_is_shown(arm: Arm, tmp_path: Path) -> None:
    all_ = seen(arm, {})
    assert "Within tolerance, and not named" not in write(all_, arm, tmp_path / "report.html")
    tilt = {"tilt_x": {"value": 0.0306, "std": 0.0018, "unit": "m/s²"}}
    all_[1]["nuisance_effects"] = [
        {"effect": "gravity_tilt", "joint": 0, "parameters": tilt, "size": 0.037, "gap": 15.2}
    ]
    page = write(all_, arm, tmp_path / "report.html")
    assert "Within tolerance, and not named" in page and "tilt x 30.6 mm/s²" in page and "15.2" in page
    said = {**all_[1], "gap": {**all_[1]["gap"], "after": 40.0}}
    assert write_verdict(said).endswith(
        "Within what is tolerated, gravity tilt of the whole arm would bring it to 15.2."
    )
    assert "tolerated" not in write_verdict({**said, "gap": {**said["gap"], "after": 16.0}})


def test_a_parameter_that_the_data_say_nothing_of_is_marked(arm: Arm, tmp_path: Path) -> None:
    all_ = seen(arm, {"cable_spring@2": {"cable_stiffness": 10.0}}, base={"mass_2": 2.502})
    q = arm.parameters.described["mass_2"]
    all_[1]["parameters"]["mass_2"]["std"] = q.tolerance * q.nominal
    page = write(all_, arm, tmp_path / "report.html")
    assert "The log says nothing of these, which keep the file&#x27;s number: mass, joint 2." in page
    row = re.search(r"<tr>[^/]*cable stiffness, joint 2</[^/]*/td><td>.*?much.*?</tr>", page)
    assert row and "mass" not in row[0]


CHART_MIDDLE = """(() => {
  const chart = document.querySelector(".uplot .u-over");
  chart.scrollIntoView({ block: "center" });
  const box = chart.getBoundingClientRect();
  return [box.left + 0.4 * box.width, box.top + 0.5 * box.height];
})()"""


@pytest.mark.skipif(chromium.PROGRAM is None, reason="no Chromium is installed")
def test_the_page_is_silent_and_asks_for_nothing(arm: Arm, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write(seen(arm, {"torque_ripple@2": TRUTHS["torque_ripple@2"][0]}), arm, path)
    with chromium.browser() as tab:
        for scheme in ("light", "dark"):
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            tab.call("Emulation.setEmulatedMedia", media="screen", features=features)
            tab.messages.clear()
            tab.requests.clear()
            tab.open(path.as_uri())
            assert tab.run("document.querySelectorAll('figure').length") >= 10
            assert tab.run("document.querySelectorAll('figure .tools button').length") >= 15
            assert tab.run("document.querySelectorAll('.uplot canvas').length") == 6
            assert tab.run("document.querySelectorAll('.still').length") == 0
            left, top = tab.run(CHART_MIDDLE)
            tab.mouse("mouseMoved", left, top)  # one cursor for all channels
            told = tab.run("[...document.querySelectorAll('.u-series:first-child .u-value')].map((v) => v.textContent)")
            assert len(told) == 6 and len(set(told)) == 1 and told[0].endswith(" s")
            shot = base64.b64decode(tab.call("Page.captureScreenshot")["data"])
            assert len(shot) > 10_000
            assert tab.messages == [] and tab.requests == [path.as_uri()]


FIRST_SCREEN = 700  # px
TEXT_ABOVE = """(() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), seen = [];
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const range = document.createRange();
    range.selectNodeContents(node);
    const boxes = [...range.getClientRects()];
    if (boxes.length && boxes.every((box) => box.bottom <= %d)) seen.push(node.textContent);
  }
  return seen.join(" ");
})()"""


@pytest.mark.skipif(chromium.PROGRAM is None, reason="no Chromium is installed")
def test_the_first_screen_is_the_answer(arm: Arm, tmp_path: Path) -> None:
    """What, where, how much, how sure, what to do: as text within the first 700 pixels on a desk and on a phone."""
    friction = arm.parameters.described["coulomb_friction_2"].nominal
    all_ = seen(arm, {"coulomb_friction@2": {"coulomb_friction": 2.6 * friction}})
    said = all_[1]
    said["causes"][0]["parameters"]["coulomb_friction"] |= {"unit": "N m", "file": friction}
    said["parameters"] = {"mass_2": {"value": 2.6, "std": 0.1, "unit": "kg", "end": None, "file": 2.5}}
    said["joints"] = [None, "elbow_joint"]
    write(all_, arm, tmp_path / "report.html")
    own = said["where"][0]["share"]
    with chromium.browser() as tab:
        for width in (1280, 400):
            tab.call(
                "Emulation.setDeviceMetricsOverride",
                width=width,
                height=FIRST_SCREEN,
                deviceScaleFactor=1,
                mobile=False,
            )
            tab.open((tmp_path / "report.html").as_uri())
            shown = " ".join(tab.run(TEXT_ABOVE % FIRST_SCREEN).split())
            for words in (
                "Coulomb friction on elbow_joint (2) is too small in the file by 2.6 times",  # what, where, how much
                "N m)",
                "Sure: 0.90",  # how sure: of the effect, and of the set
                "0.90 that exactly this is",
                "joint position of elbow_joint (2), rms on held-out motion",  # the error in its unit and in noise
                "rad",
                "times the noise over all channels",
                "95 % [90, 97]",  # what is closed, by the effect and by refitted numbers
                f"of that {100 * min(own, 1):.0f} % by the effect",
                "Adopt it",  # what to do
                "parameter file found ± change unit",
                "× 2.6",
            ):
                assert words in shown, (width, words)
            if width == 1280:
                assert "hdagen adopt" in shown
            assert tab.run("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("count", [1, REPORT.most_named_alternatives, REPORT.most_named_alternatives + 1, 28])
def test_of_what_an_effect_may_also_be_the_nearest_are_named(count: int) -> None:
    others = [f"{effect.name}@1" for effect in ALL][:count]
    cause = {"effect": "sensor_delay", "joint": 2, "probability": 0.6, "confounded_with": others, "separate_by": "-"}
    said = explain_confounding(EFFECTS, {"verdict": ["sensor_delay@2"], "causes": [cause], "undetectable": []})
    first = said.split("may also be ")[1].split(". ")[0]
    assert [o for o in others if in_words(o) in re.split(", (?!or one of)|, or", first)] == others[
        : REPORT.most_named_alternatives
    ]
    assert (f"{count - REPORT.most_named_alternatives} others" in said) == (count > REPORT.most_named_alternatives)
    assert (
        re.sub(
            r"\w+@\d",
            lambda found: in_words(found[0]),
            separating_experiments.suggest_experiments(
                EFFECTS, "sensor_delay@2", others[: REPORT.most_named_alternatives]
            ),
        )
        in said
    )


def test_where_nothing_is_named_each_candidate_and_each_experiment_stands_once() -> None:
    likely = {"stribeck_friction@1": 0.2, "presliding_friction@1": 0.1, "payload@2": 0.05, "contact@1": 0.001}
    causes = [
        {"effect": name[:-2], "joint": int(name[-1]), "probability": p, "confounded_with": [*{*likely} - {name}]}
        for name, p in likely.items()
    ]
    said = explain_confounding(EFFECTS, {"verdict": [], "contradicted": None, "causes": causes, "undetectable": []})
    for name in (
        "Stribeck friction on joint 1 (0.20)",
        "presliding friction on joint 1 (0.10)",
        "payload on joint 2 (0.05)",
    ):
        assert said.count(name) == 1
    assert said.count("Against payload on joint 2: ") == 1 and "contact" not in said
    for few in (causes[:1], causes[3:]):
        assert "Against" not in explain_confounding(
            EFFECTS, {"verdict": [], "contradicted": None, "causes": few, "undetectable": []}
        )
    assert "payload" not in explain_confounding(
        EFFECTS, {"verdict": [], "contradicted": None, "causes": causes, "undetectable": ["payload@2"]}
    )
