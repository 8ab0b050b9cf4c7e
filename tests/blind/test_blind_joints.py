"""Real joints of `hdagen blind`: what is drawn, simulated and true of them, and how a diagnosis is judged."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdagen.adoption import verdict
from hdagen.blind import blind_page, label_seal, sealed_check
from hdagen.blind.blind_report import make_report, render_report
from hdagen.blind.parameter_errors import compare_parameters
from hdagen.blind.realities import joint_reality, log_maker, rigid_joints
from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.joint_motion import PERIOD, compute_link_torques, draw_joint_motion
from hdagen.blind.realities.rigid_joints import Friction, JointCase, NamelessTorque
from hdagen.blind.score_summary import summarize_rows
from hdagen.blind.scores import Row, score_case, split_unknown
from hdagen.blind.sealed_check import Check
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.log.measured_log import read

COULOMB, VISCOUS = rigid_joints.FRICTION_EFFECTS
QUIET = NamelessTorque(wander=0.0, time=1.0, ripple=0.0, order=7.5, phase=0.0, varying=0.0, waves=1.0)


def drawn(count: int = 40) -> tuple[JointCase, ...]:
    return rigid_joints.draw_joint_cases("some seed", count)


def quiet(case: JointCase) -> JointCase:
    """The same without torque that has no name and without noise."""
    still = tuple(
        {**joint, "resolution": 1e-12, "encoder_noise": 0.0, "input_noise": 0.0} for joint in case.robot.joints
    )
    robot = replace(case.robot, joints=still)
    return replace(case, robot=robot, nameless=(QUIET,) * len(still), rate=1000, jitter=0.0, scatter=0.0)


# -- what is drawn ----------------------------------------------------------------------------------------------------


def test_the_same_seed_is_the_same_to_the_bit() -> None:
    assert drawn(4) == drawn(40)[:4] and rigid_joints.draw_joint_cases("another seed", 4) != drawn(4)
    one, again = (joint_reality.make_joint_log(drawn(1)[0], "log", 0.5) for _ in range(2))
    assert list(one) == list(again) and all(np.array_equal(one[name], again[name]) for name in one)
    held = joint_reality.make_joint_log(drawn(1)[0], "hold_out", 0.5)
    assert not any(np.array_equal(one[name], held[name]) for name in one if name != "time")


def test_a_longer_log_begins_like_a_shorter_one() -> None:
    """Labels are of one length of log, whichever is asked for."""
    short, long = (drawn(1)[0].draw_motion("log", seconds) for seconds in (2.0, 5.0))
    rows = len(short.time) - 2  # where differences are one-sided
    assert np.array_equal(short.velocity[:rows], long.velocity[:rows])


def test_every_case_is_as_it_is_said() -> None:
    found = drawn()
    assert {len(one.robot.joints) for one in found} == {1, 2} and {one.rate for one in found} == set(
        rigid_joints.LOG_RATES
    )
    assert {one.robot.encoder for one in found} == {"motor", "joint"} and {one.robot.current for one in found} == {
        True,
        False,
    }
    assert any(joint["ratio"] == 1.0 for one in found for joint in one.robot.joints)
    assert 0.15 < np.mean([one.robot.joints[0][COULOMB] > 0.0 for one in found]) < 0.55
    for case in found:
        label = case.label()
        assert (
            label["verdict"]
            and 0.0 <= label["background"] <= rigid_joints.LARGEST_NAMELESS_SHARE + 1e-12
            and case.jitter <= 50e-6
        )
        shares = {name: p["share"] for name, p in case.friction_parameters().items()}
        assert set(label["verdict"]) == {name for name, share in shares.items() if share >= 0.25}
        assert set(label["verdict"]) | set(label["optional"]) == set(shares)
        motion = case.draw_motion("log", rigid_joints.SIZING_SECONDS)
        asked = compute_link_torques(
            case.robot.joints, case.robot.gravity, motion.position, motion.velocity, motion.acceleration
        )
        for friction, v, torque in zip(case.friction, motion.velocity.T, asked.T, strict=True):
            assert 0.198 < rms(friction.torque(v)) / rms(torque) < 1.01
            assert 0.8 <= friction.exponent <= 1.2 and friction.speed == pytest.approx(rms(v), rel=0.01)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("seed", range(5))
def test_motions_start_at_rest_turn_back_and_are_neither_too_fast_nor_too_far(seed: int) -> None:
    motion = draw_joint_motion(np.random.default_rng(seed), (1.0, 4.0), 24.0)
    assert np.all(motion.position[0] == 0.0) and np.abs(motion.velocity[:3]).max() < 1e-3
    assert np.all(np.abs(motion.velocity).max(axis=0) < [1.9, 7.5]) and np.abs(motion.position).max() < 2.7
    assert min(np.count_nonzero(np.diff(np.sign(v[500:]))) for v in motion.velocity.T) > 12


def test_torques_of_the_links_are_those_of_the_energy() -> None:
    """Power in is the change of kinetic and potential energy, of which the second joint's motion is a part."""
    case = next(one for one in drawn() if len(one.robot.joints) == 2 and one.robot.gravity[1])
    motion = draw_joint_motion(np.random.default_rng(2), (2.0, 3.0), 4.0)
    q, v, a = motion.position, motion.velocity, motion.acceleration
    power = np.sum(compute_link_torques(case.robot.joints, case.robot.gravity, q, v, a) * v, axis=1)
    energy, x, y, angle, turn, dx, dy = np.zeros((7, len(q)))
    for j, joint in enumerate(case.robot.joints):
        angle, turn = angle + q[:, j], turn + v[:, j]
        c, length = joint["center_of_mass"], joint["length"]
        square = (dx - c * turn * np.sin(angle)) ** 2 + (dy + c * turn * np.cos(angle)) ** 2
        energy = energy + 0.5 * joint["mass"] * square + 0.5 * joint["inertia"] * turn**2
        energy = energy + 0.5 * joint["motor_inertia"] * (joint["ratio"] * v[:, j]) ** 2
        energy = energy - case.robot.gravity[1] * joint["mass"] * (y + c * np.sin(angle))
        x, y = x + length * np.cos(angle), y + length * np.sin(angle)
        dx, dy = dx - length * turn * np.sin(angle), dy + length * turn * np.cos(angle)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * PERIOD])
    assert np.abs(work - (energy - energy[0])).max() < 2e-4 * np.ptp(energy)


# -- what is simulated ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at", [next(k for k, one in enumerate(drawn()) if len(one.robot.joints) == n) for n in (1, 2)])
def test_the_best_linear_friction_is_what_a_regression_of_the_simulated_torque_finds(at: int) -> None:
    """The torque balance of the log itself, by numbers that the simulation never saw."""
    case = quiet(drawn()[at])
    log = joint_reality.make_joint_log(case, "log", rigid_joints.SIZING_SECONDS)
    scale = [joint["ratio"] if case.robot.encoder == "motor" else 1.0 for joint in case.robot.joints]
    angles = [f"{case.robot.encoder}_position_{j}" for j in range(1, len(scale) + 1)]
    q = np.column_stack([log[name] / s for name, s in zip(angles, scale, strict=True)])
    v = (q[2:] - q[:-2]) / (2.0 * PERIOD)
    a = (q[2:] - 2.0 * q[1:-1] + q[:-2]) / PERIOD**2
    asked = compute_link_torques(case.robot.joints, case.robot.gravity, q[1:-1], v, a)
    for j, joint in enumerate(case.robot.joints):
        name = f"motor_current_{j + 1}" if case.robot.current else f"motor_torque_{j + 1}"
        acted = 0.5 * (log[name][1:-1] + log[name][2:])  # a row shows what acted before it; at its instant both halves
        drive = acted * (joint["torque_constant"] if case.robot.current else 1.0) * joint["ratio"]
        moving = np.abs(v[:, j]) > 0.05
        columns = np.column_stack([np.sign(v[:, j]) * joint["ratio"], v[:, j] * joint["ratio"] ** 2])[moving]
        found = np.linalg.lstsq(columns, (drive - asked[:, j])[moving], rcond=None)[0]
        left = (drive - asked[:, j] - case.friction[j].torque(v[:, j]))[moving]
        assert rms(left) < 0.01 * rms(case.friction[j].torque(v[moving, j]))
        true = [case.friction_parameters()[f"{name}@{j + 1}"]["level"] for name in rigid_joints.FRICTION_EFFECTS]
        size = true[0] + true[1] * joint["ratio"] * rms(v[:, j])  # of the friction, at the motor
        assert found[0] == pytest.approx(true[0], abs=0.02 * size)
        assert found[1] * joint["ratio"] * rms(v[:, j]) == pytest.approx(
            true[1] * joint["ratio"] * rms(v[:, j]), abs=0.02 * size
        )


def test_a_dry_joint_stands_until_friction_is_overcome() -> None:
    case = quiet(next(one for one in drawn() if len(one.robot.joints) == 1))
    stiff = replace(case, friction=(replace(case.friction[0], coulomb=1e4),))
    log = joint_reality.make_joint_log(stiff, "log", 1.0)
    assert np.ptp(log[f"{case.robot.encoder}_position_1"]) < 1e-3


def test_a_wandering_torque_has_its_size_and_its_time() -> None:
    found = joint_reality.draw_wandering_torque(np.random.default_rng(1), replace(QUIET, wander=2.0, time=0.1), 400_000)
    assert rms(found) == pytest.approx(2.0, rel=0.05)
    assert np.mean(found[100:] * found[:-100]) / 4.0 == pytest.approx(math.exp(-1.0), abs=0.05)


def test_what_has_no_name_has_its_size() -> None:
    case = next(one for one in drawn() if one.label()["background"] > 0.05 and len(one.robot.joints) == 1)
    v = case.draw_motion("log", rigid_joints.SIZING_SECONDS).velocity[:, 0]
    q = case.draw_motion("log", rigid_joints.SIZING_SECONDS).position[:, 0]
    n, friction = case.nameless[0], case.friction[0].torque(v)
    wander = joint_reality.draw_wandering_torque(np.random.default_rng(3), replace(n, time=0.05), len(v))
    torque = wander + n.ripple * np.sin(n.order * q + n.phase) + friction * n.varying * np.sin(n.waves * q + n.phase)
    assert rms(torque) / rms(friction) == pytest.approx(case.label()["background"], rel=0.35)


def test_logs_have_the_columns_and_the_rate_of_their_case() -> None:
    for case in drawn(8):
        log = joint_reality.make_joint_log(case, "log", 0.5)
        assert len(log["time"]) == case.rate // 2
        assert np.abs(log["time"] - np.arange(len(log["time"])) / case.rate).max() <= 50e-6
        quantity = "motor_current" if case.robot.current else "motor_torque"
        names = [f"{quantity}_command", quantity] if case.commanded else [quantity]
        names += [f"{case.robot.encoder}_position"]
        assert set(log) == {"time", *(f"{name}_{j + 1}" for j in range(len(case.robot.joints)) for name in names)}
        if case.commanded:
            command, read_ = log[f"{quantity}_command_1"], log[f"{quantity}_1"]
            assert rms(read_[1:] - command[:-1]) == pytest.approx(case.robot.joints[0]["input_noise"], rel=0.5)
        assert set(case.robot.noise()) < set(log)


# -- what is true -----------------------------------------------------------------------------------------------------


def test_a_line_through_a_curve_comes_closest() -> None:
    v = np.linspace(-3.0, 3.0, 601)
    curve = Friction(2.0, 1.5, 0.8, 1.2)
    level, coefficient = curve.fit_linear(v)

    def error(a: float, b: float) -> float:
        return rms(curve.torque(v) - a * np.sign(v) - b * v)

    best = error(level, coefficient)
    assert all(
        error(level + d, coefficient + e) > best for d, e in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3))
    )
    assert Friction(2.0, 1.5, 1.0, 3.0).fit_linear(v) == pytest.approx((2.0, 0.5))


def test_what_is_true_can_be_read_as_a_diagnosis() -> None:
    for case in drawn(6):
        found = verdict.read_verdict(json.loads(json.dumps(case.true_diagnosis())))
        assert len(found.effects) == 2 * len(case.robot.joints) and not found.unexplained_joints
        assert ("torque_constant_1" in found.base_parameters) == case.robot.current
        assert all(value >= 0.0 for effect in found.effects for value in effect.parameters.values())


def test_where_the_file_knows_half_half_is_in_it() -> None:
    case = next(one for one in drawn() if one.robot.joints[0][COULOMB])
    stated, true = case.robot.joints[0], case.friction_parameters()
    assert stated[COULOMB] == pytest.approx(0.5 * true[f"{COULOMB}@1"]["level"], rel=1e-3)
    assert stated[VISCOUS] == pytest.approx(0.5 * true[f"{VISCOUS}@1"]["level"], rel=1e-3)


# -- how it is judged -------------------------------------------------------------------------------------------------

PARAMETERS = {
    "coulomb_friction@1": {"level": 2.0, "alone": 2.6, "share": 0.8},
    "viscous_friction@1": {"level": 0.5, "alone": 1.9, "share": 0.2},
}


def row(said: Sequence[str], sizes: Sequence[float], p: float = 0.95, **result: float) -> Row:
    """A joint whose Coulomb friction is required and whose viscous friction is optional."""
    label = {"kind": "joint", "verdict": ["coulomb_friction@1"], "optional": ["viscous_friction@1"]}
    named, _ = split_unknown(said)
    causes = []
    for one, size in zip(named, sizes, strict=True):
        effect, _, joint = one.partition("@")
        causes.append(
            {"effect": effect, "joint": int(joint), "probability": p, "parameters": {effect: {"value": size}}}
        )
    told = {"snr": 50.0, "parameters": PARAMETERS}
    diagnosis = {
        "verdict": list(said),
        "sure": p > 0.9,
        "gap": {"before": 9.0, "after": 3.0, "flexible": None},
        "where": [],
        "causes": causes,
        "hypotheses": [{"effects": list(named), "probability": p}, {"effects": [], "probability": 1.0 - p}],
    }
    gaps = {"seconds": 1.0, "before": 90.0, "after": 11.0, "after_true": 10.0} | result
    return score_case("x", {**label, "sizes": [2.0, 0.5], "background": 0.05}, told, gaps, diagnosis)


@pytest.mark.parametrize(
    "said, sizes, right, sized",
    [
        (["coulomb_friction@1", "viscous_friction@1"], [2.2, 9.0], True, True),  # what may be named has no size to miss
        (["coulomb_friction@1", "viscous_friction@1"], [2.6, 0.5], True, False),
        (["coulomb_friction@1"], [2.6], True, True),  # alone it carries the other's part
        (["coulomb_friction@1"], [2.0], True, False),
        (["coulomb_friction@1", "unknown@1"], [2.6], True, True),
        (["coulomb_friction@1", "backlash@1"], [2.0, 1.0], False, True),
        (["coulomb_friction@2"], [2.6], False, False),
        (["viscous_friction@1"], [0.5], False, False),
        (["unknown@1"], [0.0], False, False),
        ([], [], False, False),
    ],
)
def test_a_joint_is_named_where_all_that_is_required_and_nothing_beyond_is(
    said: list[str], sizes: list[float], right: bool, sized: bool
) -> None:
    found = row(said, sizes)
    assert (found.is_right, found.are_sizes_right) == (right, sized)
    assert found.remainder == (("unknown@1",) if len(said) == 2 and "unknown@1" in said else ())
    figures = summarize_rows([found])
    assert figures["named"].value == right and figures["sure_and_wrong"].value == (not right)
    assert ("sizes_within" in figures) == right


def test_hypotheses_that_differ_in_what_may_be_named_are_one() -> None:
    found = row(["coulomb_friction@1", "viscous_friction@1"], [2.0, 0.5], 0.9)
    assert found.p_truth == pytest.approx(0.9) and found.brier == pytest.approx(2 * 0.1**2)
    assert found.p_stated == pytest.approx(0.9)


def test_the_gap_is_held_against_that_with_what_is_true() -> None:
    said = ["coulomb_friction@1"], [2.6]
    rows = [row(*said, after=12.9), row(*said, after=13.1), row(*said, after_true=math.nan)]
    found = summarize_rows(rows)["after_within"]
    assert (found.value, found.count) == (0.5, 2)


def test_true_and_found_friction_are_put_side_by_side() -> None:
    lines = compare_parameters(
        [row(["coulomb_friction@1"], [2.6]), row(["coulomb_friction@1", "viscous_friction@1"], [2.2, 0.5])]
    )
    assert [(line.compared.effect, line.pairs) for line in lines] == [("coulomb_friction", ((2.6, 2.6), (2.0, 2.2)))]


def test_the_page_and_the_json_of_joints(tmp_path: Path) -> None:
    rows = [row(["coulomb_friction@1", "unknown@1"], [2.6]), row(["unknown@1"], [0.0]), row([], [], after=math.nan)]
    found = make_report(Check("joint", 3, "s", ClusterRequest(1), 24.0, tmp_path), label_seal.Seal("ab" * 32, 3), rows)
    content = json.loads(render_report(found), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert content["rows"][0]["remainder"] == ["unknown@1"] and content["rows"][0]["after_true"] == 10.0
    assert {"named", "sizes_within", "after_within", "sure_and_wrong"} <= {bar["figure"] for bar in content["bars"]}
    assert content["summary"]["remainder"]["value"] == pytest.approx(1 / 3)
    blind_page.write_page(tmp_path / "blind.html", found)
    text = (tmp_path / "blind.html").read_text()
    assert "(viscous_friction@1)" in text and "with what is true" in text and "What is there named" in text


# -- the check as a whole ---------------------------------------------------------------------------------------------

STAND_IN = """
import json, os, shutil, sys
from pathlib import Path
here = sorted(path.name for path in Path().iterdir())
text = " ".join(path.read_text() for path in Path().rglob("*.json")) + str(sorted(os.environ.items()))
with Path({seen!r}).open("a") as file:
    file.write(json.dumps([sys.argv[1], here, text]) + chr(10))
if sys.argv[1] == "diagnose":
    Path("out").mkdir(exist_ok=True)
    Path("out/diagnosis.json").write_text(json.dumps({{"verdict": [], "sure": False, "causes": [], "hypotheses": [],
        "where": [], "gap": {{"before": 1.0, "after": 1.0, "flexible": None}}}}))
else:
    shutil.copy("hold_out.parquet", sys.argv[sys.argv.index("--out") + 1])
"""


def test_seed_and_labels_stay_with_the_process_that_sealed_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a file, nor what the diagnosis sees, nor a byte that goes to a worker has the seed or a label."""
    from distributed import protocol
    from distributed.protocol.core import dumps

    sent: list[bytes] = []

    def note(*arguments: object, **more: object) -> list[bytes]:
        frames: list[bytes] = dumps(*arguments, **more)
        sent.extend(bytes(frame) for frame in frames)
        return frames

    monkeypatch.setattr(protocol, "dumps", note)
    program, seen, out = tmp_path / "hdagen.py", tmp_path / "seen", tmp_path / "out"
    program.write_text(STAND_IN.format(seen=str(seen)))
    command = (sys.executable, str(program))
    asked = Check("joint", 1, "a seed that nobody told", ClusterRequest(1), 2.0, out, True, command)
    rows, closed = sealed_check.run_check(asked, lambda _: None)
    case = draw_cases(asked.seed, asked.population, 1)[0]
    folder = out / "cases" / case.name
    told = [json.loads(line) for line in seen.read_text().splitlines()]
    assert [one[0] for one in told] == ["diagnose", "replay", "replay", "replay"]
    assert told[0][1] == ["log.parquet", "out", "robot.toml"] and told[0][2].count("friction") == 0
    assert asked.seed not in "".join(one[2] for one in told)
    knowing = [one for one in told if "true.json" in one[1]]  # the replay with the truth, by the sealing process
    assert len(knowing) == 1 and "friction" in knowing[0][2]
    result = json.loads((folder / "result.json").read_text())
    assert set(result) == {"seconds", "code", "before", "after", "after_true"} and len(rows) == 1
    kept = "".join(path.read_text() for path in out.rglob("*.json"))
    assert "friction" not in kept and asked.seed not in kept
    assert "friction" not in json.dumps(sorted(path.name for path in folder.rglob("*")))
    assert set(read(folder / "log.parquet").columns) == set(joint_reality.make_joint_log(_joint(case), "log", 0.1)) - {
        "time"
    }
    label = case.label()
    values = [repr(value) for one in _joint(case).friction_parameters().values() for value in one.values()]
    secrets = [asked.seed, closed.digest, "true.json", *label["verdict"], *label.get("optional", ()), *values]
    payloads = b"\0".join(sent)
    assert (folder / "robot.toml").read_bytes() in payloads and (folder / "log.parquet").read_bytes() in payloads
    assert [word for word in secrets if word.encode() in payloads] == []


def _joint(case: Any) -> JointCase:
    assert isinstance(case, JointCase)
    return case


def test_a_child_tells_what_is_true_of_a_joint_and_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import io

    request = {
        "seed": "s",
        "kind": "joint",
        "index": 1,
        "motion": "log",
        "seconds": 0.2,
        "out": str(tmp_path / "a.parquet"),
    }
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(request)))
    log_maker.main()
    told = json.loads(capsys.readouterr().out)
    case = rigid_joints.draw_joint_cases("s", 2)[1]
    assert (
        told["parameters"] == case.friction_parameters()
        and told["snr"] == pytest.approx(case.snr())
        and told["snr"] > 1.0
    )
    assert [path.name for path in tmp_path.iterdir()] == ["a.parquet"]
