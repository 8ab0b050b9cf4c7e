"""controller.toml of the predictive controller: every key, every refusal, and what its documents say."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpc_arms import built

from gen.mpc.structure import StructureError, fitting, parse
from hdagen.mpc.configuration import Configuration, Wall, checked, read
from hdagen.mpc.controller import MPC
from hdagen.mpc.keys import KEYS, documented
from hdagen.plant import PlantError, load

DOCS = Path(__file__).parent.parent / "docs" / "mpc.md"


def test_the_documented_keys_are_the_keys() -> None:
    assert documented() in DOCS.read_text(encoding="utf-8")


def test_every_default_is_one_that_the_key_allows() -> None:
    tables: dict[str, dict[str, object]] = {}
    for key in KEYS:
        if key.default is not None and key.table != "wall":
            tables.setdefault(key.table, {})[key.name] = key.default
    assert checked(tables, "defaults").structure == "nodes=20,walls=0,space=tip"


def test_a_file_is_read_and_changes_what_it_says(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text(
        "[mpc]\nnodes = 10\n[admittance]\nmass = [1.0, 2.0]\n[limits]\ntip_speed = 0.1\n"
        "[[wall]]\nnormal = [0.0, 1.0]\noffset = 0.2\nstiffness = 1e4\nforce = 15.0\n"
    )
    c = read(path)
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
        read(path)
    assert str(caught.value).count("\n") == 0


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "controller.toml"
    path.write_text("[mpc]\nnodes = 1\nsolver = 'x'\n[limits]\ntip_speed = -1\n")
    with pytest.raises(PlantError) as caught:
        read(path)
    assert str(caught.value).count("\n") == 2


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"limits__joint_low": 3.0, "limits__joint_high": -3.0}, "lies above"),
        ({"limits__motor_torque": (0.1, 0.1, 0.1)}, "3 numbers and there are 2 joints"),
        ({"admittance__mass": (1.0, 1.0, 1.0)}, "3 numbers and there are 2 axes"),
    ],
)
def test_what_does_not_fit_the_arm_is_refused(changes: dict[str, object], words: str) -> None:
    arm, c = built()
    with pytest.raises(PlantError, match=words):
        MPC(arm, c.changed(**changes))


def test_an_arm_without_the_controller_is_refused() -> None:
    with pytest.raises(PlantError, match="without a predictive controller"):
        MPC(load("paper", out=built()[0].folder.parent), Configuration())


@pytest.mark.parametrize(
    "text", ["nodes=1", "nodes=401", "walls=9", "space=moon", "nodes=20,nodes=20", "x=1", "nodes=-5", "nodes=2e9"]
)
def test_a_structure_that_cannot_be_built_is_refused_before_the_build(text: str) -> None:
    with pytest.raises(StructureError):
        parse(text)


def test_a_horizon_that_memory_does_not_allow_is_refused_before_the_build() -> None:
    structure = parse("nodes=400,walls=8")
    assert structure is not None
    fitting(structure, 2, 8)
    with pytest.raises(StructureError, match="MiB"):
        fitting(structure, 6, 2000)
    assert parse("") is None
