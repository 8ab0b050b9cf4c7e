"""The arm in space on a page: what it draws, what it refuses, and that the mouse turns it."""

from __future__ import annotations

import re
from pathlib import Path

import chromium
import numpy as np
import pytest

from hdagen.pages import page
from hdagen.pages.space_animation import CAMERA, animate_arm_in_space

TIME = np.linspace(0.0, 2.0, 50)
NAMES = ("base", "shoulder (1)", "tip")


def move_arm() -> np.ndarray:
    """Two links of 0.5 m, the second turning about the vertical."""
    points = np.zeros((len(TIME), 3, 3))
    points[:, 1:, 2] = 0.5
    points[:, 2, 0], points[:, 2, 1] = 0.5 * np.cos(TIME), 0.5 * np.sin(TIME)
    return points


def find_places(markup: str, name: str) -> np.ndarray:
    """The points of the first path of a class, px."""
    drawn = re.search(rf'd="([^"]*)" class="{name}"', markup)
    assert drawn
    return np.array([pair.split() for pair in re.split("[ML]", drawn[1]) if pair], float)


def test_the_still_picture_is_a_parallel_projection() -> None:
    markup = animate_arm_in_space("arm", TIME, move_arm(), names=NAMES, marked=(1,))
    base, shoulder, tip = find_places(markup.partition('class="live"')[2], "links")
    assert base[0] == shoulder[0] and shoulder[1] < base[1]  # what is vertical stays so, and up is up
    scale = (base[1] - shoulder[1]) / (0.5 * np.cos(CAMERA[1]))
    ahead = scale * 0.5 * np.array([-np.sin(CAMERA[0]), np.sin(CAMERA[1]) * np.cos(CAMERA[0])])
    assert tip - shoulder == pytest.approx(ahead, abs=0.11)
    assert "shoulder (1)</text>" in markup and "tip</text>" not in markup


def test_up_is_where_gravity_does_not_pull() -> None:
    hung = move_arm() @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]).T  # y is up
    markup = animate_arm_in_space("arm", TIME, hung, names=NAMES, up=(0.0, 1.0, 0.0))
    base, shoulder, _ = find_places(markup.partition('class="live"')[2], "links")
    assert base[0] == shoulder[0] and shoulder[1] < base[1]


@pytest.mark.parametrize(
    ("time", "points", "says"),
    [
        (TIME[::-1], move_arm(), "ascending"),
        (TIME, move_arm()[:, :, :2], r"points have shape \(50, 3, 2\)"),
        (TIME, np.full((50, 3, 3), np.nan), "no sample is finite"),
        (np.zeros(0), np.zeros((0, 3, 3)), "samples ≥ 1"),
    ],
)
def test_what_is_no_motion_is_refused(time: np.ndarray, points: np.ndarray, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        animate_arm_in_space("arm", time, points, names=NAMES)


def test_hostile_names_stay_text() -> None:
    markup = animate_arm_in_space("<b>", TIME, move_arm(), names=("a", "<script>", "c"), marked=(1,))
    assert "<script>alert" not in markup and "&lt;script&gt;" in markup


@pytest.mark.skipif(chromium.PROGRAM is None, reason="no Chromium is installed; `apt-get install chromium` brings it")
def test_the_mouse_turns_it_and_the_rail_moves_it(tmp_path: Path) -> None:
    figure = animate_arm_in_space("arm", TIME, move_arm(), names=NAMES, marked=(1,))
    page.write_page(tmp_path / "page.html", "title", "verdict", [page.Section("arm", "", [figure])], "how")
    links = "document.querySelector('.wide .live .links').getAttribute('d')"
    with chromium.browser() as tab:
        tab.call("Emulation.setDeviceMetricsOverride", width=1000, height=900, deviceScaleFactor=1, mobile=False)
        tab.open((tmp_path / "page.html").as_uri())
        still = tab.run(links)
        box = tab.run(
            "(() => { const figure = document.querySelector('svg.wide.turns'); figure.scrollIntoView();"
            " const { x, y, width, height } = figure.getBoundingClientRect();"
            " return [x + width / 2, y + height / 2]; })()"
        )
        tab.mouse("mousePressed", *box, held=True, clicks=1)
        tab.mouse("mouseMoved", box[0] + 120, box[1], held=True)
        tab.mouse("mouseReleased", box[0] + 120, box[1])
        turned = tab.run(links)
        first, now = (np.array([p.split() for p in re.split("[ML]", d) if p], float) for d in (still, turned))
        assert np.abs(now[1] - first[1]).max() < 100 and now[2] != pytest.approx(first[2], abs=5)
        assert now[1, 0] == now[0, 0]  # the vertical link stays vertical
        tab.run("(() => { const rail = document.querySelector('.rail input'); rail.value = 2;"
                " rail.dispatchEvent(new Event('input')); })()")  # fmt: skip
        assert tab.run(links) != turned and tab.run("document.querySelector('.player output').textContent") == "2.00 s"
        assert tab.messages == [] and tab.requests == [(tmp_path / "page.html").as_uri()]
