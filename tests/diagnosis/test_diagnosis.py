"""The diagnosis: its evidence against a dense Gaussian, and truths put into a simulated machine that must come back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from hdagen.__main__ import main
from hdagen.adoption import verdict
from hdagen.arm.arrays import Array
from hdagen.diagnosis.inference.linear_gaussian import CrossProducts
from hdagen.diagnosis.inference.linear_model import LinearModel
from hdagen.diagnosis.inference.marginal_likelihood import (
    compute_evidence_gain,
    compute_presence_probability,
    solve_at_scales,
    solve_with_scales,
)
from hdagen.log.measured_log import write


def problem(rng: np.random.Generator, windows: int = 3) -> tuple[LinearModel, list[Array], int, int, int]:
    """A linear model of small windows with its blocks [S | B | J | r]."""
    m, k, many, rows = 2, 3, 4, 20
    blocks = [rng.normal(size=(rows, m + k + many + 1)) for _ in range(windows)]
    gram = CrossProducts(np.stack([b[:, :-1].T @ b[:, :-1] for b in blocks]), m, k)
    z, r2 = np.stack([b[:, :-1].T @ b[:, -1] for b in blocks]), np.array([b[:, -1] @ b[:, -1] for b in blocks])
    return LinearModel(gram, z, r2, np.full(windows, rows), np.zeros(many)), blocks, m, k, many


def dense(blocks: list[Array], m: int, k: int, s: float, kappa2: Array, v: Array) -> float:
    """Log density of what is left of r once the first states are projected out of every window."""
    seen, columns, noise = [], [], []
    for b, scale in zip(blocks, kappa2, strict=True):
        S, B, J, r = b[:, :m], b[:, m : m + k], b[:, m + k : -1], b[:, -1]
        basis = np.linalg.svd(S)[0][:, m:]  # orthogonal to the first states
        seen.append(basis.T @ r)
        columns.append(basis.T @ J)
        noise.append(scale * (basis.T @ B @ B.T @ basis * s**2 + np.eye(basis.shape[1])))
    J = np.concatenate(columns)
    C = scipy.linalg.block_diag(*noise) + J @ np.diag(v**2) @ J.T
    return float(scipy.stats.multivariate_normal(cov=C).logpdf(np.concatenate(seen)))


@pytest.mark.parametrize("s", [0.0, 0.3])
@pytest.mark.parametrize("scales", [(1.0, 1.0, 1.0), (1.0, 2.5, 40.0)])
def test_the_evidence_is_that_of_the_dense_gaussian(s: float, scales: tuple[float, ...]) -> None:
    kappa2, noise = np.array(scales), np.ones(3)
    linear, blocks, m, k, many = problem(np.random.default_rng(3))
    spike, free = np.full(many, 0.2), np.array([1, 3])
    wide = spike.copy()
    wide[free] = 1.0
    at = solve_at_scales(linear.normal_equations(s), spike, s, kappa2)
    truth = dense(blocks, m, k, s, kappa2, wide) - dense(blocks, m, k, s, kappa2, spike)
    assert compute_evidence_gain(at, spike, free) == pytest.approx(truth, rel=1e-9)
    other = solve_at_scales(linear.normal_equations(0.0), spike, 0.0, noise)
    apart = dense(blocks, m, k, s, kappa2, spike) - dense(blocks, m, k, 0.0, noise, spike)
    assert at.evidence - other.evidence == pytest.approx(apart, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-3, 0.1, 1.0])
def test_how_large_an_effect_is_likely_is_that_of_the_posterior_in_which_it_is_free(scale: float) -> None:
    """Against draws; columns that the log hardly tells (small ``scale``) are as large as their prior says."""
    linear, _, _, _, many = problem(np.random.default_rng(3))
    size = np.append(np.ones(5), np.full(many, scale))
    gram = CrossProducts(
        np.stack([np.outer(size, size) * products for products in linear.cross_products.products]), 2, 3
    )
    linear = LinearModel(gram, linear.z * size, linear.r2, linear.rows, np.zeros(many))
    spike, free, kappa2 = np.full(many, 0.2), np.array([1]), np.ones(3)
    wide = spike.copy()
    wide[free] = 1.0
    ends = np.full(many, -5.0), np.array([5.0, 0.6, 5.0, 5.0])
    exact = solve_at_scales(linear.normal_equations(0.3), wide, 0.3, kappa2)
    drawn = np.random.default_rng(1).normal(exact.mean[1], np.sqrt(exact.covariance[1, 1]), 200_000)
    drawn = drawn[(drawn > -5.0) & (drawn < 0.6)]
    at = solve_at_scales(linear.normal_equations(0.3), spike, 0.3, kappa2)
    assert compute_presence_probability(at, spike, free, 0.3, ends) == pytest.approx(
        np.mean(np.abs(drawn) >= 0.3), abs=0.005
    )
    if scale < 0.01:
        prior = scipy.stats.truncnorm(-5.0, 0.6)
        assert compute_presence_probability(at, spike, free, 0.3, ends) == pytest.approx(
            1 - prior.cdf(0.3) + prior.cdf(-0.3), abs=0.005
        )
    both = compute_presence_probability(
        at, spike, np.array([0, 2]), 0.3, ends
    )  # each by itself: no less than the larger of them alone
    assert both >= max(compute_presence_probability(at, spike, np.array([k]), 0.3, ends) for k in (0, 2)) - 0.1


@pytest.mark.parametrize("s", [0.0, 0.3])
def test_first_states_and_torques_are_those_of_ridge_regression(s: float) -> None:
    linear, blocks, m, k, many = problem(np.random.default_rng(4))
    theta = np.random.default_rng(5).normal(size=many)
    begun, torque = linear.solve_inner(s, theta)
    for w, b in enumerate(blocks):
        left, inner = b[:, -1] - b[:, m + k : -1] @ theta, b[:, : m + k]
        ridge = np.diag([0.0] * m + [1.0 / s**2 if s else 1e20] * k)
        x = np.linalg.solve(inner.T @ inner + ridge, inner.T @ left)
        np.testing.assert_allclose(np.concatenate([begun[w], torque[w]]), x, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_the_most_probable_within_bounds_is_that_of_bounded_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    linear, _, _, _, many = problem(rng)
    reduced, prior, kappa2 = linear.normal_equations(0.3), rng.uniform(0.1, 1.0, many), rng.uniform(1.0, 9.0, 3)
    low, high = np.array([-np.inf, -0.01, 0.0, 0.0]), np.array([0.0, 0.01, np.inf, 0.0])
    H = (reduced.products.dense / kappa2[:, None, None]).sum(0) + np.diag(1.0 / prior**2)
    root, sought = np.linalg.cholesky(H).T, (reduced.b / kappa2[:, None]).sum(0)
    truth = scipy.optimize.lsq_linear(root, np.linalg.solve(root.T, sought), (low - 1e-12, high + 1e-12), tol=1e-14).x
    at = solve_at_scales(reduced, prior, 0.3, kappa2, (low, high))
    np.testing.assert_allclose(at.mean, truth, atol=1e-7)
    assert at.evidence <= solve_at_scales(reduced, prior, 0.3, kappa2).evidence
    far = np.full(many, 1e9)
    free, loose = (
        solve_at_scales(reduced, prior, 0.3, kappa2),
        solve_at_scales(reduced, prior, 0.3, kappa2, (-far, far)),
    )
    assert loose.evidence == free.evidence and np.array_equal(loose.mean, free.mean)


def test_what_windows_leave_at_theta_is_that_of_least_squares() -> None:
    linear, blocks, m, k, many = problem(np.random.default_rng(7))
    theta = np.random.default_rng(8).normal(size=many)
    left = linear.normal_equations(0.0).chi2(theta)
    for w, b in enumerate(blocks):
        r = b[:, -1] - b[:, m + k : -1] @ theta
        best = np.linalg.lstsq(b[:, :m], r, rcond=None)[0]
        assert left[w] == pytest.approx(float(((r - b[:, :m] @ best) ** 2).sum()), rel=1e-8)


def test_windows_that_no_parameter_explains_do_not_bend_what_the_others_say() -> None:
    """Bursts in a tenth of the windows, all the same way: least squares follows them, the weighted fit hardly does."""
    rng = np.random.default_rng(11)
    m, k, many, rows, windows = 2, 3, 4, 40, 60
    truth, blocks = rng.normal(size=many), []
    for w in range(windows):
        columns = rng.normal(size=(rows, m + k + many))
        burst = 300.0 * columns[:, m + k] if w % 10 == 0 else 0.0
        blocks.append(np.column_stack([columns, columns[:, m + k :] @ truth + burst + rng.normal(size=rows)]))
    gram = CrossProducts(np.stack([b[:, :-1].T @ b[:, :-1] for b in blocks]), m, k)
    z, r2 = np.stack([b[:, :-1].T @ b[:, -1] for b in blocks]), np.array([b[:, -1] @ b[:, -1] for b in blocks])
    linear, prior = LinearModel(gram, z, r2, np.full(windows, rows), np.zeros(many)), np.full(many, 10.0)
    at = solve_with_scales(linear, prior, 0.0)
    assert np.all(np.abs(at.mean[1:] - truth[1:]) < 3.5 * np.sqrt(np.diag(at.covariance))[1:])
    assert np.all(at.kappa2[::10] > 100.0) and np.all(at.kappa2[1:10] == 1.0)
    plain = solve_at_scales(linear.normal_equations(0.0), prior, 0.0, np.ones(windows))
    assert abs(plain.mean[0] - truth[0]) > 10.0 > 50.0 * abs(at.mean[0] - truth[0])
    assert at.evidence > plain.evidence


def test_a_hold_out_that_is_the_log_and_a_short_log_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(0, 0.5, 1e-3)
    columns = {"time": time}
    for j in (1, 2):
        columns |= {f"motor_current_command_{j}": 0.1 * np.sin(9 * time), f"motor_position_{j}": 5 * np.sin(8 * time)}
    log = tmp_path / "log.csv"
    write(columns, log)
    assert main(["diagnose", "paper", str(log), "--out", str(tmp_path / "out")]) == 3
    assert "shorter than 1 s" in capsys.readouterr().err
    assert main(["diagnose", "paper", str(log), "--hold-out", str(log), "--out", str(tmp_path / "out")]) == 3
    assert "the hold-out is the log itself" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()  # what was made for nothing is taken away, what was there stays
    (tmp_path / "kept").mkdir()
    assert main(["diagnose", "paper", str(log), "--out", str(tmp_path / "kept")]) == 3
    assert (tmp_path / "kept").exists()


@pytest.mark.campaign
def test_a_made_log_names_its_effect_and_closes_the_gap(data_dir: Path, tmp_path: Path) -> None:
    case = data_dir / "made" / "single" / "case-005"
    arguments = ["diagnose", str(case / "robot.toml"), str(case / "log.parquet"), "--out", str(tmp_path)]
    assert main([*arguments, "--hold-out", str(case / "hold_out.parquet")]) == 0
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    assert found["verdict"] == ["coulomb_friction@2"]
    assert found["gap"]["after"] < 0.1 * found["gap"]["before"]
    assert sum(h["probability"] for h in found["hypotheses"]) == pytest.approx(1.0)
    assert verdict.read_verdict(found).effects[0].name == "coulomb_friction"
    gap, alone = found["gap"], [rung["gap"] for rung in found["ranking"] if not rung["effects"]]
    assert gap["achievable"] <= min(one["gap"] for one in (*found["ranking"], *found["nuisance_effects"]))
    assert gap["achievable"] <= gap["flexible"] <= min(alone)
    assert (tmp_path / "report.html").stat().st_size < 5_000_000
