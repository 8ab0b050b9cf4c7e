"""The drive's tables and figures: Table I to its digits, the loop of Fig. 3 (b), the stiffness of Fig. 8, Table II."""

from __future__ import annotations

import math

import pytest

from hdagen.paper.figures import drive_figures
from hdagen.paper.prototype.figure_result import Claim, Result
from hdagen.paper.prototype.virtual_prototype import (
    PROTOTYPE,
    TABLE_1,
    Bench,
    torsion_changes,
    without_kinematic_torsion,
)


def held(result: Result, words: str) -> Claim:
    """The one claim that holds these words."""
    (found,) = (claim for claim in result.claims if words in claim.paper)
    return found


def test_table_1_is_reproduced_to_its_printed_digits(bench: Bench) -> None:
    result = drive_figures.make_table1(bench)
    rows = {row[0].partition(" (")[0]: row for row in result.numbers["rows"]}
    printed = {"K_w0": "2.5517", "K_f0": "9743.94", "c_f": "0.0831", "c_w": "27.027", "τ_fs": "0.037", "N": "100"}
    for name, text in printed.items():
        decimals = len(text.partition(".")[2])
        assert rows[name][1] == text and f"{rows[name][2]:.{decimals}f}" == text and rows[name][3] == "yes"
    assert held(result, "follow from the catalogue").holds and held(result, "835 g cm²").holds is False


def test_the_catalogue_s_loss_is_the_width_of_the_loop_and_the_laws_alone_have_none(bench: Bench) -> None:
    result = drive_figures.make_fig3b(bench)
    assert result.numbers["width"] == pytest.approx(drive_figures.HYSTERESIS_LOSS, rel=0.1)
    assert result.numbers["width_of_laws_alone"] < 0.02 * drive_figures.HYSTERESIS_LOSS
    assert result.numbers["loss_per_turn"] > 0
    log = result.logs["loaded"]
    assert max(abs(log["motor_position_1"])) == 0, "the input is locked"


def test_the_stiffness_is_the_catalogue_s_at_the_mid_torques_and_not_above_t2(bench: Bench) -> None:
    numbers = drive_figures.make_fig8(bench).numbers
    assert numbers["at_mid_torques"]["T1/2"] == pytest.approx(drive_figures.K1, rel=1e-6)
    assert numbers["at_mid_torques"]["(T1+T2)/2"] == pytest.approx(drive_figures.K2, rel=1e-6)
    assert numbers["at_T2"] == pytest.approx(19441, rel=1e-3) and numbers["at_T2"] > 1.2 * drive_figures.K3
    assert numbers["at_no_torque"] == pytest.approx(7051, rel=1e-3)
    slopes = dict(zip(numbers["torque"].round(1), numbers["stiffness"], strict=True))
    assert slopes[0.5] == pytest.approx(7400, rel=0.02), "the log's own slope, both springs in series"


def test_the_motor_reaches_its_no_load_speed_and_cannot_start_the_gear_on_it(bench: Bench) -> None:
    numbers = drive_figures.make_table2(bench).numbers
    speeds = list(numbers["speed_reached"].values())
    assert speeds[0] == pytest.approx(3730 * 2 * math.pi / 60, rel=0.01) and speeds[1] == 0
    assert speeds[2] == pytest.approx(speeds[0], rel=0.01)
    assert numbers["start_current"] == pytest.approx(0.037 / 0.0525, rel=1e-6)


def test_a_log_comes_with_the_robot_that_it_is_of(bench: Bench) -> None:
    text = drive_figures.make_fig3b(bench).robots["loaded"]
    assert isinstance(text, bytes)
    assert text.decode().count("coulomb_friction = 0.5") == 2 and b"virtual prototype" in text
    changed = bench.robot_file(torsion_changes(2, (1e-4, 0.0, 1e-3, 0.0, 0.0, 0.0))).decode()
    assert "encoder_bias = -0.0001" in changed and "kinematic_square = -0.001" in changed


def test_a_lumped_inertia_that_is_changed_stands_in_the_file(bench: Bench) -> None:
    """Table I's J_a is about the joint: the file of Fig. 9's lighter second arm has it so."""
    changed = bench.robot_file({"inertia_2": 0.33}, TABLE_1).decode()
    lines = [line.partition("#")[0].strip() for line in changed.splitlines() if line.startswith("inertia_about_joint")]
    assert lines == ["inertia_about_joint = 0.876", "inertia_about_joint = 0.33"]


def test_every_number_of_the_prototype_has_a_source() -> None:
    """A source, "assumed" with its reason, or what it repeats stands beside every number of the preset."""
    from gen.presets import find_presets

    lines = find_presets()[PROTOTYPE].read_text(encoding="utf-8").splitlines()
    numbers = [line for line in lines if "=" in line.partition("#")[0] and not line.startswith(("joint =", "name ="))]
    bare = [line for line in numbers if len(line.partition("#")[2].strip()) < 4]
    assert len(numbers) > 40 and bare == []


def test_a_model_can_be_made_to_know_nothing_of_the_torsion(bench: Bench) -> None:
    names = set(without_kinematic_torsion(bench.arm()))
    assert {"kinematic_square_1", "kinematic_fifth_2", "ratio_error_1", "kinematic_sine_twice_2"} <= names
