"""controller.toml of the predictive controller: every key, every refusal, and what its documents say."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mpc_arms import built

from gen.mpc.problem_structure import StructureError, check_memory, memory_needed, parse_structure
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import load
from hdagen.mpc.benchmark.scaling import format_chain_robot
from hdagen.mpc.configuration import Configuration, check_configuration, read_configuration
from hdagen.mpc.configuration_document import write_document
from hdagen.mpc.configuration_schema import CONFIGURATION_KEYS, ConfigurationKey, format_key_table
from hdagen.mpc.predictive_controller import MPC
from hdagen.mpc.wall import Wall

DOCS = Path(__file__).parents[2] / "docs" / "reference" / "controller_toml.md"


def test_the_documented_keys_are_the_keys() -> None:
    assert DOCS.read_text(encoding="utf-8") == write_document(), (
        "python -m hdagen.mpc.configuration_document > docs/reference/controller_toml.md"
    )
    assert write_document().endswith(format_key_table())


def test_the_document_is_printed() -> None:
    command = [sys.executable, "-m", "hdagen.mpc.configuration_document"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == write_document() and not done.stderr


def test_every_default_is_one_that_the_key_allows() -> None:
    tables: dict[str, dict[str, object]] = {}
    for key in CONFIGURATION_KEYS:
        if key.default is not None and key.table != "wall":
            tables.setdefault(key.table, {})[key.name] = key.default
    assert check_configuration(tables, "defaults").structure == "nodes=20,walls=0,space=tip"


def test_a_file_is_read_and_changes_what_it_says(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(
        "[mpc]\nnodes = 10\n[admittance]\nmass = [1.0, 2.0]\n[limits]\ntip_speed = 0.1\n"
        "[[wall]]\nnormal = [0.0, 1.0]\noffset = 0.2\nstiffness = 1e4\nforce = 15.0\n"
    )
    c = read_configuration(path)
    assert c.structure == "nodes=10,walls=1,space=tip"
    assert c["admittance.mass"] == (1.0, 2.0)
    assert c["admittance.damping"] == 45.0
    assert c.walls == (Wall((0.0, 1.0), 0.2, 1e4, 15.0),)


@pytest.mark.parametrize(
    "text, words",
    [
        ("[mcp]\nnodes = 20", "unknown table 'mcp'.*did you mean mpc"),
        ("[mpc]\nnode = -1.0", "mpc.node: found -1.0, possible is a number more than 0"),
        ("[mpc]\nnodes = 1", "mpc.nodes: found 1, possible is a whole number from 2 to 400"),
        ("[mpc]\nnodes = 1000000", "mpc.nodes"),
        ("[mpc]\nsolver = 'magic'", 'mpc.solver: found \'magic\', possible is "riccati" or "osqp"'),
        ("[mpc]\nnodse = 20", "unknown key 'nodse'.*did you mean node"),
        ("[weights]\nposition = -1.0", "weights.position: found -1.0"),
        ("[weights]\nposition = 0.0\nvelocity = 0.0", "nothing is followed"),
        ("[weights]\ntorque = 0.0\ntorque_rate = 0.0", "not definite"),
        ("[limits]\ntip_speed = nan", "limits.tip_speed: found nan"),
        ("[limits]\ntip_speed = true", "limits.tip_speed: found True"),
        ("[limits]\nlinear = 0.0\nsquare = 0.0", "soft limits do not count"),
        ("[mpc]\nnode = 5e-4", "make every node at least as long"),
        ("[mpc]\nnodes = 3\ngrid = [0.01, 0.01]", "state one of them"),
        ("[mpc]\nnode = 0.01\ngrid = [0.01, 0.01]", "and mpc.node too; state one of them"),
        ("[[wall]]\nnormal = [1.0, 1.0]\noffset = 0.1", "normal has length 1.414"),
        ("[[wall]]\nnormal = [1.0, 0.0]", "wall 1: offset is missing"),
        ("[[wall]]\nnormal = [1.0, 0.0]\noffset = 0.1\nforce = 3.0", "belong together"),
        (
            "[[wall]]\nnormal = [1.0, 0.0]\noffset = -0.1\n[[wall]]\nnormal = [-1.0, 0.0]\noffset = 0.0",
            "leave nothing between them",
        ),
        (
            "".join(
                f"[[wall]]\nnormal = {normal}\noffset = -0.1\n"
                for normal in ("[1.0, 0.0]", "[-0.6, 0.8]", "[-0.6, -0.8]")
            ),
            "leave nothing between them",
        ),
        ("[limits]\njoint_low = [0.0, 1.0]\njoint_high = 0.5", "joint_low lies above limits.joint_high at joint 2"),
        ("[admittance]\nmass = 0.0", "admittance.mass: found 0.0"),
        ("[mpc]\nnodes = 4000", "a whole number from 2 to 400\\.$"),
        ("[admittance]\nmass = []", "admittance.mass"),
        ("wall = 3", "write \\[\\[wall\\]\\]"),
        ("mpc = 3", "write \\[mpc\\]"),
        ("[mpc", "cannot be read as TOML"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(text)
    with pytest.raises(PlantError, match=words) as caught:
        read_configuration(path)
    assert str(caught.value).count("\n") == 0


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text("[mpc]\nnodes = 1\nsolver = 'x'\n[limits]\ntip_speed = -1\n")
    with pytest.raises(PlantError) as caught:
        read_configuration(path)
    assert str(caught.value).count("\n") == 2


FAR_WALL = "\n[[wall]]\nnormal = [0.0, 1.0]\noffset = 10.0\n"


@pytest.mark.parametrize(
    "text, words",
    [
        ("[limits]\njoint_low = 2.9", "joint_low is 2.9 and limits.joint_high 2.6 rad at joint 1"),
        ("[limits]\nmotor_torque = [0.1, 0.1, 0.1]", "motor_torque has 3 numbers and there are 2 joints"),
        ("[admittance]\nmass = [1.0, 1.0, 1.0]", "mass has 3 numbers and there are 2 axes"),
        ("[estimator]\ntorque = [1.0, 1.0, 1.0]", "estimator.torque has 3 numbers"),
        ("[[wall]]\nnormal = [1.0, 0.0]\noffset = -0.31", "the walls leave only what is 0.31 m and more from the base"),
        (
            "[[wall]]\nnormal = [1.0, 0.0]\noffset = -0.22\n[[wall]]\nnormal = [0.0, 1.0]\noffset = -0.22",
            "the walls leave only what is 0.3111 m",
        ),
    ],
)
def test_what_does_not_fit_the_arm_is_refused_before_the_build_and_by_a_built_controller(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(text + FAR_WALL * (2 - text.count("[[wall]]")))  # as many as the controller that is built
    c = read_configuration(path)
    with pytest.raises(PlantError, match=words) as caught:
        load("paper", out=tmp_path / "builds", mpc=c)
    assert str(caught.value).count("\n") == 0 or "joint 2" in str(caught.value)
    assert not (tmp_path / "builds").exists()
    arm, whole = built()
    assert whole.structure == c.structure
    with pytest.raises(PlantError, match=words):
        MPC(arm, whole).configure_with(c)


def test_a_current_needs_a_torque_constant_and_sliding_joints_have_no_reach() -> None:
    robot = {**built()[0].robot}
    robot["joints"] = [{**joint, "drive": {**joint["drive"], "torque_constant": None}} for joint in robot["joints"]]
    far = check_configuration(
        {"limits": {"motor_current": 1.0}, "wall": [{"normal": [1.0, 0.0], "offset": -9.0}]}, "test"
    )
    assert [problem[:40] for problem in far.find_incompatibilities(robot)] == [
        "limits.motor_current needs a torque_cons",
        "the walls leave only what is 9 m and mor",
    ]
    robot["joints"][1] = {**robot["joints"][1], "kind": "prismatic"}
    assert len(far.find_incompatibilities(robot)) == 1


def test_walls_given_in_python_are_checked_too() -> None:
    c = Configuration()
    with pytest.raises(PlantError, match="wall.normal: found \\[2.0, 0.0\\]"):
        c.with_changes((Wall((2.0, 0.0), 0.1),))
    with pytest.raises(PlantError, match="leave nothing between them"):
        c.with_changes((Wall((1.0, 0.0), 0.1), Wall((-1.0, 0.0), -0.1)))
    assert c.with_changes((Wall((0.6, 0.8), 0.1), Wall((-1.0, 0.0), 0.1))).walls[0].normal == (0.6, 0.8)


def test_a_configuration_replaces_hard_limits_too() -> None:
    """Torque, its rate, the safe state and the force limit are the guard's, and are replaced with all else."""
    arm, c = built()
    k = MPC(arm, c)
    k.configure_with(c.with_changes(limits__motor_torque=0.1, limits__torque_rate=5.0, fallback__force_limit=30.0))
    most, rate = k.torque_limits()
    assert most.tolist() == [0.1, 0.1]
    assert rate.tolist() == [5.0, 5.0]
    assert k.guard.force_limit == 30.0
    k.configure_with(c)
    assert k.torque_limits()[0].tolist() == [0.7875, 0.7875]


@pytest.mark.parametrize("key", CONFIGURATION_KEYS, ids=lambda key: key.path)
def test_every_key_refuses_what_it_cannot_be(key: ConfigurationKey) -> None:
    """Too small, too large, endless, no number, of another type: one sentence that names the key, never a crash."""
    number = ["x", True, {}, float("nan"), float("inf"), 10**400, -(10**400), key.low - 1, key.high * 2 + 1]
    number += [key.low] if key.open else []
    bad = {
        "text": ["x", 1, [], {}],
        "whole": [*number, 1.5, [1]],
        "number": [*number, [1.0]],
        "axes": [*number, [], ["x"], [float("nan")]],
        "joints": [*number, [], ["x"], [10**400]],
        "turns": [*number, [], ["x"], [10**400]],
        "numbers": [*number, 1.0, [], [-1.0], [10**400]],
        "point": [*number, 1.0, [1.0], [1.0, 0.0, 0.0, 0.0], [10**400, 0.0]],
    }[key.kind]
    for value in bad:
        wall = {"normal": [1.0, 0.0], "offset": 0.1, "stiffness": 1e4, "force": 9.0, key.name: value}
        with pytest.raises(PlantError) as caught:
            check_configuration({"wall": [wall]} if key.table == "wall" else {key.table: {key.name: value}}, "file")
        said = str(caught.value)
        assert said.count("\n") == 0, said
        assert f"{key.name}: found " in said, said
        assert said.endswith("."), said


def test_an_arm_without_the_controller_is_refused() -> None:
    with pytest.raises(PlantError, match="without a predictive controller"):
        MPC(load("paper", out=built()[0].folder.parent), Configuration())


@pytest.mark.parametrize(
    "text", ["nodes=1", "nodes=401", "walls=9", "space=moon", "nodes=20,nodes=20", "x=1", "nodes=-5", "nodes=2e9"]
)
def test_a_structure_that_cannot_be_built_is_refused_before_the_build(text: str) -> None:
    with pytest.raises(StructureError):
        parse_structure(text)


def test_a_horizon_that_memory_does_not_allow_is_refused_before_the_build(tmp_path: Path) -> None:
    long = parse_structure("nodes=400,walls=8")
    assert long is not None
    check_memory(long, 2, 8)
    with pytest.raises(StructureError, match=r"400 nodes of 24 states take \d+ MiB, possible are 32 MiB; take at most"):
        check_memory(long, 6, 24)
    robot = tmp_path / "robot.toml"
    robot.write_text(format_chain_robot(built()[0].robot, 6))
    c = check_configuration({"mpc": {"nodes": 400}}, "test")
    with pytest.raises(PlantError, match="take at most 1.. nodes") as caught:
        load(robot, out=tmp_path, mpc=c)
    assert str(caught.value).count("\n") == 0
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]
    assert parse_structure("") is None


def test_what_a_horizon_takes_is_what_is_said() -> None:
    size = shutil.which("size")
    if size is None:
        pytest.skip("size of binutils is not installed here")
    arm, c = built()
    library = arm.folder / arm.manifest["library"]
    done = subprocess.run([size, str(library)], capture_output=True, text=True, check=True)
    data, zeros = (int(word) for word in done.stdout.splitlines()[1].split()[1:3])
    structure = parse_structure(c.structure)
    assert structure is not None
    taken = arm.module.length("mpc_tick", "controller") + data + zeros
    assert 0.9 < memory_needed(structure, arm.n, 8) / taken < 1.1
