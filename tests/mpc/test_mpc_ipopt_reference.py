"""Plans of the predictive controller beside IPOPT's of the whole nonlinear problem, by a child process of `gen`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from kept_builds import find_builds

from hdagen.arm.build_loader import PlantError
from hdagen.mpc.benchmark import ipopt_reference
from hdagen.mpc.benchmark.ipopt_reference import (
    TruthComparison,
    compare_with_truth,
    format_truth_comparison,
    solve_with_ipopt,
)

FAR = "".join(
    f"[[wall]]\nnormal = {normal}\noffset = 10.0\n" for normal in ("[1.0, 0.0]", "[0.0, 1.0]")
)  # as many as the table's, out of reach


@pytest.fixture(autouse=True)
def builds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builds lie with the other tests'."""
    monkeypatch.setenv("HDAGEN_BUILD", str(find_builds()))


def test_a_converged_plan_costs_what_the_truth_costs_where_no_limit_is_near(tmp_path: Path) -> None:
    """Dynamics integrated finely, another solver, nothing of the compiled controller but its graphs: the plan's cost
    is the least there is to a thousandth, and its first torque IPOPT's to 2 % of the motor's largest."""
    config = tmp_path / "far.toml"
    config.write_text("[limits]\ntip_speed = 1.0\n" + FAR)
    found = compare_with_truth(str(config), "portable", 4)
    assert [one.status for one in found] == ["Solve_Succeeded"] * 4
    costs = np.array([[one.cost, one.cost_of_plan] for one in found])
    assert costs[:, 0].max() > 1e-6
    assert (costs[:, 1] <= costs[:, 0] * 1.001 + 1e-9).all()
    assert (costs[:, 1] >= costs[:, 0] * 0.999).all()
    assert max(one.apart for one in found) < 0.02


def test_the_first_torque_is_near_the_truths_where_limits_are_active(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the course the first push alone is run, which takes the tip to the wall."""
    monkeypatch.setattr(ipopt_reference, "TRUTH_SECONDS", 2.0)
    found = compare_with_truth(None, "portable", 3)
    assert [one.status for one in found] == ["Solve_Succeeded"] * 3
    assert max(one.apart for one in found) < 0.15  # of the motor's largest; the finely integrated plan touches limits
    assert np.median([one.apart for one in found]) < 0.01


def test_what_the_truth_cannot_take_is_a_sentence() -> None:
    with pytest.raises(PlantError, match="no_such_arm"):
        solve_with_ipopt("no_such_arm", "nodes=5,walls=0,space=tip", [])
    said = format_truth_comparison((TruthComparison(7, "Solve_Succeeded", 9, 1e-6, 2e-6, 1e-3),))
    assert len(said) == 2
    assert "Solve_Succeeded" in said[1]
