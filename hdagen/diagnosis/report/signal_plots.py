"""The report's section of measured and modelled signals, and of their differences, joint by joint."""

from __future__ import annotations

from hdagen.diagnosis.data.split import LogPortion
from hdagen.log.measured_log import Log
from hdagen.pages.curves import Panel, Series, draw_panels
from hdagen.pages.page import Section
from hdagen.prediction.window_replay import Replay

CHANNEL_UNITS = {"motor_position": "rad", "joint_position": "rad", "motor_current": "A", "motor_torque": "N m"}


def show_signals(held: LogPortion, before: Replay, after: Replay) -> Section:
    """Show measured and modelled signals, and measured less model; the figures zoom together.

    Args:
        held: the log, and its held-out rows (T,).
        before: the replay of the robot file's model.
        after: the replay with the verdict.

    Returns:
        The section of the report.

    """
    log = held.log
    blocks, shaded = list[tuple[float, float, str]](), ""
    if not held.rows.all():
        blocks = [(a, b, "") for a, b in held.spans]
        shaded = "Shaded: held out, all that the gap counts; the fit saw the rest."
    figures = []
    for j in range(1, log.n_joints + 1):
        names = [f"{quantity}_{j}" for quantity in CHANNEL_UNITS if f"{quantity}_{j}" in before.errors]
        for title, what, drawn in (
            ("measured and model", "", _plot_signals),
            ("measured less model", " error", _plot_errors),
        ):
            shown = [Panel(_label_axis(name, what), drawn(log, name, before, after)) for name in names]
            figures.append(
                draw_panels(f"Joint {j}: {title}", log.time, shown, bands=blocks, link="motion", caption=shaded)
            )
    return Section(
        "Measured against model",
        "Windows begin anew every 0.25 s at the state that earlier measurements give; within a window nothing measured "
        "counts. Drag to zoom, double click to go back.",
        figures,
    )


def _label_axis(name: str, what: str) -> str:
    """Label of an axis: the channel's quantity with its unit."""
    quantity = name.rpartition("_")[0]
    return f"{quantity.replace('_', ' ')}{what} ({CHANNEL_UNITS[quantity]})"


def _plot_signals(log: Log, name: str, before: Replay, after: Replay) -> list[Series]:
    """The measured channel, and that of both models."""
    return [
        Series("measured", log[name], color="grey", dash="solid", width=3.6),
        Series("model before", before.columns[name], color="orange", dash="dashed"),
        Series("model after", after.columns[name], color="blue", dash="dotted"),
    ]


def _plot_errors(log: Log, name: str, before: Replay, after: Replay) -> list[Series]:
    """The measured channel less that of each model."""
    return [
        Series("before", log[name] - before.columns[name], color="orange", dash="solid"),
        Series("after", log[name] - after.columns[name], color="blue", dash="solid"),
    ]
