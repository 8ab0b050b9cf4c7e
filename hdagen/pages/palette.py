"""The colours of the curves, for paper and for a dark screen.

The hues are those of Okabe and Ito (2008, Color Universal Design), moved in lightness until each stands out from its
background by a contrast of 3 (WCAG 2.1, 1.4.11) and any two stay apart for readers with a colour-vision deficiency.
Where curves share a plot they differ in their dashes too.
"""

from __future__ import annotations

PAPER_COLOR = "#ffffff"
NIGHT_COLOR = "#14171c"

COLORS = {  # name: (on paper, on a dark screen)
    "blue": ("#0072b2", "#3f9be0"),
    "vermilion": ("#b83c00", "#f56a2c"),
    "green": ("#00976e", "#20b98f"),
    "purple": ("#c76aa5", "#e3a0ce"),
    "orange": ("#c28a00", "#f6cd55"),
    "ink": ("#1b1f24", "#e8eaed"),
    "grey": ("#7a828c", "#8b949e"),  # for what stands in the background: targets, limits, poses
}
COLOR_CYCLE = ("blue", "vermilion", "green", "purple", "orange", "ink")

DASH_PATTERNS = {"solid": None, "dashed": "7 3", "dotted": "1.5 3", "dash-dotted": "9 3 2 3"}
DASH_CYCLE = ("solid", "dashed", "dash-dotted", "dotted")

# Heat maps: dark to light through blue, grey and yellow, after cividis (Nuñez, Anderton and Renslow 2018), and
# blue – white – vermilion about a centre. Both keep their order in lightness, or in distance from the middle, in grey.
SEQUENTIAL_COLORS = ("#00224e", "#2f3d6c", "#575c6d", "#7c7b78", "#a59c74", "#d2c060", "#fee838")
DIVERGING_COLORS = ("#004c7f", "#2f86bd", "#9cc7e3", "#f4f4f2", "#f2b48d", "#cf6425", "#8a2c00")


def build_color_style() -> str:
    """Write the CSS of the colours: one class per colour, which sets ``color`` on a dark screen.

    On paper the attribute in the drawing holds.

    Returns:
        The style sheet.

    """
    dark = "".join(f".{name}{{color:{night}}}" for name, (_, night) in COLORS.items())
    paper = "".join(f".key.{name}{{color:{day}}}" for name, (day, _) in COLORS.items())
    return f"{paper}\n@media screen and (prefers-color-scheme: dark){{{dark}{dark.replace('.', '.key.')}}}\n"


def blend_colors(stops: tuple[str, ...], position: float) -> str:
    """Blend colours, linearly in sRGB.

    Args:
        stops: Colours as #rrggbb, equally spaced from 0 to 1.
        position: Place among the stops; it is kept within [0, 1].

    Returns:
        The colour as #rrggbb.

    """
    scaled = min(max(position, 0.0), 1.0) * (len(stops) - 1)
    first = min(int(scaled), len(stops) - 2)
    share = scaled - first
    channels = [
        round((1 - share) * int(stops[first][at : at + 2], 16) + share * int(stops[first + 1][at : at + 2], 16))
        for at in (1, 3, 5)
    ]
    return "#" + "".join(f"{channel:02x}" for channel in channels)


def compute_luminance(color: str) -> float:
    """Compute the relative luminance of a colour.

    Args:
        color: The colour as #rrggbb.

    Returns:
        The luminance in [0, 1].

    Source: WCAG 2.1, relative luminance.

    """
    linear = []
    for at in (1, 3, 5):
        value = int(color[at : at + 2], 16) / 255
        if value <= 0.04045:
            linear.append(value / 12.92)
        else:
            linear.append(((value + 0.055) / 1.055) ** 2.4)
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
