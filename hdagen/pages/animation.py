"""The arm moving: the whole arm, a close-up of its tip, and the pushes as arrows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.decimation import Array, as_samples, pack_floats
from hdagen.pages.frame import LAYOUTS, WIDE, Layout, draw_text, estimate_text_width, group_in_color, shorten_text
from hdagen.pages.markup import build_element
from hdagen.pages.palette import COLOR_CYCLE
from hdagen.pages.plot import build_path_data
from hdagen.pages.quantity import format_number

MOST_FRAMES = 1500  # that travel with the page; the script interpolates between them
STILL_POSES = 7  # of each arm in the still picture
ARROW_LENGTH = 0.24  # length of the largest force, in heights of the view
CLOSE_UP_SHARE = 0.4  # the tip gets a view of its own where it stays within this share of the arm's extent
PushArrow = tuple[float, float, tuple[float, float]]


@dataclass(frozen=True)
class MovingArm:
    """``points`` (T, n + 1, 2): base, joints and tip at every sample, m, base frame (x right, y up)."""

    label: str
    points: ArrayLike
    color: str | None = None


@dataclass(frozen=True)
class _View:
    """A window on the plane: its lower left corner in m, pixels a metre, size in px."""

    name: str
    close: bool
    left: float
    low: float
    scale: float
    width: float
    height: float

    def to_pixels(self, points: Array) -> tuple[Array, Array]:
        return (points[..., 0] - self.left) * self.scale, self.height - (points[..., 1] - self.low) * self.scale


@dataclass(frozen=True)
class _Scene:
    """The content of both drawings. ``arms`` holds label, colour and points (F, n + 1, 2)."""

    time: Array
    arms: tuple[tuple[str, str, Array], ...]
    target: Array
    pushes: tuple[PushArrow, ...]


def animate_arms(
    title: str,
    time: ArrayLike,
    arms: Sequence[MovingArm],
    *,
    target: ArrayLike | None = None,
    pushes: Sequence[PushArrow] = (),
    seconds: float | None = None,
    caption: str = "",
    link: str = "",
) -> str:
    """Animate arms; without the script it is a still picture of several poses.

    Args:
        title: Heading.
        time: Time of each sample, ascending, (T,) s.
        arms: The arms, with points at every sample.
        target: Path that the tip shall follow, (K, 2) m, base frame.
        pushes: Forces on the tip as (start, end, (x, y)) in s and N, base frame.
        seconds: Length of the animation, s; None: as long as the motion took.
        caption: Text below the drawings.
        link: Figures of one link follow the animation's time.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: Shapes do not fit each other, or the time is not ascending.

    """
    scene = _build_scene(title, time, arms, target, pushes)
    words = f"{title}: {', '.join(label for label, _, _ in scene.arms)}, with the path of the tip"
    drawings = "".join(_draw_layout(layout, words, scene) for layout in LAYOUTS)
    start = length = 0.0
    if scene.time.size:
        start = float(scene.time[0])
        length = float(scene.time[-1]) - start
    if seconds is None:
        seconds = length
    data = {
        "start": start,
        "arrow": ARROW_LENGTH,
        "time": pack_floats(scene.time - start),
        "seconds": float(seconds),
        "arms": [
            {"label": label, "color": color, "points": pack_floats(points.ravel())}
            for label, color, points in scene.arms
        ],
        "joints": max((points.shape[1] for _, _, points in scene.arms), default=0),
        "pushes": [[float(begin), float(end), [float(x), float(y)]] for begin, end, (x, y) in pushes],
    }
    return frame.build_figure("arm", title, drawings, caption=caption, data=data, link=link)


def read_moments(title: str, time: ArrayLike) -> Array:
    """Read the time of an animation.

    Args:
        title: Of the animation, for the sentence.
        time: (T,) s.

    Returns:
        The time of each sample.

    Raises:
        ValueError: The time is not finite or not ascending.

    """
    moments = as_samples(time)
    if np.isnan(moments).any() or np.any(np.diff(moments) < 0):
        raise ValueError(f"animation {title!r}: time must be finite and ascending; sort the samples")
    return moments


def _build_scene(
    title: str, time: ArrayLike, arms: Sequence[MovingArm], target: ArrayLike | None, pushes: Sequence[PushArrow]
) -> _Scene:
    moments = read_moments(title, time)
    clouds = []
    for one in arms:
        points = np.asarray(one.points, dtype=np.float64)
        if points.ndim != 3 or points.shape[0] != moments.size or points.shape[1] < 2 or points.shape[2] != 2:
            raise ValueError(
                f"animation {title!r}, arm {one.label!r}: points have shape {points.shape}; "
                f"give ({moments.size} samples, joints + 1 ≥ 2, 2)"
            )
        clouds.append(points)
    if len({points.shape[1] for points in clouds}) > 1:
        raise ValueError(f"animation {title!r}: the arms differ in their number of joints; show them one by one")
    whole = np.ones(moments.size, dtype=bool)
    for points in clouds:
        whole &= np.isfinite(points).all(axis=(1, 2))
    rows = np.flatnonzero(whole)
    if rows.size:
        rows = rows[np.unique(np.linspace(0, rows.size - 1, min(rows.size, MOST_FRAMES)).round().astype(int))]
    way = np.zeros((0, 2))
    if target is not None:
        way = np.asarray(target, dtype=np.float64).reshape(-1, 2)
    named = [(one.label, one.color or COLOR_CYCLE[at % len(COLOR_CYCLE)]) for at, one in enumerate(arms)]
    return _Scene(
        moments[rows],
        tuple((label, color, points[rows]) for (label, color), points in zip(named, clouds, strict=True)),
        way[np.isfinite(way).all(axis=1)],
        tuple(pushes),
    )


def _draw_layout(layout: Layout, words: str, scene: _Scene) -> str:
    """The views beside each other, or one below the other on a narrow layout, under the key of the arms."""
    font = layout.font
    parts, x = [], 0.0
    for label, color, _ in scene.arms:
        sample = build_element(
            "path", d=f"M{x + 3:.1f} {0.7 * font:.1f}h18", stroke="currentColor", stroke_width=5, stroke_linecap="round"
        )
        short = shorten_text(label, layout.width / (len(scene.arms) + 1) - 48, font)
        parts += [group_in_color(color, sample), draw_text(x + 30, 1.05 * font, short)]
        x += 48 + estimate_text_width(short, font)
    if scene.target.size:
        sample = build_element(
            "path", d=f"M{x:.1f} {0.7 * font:.1f}h24", stroke="currentColor", stroke_width=2, stroke_dasharray="5 4"
        )
        parts += [group_in_color("grey", sample), draw_text(x + 30, 1.05 * font, "target")]
    top, views = 2 * font, _choose_views(layout, scene)
    left = lowest = 0.0
    for view in views:
        place = f"translate({left:.1f} {top:.1f})"
        parts.append(
            build_element(
                "g",
                build_element("rect", width=view.width, height=view.height, rx=4, fill_opacity=0.035),
                _draw_still(view, scene),
                draw_text(10.0, 1.6 * font, view.name, strong=True),
                _draw_ruler(view, font),
                class_="view",
                transform=place,
                data_view=f"{view.left!r} {view.low!r} {view.scale!r} {view.height!r}",
            )
        )
        lowest = top + view.height
        if layout is WIDE:
            left += view.width + 16
        else:
            top = lowest + 12
    return frame.build_svg(layout, layout.width, round(lowest + 4, 1), words, *parts)


def _choose_views(layout: Layout, scene: _Scene) -> list[_View]:
    tips = [points[:, -1] for _, _, points in scene.arms]
    close = np.concatenate([*tips, scene.target, np.zeros((0, 2))])
    whole = np.concatenate([close, *(points.reshape(-1, 2) for _, _, points in scene.arms)])
    if not close.size:
        return [_View("no data", True, 0.0, 0.0, 1.0, layout.width, 80.0)]
    apart = np.ptp(close, axis=0).max() < CLOSE_UP_SHARE * np.ptp(whole, axis=0).max()
    half = layout.width
    if layout is WIDE:
        half = (layout.width - 16) / 2
    if not apart:
        return [_fit_view("", True, whole, layout.width, half)]
    return [_fit_view("whole arm", False, whole, half, 0.92 * half), _fit_view("tip", True, close, half, 0.92 * half)]


def _fit_view(name: str, close: bool, points: Array, width: float, height: float) -> _View:
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-6)
    scale = float(min(width / size[0], height / size[1]) * 0.68)
    corner = (low + high) / 2 - np.array([width, height]) / scale / 2
    return _View(name, close, float(corner[0]), float(corner[1]), scale, width, height)


def _draw_still(view: _View, scene: _Scene) -> str:
    """Paths, poses and arrows as they stand in print; the script moves the elements of class live."""
    size = scene.time.size
    parts, poses = [], ""
    if scene.arms and size:
        first = scene.arms[0][2]
        parts.append(_draw_base(view, first[0, 0]))
        shown = np.unique(np.linspace(0, size - 1, STILL_POSES).round().astype(int)).tolist()
        poses = "".join(_draw_pose(view, first[at], 0.15, 6) for at in shown)
    parts.append(group_in_color("grey", _draw_line(build_path_data(*view.to_pixels(scene.target)), 1.6, dash="5 4")))
    for _, color, points in scene.arms:
        parts.append(
            group_in_color(
                color,
                build_element("g", poses, class_="poses"),
                _draw_line(build_path_data(*view.to_pixels(points[:, -1])), 1.3),
            )
        )
        poses = ""  # of the first arm alone
    for rank, (_, color, points) in enumerate(scene.arms):  # the first is the thickest, so that none hides another
        live = ""
        if size:
            live = _draw_pose(view, points[0], 0.9, 5 + 4 * (len(scene.arms) - 1 - rank))
        parts.append(group_in_color(color, _draw_line("", 2.6, class_="trail"), live, class_="live"))
    for begin, end, force in scene.pushes:  # above the arms, which would hide their sizes
        at = int(np.searchsorted(scene.time, (begin + end) / 2))
        if scene.arms and at < size:
            arrow = _draw_arrow(view, scene.arms[0][2][at, -1], force, _find_largest_force(scene.pushes))
            parts.append(build_element("g", arrow, class_="arrows", opacity=0.75))
    parts.append(
        build_element("g", _draw_arrow(view, np.zeros(2), (0.0, 0.0), 1.0), class_="push", visibility="hidden")
    )
    return build_element("svg", *parts, width=view.width, height=view.height)


def _draw_line(
    d: str, width: float, *, dash: str | None = None, opacity: float | None = None, class_: str | None = None
) -> str:
    return build_element(
        "path",
        d=d,
        class_=class_,
        fill="none",
        stroke="currentColor",
        stroke_width=width,
        stroke_dasharray=dash,
        stroke_opacity=opacity,
        stroke_linecap="round",
        stroke_linejoin="round",
    )


def _draw_pose(view: _View, points: Array, opacity: float, thick: float) -> str:
    """Links and joints; the script writes the same two paths."""
    x, y = view.to_pixels(points)
    links = "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    joints = "".join(f"M{a:.1f} {b:.1f}h.01" for a, b in zip(x.tolist(), y.tolist(), strict=True))
    return _draw_line(links, thick, opacity=opacity, class_="links") + _draw_line(
        joints, 2 * thick, opacity=opacity, class_="joints"
    )


def _draw_base(view: _View, foot: Array) -> str:
    x, y = view.to_pixels(foot)
    hatch = "".join(f"M{x - 16 + 8 * at:.1f} {y + 15:.1f}l-6 7" for at in range(5))
    outline = f"M{x:.1f} {y:.1f}l-11 15h22zM{x - 20:.1f} {y + 15:.1f}h40{hatch}"
    return group_in_color("grey", _draw_line(outline, 1.5))


def _find_largest_force(pushes: Sequence[PushArrow]) -> float:
    return max((math.hypot(*force) for _, _, force in pushes), default=0.0) or 1.0


def _draw_arrow(view: _View, tip: Array, force: tuple[float, float], longest: float) -> str:
    """An arrow that ends at the tip of the arm, like a push; drawn along x and turned. In a close-up its size stands
    at its end."""
    x, y = view.to_pixels(tip)
    size = math.hypot(*force)
    length = ARROW_LENGTH * view.height * size / longest
    angle = math.degrees(math.atan2(-force[1], force[0]))
    shaft = _draw_line(f"M{-length - 8:.1f} 0H-16", 3.2, class_="shaft")
    head = build_element("path", d="M-8 0l-13 -6v12z", class_="head")
    turned = build_element("g", shaft, head, transform=f"rotate({angle:.1f})", class_="turn")
    across, down = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    at_x, at_y = -across * (length + 30), -down * (length + 22) + 4
    parts = [turned]
    if view.close:
        text = f"{format_number(size, 3)} N"
        parts.append(draw_text(round(at_x, 1), round(at_y, 1), text, anchor="middle", strong=True, halo=True))
    return group_in_color("ink", *parts, transform=f"translate({x:.1f} {y:.1f})")


def _draw_ruler(view: _View, font: float) -> str:
    """A round length in the lower right corner."""
    room = 0.28 * view.width / view.scale
    power = 10.0 ** math.floor(math.log10(room))
    length = next(step for step in (5, 2, 1) if step * power <= room) * power
    x, y = view.width - 12 - length * view.scale, view.height - 12
    bar = _draw_line(f"M{x:.1f} {y - 4:.1f}v4h{length * view.scale:.1f}v-4", 1.3)
    text = f"{format_number(1000 * length)} mm"
    if length >= 1:
        text = f"{format_number(length)} m"
    return bar + draw_text(view.width - 12 - length * view.scale / 2, y - 0.6 * font, text, anchor="middle", faint=True)
