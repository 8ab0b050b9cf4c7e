"""The functions at the top of `hdagen`: their arguments and results, and that importing them loads nothing heavy."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, diagnosis

import hdagen
from hdagen.adoption.robot_update import adopt as adopt_file
from hdagen.api.robot_loading import find_robot_file
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.stages.stage import Stage
from hdagen.log.measured_log import Log, write
from hdagen.prediction.window_replay import replay as replay_windows

FUNCTIONS = (
    "adopt",
    "check",
    "diagnose",
    "excite",
    "export",
    "load_robot",
    "read_diagnosis",
    "read_log",
    "replay",
    "simulate",
)
HEAVY = ("numpy", "scipy", "pyarrow", "pandas", "polars", "casadi", "rich")


@pytest.fixture
def robot(tmp_path: Path, build: Callable[..., Compiled], monkeypatch: pytest.MonkeyPatch) -> Path:
    """The robot file of `arm`, whose builds the session shares."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(FLEXIBLE).folder.parent))
    path = tmp_path / "robot.toml"
    path.write_text(FLEXIBLE, encoding="utf-8")
    return path


def test_importing_hdagen_loads_nothing_heavy() -> None:
    script = f"import sys, hdagen; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_name_is_there_and_the_functions_are_typed() -> None:
    assert set(FUNCTIONS) <= set(hdagen.__all__) <= set(dir(hdagen))
    for name in hdagen.__all__:
        assert callable(getattr(hdagen, name)), name
    for name in FUNCTIONS:
        function = getattr(hdagen, name)
        hints = typing.get_type_hints(function)
        assert inspect.isfunction(function) and set(inspect.signature(function).parameters) == hints.keys() - {"return"}


def test_options_are_given_by_name_and_have_defaults() -> None:
    for name in ("adopt", "check", "diagnose", "excite", "load_robot", "read_log", "replay"):
        parameters = inspect.signature(getattr(hdagen, name)).parameters.values()
        options = [one for one in parameters if one.kind is inspect.Parameter.KEYWORD_ONLY]
        assert options and all(one.default is not inspect.Parameter.empty for one in options), name


# -- robots -----------------------------------------------------------------------------------------------------------


def test_a_loaded_robot_stands_for_its_file(robot: Path) -> None:
    arm = hdagen.load_robot(robot)
    assert hdagen.load_robot(arm) is arm
    assert find_robot_file(arm) == robot
    assert find_robot_file("emps") == "emps"


def test_a_robot_with_other_parameters_than_its_file_is_refused(robot: Path) -> None:
    arm = hdagen.load_robot(robot)
    arm.parameters["mass_1"] *= 1.1
    with pytest.raises(hdagen.PlantError, match=r"mass_1 differ from the robot file.*write them into the file"):
        find_robot_file(arm)


def test_a_build_alone_is_refused_where_other_effects_are_wanted(arm: Arm, good: Log) -> None:
    with pytest.raises(hdagen.PlantError, match=r"the folder of a build.*give the preset or the robot.toml"):
        hdagen.diagnose(arm, good)


# -- diagnose ---------------------------------------------------------------------------------------------------------


def test_diagnose_hands_on_what_it_is_given(
    robot: Path, good: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One log or several, of files, of `Log` objects and of tables."""
    given: list[Any] = []

    def note(*arguments: Any, **options: Any) -> str:
        given[:] = [*arguments, options["on_stage"]]
        return "a diagnosis"

    monkeypatch.setattr("hdagen.api.log_diagnosis.pipeline.diagnose", note)
    file = tmp_path / "log.parquet"
    write(good, file)
    table = {"time": good.time, **good.columns}
    heard: list[Stage] = []
    said = hdagen.diagnose(robot, [str(file), good, table], file, on_stage=heard.append)
    assert str(said) == "a diagnosis" and given[0] == robot and given[3] == heard.append
    assert [log.source for log in given[1]] == [str(file), "simulated", "table"]
    for log in (*given[1], *given[2]):
        assert np.array_equal(log.time, good.time) and all(np.array_equal(log[n], good[n]) for n in good.columns)
    for one in (file, good, table):
        hdagen.diagnose(robot, one)
        assert len(given[1]) == 1 and given[2] == []


@pytest.mark.parametrize("logs, said", [([], "found none"), (7, "found 7"), (["x.xls"], "no log ends in '.xls'")])
def test_logs_that_are_none_are_refused(logs: Any, said: str) -> None:
    with pytest.raises(hdagen.LogError, match=said):
        hdagen.diagnose("emps", logs)


# -- check, replay, adopt ---------------------------------------------------------------------------------------------


def test_a_good_log_is_usable(arm: Arm, good: Log) -> None:
    found = hdagen.check(arm, good)
    assert found.is_usable and len(found.log) == len(good)
    assert found.table()["severity"] == ["repaired"] * len(found.repairs) + ["warning"] * len(found.warnings) + [
        "notice"
    ] * len(found.notices)


def test_a_log_of_another_robot_is_not(arm: Arm, good: Log) -> None:
    one_joint = {name: values for name, values in good.columns.items() if not name.endswith("_2")}
    found = hdagen.check(arm, Log(good.time, one_joint, 1, "half"))
    assert not found.is_usable and "half" in found.problems[0]
    assert "refused" in str(found) and "<table>" in found._repr_html_()


def test_a_replay_is_that_of_the_repaired_log(arm: Arm, good: Log) -> None:
    found, plain = hdagen.replay(arm, good), replay_windows(arm, good)
    assert found.gap == plain.gap and all(np.array_equal(found.columns[n], plain.columns[n]) for n in plain.columns)
    assert pa.table(found).column_names == list(plain.columns)


def test_a_replay_takes_a_diagnosis(robot: Path, good: Log) -> None:
    said = diagnosis()
    arm = hdagen.load_robot(robot, effects=("transmission_hysteresis",))
    assert hdagen.replay(robot, good, diagnosis=said).errors == replay_windows(arm, good, with_=said).errors


def test_a_replay_over_missing_values_is_refused(arm: Arm, good: Log) -> None:
    columns = dict(good.columns)
    columns["motor_current_1"] = columns["motor_current_1"].copy()
    columns["motor_current_1"][100:110] = np.nan
    with pytest.raises(hdagen.LogError, match=r"motor_current_1 has no value in 10 row.*fill"):
        hdagen.replay(arm, Log(good.time, columns, 2, "holes"))


def test_adopt_takes_a_file_its_content_and_a_diagnosis(robot: Path, tmp_path: Path) -> None:
    content = diagnosis()
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(content))
    texts = {hdagen.adopt(given, robot).text for given in (path, content, hdagen.read_diagnosis(path))}
    assert texts == {adopt_file(path, robot, None).text}
    assert "transmission_hysteresis" in texts.pop() and sorted(p.name for p in tmp_path.iterdir()) == [
        "diagnosis.json",
        "robot.toml",
    ]
