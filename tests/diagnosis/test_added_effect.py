"""An effect that only a file of its own and a line in the list of effects know: all else must follow from these."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import arms
import pytest

from gen.effects import ALL
from gen.robot.schema import keys_of

ROOT = Path(__file__).resolve().parents[2]
EFFECT_FILE = '''"""Magnetic detents of a joint. Legend: q joint angle; a, b sine and cosine amplitude, N m."""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from gen.effects.appearance import Abscissa, ConfusionGroup, Experiment, Plot, PlotKind
from gen.effects.effect import Effect, Parameter, Port, Signals


def compute_torque(s: Signals, p: Mapping[str, Any]) -> Any:
    """a sin 5q + b cos 5q."""
    angle = 5 * s.joint_position
    return p["detent_sine"] * ca.sin(angle) + p["detent_cosine"] * ca.cos(angle)


EFFECT = Effect(
    name="magnetic_detent",
    port=Port.LINK,
    parameters=(
        Parameter("detent_sine", "N m", 0.0, -50.0, 50.0, "pull towards a detent", typical=1.0),
        Parameter("detent_cosine", "N m", 0.0, -50.0, 50.0, "pull towards a detent", typical=1.0),
    ),
    amplitudes=("detent_sine", "detent_cosine"),
    equation=compute_torque,
    citation="of this test",
    experiment=Experiment("creep past every detent", "pulls five times a turn"),
    confusion_groups=(ConfusionGroup.RANGE_END,),
    plot=Plot(PlotKind.RESIDUAL, Abscissa.JOINT_ANGLE),
)
'''
LAST_LINE = '    "torque_sensor_gain",\n'
ROBOT = arms.arm(
    "R",
    rigid="r",
    step=1e-3,
    drive="torque_constant = 0.05\nmax_current = 10.0\nfriction_smoothing = 1.0\n"
    "[joint.sensor]\njoint_encoder_resolution = 6e-6\ncurrent_noise = 0.01",
).replace("motor_inertia = 0.00013", "motor_inertia = 0.0")  # no rotor, and so no spring to look for
TRUTH = {"detent_sine": 1.5, "detent_cosine": -0.8}
SCRIPT = """
import json, sys
import numpy as np
from hdagen.arm.compiled_arm import load
from hdagen.diagnosis.decision.separating_experiments import suggest_experiments
from hdagen.log.measured_log import Log, write

truth = json.loads(sys.argv[1])
arm = load("robot.toml", "native", ("all",))  # as a diagnosis builds it
arm.parameters.update({f"{name}_1": value for name, value in truth.items()})
time = np.arange(4000) * 1e-3
waves = np.sin(2 * np.pi * np.outer(time, [0.31, 0.9, 2.3]) + [0.0, 1.0, 2.0])
u = np.zeros((len(time), arm.nu))
u[:, 0] = np.minimum(2.0 * time, 1.0) * (waves @ [3.0, 1.4, 0.7])
x = arm.rollout(arm.rest([-np.pi / 2]), u[:-1], np.diff(time), exact=True)
angle = arm.outputs(x, u)["joint_position"][:, 0]
columns = {"motor_current_command_1": u[:, 0].copy(), "joint_position_1": np.round(angle / 6e-6) * 6e-6}
write(Log(time, columns, 1, "made"), "log.csv")
others = ["contact@1", "command_delay@1"]
print(suggest_experiments(arm.effects, "magnetic_detent@1", others))
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project with one more effect, beside a robot file."""
    folder = tmp_path_factory.mktemp("project")
    shutil.copytree(ROOT / "gen", folder / "gen", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "hdagen").symlink_to(ROOT / "hdagen")
    (folder / "gen" / "effects" / "magnetic_detent.py").write_text(EFFECT_FILE)
    registered = folder / "gen" / "effects" / "__init__.py"
    text = registered.read_text()
    assert text.count(LAST_LINE) == 1
    registered.write_text(text.replace(LAST_LINE, f'{LAST_LINE}    "magnetic_detent",\n'))
    (folder / "robot.toml").write_text(ROBOT)
    return folder


def run_python(project: Path, *arguments: str) -> str:
    """What a Python prints that finds the copy of the project."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(project)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def test_an_effect_is_one_file_and_one_line(project: Path) -> None:
    """It is simulated, separated from others by experiments and by a motion, found in a log, and drawn."""
    experiments = run_python(project, "-c", SCRIPT, json.dumps(TRUTH))
    assert "Against contact@1: approach both ends of the range slowly" in experiments
    assert "creep past every detent (magnetic detent pulls five times a turn)" in experiments

    run_python(project, "-m", "hdagen", "diagnose", "robot.toml", "log.csv", "--out", "found")
    found = json.loads((project / "found" / "diagnosis.json").read_text())
    assert found["verdict"] == ["magnetic_detent@1"]
    cause = next(cause for cause in found["causes"] if cause["effect"] == "magnetic_detent")
    values = {name: one["value"] for name, one in cause["parameters"].items()}
    assert values == pytest.approx(TRUTH, rel=0.1)
    report = (project / "found" / "report.html").read_text()
    assert "Magnetic detent on joint 1 is missing in the model" in report
    picture = report.partition("Magnetic detent of joint 1")[2]
    assert float(re.findall(r"R² = (-?[0-9.]+)", picture)[0]) > 0.95

    pair = "magnetic_detent,cable_spring"
    moved = run_python(project, "-m", "hdagen", "excite", "robot.toml", "--separate", pair, "--duration", "2", "--json")
    assert json.loads(moved)["separates"]


# -- nothing else knows an effect by its name -------------------------------------------------------------------------

ALLOWED = (
    "hdagen/blind/",  # another simulator, with effects of its own
    "hdagen/paper/",  # the paper's arm
    "hdagen/bench/",  # the arms that are measured
    "hdagen/model_export/",  # what another simulator holds of each effect; the rest is listed as left out
    "hdagen/adoption/series_springs.py: stiffness_level",  # the number that stands for four springs of the file
    "hdagen/adoption/verdict.py: , possible is name@joint, as ",  # an example in an error
    "hdagen/cli/excite.py: example:",  # an example in the help
    "hdagen/diagnosis/residuals/localization.py: payload_",  # a number that a robot file states of its last link
)


def strings(path: Path) -> list[str]:
    """The strings of a module, those of f-strings included, without docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bare = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in bare]
    return [node.value for node in constants if isinstance(node.value, str)]


def test_no_other_file_knows_an_effect_by_name() -> None:
    """Keys of the robot file aside, which are friction and torque constant of every drive."""
    keys = {key for table in ("", "joint", "joint.drive") for key in keys_of(table)} | {"stiffness"}
    names = {effect.name for effect in ALL} | {q.name for effect in ALL for q in effect.parameters}
    long, words = (sorted(name for name in names - keys if ("_" in name) is told) for told in (True, False))
    known = re.compile(rf"(?s).*\b({'|'.join(long)})(?![a-z]).*|({'|'.join(words)})[_@]?")  # a word is also English
    found = []
    for path in sorted((ROOT / "hdagen").rglob("*.py")):
        place = path.relative_to(ROOT).as_posix()
        lines = (f"{place}: {text.strip()}" for text in strings(path) if known.fullmatch(text))
        found += [line for line in lines if not line.startswith(ALLOWED)]
    assert found == []
