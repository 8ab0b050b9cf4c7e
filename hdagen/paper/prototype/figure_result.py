"""The result of a figure or table of the paper: pictures, numbers, logs, and a line for each of the paper's claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from hdagen.arm.arrays import Array
from hdagen.log.measured_log import Log

Cell = str | float | int | bool | None


@dataclass(frozen=True)
class Claim:
    """``paper``: a claim of the paper; ``here``: the result; ``holds``: whether the claim holds (None: it cannot be
    tested); ``why``: the reason for a difference, or the limit of the claim."""

    paper: str
    here: str
    holds: bool | None
    why: str = ""


@dataclass(frozen=True)
class Choice:
    """A question that the paper leaves open: the choice ``taken``, and the results of its ``alternatives``."""

    question: str
    taken: str
    alternatives: str


@dataclass(frozen=True)
class Curve:
    """A curve, ``x`` and ``y`` (T,) in SI units. ``draw``: line, points or step. ``color`` and ``dash`` are names of
    `hdagen.pages.palette`; by default they follow the order of the curves."""

    label: str
    x: ArrayLike
    y: ArrayLike
    draw: str = "line"
    color: str | None = None
    dash: str | None = None
    width: float = 1.5


def plot_path(
    label: str, points: Array, color: str | None = None, dash: str | None = None, width: float = 1.5
) -> Curve:
    """Make the curve through points of the plane.

    Args:
        label: of the legend.
        points: x and y (T, 2), m.
        color: name of a colour; None for the next one.
        dash: name of a pattern; None for the next one.
        width: of the line, points.

    Returns:
        The curve.

    """
    return Curve(label, points[:, 0], points[:, 1], color=color, dash=dash, width=width)


@dataclass(frozen=True)
class Axes:
    """One pair of axes. ``bands``: labelled intervals of x; ``marks``: labelled points; ``equal``: both axes have the
    same scale."""

    heading: str
    x_label: str
    y_label: str
    curves: Sequence[Curve]
    log_x: bool = False
    log_y: bool = False
    equal: bool = False
    bands: Sequence[tuple[float, float, str]] = ()
    marks: Sequence[tuple[float, float, str]] = ()


@dataclass(frozen=True)
class Map:
    """A number for every cell of a grid: ``x``, ``y`` the edges of its columns and rows, ``values`` (rows, columns)."""

    heading: str
    x_label: str
    y_label: str
    value_label: str
    x: ArrayLike
    y: ArrayLike
    values: ArrayLike
    log_x: bool = True
    log_y: bool = True


@dataclass(frozen=True)
class Grid:
    """A table of words and numbers."""

    heading: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    digits: int = 4


Part = Axes | Map | Grid


@dataclass(frozen=True)
class Result:
    """A figure or table. ``parts`` stand row by row, ``columns`` beside each other, as in the paper; ``numbers`` go
    into its JSON; ``logs`` by the end of their file's name; ``robots`` for `hdagen replay` of each log: a preset
    (`paper_prototype` where none is named) or the content of a robot file."""

    name: str
    title: str
    text: str
    parts: Sequence[Part]
    claims: Sequence[Claim]
    numbers: Mapping[str, Any]
    columns: int = 2
    choices: Sequence[Choice] = ()
    logs: Mapping[str, Log] = field(default_factory=dict)
    robots: Mapping[str, str | bytes] = field(default_factory=dict)
