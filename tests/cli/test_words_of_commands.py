"""What a command says can be done where it was said: keys of files and options, no calls of Python."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import arms
import pytest
from compiled import Compiled

import hdagen
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.support.messages import join_nearest_names

CALL = re.compile(r"\b[A-Za-z_][\w.]*\((\w+=|\.\.\.)|\b\w+=\(")
ASKED_FROM_PYTHON = {
    "verdict.py",
    "predictive_controller.py",
    "build_loader.py",
    "json_writer.py",
}  # what loads a model by itself never meets these


def texts(path: Path) -> Iterator[str]:
    """Every string of a module but its documentation."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bodies = (node.body for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef))
    documentation = {id(body[0].value) for body in bodies if body and isinstance(body[0], ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.value


def test_no_sentence_asks_for_a_call_of_python() -> None:
    found = {
        f"{path.name}: {text}"
        for path in Path(hdagen.__file__).parent.rglob("*.py")
        for text in texts(path)
        if " " in text and CALL.search(text) and "<" not in text
    }
    assert not {entry for entry in found if entry.partition(":")[0] not in ASKED_FROM_PYTHON}


@pytest.fixture
def arm(build: Callable[..., Compiled]) -> Callable[[str], Arm]:
    """arm(limits) -> an arm of one joint with these keys of [joint.limits]."""
    return lambda limits: Arm(build(f"{arms.SMALL}[joint.limits]\n{limits}").folder)


def test_what_a_controller_lacks_is_told_by_its_key(arm: Callable[[str], Arm]) -> None:
    with pytest.raises(PlantError) as raised:
        Controller(arm("speed = 2.0\n"), "position", Guard(Safe.ZERO))
    limit, rate = str(raised.value).splitlines()
    assert "write torque_constant and max_current in [joint.drive], or torque in [joint.limits]" in limit
    assert "write motor_torque_rate in [joint.limits]" in rate


def test_a_drive_whose_input_is_torque_is_limited_by_its_joint(arm: Callable[[str], Arm]) -> None:
    controller = Controller(arm("torque = 30.0\nmotor_torque_rate = 50.0\n"), "position", Guard(Safe.ZERO))
    assert [float(values[0]) for values in controller.torque_limits()] == [1.5, 50.0]  # 30 N m over a ratio of 20


def test_the_nearest_names_come_first_and_the_rest_is_counted(arm: Callable[[str], Arm]) -> None:
    one = arm("speed = 2.0\n")
    with pytest.raises(
        PlantError, match=r"no parameter named mas_1; there are mass_1, .* and \d+ more\.|there are mass_1"
    ):
        one.parameters["mas_1"]
    assert join_nearest_names(["torqe"], ["a", "torque", "b"], 2) == "torque, a and 1 more"
    assert join_nearest_names(["x"], []) == "none"
