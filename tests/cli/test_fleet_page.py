"""The page of a fleet of 1,000 machines: its size, its links, drifts and outliers that were put in and are found."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import chromium
import numpy as np
import pytest
from trivial_tasks import make_diagnosis

from hdagen.campaign.task import Outcome, Status
from hdagen.fleet import fleet_page
from hdagen.fleet.fleet_diagnosis import MachineResult
from hdagen.fleet.fleet_file import FleetMachine
from hdagen.fleet.fleet_statistics import find_drifts, find_outliers
from hdagen.fleet.machine_task import is_machine_row, summarize_diagnosis

NAMES = [f"{name}_{j}" for name in ("mass", "viscous_friction", "coulomb_friction", "inertia") for j in (1, 2)]


def fleet(robots: int, dates: int, seed: int = 0) -> list[MachineResult]:
    """Robots of one kind with logs of several dates: every estimate is scattered as its standard deviation says."""
    rng, found = np.random.default_rng(seed), []
    first = datetime.date(2026, 1, 1)
    for robot in range(robots):
        for k in range(dates):
            name = f"robot {robot} log {k}"
            machine = FleetMachine(
                name, f"robot_{robot}.toml", Path(f"{name}.csv"), None, None,
                (first + datetime.timedelta(days=30 * k)).isoformat(),
            )  # fmt: skip
            row = summarize_diagnosis(make_diagnosis(["stribeck_friction@2"] if robot % 3 else []))
            row["parameters"] = {name: [1.0 + 0.1 * rng.standard_normal(), 0.1, "kg"] for name in NAMES}
            found.append(MachineResult(machine, Outcome(Status.DONE, row)))
    return found


def test_a_thousand_machines_are_a_page_below_two_megabytes(tmp_path: Path) -> None:
    results = fleet(200, 5)
    fleet_page.write_fleet_page(tmp_path / "fleet.html", Path("fleet.toml"), results)
    text = (tmp_path / "fleet.html").read_text()
    assert len(text.encode()) < 2_000_000
    links = re.findall(r'href="([^"#]*/report\.html)"', text)
    assert set(links) >= {f"robot%20{robot}%20log%20{k}/report.html" for robot in range(200) for k in range(5)}
    assert text.replace(" ", "").count('"searchable":true') == 3  # machines, drifts, remarks
    assert text.count('class="scroll long"') == 3  # each in a box of its own
    assert "and 645 more" in text  # names of the machines with the same effect


def test_a_drift_that_was_put_in_is_found_and_no_other() -> None:
    results = fleet(40, 5)
    assert not any(one.is_sure for one in find_drifts(results))
    for k, one in enumerate(results[15:20]):  # of the fourth robot, 0.3 kg a month
        assert one.row is not None
        one.row["parameters"]["mass_2"][0] += 0.3 * k
    drifts = find_drifts(results)
    sure = [one for one in drifts if one.is_sure]
    assert [(one.robot, one.parameter) for one in sure] == [("robot_3.toml", "mass_2")] and drifts[0] is sure[0]
    assert 30 * sure[0].slope == pytest.approx(0.3, abs=3 * 30 * sure[0].slope_std)
    assert sure[0].days == (0.0, 30.0, 60.0, 90.0, 120.0)


SIDES_OF_FIGURES = """
[...document.querySelectorAll("h2, figure")].map((one) => {
  const box = one.getBoundingClientRect();
  return [one.tagName, box.left, box.right];
})"""


@pytest.mark.skipif(chromium.PROGRAM is None, reason="no Chromium is installed")
@pytest.mark.parametrize("count", [1, 3])
def test_drawn_drifts_stay_in_the_column_of_the_text(count: int, tmp_path: Path) -> None:
    results = fleet(8, 5)
    for k, one in enumerate(results[: 5 * count]):
        assert one.row is not None
        one.row["parameters"]["mass_2"][0] += 0.5 * (k % 5)
    fleet_page.write_fleet_page(tmp_path / "fleet.html", Path("fleet.toml"), results)
    assert (tmp_path / "fleet.html").read_text().count("time since the first log (d)</text>") >= count
    with chromium.browser() as tab:
        for width in (1280, 400):
            tab.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
            tab.open((tmp_path / "fleet.html").as_uri())
            boxes = tab.run(SIDES_OF_FIGURES)
            (left, right), *others = {(low, high) for name, low, high in boxes if name == "H2"}
            assert not others
            assert [box for box in boxes if box[1] < left - 1 or box[2] > right + 1] == [], width
            assert tab.run("document.documentElement.scrollWidth") <= width


def test_scatter_beyond_the_estimates_own_widens_a_slope() -> None:
    (narrow,) = (one for one in find_drifts(fleet(1, 5)) if one.parameter == "mass_1")
    results = fleet(1, 5)
    for k, one in enumerate(results):
        assert one.row is not None
        one.row["parameters"]["mass_1"][0] += 3.0 * (-1) ** k
    (wide,) = (one for one in find_drifts(results) if one.parameter == "mass_1")
    assert wide.slope_std > 10 * narrow.slope_std and not wide.is_sure


def test_chance_alone_names_no_drift_and_no_outlier_more_often_than_stated() -> None:
    counts = np.zeros(2)
    for seed in range(40):
        results = fleet(8, 3, seed)
        counts += [any(one.is_sure for one in find_drifts(results)), bool(find_outliers(results))]
    assert (counts <= 8).all()  # 5 % of 40 are 2


def test_a_machine_that_stands_out_is_named(tmp_path: Path) -> None:
    results = fleet(30, 1)
    assert results[7].row is not None
    results[7].row["parameters"]["coulomb_friction_1"][0] = 4.0
    ((one, said),) = find_outliers(results)
    assert one is results[7] and said.startswith("coulomb_friction_1 is 4 kg; the median of 30 is")
    fleet_page.write_fleet_page(tmp_path / "fleet.html", Path("fleet.toml"), results)
    assert "coulomb_friction_1 is 4 kg" in (tmp_path / "fleet.html").read_text()


def test_logs_without_a_date_are_left_out_of_the_drift_and_that_is_said(tmp_path: Path) -> None:
    results = fleet(2, 3)
    undated = FleetMachine("undated", "robot_0.toml", Path("x.csv"), None, None)
    results.append(MachineResult(undated, results[0].outcome))
    assert {len(one.days) for one in find_drifts(results)} == {3}
    fleet_page.write_fleet_page(tmp_path / "fleet.html", Path("fleet.toml"), results)
    assert "1 of 7 logs have no date in fleet.toml and are left out here." in (tmp_path / "fleet.html").read_text()


def test_rows_that_are_not_whole_are_not_taken() -> None:
    row = summarize_diagnosis(make_diagnosis(["payload@2"]))
    assert is_machine_row(row)
    broken: list[dict[str, object]] = [
        {"gap": {}},
        {"sure": 1},
        {"verdict": "payload@2"},
        {"parameters": {"a": [1.0]}},
        {"probability": "x"},
        {"causes": [{"effect": "a", "joint": -1, "probability": 0.5}]},
        {"robot_name": 3},
    ]
    assert [is_machine_row(row | change) for change in broken] == [False] * len(broken)
    assert not any(is_machine_row({key: value for key, value in row.items() if key != name}) for name in row)
