"""Whatever a diagnosis finds, its sentences, pages and JSON are written: nothing named, all withdrawn, what was read
off alone, no held-out interval, one channel, a joint that never moves."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import arms
import numpy as np
import pytest
from catalogue import EFFECTS
from compiled import Compiled
from hypothesis import given
from hypothesis import strategies as st
from replayed import SENSORS, simulated

from gen.effects import ALL
from hdagen.adoption import verdict
from hdagen.adoption.diagnosis_schema import SCHEMA
from hdagen.arm.compiled_arm import Arm
from hdagen.campaign.task import Outcome, Status
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion, mark_holdout_blocks
from hdagen.diagnosis.decision.direct_evidence import DirectEvidence, add_direct_evidence
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis, conclude_verdict
from hdagen.diagnosis.holdout.holdout_check import choose_model
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import remove_unknown
from hdagen.diagnosis.report import report_page
from hdagen.diagnosis.report.confounding import explain_confounding
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles
from hdagen.diagnosis.report.sentences import write_verdict
from hdagen.diagnosis.residuals.localization import localize_gap
from hdagen.diagnosis.residuals.residual_torque import see_residual_torque
from hdagen.fleet import fleet_page
from hdagen.fleet.fleet_diagnosis import MachineResult, summarize_fleet
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.fleet.machine_task import summarize_diagnosis
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay

FRICTION, BIAS, STRANGE = "coulomb_friction@1", "encoder_bias@1", "unknown@1"
VERDICTS: tuple[list[str], ...] = ([], [FRICTION], [BIAS, FRICTION], [STRANGE], [BIAS, STRANGE])
CHANNEL = {"joint_position_1": {"before": 30.0, "after": 2.0, "noise": 1e-6}}
GAPS: list[dict[str, Any]] = [
    {
        "before": before,
        "after": after,
        "flexible": flexible,
        "achievable": min(before, after, flexible or np.inf),
        "shrink": shrink,
        "interval": interval,
    }
    for before, after in ((0.9, 0.9), (1.1, 1.0), (50.0, 3.0), (5e3, 5e3))
    for flexible in (None, 0.5, 2.0, 6e3)
    for shrink, interval in ((None, None), (0.5, None), (0.5, [0.2, 0.9]))
]


def estimate(value: float, **changes: Any) -> dict[str, Any]:
    return {"value": value, "std": 0.1 * value, "unit": "N m", "end": None} | changes


def cause(name: str, probability: float, parameters: Mapping[str, Any]) -> dict[str, Any]:
    effect, _, joint = name.partition("@")
    said = {"effect": effect, "joint": int(joint), "probability": probability, "parameters": dict(parameters)}
    return said | {"confounded_with": ["backlash@1"] if probability < 0.9 else [], "separate_by": ""}


CAUSES = [
    cause(FRICTION, 0.8, {"coulomb_friction": estimate(0.1, end="high")}),
    cause(BIAS, 0.95, {"encoder_bias": estimate(1e-3, std=None)}),
    cause("backlash@1", 0.0, {}),
]


def content(said: list[str], sets: list[list[str]], **changes: Any) -> dict[str, Any]:
    """diagnosis.json of a verdict and sets of effects, the most probable first."""
    p = 0.5 ** np.arange(1, len(sets) + 1)
    return {
        "schema": SCHEMA,
        "verdict": said,
        "sure": False,
        "where": [],
        "causes": CAUSES,
        "hypotheses": [{"effects": e, "probability": float(q / p.sum())} for e, q in zip(sets, p, strict=True)],
        "parameters": {},
        "undetectable": [],
        "doubts": None,
        "contradicted": None,
        "moments": [],
        "direct_evidence": [],
        "nuisance_effects": [],
        "small": [],
        "remains": [],
        "as_good_as_it_gets": False,
        "method": {"calibrated": True},
        "gap": GAPS[0] | {"floor": 1.0, "by_channel": CHANNEL},
    } | changes


SETS = [*map(list, itertools.permutations(VERDICTS, 2)), *([one] for one in VERDICTS)]
MORE: dict[str, list[Any]] = {
    "doubts": [None, *({"verdict": one, "joint": 1, "left": 0.9} for one in VERDICTS[:2])],
    "causes": [CAUSES, []],
    "undetectable": [[], [FRICTION, BIAS]],
    "parameters": [{}, {"mass_1": estimate(2.0)}],
    "remains": [[], [{"joint": 1, "share": 0.5, "noise": 20.0}]],
    "as_good_as_it_gets": [False, True],
    "small": [[], [{"effect": "gravity_tilt", "joint": 0, "with": 2.0, "without": 2.1}]],
    "nuisance_effects": [[], [{"effect": "gravity_tilt", "joint": 0, "parameters": {}, "size": 0.1, "gap": 0.2}]],
}


@pytest.mark.parametrize("said", VERDICTS, ids=str)
def test_every_sentence_is_written(said: list[str]) -> None:
    """Where the set that is said is not among the hypotheses, or no set without effects is, too."""
    one_changed = [(key, value) for key, values in MORE.items() for value in values]
    for sets, told, (key, value) in itertools.product(SETS, GAPS, one_changed):
        shown = content(said, sets, gap=told | {"floor": 1.0, "by_channel": CHANNEL}, **{key: value})
        for text in (write_verdict(shown), explain_confounding(EFFECTS, shown)):
            assert text and "nan" not in text and "None" not in text


def test_what_was_read_off_and_withdrawn_leaves_no_gap() -> None:
    said = write_verdict(content([], [[BIAS], [FRICTION]]))
    assert said.startswith("There is no gap to explain, although the log may have encoder bias on joint 1 (0.67)")


def test_a_fleet_is_told_of_every_result(tmp_path: Path) -> None:
    shapes = [content(said, sets) for said in VERDICTS for sets in SETS] + [content([], [[]], causes=[])]
    machine = FleetMachine("one", "paper", Path("log.csv"), None, None)
    results = [MachineResult(machine, Outcome(Status.DONE, summarize_diagnosis(shape))) for shape in shapes]
    others = [MachineResult(machine, Outcome(status)) for status in Status if status is not Status.DONE]
    for some in ([], others, results[-1:], results + others, *([one] for one in results)):
        assert fleet_page.format_fleet_verdict(some)
        json.dumps(summarize_fleet(some), allow_nan=False)
    for some in ([], others, results[-1:], results + others):
        fleet_page.write_fleet_page(tmp_path / "fleet.html", Path("fleet.toml"), some)


# -- decisions --------------------------------------------------------------------------------------------------------

ATOMS = [SimpleNamespace(name=FRICTION, place="motor"), SimpleNamespace(name=BIAS, place="sensor")]
FIT: Any = SimpleNamespace(sensitivities=SimpleNamespace(candidates=SimpleNamespace(members=ATOMS)))
NAMES = ((FRICTION,), (BIAS,), (BIAS, FRICTION))


@given(
    weights=st.lists(st.floats(1e-12, 1.0), min_size=4, max_size=4),
    strange=st.none() | st.floats(1e-6, 1.0),
    alone=st.sampled_from([[], [DirectEvidence(BIAS, {"encoder_bias_1": 1e-3}, 0.1)]]),
)
def test_every_decision_can_be_said(weights: list[float], strange: float | None, alone: list[DirectEvidence]) -> None:
    """Named, none, unknown, and beside each what is read off; the set that is said is among those that are listed."""
    names = [(), *NAMES, *([(STRANGE,)] if strange else [])]
    shares = [*weights, strange] if strange else weights
    given_ = [
        Hypothesis(n, w / sum(shares), None if n == (STRANGE,) else FIT) for n, w in zip(names, shares, strict=True)
    ]
    first = conclude_verdict(given_, FIT)
    second = add_direct_evidence(first, alone)
    for found in (
        first,
        second,
        remove_unknown(first),
        remove_unknown(second),
        add_direct_evidence(remove_unknown(first), alone),
    ):
        assert () in [h.names for h in found.hypotheses]
        assert sum(h.probability for h in found.hypotheses) == pytest.approx(1.0)
        assert found.verdict in [h.names for h in found.hypotheses]
        for said in (list(found.verdict), [n for n in found.verdict if n.startswith("unknown@")]):  # or withdrawn
            assert write_verdict(_told(found, said)) and explain_confounding(EFFECTS, _told(found, said))


def _told(found: Decision, said: list[str]) -> dict[str, Any]:
    sets = [{"effects": list(h.names), "probability": h.probability} for h in found.hypotheses]
    return content(said, [[]], hypotheses=sets)


def test_a_verdict_without_a_spring_is_replayed_with_rigid_drives() -> None:
    """Though its parameters were fitted in a model that has springs, which are as good as rigid and no more."""
    rigid, springs = _arm_with("coulomb_friction_1", "mass_1"), _arm_with(*SPRING_PARAMETERS)
    one: Any = SimpleNamespace(best=_fit_on(springs), hypotheses=())
    said = content([FRICTION], [[FRICTION]], parameters={"mass_1": estimate(2.0)})
    assert choose_model(rigid, one, verdict.read_verdict(said)) is rigid
    assert choose_model(rigid, one, verdict.read_verdict(_told_spring())) is springs


def test_a_spring_that_only_other_hypotheses_have_is_replayed_on_their_model() -> None:
    rigid, springs = _arm_with("coulomb_friction_1", "mass_1"), _arm_with(*SPRING_PARAMETERS)
    others = [SimpleNamespace(fit=None), SimpleNamespace(fit=_fit_on(springs))]
    one: Any = SimpleNamespace(best=_fit_on(rigid), hypotheses=others)
    assert choose_model(rigid, one, verdict.read_verdict(_told_spring())) is springs


SPRING_PARAMETERS = "coulomb_friction_1", "mass_1", "missing_compliance_1"


def _told_spring() -> dict[str, Any]:
    spring = cause("missing_compliance@1", 0.9, {"missing_compliance": estimate(1e-4)})
    return content(["missing_compliance@1"], [[FRICTION]], causes=[spring])


def _arm_with(*parameters: str) -> Any:
    return SimpleNamespace(parameters=SimpleNamespace(described=dict.fromkeys(parameters)))


def _fit_on(arm: Any) -> Any:
    return SimpleNamespace(sensitivities=SimpleNamespace(shooting=SimpleNamespace(arm=arm)))


# -- pages ------------------------------------------------------------------------------------------------------------

DRIVE = f"friction_smoothing = 1.0\n{SENSORS}"
AT_JOINT_SCALE = (
    arms.arm("R", rigid="r", drive=DRIVE)
    .replace("ratio = 20.0", "ratio = 1.0")
    .replace("motor_inertia = 0.00013", "motor_inertia = 0.05")
    .replace("coulomb_friction = 0.03", "coulomb_friction = 0.2")
)
ROBOTS = {"joint scale": AT_JOINT_SCALE, "springs": arms.arm("R", drive=SENSORS)}


def shown(log: Log, keep: str) -> Log:
    """The channels that match."""
    columns = {name: values for name, values in log.columns.items() if re.search(keep, name)}
    return Log(log.time, columns, log.n_joints, log.source)


def still(log: Log) -> Log:
    """The same of a joint that never moves."""
    moves = re.compile("position|current|torque|force")
    columns = {n: np.zeros(len(v)) if moves.match(n.partition("_")[2]) else v for n, v in log.columns.items()}
    return Log(log.time, columns, log.n_joints, log.source)


LOGS: dict[str, Callable[[Log], Log]] = {
    "all channels": lambda log: log,
    "one channel": lambda log: shown(log, "command|joint_position"),
    "measured input": lambda log: shown(log, "motor_(torque|current)_1|motor_position"),
    "a joint that never moves": still,
    "hardly any rows": lambda log: log.rows(0, 120),
}
SAID: dict[str, dict[str, dict[str, float]]] = {  # an effect of each kind of picture
    "none": {},
    "unknown": {STRANGE: {}},
    "friction": {FRICTION: {"coulomb_friction": 0.25}},
    "torque": {"current_bias@1": {"bias": 0.01}},
    "input": {"command_delay@1": {"command_delay": 2e-3}},
    "along": {"load_dependent_friction@1": {"load_share": 1e-3}},
    "presliding": {"presliding_friction@1": {"presliding_share": 0.5, "presliding_angle": 0.02}},
    "link": {"cable_spring@1": {"cable_stiffness": 5.0, "cable_rest": 0.0}},
    "whole arm": {"gravity_tilt@0": {"tilt_x": 0.5}},
    "encoder": {"sensor_delay@1": {"sensor_delay": 2e-3}},
    "beside unknown": {BIAS: {"encoder_bias": 1e-3}, STRANGE: {}},
}


@pytest.fixture(scope="module", params=ROBOTS)
def one(request: pytest.FixtureRequest, build: Callable[..., Compiled]) -> tuple[Arm, Log]:
    """An arm of one joint, with the effects that are said, and a log of it."""
    named = {entry.partition("@")[0] for entries in SAID.values() for entry in entries}
    arm = Arm(build(ROBOTS[request.param], effects=tuple(e.name for e in ALL if e.name in named)).folder)
    return arm, simulated(arm, 1.6)


@pytest.mark.parametrize("which", LOGS)
def test_every_page_is_written(one: tuple[Arm, Log], which: str, tmp_path: Path) -> None:
    arm, log = one[0], LOGS[which](one[1])
    held = LogPortion(log, mark_holdout_blocks(log.time))
    before = replay(arm, log)
    for k, entries in enumerate(SAID.values()):
        effects = {name: values for name, values in entries.items() if name != STRANGE}
        causes = [cause(n, 0.9, {key: estimate(v) for key, v in values.items()}) for n, values in effects.items()]
        said = content(list(entries), [list(entries), []], causes=causes)
        said |= {"parameters": {} if k % 2 else {"mass_1": estimate(4.6)}, "robot": {"name": "arm", "sha256": None}}
        after = replay(arm, log, with_=verdict.read_verdict(said))
        said |= {"gap": evaluate_gap(before, after, held), "data": {"rate": 1e3, "duration": 1.6, "held_out": "blocks"}}
        rung: dict[str, Any] = {"effects": [], "probability": None, "gap": 2.0, "interval": None}
        said |= {"ranking": [rung | {"model": model} for model in ("robot file", "verdict")]}
        said |= {"control": {"refused": "no speed limit"} if k % 2 else None}
        sight = see_residual_torque(arm, verdict.read_verdict(said), log, before, after)
        said["where"] = localize_gap(sight, said["verdict"], held.rows)
        seen = HoldoutMotion(held, lambda _: before, before, before, before)
        found = SimpleNamespace(content=said, after=after, holdout=seen, residual_torque=sight)
        files = DiagnosedFiles("robot.toml", ("log.csv",), (), tmp_path)
        report_page.write_report(found, tmp_path / "report.html", files)  # type: ignore[arg-type]
        assert "</html>" in (tmp_path / "report.html").read_text(encoding="utf-8")
        json.dumps(said, allow_nan=False)
