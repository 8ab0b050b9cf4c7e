"""Figures: numbers in, one HTML ``figure`` element out, as a string.

Every function is pure: the same numbers give the same text. Labels are "name (unit)" with SI base units. A figure is
readable without its script; with it, it reads out values under the cursor, zooms by dragging (double click: back) and
can be saved as SVG, and its numbers as CSV in base units.
"""

from collections.abc import Sequence

from hdagen.pages.bar_chart import Bars, bars
from hdagen.pages.curves import Curve, Panel, Plane, Series, lines, panels, planes, xy
from hdagen.pages.heat_map import heat
from hdagen.pages.markup import tag
from hdagen.pages.number_table import table

__all__ = [
    "Bars", "Curve", "Panel", "Plane", "Series", "abreast", "bars", "heat", "lines", "panels", "planes", "table", "xy",
]  # fmt: skip


def abreast(figures: Sequence[str]) -> str:
    """Place figures beside each other, as many in a row as there is room for.

    Args:
        figures: Markup of the figures.

    Returns:
        Markup of the group.

    """
    return tag("div", *figures, class_="abreast")
