"""The page's section on the gap: as a whole, by channel, remainders, small effects, and effects within tolerance."""

from __future__ import annotations

from typing import Any

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.report.residual_maps import REPLAY_COLORS
from hdagen.diagnosis.report.sentences import name_effect
from hdagen.pages.bar_chart import BarGroup, draw_bars
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section


def show_gap(content: dict[str, Any]) -> Section:
    """Make the section of the page.

    Args:
        content: of diagnosis.json.

    Returns:
        The gap as a whole and by channel, remainders, small effects, and effects within tolerance.

    """
    gap = content["gap"]
    channels = gap["by_channel"]
    names, values = ["before", "after"], [gap["before"], gap["after"]]
    caption = ""
    if gap["flexible"] is not None:
        names, values = [*names, "flexible correction"], [*values, gap["flexible"]]
        caption = (
            "Flexible correction: base parameters refitted, then regressions without structure as far as they close "
            "more, on the same data."
        )
    whole = draw_bars(
        "Gap on held-out motion",
        names,
        [BarGroup("", values)],
        value_label="replay error in multiples of noise",
        levels=list_gap_levels(gap),
        log=True,
        caption=caption,
    )
    drawn = []
    for when in ("before", "after"):
        drawn.append(BarGroup(when, [c[when] for c in channels.values()], color=REPLAY_COLORS[when]))
    by = draw_bars(
        "Gap by channel",
        [name.replace("_", " ") for name in channels],
        drawn,
        value_label="replay error in multiples of noise",
        levels=[(gap["floor"], "noise alone")],
        log=True,
    )
    text = (
        "Root mean square of the replay error in windows of 0.25 s, in multiples of each channel's noise, joined as "
        f"the geometric mean. Held out: {content['data']['held_out']}."
    )
    return Section(
        "The gap",
        text,
        [whole, by, *_show_remainders(content), *_show_small_effects(content), *_show_nuisance_effects(content)],
    )


def list_gap_levels(gap: dict[str, Any]) -> list[tuple[float, str]]:
    """List the levels that bound a gap.

    Args:
        gap: of diagnosis.json.

    Returns:
        The noise and the achievable gap, in multiples of the noise, each with its words.

    """
    return [(gap["floor"], "noise alone"), (gap["achievable"], "best of all that was fitted")]


def _show_remainders(content: dict[str, Any]) -> list[str]:
    """A table of the share of each joint's error that no known effect explains; no table where there was no error."""
    rows: list[list[str | float | None]] = [
        [f"joint {one['joint']}", 100 * one["share"], one["noise"]] for one in content["remains"]
    ]
    if not rows:
        return []
    return [
        draw_table(
            "What remains",
            ["", "of the error before (%)", "in multiples of the noise"],
            rows,
            caption=(
                "Of the channel of each joint that is explained best. From"
                f" {100 * HOLDOUT_CHECK.named_remainder_share:.0f} % and"
                f" {DATA.significant_noise_multiple:g} times the noise on, a verdict with named effects says that"
                " something unknown is at this joint, too; that takes nothing from what is named."
            ),
        )
    ]


def _show_small_effects(content: dict[str, Any]) -> list[str]:
    """A table of effects that are present and close next to nothing of the gap; no table where there are none."""
    rows: list[list[str | float | None]] = [
        [name_effect(f"{one['effect']}@{one['joint']}"), one["without"], one["with"]] for one in content["small"]
    ]
    if not rows:
        return []
    return [
        draw_table(
            "There, and small",
            ["effect", "gap without it", "gap with it"],
            rows,
            caption="The log tells these effects, but held-out motion is told about as well without them: the verdict "
            "leaves them out. In multiples of the noise.",
        )
    ]


def _show_nuisance_effects(content: dict[str, Any]) -> list[str]:
    """A table of effects within tolerance that would close more of the gap; no table where there are none."""
    rows: list[list[str | float | None]] = []
    for one in content["nuisance_effects"]:
        values = ", ".join(
            f"{name} {v['value']:.3g} {v['unit']}" for name, v in one["parameters"].items() if v["value"]
        )
        rows.append([name_effect(f"{one['effect']}@{one['joint']}"), values, 100 * one["size"], one["gap"]])
    if not rows:
        return []
    return [
        draw_table(
            "Within tolerance, and not named",
            ["effect", "as large as", "of its usual size (%)", "gap, were it in the model, too"],
            rows,
            caption="No effect is ever exactly absent. These are too small to count as missing, and the verdict leaves "
            "them out; each of them, beside the verdict, would close this much more. The robot file may have them.",
        )
    ]
