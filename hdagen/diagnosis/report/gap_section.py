"""The page's section on the error: by channel in its unit, remainders, small effects, and effects within tolerance."""

from __future__ import annotations

from typing import Any

from hdagen.diagnosis.report.effect_words import find_channel_unit, format_values, name_channel, name_effect, name_joint
from hdagen.diagnosis.report.gap_words import format_channel_error
from hdagen.diagnosis.report.residual_maps import REPLAY_COLORS
from hdagen.pages.dot_chart import DotGroup, draw_dots
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section
from hdagen.prediction.window_replay import REPLAY_WINDOW


def show_gap(content: dict[str, Any]) -> Section:
    """Make the section of the page.

    Args:
        content: of diagnosis.json.

    Returns:
        The error by channel, remainders, small effects, and effects within tolerance.

    """
    text = (
        f"Root mean square of the replay error in windows of {REPLAY_WINDOW:g} s, on motion that no fit saw: "
        f"{content['data']['held_out']}. The gap is the geometric mean over the channels, in multiples of their noise."
        f"{_say_remainders(content)}"
    )
    figures = [_draw_channels(content), *_show_small_effects(content), *_show_nuisance_effects(content)]
    return Section("The error by channel", text, figures)


def _draw_channels(content: dict[str, Any]) -> str:
    """Each channel before and after in multiples of its noise, and in its unit beside its name."""
    channels, joints = content["gap"]["by_channel"], content.get("joints", ())
    names = [f"{name_channel(name, joints)}: {format_channel_error(content, name)}" for name in channels]
    groups = [
        DotGroup(when, [one[when] for one in channels.values()], color=REPLAY_COLORS[when])
        for when in ("before", "after")
    ]
    noise = []
    for name, one in channels.items():
        (value,), unit = format_values([one["noise"]], find_channel_unit(name, one), 2)
        noise.append(f"{name_channel(name, joints)} {value} {unit}")
    return draw_dots(
        "Error of each channel",
        names,
        groups,
        value_label="error in multiples of the noise",
        levels=[(content["gap"]["floor"], "noise alone")],
        log=True,
        caption=f"One noise is: {'; '.join(noise)}.",
    )


def _say_remainders(content: dict[str, Any]) -> str:
    """The share of each joint's error that stays; "" where there was no error."""
    joints = content.get("joints", ())
    each = [
        f"{100 * one['share']:.2g} % at {name_joint(one['joint'], joints)} ({one['noise']:.3g} times the noise)"
        for one in content["remains"]
    ]
    if not each:
        return ""
    return f" Of the error of the channel that is explained best, there remain {' and '.join(each)}."


def _show_small_effects(content: dict[str, Any]) -> list[str]:
    """A table of effects that are present and close next to nothing of the gap; no table where there are none."""
    joints = content.get("joints", ())
    rows: list[list[str | float | None]] = [
        [name_effect(f"{one['effect']}@{one['joint']}", joints), one["without"], one["with"]]
        for one in content["small"]
    ]
    if not rows:
        return []
    return [
        draw_table(
            "There, and small",
            ["effect", "gap without it (noise)", "gap with it (noise)"],
            rows,
            digits=3,
            caption="The log shows these effects, but held-out motion is predicted about as well without them: the "
            "verdict leaves them out.",
        )
    ]


def _show_nuisance_effects(content: dict[str, Any]) -> list[str]:
    """A table of effects within tolerance that would close more of the gap; no table where there are none."""
    joints = content.get("joints", ())
    rows: list[list[str | float | None]] = []
    for one in content["nuisance_effects"]:
        sizes = []
        for name, v in one["parameters"].items():
            if v["value"]:
                (value,), unit = format_values([v["value"]], v["unit"])
                sizes.append(f"{name.replace('_', ' ')} {value} {unit}".rstrip())
        effect = name_effect(f"{one['effect']}@{one['joint']}", joints)
        rows.append([effect, ", ".join(sizes), f"{100 * one['size']:.2g} %", one["gap"]])
    if not rows:
        return []
    return [
        draw_table(
            "Within tolerance, and not named",
            ["effect", "size", "of its usual size", "gap with it, too (noise)"],
            rows,
            digits=3,
            caption="No effect is ever exactly absent. These are too small to count as missing; each of them would "
            "close this much more beside the verdict. The robot file may have them.",
        )
    ]
