"""Pages: well formed whatever the words, the same bytes for the same numbers, small, no extreme left out."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sample_page
from hypothesis import given, settings
from hypothesis import strategies as st

from hdagen.pages import animation, figure, markup, page, palette, time_chart
from hdagen.pages.axis import fit_axis
from hdagen.pages.decimation import as_samples, choose_rows, find_extreme_rows, pack_floats
from hdagen.pages.quantity import MINUS_SIGN, format_number, scale_quantity

VOID = {"meta", "link", "br", "hr", "img", "input"}
HOSTILE = [
    "</script><script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "' onmouseover='alert(1)",
    "<!--<script>",
    "</SCRIPT\t/ x",
    "]]></svg></style><svg onload=alert(1)>",
    "&lt;b&gt; &amp; &#60;",
    "\\u003c/script> \u2028 \u2029",
    "nul \x00 escape \x1b lone \ud800 turned \u202egnp.exe",
    "a (b) (c) %s {x} $1",
    "x" * 2000,
    "",
]


class Outline(HTMLParser):
    """The elements and attribute names of a page in order, its text, and whether every element is closed in turn."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.shape: list[tuple[str, tuple[str, ...]]] = []
        self.values: list[tuple[str, str, str]] = []
        self.blocks: dict[str, list[str]] = {}
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.shape.append((tag, tuple(name for name, _ in attrs)))
        self.values += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)
            self.blocks.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.blocks[self.open[-1]][-1] += data


def test_page_is_well_formed() -> None:
    outline = Outline(sample_page.text())
    tags = [tag for tag, _ in outline.shape]
    assert tags.count("html") == tags.count("body") == tags.count("main") == tags.count("h1") == 1
    assert tags.count("figure") == 9
    assert all("aria-label" in names for tag, names in outline.shape if tag == "svg" and "role" in names)
    anchors = [value for _, name, value in outline.values if name == "id"]
    assert len(anchors) == len(set(anchors)) == 3


@pytest.mark.parametrize("hostile", HOSTILE)
def test_hostile_words_stay_words(hostile: str) -> None:
    """Words do not change which elements and attributes there are; marks stand around them so that none is empty."""
    plain = Outline(sample_page.text(lambda word: f"_{word}_"))
    attacked = Outline(sample_page.text(lambda word: f"_{hostile}{word}_"))
    body = {"text", "tspan", "svg", "g", "path", "rect", "circle"}  # layout follows the length of the words
    assert [one for one in attacked.shape if one[0] not in body] == [one for one in plain.shape if one[0] not in body]
    known = {name for _, names in plain.shape for name in names}
    assert {name for _, names in attacked.shape for name in names} <= known
    assert markup.replace_unprintable(hostile) + "title" in attacked.blocks["h1"][0]
    assert all(json.loads(block) is not None for block in attacked.blocks["script"][:-1])


@given(st.text())
def test_escaping_is_undone_by_reading(words: str) -> None:
    outline = Outline(
        markup.build_element("p", markup.escape_html(words), title=words) + markup.build_data_block([words])
    )
    assert outline.blocks["p"] == [markup.replace_unprintable(words)]
    assert outline.values[0] == ("p", "title", markup.replace_unprintable(words))
    assert json.loads(outline.blocks["script"][0]) == [words] and "<" not in outline.blocks["script"][0]
    markup.replace_unprintable(words).encode("utf-8")


def test_same_numbers_same_bytes() -> None:
    program = "import sample_page, sys; sys.stdout.buffer.write(sample_page.text().encode())"
    pages = {sample_page.text().encode()}
    for seed in ("1", "2"):
        places = os.pathsep.join([str(Path(page.__file__).parents[2]), str(Path(__file__).parents[1] / "support")])
        run = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": places},
            capture_output=True,
            check=True,
        )
        pages.add(run.stdout)
    assert len(pages) == 1


def test_nothing_points_outside() -> None:
    text = sample_page.text()
    assert "://" not in text and "@import" not in text and "url(" not in text
    outline = Outline(text)
    assert {value for _, name, value in outline.values if name in ("src", "href")} <= {
        "data:,",
        "#first",
        "#second",
        "#third",
    }
    assert not [name for _, name, _ in outline.values if name.startswith("on") or name == "style"]


def test_policy_allows_these_inline_texts_only() -> None:
    outline = Outline(sample_page.text())
    policy = next(value for tag, name, value in outline.values if (tag, name) == ("meta", "content") and "src" in value)
    assert policy.startswith("default-src 'none';") and "unsafe" not in policy and "*" not in policy
    for kind, text in (("style", outline.blocks["style"][0]), ("script", outline.blocks["script"][-1])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy


def test_a_minute_of_two_joints_stays_below_five_megabytes() -> None:
    rng = np.random.default_rng(0)
    time = np.arange(60_000) * 1e-3
    noise = rng.normal(size=(16, time.size))
    tip = np.stack([0.35 + 0.05 * np.cos(time), 0.15 + 0.05 * np.sin(time)], axis=1)
    pair = [figure.Series("measured", noise[0]), figure.Series("replay", noise[1])]
    figs = [animation.animate_arms("arm", time, [animation.MovingArm("one", sample_page.points(tip))])]
    figs += [
        figure.draw_panels(str(at), time, [figure.Panel("a (N m)", pair), figure.Panel("b (N m)", pair)])
        for at in range(7)
    ]
    figs += [
        figure.draw_plane(
            "path",
            [figure.Curve("tip", tip[:, 0] + 1e-3 * noise[0], tip[:, 1] + 1e-3 * noise[1], time=time)],
            x_label="x",
            y_label="y",
        )
    ]
    text = page.render_page("t", "v", [page.Section("s", "", figs)], "r")
    assert 1e6 < len(text.encode()) < 5e6


AWKWARD = {
    "empty": [],
    "one": [3.0],
    "constant": [2.5] * 9,
    "zero": [0.0] * 9,
    "all nan": [math.nan] * 9,
    "gaps": [1.0, math.nan, 2.0, math.inf, -math.inf, 3.0, math.nan, math.nan, 4.0],
    "huge": [1e308, -1e308, 1e300, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    "tiny": [1e-300, 2e-300, 5e-324, 0.0, 1e-300, 1e-300, 1e-300, 1e-300, 1e-300],
    "far from zero": [1e9 + 1e-3 * k for k in range(9)],
}


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("name", AWKWARD)
def test_awkward_numbers_are_drawn_or_left_out(name: str, log: bool) -> None:
    y = AWKWARD[name]
    x = np.arange(float(len(y)))
    both = [
        figure.draw_lines("a", x, [figure.Series("s", y, band_of=(y, y))], y_label="a (N m)", log_x=log, log_y=log),
        figure.draw_lines("a", x, [figure.Series("s", y, draw="step")], y_label="a (kg)", bands=[(0.0, 1.0, "b")]),
        figure.draw_plane("a", [figure.Curve("s", y, y, draw="points")], x_label="x (m)", y_label="y (m)", log_x=log),
        figure.draw_dots("a", [str(at) for at in x], [figure.DotGroup("s", y, (y, y))], value_label="a (m)", log=log),
        figure.draw_table("a", ["x", "y"], [[one, one] for one in y]),
    ]
    if len(y) == 9:
        both.append(
            figure.draw_heat_map(
                "a", list("abc"), list("def"), np.reshape(y, (3, 3)), x_label="", y_label="", value_label="v"
            )
        )
    for drawn in both:
        outline = Outline(drawn)
        for _, key, value in outline.values:
            if key in ("d", "x", "y", "width", "height", "transform", "viewbox", "data-x", "data-y"):
                assert not re.search(r"nan|inf", value), (key, value)
        assert all(json.loads(block) is not None for block in outline.blocks["script"])
    if name in ("empty", "all nan"):
        assert "no data" in both[0]


def test_no_series_no_panel_no_arm() -> None:
    for drawn in (
        figure.draw_lines("a", [], [], y_label="a"),
        figure.draw_panels("a", [0.0, 1.0], []),
        figure.draw_planes("a", [], x_label="x", y_label="y"),
        figure.draw_dots("a", [], [], value_label="v"),
        animation.animate_arms("a", [], []),
        animation.animate_arms(
            "a", [0.0], [animation.MovingArm("one", np.full((1, 3, 2), np.nan))], target=[[np.nan, 0.0]]
        ),
    ):
        Outline(drawn)
        assert "nan" not in drawn


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6) | st.just(math.nan), min_size=1, max_size=400), st.integers(1, 40))
def test_thinning_keeps_every_extreme_and_every_gap(values: list[float], stretches: int) -> None:
    column = as_samples(values)
    position = np.arange(column.size, dtype=float)
    rows = find_extreme_rows(position, [column], stretches)
    assert np.all(np.diff(rows) > 0) and rows.size <= 3 * stretches + 2
    assert rows[0] == 0 and rows[-1] == column.size - 1
    share = position / max(column.size - 1, 1)  # a row at an edge of two stretches lies where rounding puts it
    for stretch in range(stretches):
        inside = np.flatnonzero(np.minimum((share * stretches).astype(int), stretches - 1) == stretch)
        mine = np.intersect1d(inside, rows)
        if np.isfinite(column[inside]).any():
            assert np.nanmax(column[mine]) == np.nanmax(column[inside])
            assert np.nanmin(column[mine]) == np.nanmin(column[inside])
        assert np.isnan(column[mine]).any() == np.isnan(column[inside]).any()


def test_a_single_spike_survives_thinning_and_drawing() -> None:
    y = np.zeros(60_000)
    y[31_234] = 1.0
    time = np.arange(y.size).astype(float) * 1e-3
    rows = choose_rows(time, [y, y, y], 3000)
    assert 31_234 in rows and 2000 < rows.size <= 3010
    drawn = figure.draw_lines("a", time, [figure.Series("", y)], y_label="a")
    desk = re.findall(r'd="(M[^"]*)"', drawn[: drawn.index("narrow")])
    highest = min(float(v) for d in desk for v in re.findall(r"L[\d.]+ ([\d.]+)", d))
    assert highest == pytest.approx(240 * 0.05 / 1.1, abs=0.2)  # 5 % below the top of an axis of 240 px


def test_packed_numbers_come_back() -> None:
    values = np.array([0.0, 1.5, -2.25e-9, np.nan, 3.4e30])
    back = np.frombuffer(base64.b64decode(pack_floats(values)), "<f4")
    np.testing.assert_array_equal(back, values.astype(np.float32))


@given(st.floats(-1e8, 1e8), st.floats(1e-6, 1e8), st.integers(2, 12))
def test_ticks_are_round_and_say_where_they_stand(low: float, span: float, count: int) -> None:
    axis = fit_axis("torque (N m)", [np.array([low, low + span])])
    ticks = axis.ticks(count)
    values = np.array([value for value, _ in ticks]) * axis.quantity.factor
    slack = 0.011 * (values[1] - values[0])
    assert 2 <= len(ticks) <= 3 * count + 1
    np.testing.assert_allclose(np.diff(values), values[1] - values[0], rtol=1e-5)
    assert (
        values[0] >= axis.low * axis.quantity.factor - slack and values[-1] <= axis.high * axis.quantity.factor + slack
    )
    for value, (_, text) in zip(values, ticks, strict=True):
        assert float(text.replace(MINUS_SIGN, "-")) == pytest.approx(
            value, rel=1e-9, abs=1e-9 * (values[1] - values[0])
        )


@given(st.floats(1e-12, 1e6), st.floats(1.001, 1e12), st.integers(2, 12))
def test_ticks_of_a_log_axis_lie_on_it(low: float, ratio: float, count: int) -> None:
    axis = fit_axis("a (kg)", [np.array([low, low * ratio])], log=True)
    ticks = axis.ticks(count)
    assert 1 <= len(ticks) <= 3 * count + 1
    assert all(axis.low * (1 - 1e-2) <= value <= axis.high * (1 + 1e-2) for value, _ in ticks)
    assert [value for value, _ in ticks] == sorted({value for value, _ in ticks})


def test_quantities_take_a_prefix_only_where_the_unit_does() -> None:
    assert scale_quantity("torsion (rad)", 3e-4)[:3] == ("torsion", "µrad", pytest.approx(1e6))
    assert scale_quantity("path (m)", 0.05)[:2] == ("path", "mm")
    assert scale_quantity("torque (N m)", 0.5)[:2] == ("torque", "N m")
    assert scale_quantity("stiffness (N m/rad)", 16e3)[:2] == ("stiffness", "kN m/rad")
    assert scale_quantity("mass (kg)", 2e-5)[:2] == ("mass", "10⁻⁶ kg")
    assert scale_quantity("share (%)", 0.02)[:2] == ("share", "%")
    assert scale_quantity("compliance (rad/(N m))", 1.4e-4)[:2] == ("compliance", "µrad/(N m)")
    assert scale_quantity("stiffening (1/(N m))", 25.0) == ("stiffening", "1/(N m)", 1.0, "1/(N m)")
    assert scale_quantity("torque (of joint 1) (N m)", 0.5)[:2] == ("torque (of joint 1)", "N m")
    assert [format_number(x) for x in (0.021434, -1.5, 0.0, math.nan, 60_000, 1.25e-7, -math.inf, 9.99996)] == [
        "0.02143", "−1.5", "0", "–", "60000", "1.25×10⁻⁷", "−∞", "10",
    ]  # fmt: skip


def seen(color: str, deficiency: np.ndarray) -> np.ndarray:
    """CIELAB of ``color`` as seen with a colour-vision deficiency (matrices of Machado et al. 2009, severity 1)."""
    channels = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    relative = to_xyz @ np.clip(deficiency @ linear, 0, 1) / np.array([0.9505, 1.0, 1.089])
    f = np.where(relative > 0.008856, np.cbrt(relative), 7.787 * relative + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deuteranopia": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
    "tritanopia": np.array([[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]]),
}


@pytest.mark.parametrize("which, background", [(0, palette.PAPER_COLOR), (1, palette.NIGHT_COLOR)])
def test_colours_stand_out_and_stay_apart(which: int, background: str) -> None:
    colors = [palette.COLORS[name][which] for name in palette.COLOR_CYCLE]
    for color in colors:
        light = sorted([palette.compute_luminance(color), palette.compute_luminance(background)])
        assert (light[1] + 0.05) / (light[0] + 0.05) >= 3.0
    for matrix in DEFICIENCIES.values():
        apart = [np.linalg.norm(seen(a, matrix) - seen(b, matrix)) for a in colors for b in colors if a < b]
        assert min(apart) > 12.0
    assert len({(palette.COLOR_CYCLE[k % 6], palette.DASH_CYCLE[k % 4]) for k in range(12)}) == 12


def test_equal_axes_are_equal() -> None:
    drawn = figure.draw_plane("a", [figure.Curve("", [0.0, 0.3], [0.0, 0.05])], x_label="x (m)", y_label="y (m)")
    assert ">x (m)<" in drawn and ">y (m)<" in drawn  # one unit for both, though y alone would be in mm
    spans = [[float(v) for v in re.findall(rf'data-{axis}="(\S+) (\S+)"', drawn)[0]] for axis in "xy"]
    width, height = (float(v) for v in re.findall(r'class="area" width="([\d.]+)" height="([\d.]+)"', drawn)[0])
    assert (spans[0][1] - spans[0][0]) / width == pytest.approx((spans[1][1] - spans[1][0]) / height, rel=1e-4)


def test_the_library_of_curves_over_time_is_whole_and_unmodified() -> None:
    files = {
        "uPlot.iife.min.js": "19c8d4c6ad88929a79f4ae49d6f7161566dfd0ba3d15cc495e974f787eb78f1f",
        "uPlot.min.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
        "LICENSE": "8f989229699b4fe2f1a0432d0e9edc338a8a911e250e2d1b01ecd770a5f5b1bd",
    }
    folder = resources.files("hdagen.pages") / "uplot"
    assert {one.name: hashlib.sha256(one.read_bytes()).hexdigest() for one in folder.iterdir()} == files
    version = re.search(r"\(v([\d.]+)\)", (folder / "uPlot.iife.min.js").read_text("utf-8"))
    document = (Path(__file__).parents[2] / "docs" / "project" / "dependencies.md").read_text("utf-8")
    assert version and f"`uPlot` {version[1]}, from the npm registry" in document


def test_a_page_has_the_library_only_where_it_draws_with_it() -> None:
    channel = time_chart.TimeChannel("c", "rad", [0.0, 1.0], {"before": [0.0, 0.5]})
    lines = {"measured": ("grey", False), "before": ("orange", True)}
    curves = time_chart.draw_time_charts("t", [0.0, 1.0], [channel], lines)
    for figures, there in (([], False), ([curves], True)):
        text = page.render_page("t", "v", [page.Section("s", "", figures)], "r")
        assert ("uPlot=" in text) is there and (".u-legend {font" in text) is there


@pytest.mark.parametrize("values", [[0.5], [-3.0, np.nan, 7.0], np.linspace(-1.0, 1.0, 1000), [np.nan], []])
def test_values_in_16_bits_are_near(values: Any) -> None:
    true = np.asarray(values, float)
    packed: dict[str, Any] = time_chart.pack_quantized(true)
    steps = np.frombuffer(base64.b64decode(packed["data"]), "<u2").astype(float)
    back = np.where(steps == 65535, np.nan, packed["low"] + packed["step"] * steps)
    span = np.ptp(true[np.isfinite(true)]) if np.isfinite(true).any() else 0.0
    np.testing.assert_allclose(back, true, atol=0.51 * span / 65534, rtol=1e-15)


def test_a_minute_of_seven_joints_is_a_page_of_three_megabytes() -> None:
    rng, time = np.random.default_rng(0), np.arange(60_000) * 1e-3
    walk = np.cumsum(rng.standard_normal((4, time.size)), axis=1)
    lines = {"measured": ("grey", False), "before": ("orange", True), "after": ("blue", False)}
    for joints, length, most in ((2, 10_000, 0.7e6), (7, 60_000, 2.3e6)):
        channels = [
            time_chart.TimeChannel(
                f"{k}", "rad", walk[k % 4][:length], {"before": walk[0][:length], "after": walk[1][:length]}
            )
            for k in range(3 * joints)
        ]
        assert len(time_chart.draw_time_charts("t", time[:length], channels, lines)) < most


@pytest.mark.parametrize("log", [False, True])
def test_dots_stand_where_their_values_are(log: bool) -> None:
    values = np.array([12.0, 3.0, 48.0])
    drawn = figure.draw_dots("a", ["p", "q", "r"], [figure.DotGroup("", values)], value_label="e", log=log)
    places = [float(x) for x in re.findall(r'<circle cx="([\d.]+)"', drawn)[:3]]
    scale = np.log(values) if log else values
    assert np.corrcoef(places, scale)[0, 1] == pytest.approx(1.0, abs=1e-4)
    assert "rect" not in drawn  # no bar from an origin that a logarithmic axis lacks


def test_heat_colours_the_cells_and_leaves_gaps() -> None:
    drawn = figure.draw_heat_map(
        "a", ["p", "q", "r"], ["s"], [[-2.0, np.nan, 1.0]], x_label="", y_label="", value_label="v", center=0
    )
    patches = re.findall(r'<path d="M([\d.]+) [^"]*" fill="(#\w+)" shape', drawn.split("narrow")[0])
    assert [color for _, color in patches] == [
        palette.DIVERGING_COLORS[0],
        palette.blend_colors(palette.DIVERGING_COLORS, 48 / 63),
    ]
    assert float(patches[0][0]) == 0.0 and "Hatched: no data." in drawn


def test_the_numbers_of_a_key_never_lie_over_each_other() -> None:
    for rows in (1, 2, 9):
        cells = np.arange(1.0, 1.0 + 2 * rows).reshape(rows, 2) * 8
        names = [f"row {k}" for k in range(rows)]
        drawn = figure.draw_heat_map("a", ["p", "q"], names, cells, x_label="x", y_label="y", value_label="cases")
        key = re.search(r'width="14" [^>]*></rect>((?:<text [^>]*>[^<]*</text>)+)</g>', drawn)
        assert key is not None
        places = [float(y) for y in re.findall(r' y="([-\d.]+)"', key[1])]
        assert len(places) >= 2 and min(-np.diff(places)) >= 12.0  # the font's size


@pytest.mark.parametrize(
    "make, found",
    [
        (lambda: figure.draw_lines("f", [0, 1], [figure.Series("s", [1])], y_label="y"), "y has 1 samples and x has 2"),
        (lambda: figure.draw_lines("f", [0, 2, 1], [], y_label="y"), r"backwards at sample 2 \(1 after 2\)"),
        (lambda: figure.draw_lines("f", [0, np.nan], [], y_label="y"), "not a finite number at sample 1"),
        (lambda: figure.draw_lines("f", [0], [figure.Series("s", [1], dash="wavy")], y_label="y"), "use solid, dashed"),
        (lambda: figure.draw_lines("f", [0], [figure.Series("s", [1], color="mauve")], y_label="y"), "use one of blue"),
        (
            lambda: figure.draw_dots("f", ["a"], [figure.DotGroup("b", [1, 2])], value_label="v"),
            "2 numbers for 1 names",
        ),
        (
            lambda: figure.draw_heat_map("f", [0, 1], [1, 0], [[1]], x_label="", y_label="", value_label=""),
            "2 edges of 1 cells",
        ),
        (lambda: figure.draw_table("f", ["a"], [["x", 1.0]]), "2 cells for 1 columns"),
        (
            lambda: animation.animate_arms("f", [0, 1], [animation.MovingArm("a", np.zeros((3, 3, 2)))]),
            r"shape \(3, 3, 2\)",
        ),
    ],
)
def test_what_does_not_fit_is_said_in_a_sentence(make: object, found: str) -> None:
    with pytest.raises(ValueError, match=found):
        make()  # type: ignore[operator]


def test_a_page_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"
    page.write_page(path, "one", "v", [], "r")
    before = path.read_bytes()
    assert before == page.render_page("one", "v", [], "r").encode()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="what stood there is unchanged: No space left"):
        page.write_page(path, "two", "v", [], "r")
    assert path.read_bytes() == before and [one.name for one in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        page.write_page(tmp_path / "nowhere" / "report.html", "two", "v", [], "r")
