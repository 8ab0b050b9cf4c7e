"""The report's section of measured and modelled signals: every channel over one time axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.report.effect_words import CHANNEL_UNITS, find_channel_unit, name_channel
from hdagen.diagnosis.report.residual_maps import REPLAY_COLORS
from hdagen.pages.page import Section
from hdagen.pages.time_chart import TimeChannel, draw_time_charts
from hdagen.prediction.window_replay import REPLAY_WINDOW, Replay

SIGNAL_LINES = {
    "measured": ("grey", False),
    "before": (REPLAY_COLORS["before"], True),
    "after": (REPLAY_COLORS["after"], False),
}


def show_signals(content: Mapping[str, Any], held: LogPortion, before: Replay, after: Replay) -> Section:
    """Show measured less modelled, or both, of every channel that the model can err in.

    Args:
        content: of diagnosis.json.
        held: the log, and its held-out rows (T,).
        before: the replay of the robot file's model.
        after: the replay with the verdict.

    Returns:
        The section of the report.

    """
    log, joints = held.log, content.get("joints", ())
    blocks, shaded = list[tuple[float, float]](), ""
    if not held.rows.all():
        blocks, shaded = list(held.spans), " Shaded: held out, all that the gap counts."
    names = [
        name
        for joint in range(1, log.n_joints + 1)
        for name in (f"{quantity}_{joint}" for quantity in CHANNEL_UNITS)
        if name in before.errors and name not in before.driving_channels
    ]
    channels = [
        TimeChannel(
            name_channel(name, joints),
            find_channel_unit(name, content["gap"]["by_channel"].get(name, {})),
            log[name],
            {"before": before.columns[name], "after": after.columns[name]},
        )
        for name in names
    ]
    caption = (
        f"Windows begin again every {REPLAY_WINDOW:g} s at the state that earlier measurements give; within a window "
        f"nothing measured counts. Drag to zoom, double click to go back.{shaded}"
    )
    return Section(
        "Measured against model",
        "",
        [draw_time_charts("All channels over time", log.time, channels, SIGNAL_LINES, bands=blocks, caption=caption)],
    )
