"""The error before and after a verdict in words: by channel in its unit, as a whole in multiples of the noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdagen.diagnosis.report.effect_words import find_channel_unit, format_change
from hdagen.pages.quantity import format_number


def list_named_effects(content: Mapping[str, Any]) -> list[str]:
    """List the known effects of the verdict.

    Args:
        content: of diagnosis.json.

    Returns:
        effect@joint each.

    """
    return [entry for entry in content["verdict"] if not entry.startswith("unknown@")]


def find_shown_channel(content: Mapping[str, Any]) -> str | None:
    """Find the channel whose error is said in its unit: the position of the named joint, else what errs most.

    Args:
        content: of diagnosis.json.

    Returns:
        The name of its column; None where no channel counts.

    """
    channels = content["gap"]["by_channel"]
    joints = [entry.partition("@")[2] for entry in content["verdict"]]
    for joint in joints[:1]:
        for name in (f"joint_position_{joint}", f"motor_position_{joint}"):
            if name in channels:
                return name
    return max(channels, key=lambda name: float(channels[name]["before"]), default=None)


def format_channel_error(content: Mapping[str, Any], name: str, between: str = " → ") -> str:
    """Format the error of a channel before and after the verdict.

    Args:
        content: of diagnosis.json.
        name: of its column.
        between: what stands between both.

    Returns:
        Root mean squares before and after, with their unit.

    """
    one = content["gap"]["by_channel"][name]
    before, after = (one[when] * one["noise"] for when in ("before", "after"))
    return format_change(before, after, find_channel_unit(name, one), between)


def format_closed_share(gap: Mapping[str, Any]) -> str:
    """Format the share of the gap that is closed, with its interval.

    Args:
        gap: of diagnosis.json, with a share.

    Returns:
        The share in percent.

    """
    spread = ""
    if gap["interval"]:
        low, high = gap["interval"]
        spread = f" [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{100 * gap['shrink']:.0f} %{spread}"


def find_effect_credit(content: Mapping[str, Any]) -> float | None:
    """Find the share of the closed gap that is the named effects' own, the rest being that of refitted numbers.

    Args:
        content: of diagnosis.json.

    Returns:
        The share, between 0 and 1; None where it is not known, or nothing is closed.

    """
    shares = [entry["share"] for entry, _ in zip(content.get("where", ()), list_named_effects(content), strict=False)]
    if not shares or content["gap"]["shrink"] is None or content["gap"]["shrink"] <= 0 or None in shares:
        return None
    return float(min(max(sum(shares), 0.0), 1.0))


def format_multiple(multiples: float) -> str:
    """Format a multiple of the noise with three digits.

    Args:
        multiples: The number.

    Returns:
        The text.

    """
    return format_number(float(f"{multiples:.3g}"), 3)
