"""Figures: numbers in, one HTML ``figure`` element out, as a string.

Every function is pure: the same numbers give the same text. Labels are "name (unit)" with SI base units. A figure is
readable without its script; with it, it reads out values under the cursor, zooms by dragging (double click: back) and
can be saved as SVG, and its numbers as CSV in base units.
"""

from collections.abc import Sequence

from hdagen.pages.curves import Curve, Panel, Plane, Series, draw_lines, draw_panels, draw_plane, draw_planes
from hdagen.pages.dot_chart import DotGroup, draw_dots
from hdagen.pages.heat_map import draw_heat_map
from hdagen.pages.markup import build_element
from hdagen.pages.number_table import draw_table

__all__ = [
    "Curve",
    "DotGroup",
    "Panel",
    "Plane",
    "Series",
    "draw_dots",
    "draw_heat_map",
    "draw_lines",
    "draw_panels",
    "draw_plane",
    "draw_planes",
    "draw_table",
    "place_abreast",
    "place_in_column",
]  # fmt: skip


def place_abreast(figures: Sequence[str]) -> str:
    """Place figures beside each other, as many in a row as the window has room for: the row may be wider than the text.

    Args:
        figures: Markup of the figures.

    Returns:
        Markup of the group.

    """
    return build_element("div", *figures, class_="abreast")


def place_in_column(figures: Sequence[str]) -> str:
    """Place figures beside each other, as many in a row as the column of the text has room for.

    Args:
        figures: Markup of the figures.

    Returns:
        Markup of the group.

    """
    return build_element("div", *figures, class_="abreast within")
