"""Names of joints in place of their numbers: in columns, in columns.toml, and in effect@name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdagen
from hdagen.arm.joint_names import number_effect, number_joint, read_joint_names
from hdagen.log.column_map import ColumnsError, number_column
from hdagen.log.measured_log import read

NAMES = ("shoulder", "command_1", None)
ROWS = 20


def make_table(*names: str) -> dict[str, np.ndarray]:
    time = np.arange(ROWS) * 0.01
    return {"time": time} | {name: np.sin(time + k) for k, name in enumerate(names)}


@pytest.mark.parametrize(
    ("stated", "column"),
    [
        ("motor_torque_shoulder", "motor_torque_1"),
        ("motor_torque_command_shoulder", "motor_torque_command_1"),
        ("motor_torque_command_1", "motor_torque_command_1"),  # a number stands before a name that reads like one
        ("joint_position_command_1", "joint_position_2"),
        ("joint_position_elbow", "joint_position_elbow"),
        ("joint_position_", "joint_position_"),
        ("time", "time"),
        ("tip_force_x", "tip_force_x"),
    ],
)
def test_a_column_has_the_number_of_its_joint(stated: str, column: str) -> None:
    assert number_column(stated, NAMES) == column


def test_a_log_by_names_is_the_log_by_numbers() -> None:
    named = make_table("motor_torque_shoulder", "joint_position_shoulder", "left_over")
    plain = hdagen.read_log(make_table("motor_torque_1", "joint_position_1"))
    found = hdagen.read_log(named, joints=NAMES)
    assert set(found.columns) == set(plain.columns) and found.n_joints == 1
    assert all(np.array_equal(found[name], plain[name]) for name in plain.columns)
    assert any("left_over" in note for note in found.notes)


def test_columns_toml_takes_names() -> None:
    table = make_table("torque", "joint_position_shoulder")
    columns = {"motor_torque_shoulder": {"from": "torque"}, "joint_position_shoulder": {"sign": -1}}
    found = hdagen.read_log(table, columns=columns, joints=NAMES)
    assert np.array_equal(found["motor_torque_1"], table["torque"])
    assert np.array_equal(found["joint_position_1"], -table["joint_position_shoulder"])


def test_a_joint_that_is_there_twice_is_refused() -> None:
    table = make_table("motor_torque_1", "motor_torque_shoulder", "joint_position_1")
    with pytest.raises(ColumnsError, match="motor_torque_1 and motor_torque_shoulder are the same column"):
        hdagen.read_log(table, joints=NAMES)
    columns = {"motor_torque_1": {"unit": "N m"}, "motor_torque_shoulder": {"unit": "N m"}}
    with pytest.raises(ColumnsError, match=r"\[motor_torque_shoulder\] and \[motor_torque_1\] are the same column"):
        hdagen.read_log(table, columns=columns, joints=NAMES)


def test_a_force_in_space_is_not_turned_in_the_plane() -> None:
    table = make_table("motor_torque_1", "joint_position_1", "tip_force_x", "tip_force_y", "tip_moment_z")
    with pytest.raises(ColumnsError, match="turns a force in the plane, and the log has tip_moment_z"):
        hdagen.read_log(table, columns={"tip_force": {"frame": "tip"}})


def test_a_file_by_names_is_read(tmp_path: Path) -> None:
    table = make_table("motor_torque_shoulder", "joint_position_shoulder")
    text = (
        ",".join(table)
        + "\n"
        + "\n".join(",".join(map(repr, map(float, row))) for row in zip(*table.values(), strict=True))
    )
    (tmp_path / "log.csv").write_text(text)
    assert read(tmp_path / "log.csv", names=NAMES).n_joints == 1


def test_effects_and_joints_by_name() -> None:
    assert number_effect("stribeck_friction@shoulder", NAMES) == "stribeck_friction@1"
    assert number_effect("stribeck_friction@3", NAMES) == "stribeck_friction@3"
    assert number_effect("payload", NAMES) == "payload" and number_joint("elbow", NAMES) == "elbow"


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ('[[joint]]\nname = "a"\n[[joint]]\n', ("a", None)),
        ("joint = 3", ()),
        ("[[joint]]\nname = 7\n", (None,)),
        ("joint = [1, {name = 'b'}]", (None, "b")),
        ("not toml", ()),
        ("", ()),
    ],
)
def test_names_are_read_from_any_file(text: str, names: tuple[str | None, ...], tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(text)
    assert read_joint_names(tmp_path / "robot.toml") == names
    assert read_joint_names(tmp_path / "absent.toml") == () and read_joint_names("paper") == (None, None)
