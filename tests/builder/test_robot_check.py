"""`gen check`, and the step against the model: friction and modes by closed forms, and by steps of the compiled arm."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import robots
from arms import ALL_EFFECTS, CHAINS, SPRINGS, arm
from compiled import Compiled
from planar_links import get_planar_link
from stub_compiler import stub_compiler

from gen.__main__ import main
from gen.builder import build as builds
from gen.builder import compiler
from gen.builder.robot_check import report_robot
from gen.builder.step_stability import LARGEST_ACCURATE_MODE, LARGEST_STABLE_MODE, StepExamination, examine_step
from gen.effects import ALL, NOMINAL
from gen.model.arm_model import Model
from gen.model.right_hand_side import assemble_graphs
from gen.presets import find_presets
from gen.robot.description import Robot, RobotError, describe_robot
from gen.robot.load_robot import load
from gen.robot.mass_matrix import mass_matrix
from gen.robot.schema import keys_of


def examined(tmp_path: Path, text: str, extra: tuple[str, ...] = ()) -> tuple[Robot, StepExamination]:
    path = tmp_path / "robot.toml"
    path.write_text(text)
    robot = load(str(path))
    effects = tuple(e for e in ALL if e in NOMINAL or e.name in extra)
    return robot, examine_step(assemble_graphs(Model(robot, effects)))


def values(robot: Robot, name: str) -> np.ndarray:
    return np.array([getattr(joint.drive, name).nominal for joint in robot.joints])


# -- the rates --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chain", ["R", "RR"])
def test_friction_of_springy_drives_is_level_over_rotor_and_width(tmp_path: Path, chain: str) -> None:
    robot, found = examined(tmp_path, CHAINS[chain])
    expected = values(robot, "coulomb_friction") / (
        values(robot, "motor_inertia") * values(robot, "friction_smoothing")
    )
    assert found.friction == pytest.approx(expected, rel=1e-9)
    assert found.friction_rate == pytest.approx(expected.max(), rel=1e-9)


@pytest.mark.parametrize("chain", ["R", "P", "RR", "RPR", "RRR"])
def test_friction_of_rigid_drives_feels_rotors_and_links(tmp_path: Path, chain: str) -> None:
    """Against the mass matrix by the Jacobians of the centres of mass, on a denser grid."""
    robot, found = examined(tmp_path, arm(chain, rigid="r" * len(chain), drive="friction_smoothing = 1.0"))
    ratio = values(robot, "ratio")
    slope = ratio * values(robot, "coulomb_friction") / values(robot, "friction_smoothing") * ratio
    axes = [np.linspace(-1, 1, 9) if kind == "P" else np.linspace(0, 2 * np.pi, 25) for kind in chain]
    q = np.array(list(itertools.product(*[np.zeros(1) if chain[0] == "R" else axes[0], *axes[1:]])))
    inverse = np.linalg.inv(mass_matrix(robot.joints, q))
    fastest = np.linalg.eigvals(inverse * slope).real.max()
    assert found.friction_rate == pytest.approx(fastest, rel=0.02), "the grids differ, the law does not"
    seen = inverse[:, range(len(chain)), range(len(chain))].max(axis=0) * slope
    assert (np.array(found.friction) > 0.98 * seen).all()
    if len(chain) == 1:
        assert found.friction[0] == pytest.approx(seen[0], rel=1e-9)


def test_fastest_mode_of_one_spring_is_that_of_two_masses(tmp_path: Path) -> None:
    text = arm("R").replace("torsional_damping = 6.0", "torsional_damping = 0.0").replace("-9.81", "0.0")
    limited = text.replace("viscous_friction = 0.0001", "viscous_friction = 0.0") + "[joint.limits]\ntorque = 40.0\n"
    robot, found = examined(tmp_path, limited)
    joint, p = robot.joints[0], robot.joints[0].drive
    assert (
        p.flexspline_stiffness
        and p.flexspline_stiffening
        and p.wave_generator_stiffness
        and p.wave_generator_stiffening
    )
    planar = get_planar_link(joint)
    link = planar.inertia.nominal + joint.mass.nominal * planar.center_of_mass.nominal**2
    rotor = p.ratio.nominal**2 * p.motor_inertia.nominal
    for mode, torque in ((found.unloaded, 0.0), (found.loaded, 40.0)):
        flexspline = 1 / (p.flexspline_stiffness.nominal * (1 + (p.flexspline_stiffening.nominal * torque) ** 2))
        faded = np.exp(-p.wave_generator_stiffening.nominal * torque / p.ratio.nominal)
        generator = faded / (p.ratio.nominal**2 * p.wave_generator_stiffness.nominal)
        stiffness = 1 / (flexspline + generator)  # (11) differentiated by the torque
        assert mode.rate == pytest.approx(np.sqrt(stiffness * (1 / link + 1 / rotor)), rel=1e-6)
        assert mode.joint == 1


def test_the_mode_beyond_which_a_step_diverges_is_the_one_refused(
    build: Callable[..., Compiled], tmp_path: Path
) -> None:
    text = arm("R").replace("torsional_damping = 6.0", "torsional_damping = 0.0").replace("-9.81", "0.0")
    text = text.replace("0.03\n", "0.0\n").replace("viscous_friction = 0.0001", "viscous_friction = 0.0")
    _, found = examined(tmp_path, text)
    made = build(text)
    for size, grows in ((0.95 * LARGEST_STABLE_MODE, False), (1.05 * LARGEST_STABLE_MODE, True)):
        x = made.x(joint_velocity_1=1e-6)
        h = np.array([size / found.unloaded.rate])
        for _ in range(400):
            (x,) = made("step", x, np.zeros(3), made.prepare(), h)
        swing = abs(made.at(x, "joint_velocity_1") - made.at(x, "motor_velocity_1") / 100)
        assert (not swing <= 1e-6) == grows, (size, swing)  # NaN has grown


@pytest.mark.parametrize("share, follows", [(0.3, True), (1.0, True), (2.5, True), (3.2, False), (20.0, False)])
def test_friction_beyond_the_bound_moves_the_motor_to_and_fro(
    build: Callable[..., Compiled], share: float, follows: bool
) -> None:
    """The reason for the bound: at rest nothing drives the motor, and friction itself keeps it from coming to rest."""
    made, h = build(arm("R")), 5e-4
    width = h * made.vector()[made.parameters.index("coulomb_friction_1")] / (1.3e-4 * share)
    c = made.prepare(friction_smoothing_1=width, gravity_y=0.0)
    x = made.x(motor_velocity_1=1e-3 * width)
    for _ in range(200):
        (x,) = made("step", x, np.zeros(3), c, np.array([h]))
    assert (abs(made.at(x, "motor_velocity_1")) < 1e-3 * width) == follows


# -- what is refused --------------------------------------------------------------------------------------------------


def narrow(chain: str, rigid: str, width: str = "friction_smoothing = 0.02") -> str:
    return arm(chain, rigid=rigid, drive=width)


@pytest.mark.parametrize("chain, rigid", [("R", "f"), ("RR", "ff"), ("R", "r"), ("RRR", "rrr"), ("RPR", "rfr")])
def test_what_a_refusal_says_would_fit_does_fit(tmp_path: Path, chain: str, rigid: str) -> None:
    text = narrow(chain, rigid)
    _, found = examined(tmp_path, text)
    refused = found.refusals("robot.toml")
    assert refused
    pattern = (
        r"robot\.toml, joint\[(\d)\]\.drive\.friction_smoothing: found 0\.02 rad/s, .* possible is (\S+) or more; "
        r"write that, or step = (\S+) or less\."
    )
    joints = text.split("[[joint]]")
    for sentence in refused:
        number, width, step = re.fullmatch(pattern, sentence).groups()  # type: ignore[union-attr]
        joints[int(number)] = joints[int(number)].replace("= 0.02\n", f"= {width}\n")
    for factor, fits in ((1.0, True), (1.02, False)):
        shorter = text.replace("step = 0.0005", f"step = {factor * float(step)}")
        assert (not examined(tmp_path, shorter)[1].refusals("")) == fits
    assert not examined(tmp_path, "[[joint]]".join(joints))[1].refusals("")


def test_check_and_build_refuse_the_same_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.toml").write_text(narrow("RR", "ff"))
    assert main(["build", "robot.toml"]) == 2
    built = capsys.readouterr()
    assert built.out == ""
    assert main(["check", "robot.toml"]) == 2
    checked = capsys.readouterr().out.splitlines()
    assert checked[-2:] == built.err.splitlines()
    assert [line.split(": found")[0] for line in checked[-2:]] == [
        f"robot.toml, joint[{j}].drive.friction_smoothing" for j in (1, 2)
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


def test_a_mode_too_fast_for_the_step_is_refused_with_a_step_that_fits(tmp_path: Path) -> None:
    light = arm("R").replace("inertia = 0.08", "inertia = 1e-4").replace("mass = 4.5", "mass = 0.01")
    _, found = examined(tmp_path, light)
    (sentence,) = found.refusals("robot.toml")
    assert sentence.startswith("robot.toml, step: found 0.0005 s, in which the fastest mode (")
    assert "at joint 1, without load" in sentence
    step = re.search(r"write step = (\S+) or less", sentence).group(1)  # type: ignore[union-attr]
    assert not examined(tmp_path, light.replace("step = 0.0005", f"step = {step}"))[1].refusals("")
    assert examined(tmp_path, light.replace("step = 0.0005", f"step = {float(step) * 1.02}"))[1].refusals("")


def test_torque_limits_decide_where_they_are_stated(tmp_path: Path) -> None:
    free = arm("RR")
    limited = "[[joint]]".join(
        part + ("[joint.limits]\ntorque = 140.0\n" if k else "") for k, part in enumerate(free.split("[[joint]]"))
    )
    _, found = examined(tmp_path, free)
    assert found.refusals("") == []
    unstable = dict(found.unstable_from)
    assert set(unstable) == {1, 2}
    assert any(line.startswith("unstable from joint torques") for line in found.describe_step())
    (sentence,) = examined(tmp_path, limited)[1].refusals("")
    assert "at the torque limits" in sentence
    for share, refused in ((0.98, False), (1.02, True)):
        text = limited.replace("torque = 140.0", f"torque = {share * unstable[1]}")
        assert bool(examined(tmp_path, text)[1].refusals("")) == refused


def test_a_stiff_memory_brings_the_step_that_carries_narrow_friction(tmp_path: Path) -> None:
    assert examined(tmp_path, narrow("R", "f"))[1].refusals("")
    bristles = robots.effect("presliding_friction", 1, presliding_share=1.0, presliding_angle=0.02)
    _, found = examined(tmp_path, narrow("R", "f") + bristles, ("presliding_friction",))
    assert not found.refusals("")
    assert found.smallest_step < 5e-4 / 100


def test_remark_on_accuracy(tmp_path: Path) -> None:
    for step, remarked in ((5e-4, False), (4e-3, True)):
        _, found = examined(tmp_path, arm("R", step=step, drive="friction_smoothing = 20.0"))
        assert (LARGEST_ACCURATE_MODE < step * found.unloaded.rate < LARGEST_STABLE_MODE) == remarked
        assert any("mind the accuracy" in line for line in found.describe_step()) == remarked


def test_springs_that_cannot_be_inverted_are_said(tmp_path: Path) -> None:
    sharp = arm("R").replace("0.0831", "90.0").replace(SPRINGS.splitlines()[0], "law_torque = 1e6")
    (tmp_path / "robot.toml").write_text(sharp)
    with pytest.raises(RobotError, match=r"robot\.toml, joint: the spring law cannot be inverted .* lower law_torque"):
        report_robot(str(tmp_path / "robot.toml"))


# -- the report -------------------------------------------------------------------------------------------------------


SMALL = 6  # joints: a graph of seven in space takes four times the time of one of six
PRESETS = [
    pytest.param(name, marks=[pytest.mark.campaign] if len(load(name).joints) > SMALL else [])
    for name in find_presets()
]


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_is_carried_by_its_step(name: str, tmp_path: Path) -> None:
    lines, fits = report_robot(name, out=tmp_path)
    assert fits, lines
    assert lines[-1].endswith("(portable) would be made")
    robot = load(name)
    assert lines[0].startswith(f"{robot.name}: {len(robot.joints)} joint")
    assert sum(line.startswith("  joint ") for line in lines) == len(robot.joints)
    assert any(line.startswith("  effect   coulomb_friction (motor, ") for line in lines)
    assert any(line.startswith("  springs  inverse within 1e-12 rad") for line in lines) == any(
        not joint.drive.rigid for joint in robot.joints
    )


def test_report_says_what_a_build_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", str(stub_compiler(tmp_path)))
    compiler.find_compiler.cache_clear()
    try:
        (tmp_path / "robot.toml").write_text(arm("R", rigid="r", drive="friction_smoothing = 1.0"))
        out = ["--out", str(tmp_path / "build"), "--effects", "presliding_friction", "--profile", "native"]
        assert main(["check", str(tmp_path / "robot.toml"), *out]) == 0
        before = capsys.readouterr().out.splitlines()
        assert not (tmp_path / "build").exists()
        assert main(["build", str(tmp_path / "robot.toml"), *out]) == 0
        folder = capsys.readouterr().out.strip()
        assert before[-1] == f"{folder} (native) would be made"
        assert main(["check", str(tmp_path / "robot.toml"), *out]) == 0
        after = capsys.readouterr().out.splitlines()
        assert after == [*before[:-1], f"{folder} (native) is there"]
        manifest = json.loads((Path(folder) / "manifest.json").read_text())
        sizes = [len(manifest[what]) for what in ("state", "input", "parameters")]
        assert after[0] == (
            f"test arm: 1 joint, {sizes[0]} states, {sizes[1]} inputs, {sizes[2]} parameters, "
            f"{manifest['constants']} constants, {len(manifest['functions'])} functions"
        )
        for effect in manifest["effects"]:
            assert any(effect["name"] in line and effect["citation"] in line for line in after)
    finally:
        compiler.find_compiler.cache_clear()


def test_check_without_a_compiler_still_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "/nowhere/cc")
    compiler.find_compiler.cache_clear()
    try:
        lines, fits = report_robot("emps", out=tmp_path)
        assert fits
        assert lines[-1].startswith("cannot be built here: $CC: found /nowhere/cc")
    finally:
        compiler.find_compiler.cache_clear()


def test_check_of_many_joints_with_every_effect(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(CHAINS["6R"])
    lines, fits = report_robot(str(tmp_path / "robot.toml"), ALL_EFFECTS, out=tmp_path)
    assert fits, lines
    assert any("kinematic_error (transmission, joint 1, 2, 3)" in line for line in lines)


WRIST = """name = "wrist"
gravity = [0, -9.81]
step = 0.0005
[[joint]]
length = 0.1
mass = 1.0
center_of_mass = 0.05
inertia = 0.01
[joint.drive]
rigid = true
ratio = 1
motor_inertia = {}
viscous_friction = 0.1
coulomb_friction = 0.5
friction_smoothing = 0.1
"""


@pytest.mark.parametrize(("rotor", "turns"), [(1e-3, True), (2e-4, True), (1e-5, False), (1e-11, False), (0, False)])
@pytest.mark.parametrize("joints", [1, 2])
def test_a_spring_that_is_only_looked_for_is_carried_by_the_step_that_carries_the_file(
    tmp_path: Path, rotor: float, turns: bool, joints: int
) -> None:
    """A light rotor at a ratio of 1: as stiff as a drive usually is, its spring would ask for a tenth of the step."""
    path = tmp_path / "robot.toml"
    joint = WRIST[WRIST.index("[[joint]]") :].format(rotor)
    path.write_text(WRIST.format(rotor) + (joints - 1) * joint)
    robot = load(str(path))
    assert builds.assemble_library(str(path), robot, ())[2].refusals("robot") == []
    made, _, looked = builds.assemble_library(str(path), robot, ("missing_compliance",))
    assert looked.refusals("robot") == []
    model = made.graphs.model
    assert model.flexible == (tuple(range(1, joints + 1)) if turns else ())
    assert describe_robot(model.robot)["effects"] == []  # the file states none
    for q in (q for q in model.quantities if q.effect == "missing_compliance"):
        assert q.low <= q.nominal <= q.high, q.name


def test_a_fit_may_find_no_number_that_a_robot_file_may_not_state(tmp_path: Path) -> None:
    """The nearest to linear that springs can be stated is the least that they can be found."""
    path = tmp_path / "robot.toml"
    path.write_text(arm("RR").replace("stiffening = 0.0831", "stiffening = 1e-6").replace("= 27.027", "= 1e-3"))
    ranges = {name: key.range for table in ("", "joint", "joint.drive") for name, key in keys_of(table).items()}
    for source in (str(path), *find_presets()):
        for q in Model(load(source), NOMINAL).quantities:
            name = q.name.rpartition("_")[0]
            if q.role == "base" and name in ranges:
                stated = q.low + q.offset, q.high + q.offset  # a lumped inertia is stated about the joint
                assert all(bound in ranges[name] for bound in stated), (source, q.name)
                assert q.low <= q.nominal <= q.high
