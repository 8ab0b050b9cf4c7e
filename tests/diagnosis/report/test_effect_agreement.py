"""An effect's own picture says how far it tells the log's points, and warns where they are surely something else."""

from __future__ import annotations

import numpy as np
import pytest

from hdagen.arm.arrays import Array
from hdagen.diagnosis.residuals.effect_agreement import measure_agreement


def walk(rng: np.random.Generator, rows: int) -> Array:
    """Noise of which neighbours are alike, of unit size."""
    values = np.convolve(rng.normal(size=rows + 199), np.hanning(200), "valid")
    return np.asarray(values / values.std())


@pytest.mark.parametrize(("times", "warns"), [(1.0, False), (1.7, False), (4.0, True), (0.25, True), (-1.0, True)])
def test_an_effect_with_a_quarter_of_the_slope_of_the_points_is_warned_of(times: float, warns: bool) -> None:
    rng = np.random.default_rng(1)
    added = np.sin(np.linspace(0, 200, 20_000))
    found = measure_agreement(times * added + 0.1 * walk(rng, len(added)), added)
    assert found.slope == pytest.approx(times, abs=0.05) and found.is_contradicted is warns
    assert (
        "Warning: the log shows" in found.describe()
    ) is warns and f"R² = {found.explained_share:.2f}" in found.describe()
    if times == 4.0:
        assert found.explained_share == pytest.approx(1 - 9 / 16, abs=0.01) and "4 times" in found.describe()


def test_r_squared_is_the_share_that_is_taken_away() -> None:
    rng = np.random.default_rng(2)
    added = np.full(5000, 0.3)  # a bias has no slope over anything
    assert measure_agreement(added, added).explained_share == 1.0
    assert measure_agreement(added + 0.3 * rng.normal(size=5000), added).explained_share == pytest.approx(0.5, abs=0.03)
    assert measure_agreement(-added, added).explained_share == pytest.approx(-3.0)
    assert (
        not measure_agreement(added, 0.0 * added).is_contradicted
        and measure_agreement(added, 0.0 * added).explained_share == 0.0
    )
    assert measure_agreement(0.0 * added, added).is_contradicted


def test_what_noise_hides_is_no_contradiction() -> None:
    rng, warned = np.random.default_rng(3), 0
    for _ in range(200):
        added = walk(rng, 4000)
        warned += measure_agreement(added + 5.0 * walk(rng, 4000), added).is_contradicted
    assert warned <= 10
