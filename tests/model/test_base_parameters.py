"""Base parameters: their number in closed form, and that Pinocchio's regressor has no other combinations."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import robots
import space_robots
from test_chain_in_space import URDFS, Pinocchio, find_urdf

from gen.builder.robot_check import report_robot
from gen.model.base_parameters import LINK_PARAMETERS, BaseParameter, find_base_parameters
from gen.model.robot_chain import make_chain
from gen.robot.load_robot import from_table
from gen.robot.model_parameters import list_parameters
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model

THEIRS = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")  # Pinocchio's order


def find(text: str) -> tuple[list[BaseParameter], list[str]]:
    robot = from_table(tomllib.loads(text), "robot.toml", Path("robot.toml"))
    values = {value.name: value.nominal for value in list_parameters(robot)}
    return find_base_parameters(make_chain(robot), values)


def flat(joints: int, gravity: str) -> str:
    """A chain of parallel axes along z."""
    text = space_robots.chain("R" * joints, 3, aligned=True)
    lines = []
    for line in text.splitlines():
        key = line.partition(" = ")[0]
        own = {"rotation": "[1.0, 0.0, 0.0, 0.0]", "axis": "[0.0, 0.0, 1.0]", "gravity": gravity}
        lines.append(f"{key} = {own[key]}" if key in own else line)
    return "\n".join(lines)


def urdf(robot: str) -> str:
    return import_model(str(find_urdf(robot)), ChainRequest(tip=URDFS[robot][1])).text


# 7 n − 4 β, less 2 where the first axis is upright; β joints from the base on are parallel (Mayeda et al. 1990)
KNOWN: dict[str, tuple[Callable[[], str], int]] = {
    "one joint across gravity": (lambda: flat(1, "[0.0, -9.81, 0.0]"), 3),
    "three parallel joints across gravity": (lambda: flat(3, "[0.0, -9.81, 0.0]"), 9),
    "three parallel upright joints": (lambda: flat(3, "[0.0, 0.0, -9.81]"), 7),
    "any four joints": (lambda: space_robots.chain("RRRR", 8), 24),
    "ur5": (lambda: urdf("ur5"), 36),
    "panda": (lambda: urdf("panda"), 43),
}


@pytest.mark.parametrize("which", KNOWN)
def test_there_are_as_many_as_is_known(which: str) -> None:
    make_text, count = KNOWN[which]
    text = make_text()
    found, unseen = find(text)
    assert len(found) == count
    every = [one.name for one in found] + unseen + [name for one in found for name, _ in one.others]
    assert set(every) == {f"{name}{j}" for j in range(1, text.count("[[joint]]") + 1) for name in LINK_PARAMETERS}


@pytest.mark.parametrize("kinds", ["RRR", "RPR", "PRRR"])
def test_pinocchios_regressor_has_these_combinations_and_no_other(kinds: str) -> None:
    text = space_robots.chain(kinds, 9)
    found, unseen = find(text)
    reference, n = Pinocchio(text), len(kinds)
    rng = np.random.default_rng(4)
    rows = [
        pin.computeJointTorqueRegressor(reference.model, reference.data, *rng.uniform(-3, 3, (3, n))).copy()
        for _ in range(100)
    ]
    whole = np.vstack(rows)
    column = {f"{name}{j + 1}": whole[:, 10 * j + k] for j in range(n) for k, name in enumerate(THEIRS)}
    assert np.linalg.matrix_rank(whole) == len(found) < 10 * n
    assert all(np.abs(column[name]).max() < 1e-9 for name in unseen)
    combined = dict.fromkeys((name for one in found for name, _ in one.others), np.zeros(len(whole)))
    for one in found:
        for name, share in one.others:
            combined[name] = combined[name] + share * column[one.name]
    for name, made in combined.items():
        assert made == pytest.approx(column[name], abs=1e-6 * np.abs(column[name]).max())


def test_a_check_prints_them(tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text(flat(2, "[0.0, 0.0, -9.81]"))
    lines, _ = report_robot(str(robot), out=tmp_path)
    shown = [line.split("links    ")[1] for line in lines if "links    " in line]
    assert shown[0] == "4 combinations of 20 inertial parameters show in a motion"
    assert shown[1].startswith("ZZ1 + ") and shown[1].endswith(" M2")
    assert [line.split()[0] for line in shown[2:5]] == ["MX2", "MY2", "ZZ2"]
    assert shown[-1].startswith("no motion shows M1, MX1, MY1, MZ1, XX1, YY1, XY1, XZ1, YZ1, MZ2, XX2")
    robot.write_text(robots.chain("R", 1))
    assert not any("links    " in line for line in report_robot(str(robot), out=tmp_path)[0])
