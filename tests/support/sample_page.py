"""One of every figure, small, for the tests of pages: every word in it comes from the caller."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdagen.pages import animation, figure, page

TIME = np.arange(0.0, 10.0, 0.01)
TORQUE = 4.0 * np.sin(TIME)
TIP = np.stack([0.35 + 0.05 * np.cos(TIME), 0.15 + 0.05 * np.sin(TIME)], axis=1)


def points(tip: np.ndarray) -> np.ndarray:
    """A two-link arm whose tip is at ``tip`` (T, 2): base, elbow, tip (T, 3, 2)."""
    elbow = np.stack([0.5 * tip[:, 0] + 0.1, 0.5 * tip[:, 1] - 0.2], axis=1)
    return np.stack([np.zeros_like(tip), elbow, tip], axis=1)


def figures(word: Callable[[str], str]) -> list[str]:
    curve, series, dots = figure.Curve, figure.Series, figure.DotGroup
    noisy = TORQUE + 0.1 * np.sin(300 * TIME)
    frequency = np.geomspace(0.1, 500.0, 300)
    return [
        animation.animate_arms(
            word("arm"),
            TIME,
            [animation.MovingArm(word("one"), points(TIP)), animation.MovingArm(word("two"), points(TIP + 0.002))],
            target=TIP,
            pushes=[(3.0, 4.0, (15.0, 0.0)), (6.0, 7.0, (0.0, 15.0))],
            caption=word("caption"),
            link=word("link"),
        ),
        figure.draw_panels(
            word("torques"),
            TIME,
            [
                figure.Panel(
                    word("torque (N m)"),
                    [
                        series(word("true"), TORQUE),
                        series(word("estimate"), noisy, band_of=(noisy - 0.5, noisy + 0.5)),
                    ],
                    heading=word("joint 1"),
                    levels=[(3.0, word("limit"))],
                ),
                figure.Panel(word("error (N m)"), [series("", 1e-3 * (noisy - TORQUE))], height=0.6),
            ],
            bands=[(3.0, 4.0, word("push"))],
            caption=word("caption"),
            link=word("link"),
        ),
        figure.draw_planes(
            word("paths"),
            [
                figure.Plane([curve(word("tip"), TIP[:, 0], TIP[:, 1], time=TIME)], marks=[(0.4, 0.15, word("start"))]),
                figure.Plane([curve(word("tip"), *(TIP.T + 0.001))], heading=word("second")),
            ],
            x_label=word("x (m)"),
            y_label=word("y (m)"),
            link=word("link"),
        ),
        figure.draw_lines(
            word("spectrum"),
            frequency,
            [series(word("residual"), 1e-3 / frequency)],
            x_label=word("frequency (Hz)"),
            y_label=word("amplitude (rad)"),
            log_x=True,
            log_y=True,
        ),
        figure.draw_dots(
            word("dots"),
            [word("joint 1"), word("joint 2")],
            [dots(word("before"), [12.0, 6.0]), dots(word("after"), [1.5, np.nan], ([1.2, np.nan], [1.7, np.nan]))],
            value_label=word("error (m)"),
            levels=[(1.0, word("noise"))],
        ),
        figure.draw_heat_map(
            word("map"),
            np.linspace(-3.0, 3.0, 7),
            np.linspace(0.0, 10.0, 5),
            np.arange(24.0).reshape(4, 6) - 8.0,
            x_label=word("speed (rad/s)"),
            y_label=word("load (N m)"),
            value_label=word("residual (N m)"),
            center=0.0,
        ),
        figure.draw_heat_map(
            word("names"),
            [word("joint 1"), word("joint 2")],
            [word("effect 1"), word("effect 2")],
            [[0.1, 0.9], [np.nan, 0.0]],
            x_label="",
            y_label=word("effect"),
            value_label=word("probability"),
        ),
        figure.draw_table(
            word("numbers"), [word("name"), word("value")], [[word("largest"), 0.02143], [word("none"), None]]
        ),
        figure.draw_lines(
            word("clock"), 1.7e9 + TIME, [series(word("one"), 1e3 + 1e-3 * TIME)], y_label=word("height (m)")
        ),
    ]


def sections(word: Callable[[str], str] = str) -> list[page.Section]:
    return [
        page.Section(word("first"), word("words") + "\n\n    " + word("code"), figures(word)),
        page.Section(word("second"), word("words")),
        page.Section(word("third"), word("words")),
    ]


def text(word: Callable[[str], str] = str) -> str:
    return page.render_page(word("title"), word("verdict"), sections(word), word("how") + "\n\n    " + word("command"))
