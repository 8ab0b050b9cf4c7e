"""An arm in space moving: drawn in parallel projection, turned with the mouse, with its shadow on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.animation import read_moments
from hdagen.pages.decimation import Array, pack_floats
from hdagen.pages.frame import LAYOUTS, WIDE, Layout, draw_text, group_in_color
from hdagen.pages.markup import build_element
from hdagen.pages.plot import build_path_data

MOST_SPACE_FRAMES = 600  # that travel with the page; the script interpolates between them
STILL_SPACE_POSES = 5  # in the still picture
CAMERA = (-1.0, 0.35)  # turn about the vertical and tilt down, rad
FLOOR_LINES = 9  # each way
WIDE_HEIGHT = 420.0  # px


@dataclass(frozen=True)
class _Camera:
    """A parallel projection: the direction of sight, what is in the middle, pixels a metre, and the size in px."""

    turn: float
    tilt: float
    middle: Array
    scale: float
    width: float
    height: float

    def to_pixels(self, points: Array) -> tuple[Array, Array]:
        """Project points (…, 3) with z up."""
        x, y, z = np.moveaxis(points - self.middle, -1, 0)
        right = -np.sin(self.turn) * x + np.cos(self.turn) * y
        away = np.cos(self.turn) * x + np.sin(self.turn) * y
        up = np.cos(self.tilt) * z - np.sin(self.tilt) * away
        return self.width / 2 + self.scale * right, self.height / 2 - self.scale * up


@dataclass(frozen=True)
class _Scene:
    """``points`` (F, n + 1, 3) with z up, the floor's height, and the lines that stand still, each (K, 3)."""

    points: Array
    floor: float
    floor_lines: tuple[Array, ...]
    names: tuple[str, ...]
    marked: tuple[int, ...]

    @property
    def still_lines(self) -> tuple[Array, ...]:
        """The floor's lines, and the path of the tip."""
        return (*self.floor_lines, self.points[:, -1])


def animate_arm_in_space(
    title: str,
    time: ArrayLike,
    points: ArrayLike,
    *,
    names: Sequence[str],
    marked: Sequence[int] = (),
    up: ArrayLike = (0.0, 0.0, 1.0),
    caption: str = "",
    link: str = "",
) -> str:
    """Animate an arm in space; without the script it is a still picture of several poses.

    Args:
        title: Heading.
        time: Time of each sample, ascending, (T,) s.
        points: (T, n + 1, 3), the joints and the tip at every sample, m, base frame.
        names: Names of the points, n + 1.
        marked: Points that are marked and named in the picture, from 0.
        up: (3,), what is up in the base frame.
        caption: Text below the drawings.
        link: Figures of one link follow the animation's time.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: Shapes do not fit each other, or the time is not ascending.

    """
    moments, places = read_moments(title, time), np.asarray(points, dtype=np.float64)
    if places.shape != (moments.size, len(names), 3) or not moments.size or len(names) < 2:
        raise ValueError(
            f"animation {title!r}: points have shape {places.shape}; give ({moments.size} samples ≥ 1, {len(names)}, 3)"
        )
    rows = np.flatnonzero(np.isfinite(places).all(axis=(1, 2)))
    if not rows.size:
        raise ValueError(f"animation {title!r}: no sample is finite; give one")
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(rows.size, MOST_SPACE_FRAMES)).round().astype(int))]
    scene = _build_scene(places[rows] @ _turn_upright(np.asarray(up, float)).T, tuple(names), tuple(marked))
    middle, radius = _find_extent(scene)
    words = f"{title}: {', '.join(scene.names)}, with the path of the last"
    start = float(moments[rows[0]])
    data = {
        "start": start,
        "time": pack_floats(moments[rows] - start),
        "seconds": float(moments[rows[-1]]) - start,
        "points": pack_floats(scene.points.ravel()),
        "names": scene.names,
        "marked": scene.marked,
        "floor": scene.floor,
        "middle": middle.tolist(),
        "camera": CAMERA,
        "still": [pack_floats(line.ravel()) for line in scene.still_lines],
    }
    drawings = "".join(_draw_layout(layout, words, scene, middle, radius) for layout in LAYOUTS)
    return frame.build_figure("space_arm", title, drawings, caption=caption, data=data, link=link)


def _turn_upright(up: Array) -> Array:
    """The rotation (3, 3) that brings what is up onto z, and keeps x in front as far as it can."""
    z = up / np.linalg.norm(up)
    x = np.eye(3)[int(np.argmax(np.abs(z) < 0.9))]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _build_scene(points: Array, names: tuple[str, ...], marked: tuple[int, ...]) -> _Scene:
    floor = min(float(points[..., 2].min()), float(points[0, 0, 2]))
    low, high = points[..., :2].min(axis=(0, 1)), points[..., :2].max(axis=(0, 1))
    middle, half = (low + high) / 2, 0.6 * max(float((high - low).max()), float(np.ptp(points[..., 2])), 1e-3)
    lines = []
    for at in np.linspace(-half, half, FLOOR_LINES):
        lines.append(np.array([[middle[0] + at, middle[1] + side * half, floor] for side in (-1, 1)]))
        lines.append(np.array([[middle[0] + side * half, middle[1] + at, floor] for side in (-1, 1)]))
    return _Scene(points, floor, tuple(lines), names, marked)


def _find_extent(scene: _Scene) -> tuple[Array, float]:
    """The middle of all, and the largest distance from it, m."""
    every = np.concatenate([scene.points.reshape(-1, 3), *scene.still_lines])
    middle = (every.min(axis=0) + every.max(axis=0)) / 2
    return middle, float(np.linalg.norm(every - middle, axis=1).max())


def _draw_layout(layout: Layout, words: str, scene: _Scene, middle: Array, radius: float) -> str:
    height = WIDE_HEIGHT if layout is WIDE else 0.9 * layout.width
    camera = _Camera(*CAMERA, middle, 0.5 * min(layout.width, 1.25 * height) / radius, layout.width, height)
    last = len(scene.floor_lines)
    floor = [_draw_still(camera, line, at, 0.8, 0.28) for at, line in enumerate(scene.floor_lines)]
    shown = np.unique(np.linspace(0, len(scene.points) - 1, STILL_SPACE_POSES).round().astype(int)).tolist()
    poses = "".join(_draw_pose(camera, scene.points[at], 0.15) for at in shown[1:])
    view = build_element(
        "g",
        build_element("rect", width=layout.width, height=height, rx=4, fill_opacity=0.035),
        group_in_color("grey", *floor),
        group_in_color("blue", build_element("g", poses, class_="poses")),
        group_in_color("blue", _draw_still(camera, scene.points[:, -1], last, 1.3, 0.8)),
        build_element("g", *_draw_live(camera, scene, layout.font), class_="live"),
        class_="view",
        data_view=f"{camera.scale!r} {camera.width!r} {camera.height!r}",
    )
    return frame.build_svg(layout, layout.width, height, words, view)


def _draw_live(camera: _Camera, scene: _Scene, font: float) -> list[str]:
    """The arm at the begin with its shadow, and the marked joints, which the script moves."""
    first = scene.points[0]
    shadow = first.copy()
    shadow[:, 2] = scene.floor
    marked = first[list(scene.marked)].reshape(-1, 3)
    x, y = camera.to_pixels(marked)
    names = [
        draw_text(round(float(a) + 14, 1), round(float(b) - 10, 1), scene.names[at], strong=True, halo=True)
        for at, a, b in zip(scene.marked, x, y, strict=True)
    ]
    return [
        group_in_color("grey", _draw_path(build_path_data(*camera.to_pixels(shadow)), 5, 0.35, "shadow")),
        group_in_color("blue", _draw_pose(camera, first, 0.9)),
        group_in_color("vermilion", _draw_path(_place_dots(camera, marked), 16, 1.0, "marked"), *names),
    ]


def _draw_still(camera: _Camera, line: Array, at: int, width: float, opacity: float) -> str:
    """A line that stands still, which the script turns."""
    return _draw_path(build_path_data(*camera.to_pixels(line)), width, opacity, "fixed", data_at=at)


def _draw_pose(camera: _Camera, points: Array, opacity: float) -> str:
    links = _draw_path(build_path_data(*camera.to_pixels(points)), 6, opacity, "links")
    return links + _draw_path(_place_dots(camera, points), 11, opacity, "joints")


def _place_dots(camera: _Camera, points: Array) -> str:
    return build_path_data(*camera.to_pixels(points), "points")


def _draw_path(d: str, width: float, opacity: float, class_: str, **attributes: object) -> str:
    return build_element(
        "path",
        d=d,
        class_=class_,
        fill="none",
        stroke="currentColor",
        stroke_width=width,
        stroke_opacity=opacity,
        stroke_linecap="round",
        stroke_linejoin="round",
        **attributes,
    )
