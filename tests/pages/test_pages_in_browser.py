"""Pages in a real Chromium: silent, self-contained; what the script says, zooms and saves is what the numbers are."""

from __future__ import annotations

import csv
import io
import re
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import chromium
import numpy as np
import pytest
import sample_page

from hdagen.pages import page

pytestmark = pytest.mark.skipif(
    chromium.PROGRAM is None,
    reason="no Chromium is installed; `apt-get install chromium` brings what this test looks with",
)
FIGURES = {"arm": 0, "torques": 1, "paths": 2, "spectrum": 3, "dots": 4, "map": 5, "names": 6, "numbers": 7, "clock": 8}


@pytest.fixture(scope="module")
def tab() -> Iterator[chromium.Page]:
    with chromium.browser() as page:
        yield page


@pytest.fixture
def shown(tab: chromium.Page, tmp_path: Path) -> Iterator[chromium.Page]:
    """The sample page on a desk of 1000 px; at the end its console must have stayed empty."""
    page.write_page(tmp_path / "page.html", "title", "verdict", sample_page.sections(), "how")
    look(tab, tmp_path / "page.html")
    yield tab
    assert tab.messages == []
    assert tab.requests == [(tmp_path / "page.html").as_uri()]


def look(tab: chromium.Page, path: Path, *, width: int = 1000, scheme: str = "light", media: str = "screen") -> None:
    tab.messages.clear()
    tab.requests.clear()
    tab.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    tab.call("Emulation.setEmulatedMedia", media=media, features=features)
    tab.mouse("mouseMoved", 1, 1)
    tab.open(path.as_uri())


def area(tab: chromium.Page, name: str, which: int = 0) -> tuple[float, float, float, float]:
    """Left, top, width and height on the screen of the axes of a plot, scrolled into sight."""
    script = f"""(() => {{
      const figure = document.querySelectorAll("figure")[{FIGURES[name]}];
      figure.scrollIntoView();
      const plot = figure.querySelectorAll(".wide .plot")[{which}], area = plot.querySelector(".area");
      const matrix = plot.getScreenCTM(), size = (name) => Number(area.getAttribute(name));
      return [matrix.e, matrix.f, matrix.a * size("width"), matrix.d * size("height")];
    }})()"""
    left, top, width, height = tab.run(script)
    return left, top, width, height


def drag(tab: chromium.Page, start: tuple[float, float], end: tuple[float, float]) -> None:
    tab.mouse("mouseMoved", *start)
    tab.mouse("mousePressed", *start, held=True, clicks=1)
    tab.mouse("mouseMoved", (start[0] + end[0]) / 2, (start[1] + end[1]) / 2, held=True)
    tab.mouse("mouseMoved", *end, held=True)
    tab.mouse("mouseReleased", *end, clicks=1)


def double_click(tab: chromium.Page, x: float, y: float) -> None:
    for clicks in (1, 2):
        tab.mouse("mousePressed", x, y, held=True, clicks=clicks)
        tab.mouse("mouseReleased", x, y, clicks=clicks)


def readout(tab: chromium.Page, name: str) -> str:
    """What stands in the box beside the pointer; nothing where it is hidden."""
    box = f'document.querySelectorAll("figure")[{FIGURES[name]}].querySelector(".readout")'
    return str(tab.run(f'{box}.getClientRects().length ? {box}.innerText : ""'))


def domain(tab: chromium.Page, name: str) -> list[str]:
    """The texts of the ticks of all plots, on the desk."""
    figure = f'document.querySelectorAll("figure")[{FIGURES[name]}]'
    return list(tab.run(f'[...{figure}.querySelectorAll(".wide .scales text")].map((t) => t.textContent)'))


def saved(tab: chromium.Page, name: str, kind: str) -> str:
    """What the button of a figure saves."""
    return str(
        tab.run(f"""(async () => {{
      let blob = null;
      const original = URL.createObjectURL;
      URL.createObjectURL = (one) => {{ blob = one; return original(one); }};
      HTMLAnchorElement.prototype.click = () => {{}};
      const figure = document.querySelectorAll("figure")[{FIGURES[name]}];
      [...figure.querySelectorAll(".tools button")].find((one) => one.textContent === "{kind}").click();
      URL.createObjectURL = original;
      return await blob.text();
    }})()""")
    )


def numbers(text: str) -> list[float]:
    return [float(one) for one in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text.replace("\N{MINUS SIGN}", "-"))]


def test_every_figure_comes_alive_in_silence(shown: chromium.Page) -> None:
    assert shown.run('document.querySelectorAll(".tools").length') == len(FIGURES)
    assert shown.run("""document.querySelectorAll(".player button").length""") == 1


def test_cursor_reads_out_the_samples(shown: chromium.Page) -> None:
    left, top, width, height = area(shown, "torques")
    for share in (0.1, 0.5, 0.93):
        shown.mouse("mouseMoved", left + share * width, top + 0.5 * height)
        words = readout(shown, "torques")
        moment = numbers(words)[0]
        row = round(moment / 0.01)
        assert moment == pytest.approx(share * 9.99, abs=0.011)
        true = re.search(r"true (\S+) N m", words)
        assert true and numbers(true[1])[0] == pytest.approx(sample_page.TORQUE[row], abs=0.006)
    followed = shown.run("""[...document.querySelectorAll("figure")[2].querySelectorAll(".wide .cursor")].length""")
    assert followed == 2  # the paths of the same link show the moment too
    shown.mouse("mouseMoved", 2, 2)
    assert readout(shown, "torques") == "" and shown.run('document.querySelectorAll(".cursor").length') == 0


def test_drag_zooms_and_double_click_shows_the_whole(shown: chromium.Page) -> None:
    for name in ("torques", "spectrum", "paths"):
        left, top, width, height = area(shown, name)
        before = domain(shown, name)
        drag(shown, (left + 0.2 * width, top + 0.2 * height), (left + 0.4 * width, top + 0.6 * height))
        near = domain(shown, name)
        assert near != before and len(near) >= 2
        double_click(shown, left + 0.5 * width, top + 0.5 * height)
        assert domain(shown, name) == before  # the script's ticks are those that Python drew


def test_zoom_shows_that_stretch_and_all_of_its_samples(shown: chromium.Page) -> None:
    left, top, width, _ = area(shown, "torques")
    drag(shown, (left + 0.5 * width, top + 9), (left + 0.6 * width, top + 30))
    figure = 'document.querySelectorAll("figure")[1]'
    assert [one for one in numbers(" ".join(domain(shown, "torques"))) if 5.0 <= one <= 6.0]
    path = shown.run(f'{figure}.querySelector(".wide .curve").getAttribute("d")')
    points = np.array([[float(v) for v in one.split()] for one in re.findall(r"[ML](\S+ \S+?)(?=[ML]|$)", path)])
    assert abs(len(points) - 100) <= 4  # a second at 100 Hz
    low, high = 0.5 * 9.99, 0.6 * 9.99
    box = shown.run(f'Number({figure}.querySelector(".wide .area").getAttribute("width"))')
    times = low + points[:, 0] / box * (high - low)
    shape = np.polyfit(4.0 * np.sin(times), points[:, 1], 1)
    np.testing.assert_allclose(np.polyval(shape, 4.0 * np.sin(times)), points[:, 1], atol=1.5)
    assert shape[0] < 0  # up is up


def test_arrow_keys_walk_from_sample_to_sample(shown: chromium.Page) -> None:
    shown.run('document.querySelectorAll("figure")[1].querySelector(".wide").focus()')
    for _ in range(3):
        for kind in ("keyDown", "keyUp"):
            shown.call(
                "Input.dispatchKeyEvent", type=kind, key="ArrowRight", code="ArrowRight", windowsVirtualKeyCode=39
            )
    assert numbers(readout(shown, "torques"))[0] == pytest.approx(0.03)


def test_cursor_finds_the_cell_of_a_heat_map(shown: chromium.Page) -> None:
    left, top, width, height = area(shown, "map")
    shown.mouse("mouseMoved", left + 0.9 * width, top + 0.1 * height)
    assert numbers(readout(shown, "map"))[-1] == 23 - 8  # the last column of the topmost row
    shown.mouse("mouseMoved", left + 0.1 * width, top + 0.9 * height)
    assert numbers(readout(shown, "map")) == [-3, -2, 0, 2.5, -8]


def test_saved_numbers_are_those_that_were_given(shown: chromium.Page) -> None:
    rows = list(csv.reader(io.StringIO(saved(shown, "torques", "CSV"))))
    assert rows[11][0] == "0.1"
    assert rows[0][:3] == ["time (s)", "joint 1 true: torque (N m)", "joint 1 estimate: torque (N m)"]
    table = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(table[:, 0], sample_page.TIME, atol=1e-6)
    np.testing.assert_allclose(table[:, 1], sample_page.TORQUE, atol=1e-6)
    rows = list(csv.reader(io.StringIO(saved(shown, "spectrum", "CSV"))))
    frequency = np.geomspace(0.1, 500.0, 300)
    np.testing.assert_allclose(np.array(rows[1:], dtype=float), np.stack([frequency, 1e-3 / frequency], 1), rtol=1e-6)
    rows = list(csv.reader(io.StringIO(saved(shown, "clock", "CSV"))))
    assert float(rows[-1][0]) - float(rows[1][0]) == pytest.approx(9.99, abs=1e-6) and float(rows[1][0]) == 1.7e9
    assert list(csv.reader(io.StringIO(saved(shown, "numbers", "CSV")))) == [
        ["name", "value"],
        ["largest", "0.02143"],
        ["none", ""],
    ]
    cells = list(csv.reader(io.StringIO(saved(shown, "map", "CSV"))))
    assert len(cells) == 25 and [float(v) for v in cells[1]] == [-3, -2, 0, 2.5, -8]
    arm = np.array(list(csv.reader(io.StringIO(saved(shown, "arm", "CSV"))))[1:], dtype=float)
    np.testing.assert_allclose(arm[:, 5:7], sample_page.TIP[: len(arm)], atol=1e-6)


@pytest.mark.parametrize("name", [name for name in FIGURES if name != "numbers"])
def test_saved_drawing_stands_alone(shown: chromium.Page, name: str) -> None:
    root = ElementTree.fromstring(saved(shown, name, "SVG"))
    assert root.tag.endswith("}svg") and root.get("color") and root.get("font-family")
    named = {"blue", "vermilion", "green", "purple", "orange", "ink", "grey"}
    for element in root.iter():
        if named & set((element.get("class") or "").split()):
            assert re.fullmatch(r"#[0-9a-f]{6}", element.get("color") or "")


def test_arm_stands_where_the_scrubber_says(shown: chromium.Page) -> None:
    shown.run("""(() => {
      const rail = document.querySelector(".rail input");
      rail.value = 3.5;
      rail.dispatchEvent(new Event("input"));
    })()""")
    view, links, push = shown.run("""(() => {
      const view = document.querySelectorAll(".wide .view")[0];
      const push = view.querySelector(".push");
      return [view.dataset.view, view.querySelector(".live .links").getAttribute("d"), push.getAttribute("visibility")];
    })()""")
    left, low, scale, height = (float(part) for part in view.split())
    drawn = np.array([[float(v) for v in pair.split()] for pair in re.split("[ML]", links)[1:]])
    points = sample_page.points(sample_page.TIP)[350]
    expected = np.stack([(points[:, 0] - left) * scale, height - (points[:, 1] - low) * scale], axis=1)
    np.testing.assert_allclose(drawn, expected, atol=0.06)
    assert push == "visible"
    line = shown.run('document.querySelectorAll("figure")[1].querySelector(".cursor path").getAttribute("d")')
    at = float(line[1:].split()[0])
    box = shown.run('Number(document.querySelectorAll("figure")[1].querySelector(".area").getAttribute("width"))')
    assert at / box == pytest.approx(3.5 / 9.99, abs=1e-3)  # the curves of its link follow


def test_arm_plays_and_pauses(shown: chromium.Page) -> None:
    shown.run('document.querySelector(".player button").click()')
    shown.run("new Promise((done) => setTimeout(done, 300))")
    shown.run('document.querySelector(".player button").click()')
    first = float(shown.run('document.querySelector(".rail input").value'))
    shown.run("new Promise((done) => setTimeout(done, 100))")
    assert 0.02 < first < 3.0 and float(shown.run('document.querySelector(".rail input").value')) == first


def visible(tab: chromium.Page, what: str) -> int:
    return int(tab.run(f'[...document.querySelectorAll("{what}")].filter((one) => one.getClientRects().length).length'))


def test_phone_dark_and_print(shown: chromium.Page, tmp_path: Path) -> None:
    def background() -> str:
        return str(shown.run("getComputedStyle(document.body).backgroundColor"))

    path = tmp_path / "page.html"
    assert visible(shown, "svg.wide") == 8 and visible(shown, "svg.narrow") == 0
    assert background() == "rgb(255, 255, 255)"
    look(shown, path, width=420, scheme="dark")
    assert visible(shown, "svg.wide") == 0 and visible(shown, "svg.narrow") == 8
    assert shown.run("document.documentElement.scrollWidth") <= 420
    assert background() == "rgb(20, 23, 28)"
    curve = 'getComputedStyle(document.querySelector("svg.narrow .blue")).color'
    assert shown.run(curve) == "rgb(63, 155, 224)"
    look(shown, path, scheme="dark", media="print")
    assert visible(shown, "svg.wide") == 8 and visible(shown, ".tools") == 0 and visible(shown, ".player") == 0
    assert background() == "rgb(255, 255, 255)"


def test_readable_without_the_script(tab: chromium.Page, tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    page.write_page(path, "title", "verdict", sample_page.sections(), "how")
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        look(tab, path)
        assert visible(tab, "svg.wide") == 8 and visible(tab, "svg.narrow") == 0 and visible(tab, "button") == 0
        assert visible(tab, "svg.wide .curve") >= 6 and visible(tab, "td") >= 2
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)


DAMAGES: dict[str, Callable[[str], str]] = {
    "no data": lambda text: re.sub(r'<script type="application/json">.*?</script>', "", text),
    "broken data": lambda text: text.replace('<script type="application/json">{', '<script type="application/json">'),
    "no drawings": lambda text: re.sub(r"<svg.*?</svg>", "", text),
    "no headings": lambda text: re.sub(r"<h3>.*?</h3>", "", text),
    "unknown kind": lambda text: text.replace('data-kind="', 'data-kind="x'),
    "cut columns": lambda text: re.sub(r'"data":"[^"]{20}', '"data":"', text),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_figure_stays_still_and_raises_nothing(tab: chromium.Page, tmp_path: Path, damage: str) -> None:
    text = DAMAGES[damage](sample_page.text())
    assert text != sample_page.text()
    (tmp_path / "page.html").write_text(text)
    look(tab, tmp_path / "page.html")
    for x in range(100, 900, 100):
        for y in range(150, 900, 150):
            tab.mouse("mouseMoved", x, y)
    assert [one for one in tab.messages if not one.startswith("info: The figure")] == []


def test_hostile_words_run_nothing(tab: chromium.Page, tmp_path: Path) -> None:
    taken = "document.title='taken'"
    attack = f'</script><script>{taken}</script><img src=x onerror="{taken}">\'"--><svg/onload={taken}>'
    text = sample_page.text(lambda word: f"{attack}{word}")
    (tmp_path / "page.html").write_text(text, "utf-8")
    look(tab, tmp_path / "page.html")
    assert tab.run("document.title") == attack + "title"
    left, top, width, height = area(tab, "torques")
    tab.mouse("mouseMoved", left + 0.5 * width, top + 0.5 * height)
    assert attack in readout(tab, "torques") and tab.run('document.querySelectorAll("img").length') == 0
    assert tab.messages == []


class Counter(BaseHTTPRequestHandler):
    """Serves one page and notes every request."""

    text = b""
    asked: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.asked.append(self.path)
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.end_headers()
        self.wfile.write(self.text)

    def log_message(self, *args: Any) -> None:
        pass


def test_policy_stops_what_would_go_outside(tab: chromium.Page) -> None:
    """A page that does ask, were it let: the server behind it hears of the page alone, and the browser says why."""
    outside = '<img src="/image.png"><script src="/script.js"></script><link rel="stylesheet" href="/style.css"><main>'
    Counter.text = sample_page.text().replace("<main>", outside).encode()
    Counter.asked.clear()
    server = ThreadingHTTPServer(("127.0.0.1", 0), Counter)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        tab.messages.clear()
        tab.open(f"http://127.0.0.1:{server.server_port}/page.html")
        time.sleep(0.2)
        tab.run("0")
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
    assert Counter.asked == ["/page.html"]
    assert sum("Content Security Policy" in one for one in tab.messages) >= 3
