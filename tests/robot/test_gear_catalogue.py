"""Table I of the paper from the catalogue's numbers alone."""

from __future__ import annotations

import math

import pytest

from gen.robot.gear_catalogue import CATALOGUE, Gear, drive_laws

TABLE_1 = {"K_f0": "9743.94", "c_f": "0.0831", "K_w0": "2.5517", "c_w": "27.027"}


@pytest.fixture
def gear() -> Gear:
    return CATALOGUE["CSG-17-100"]


def test_table_1_to_every_printed_digit(gear: Gear) -> None:
    for (name, printed), number in zip(TABLE_1.items(), drive_laws(gear), strict=True):
        digits = len(printed.split(".")[1])
        assert f"{number:.{digits}f}" == printed, name


def test_stiffness_passes_through_k1_and_k2_at_the_mid_torques(gear: Gear) -> None:
    K_f0, c_f, _, _ = drive_laws(gear)
    assert K_f0 * (1 + (c_f * gear.T1 / 2) ** 2) == pytest.approx(gear.K1, rel=1e-12)
    assert K_f0 * (1 + (c_f * (gear.T1 + gear.T2) / 2) ** 2) == pytest.approx(gear.K2, rel=1e-12)


def test_the_wave_generator_saturates_at_half_the_loss(gear: Gear) -> None:
    _, _, K_w0, c_w = drive_laws(gear)
    assert 1 / (c_w * gear.ratio * K_w0) == pytest.approx(gear.hysteresis_loss / 2, rel=1e-12)  # (30)
    assert c_w == pytest.approx(1 / gear.starting_torque, rel=1e-12)


def test_the_printed_28a_with_torsions_misses_table_1(gear: Gear) -> None:
    """(28a) prints differences of torsion squared; taken so, c_f K_f0 comes out nowhere near Table I."""
    first, second = gear.T1 / 2 / gear.K1, gear.T1 / gear.K1 + (gear.T2 - gear.T1) / 2 / gear.K2
    K_f0 = float(TABLE_1["K_f0"])
    c_f = math.sqrt((gear.K2 - gear.K1) / (K_f0 * (second**2 - first**2)))
    assert abs(c_f / float(TABLE_1["c_f"]) - 1) > 0.5


@pytest.mark.parametrize("gear", CATALOGUE.values(), ids=CATALOGUE)
def test_every_gear_stiffens_and_has_a_source(gear: Gear) -> None:
    assert 0 < gear.T1 < gear.T2 and 0 < gear.K1 < gear.K2 < gear.K3
    assert all(number > 0 for number in drive_laws(gear))
    assert len(gear.source) > 40
