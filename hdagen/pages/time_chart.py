"""Channels of a log over one time axis with a common cursor: what was measured, and the errors of models of it.

uPlot draws them; its files stand in `uplot`, whole and unmodified. A page embeds them only where it has such a figure.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hdagen.pages import frame
from hdagen.pages.decimation import Array, as_samples, choose_rows, pack_floats
from hdagen.pages.markup import build_element
from hdagen.pages.palette import COLORS
from hdagen.pages.quantity import scale_quantity

FIGURE_KIND = "time"
FIGURE_MARK = f'data-kind="{FIGURE_KIND}"'
LIBRARY_SCRIPTS = ("uplot/uPlot.iife.min.js",)  # before the scripts of every page
LIBRARY_STYLES = ("uplot/uPlot.min.css",)
MOST_KEPT_ROWS = 6000  # of a channel that travel with a page: six samples in every pixel of a wide screen
MOST_STEPS = 65534  # of 16 bits, between the smallest and the largest value of a column; one more stands for a gap
STILL_WORDS = "These curves are drawn by the script of this page, which did not run here."


@dataclass(frozen=True)
class TimeChannel:
    """One channel: ``measured`` (T,) in ``unit``, and what each model says of it, by label (T,)."""

    name: str
    unit: str
    measured: ArrayLike
    models: Mapping[str, ArrayLike]


def draw_time_charts(
    title: str,
    time: ArrayLike,
    channels: Sequence[TimeChannel],
    colors: Mapping[str, tuple[str, bool]],
    *,
    bands: Sequence[tuple[float, float]] = (),
    caption: str = "",
) -> str:
    """Draw channels one below the other: measured less model, or measured and model where a button asks for that.

    Values travel in 16 bits: measured ones and errors each in a 65,000th of their own range.

    Args:
        title: Heading.
        time: Time of each sample, ascending, (T,) s.
        channels: The channels, with values at every sample.
        colors: By label of a model, and of "measured": a key of ``palette.COLORS``, and whether its line is dashed.
        bands: Stretches of time that are shaded, (start, end) in s.
        caption: Text below the charts.

    Returns:
        The ``build_figure`` element.

    Raises:
        ValueError: A channel does not have one value for every sample.

    """
    moments = as_samples(time)
    start = float(moments[0]) if moments.size else 0.0
    clocks, sent = dict[bytes, tuple[int, str]](), []
    kept = 0
    for channel in channels:
        described, rows = _describe_channel(title, channel, moments)
        at, _ = clocks.setdefault(rows.tobytes(), (len(clocks), pack_floats(moments[rows] - start)))
        sent.append({"clock": at, **described})
        kept = max(kept, rows.size)
    data = {
        "start": start,
        "clocks": [text for _, text in clocks.values()],
        "channels": sent,
        "bands": [[begin - start, end - start] for begin, end in bands],
        "lines": {label: [*COLORS[color], dashed] for label, (color, dashed) in colors.items()},
    }
    note = ""
    if kept < moments.size:
        note = f"{kept} of {moments.size} samples are kept, the smallest and the largest of every stretch among them."
    still = build_element("p", STILL_WORDS, class_="still")
    return frame.build_figure(FIGURE_KIND, title, still, caption=caption, note=note, data=data)


def _describe_channel(title: str, channel: TimeChannel, moments: Array) -> tuple[dict[str, object], np.ndarray]:
    """A channel as the script reads it, and the rows of it that travel with the page."""
    measured = _read_samples(title, channel, channel.measured, moments.size)
    errors = [measured - _read_samples(title, channel, values, moments.size) for values in channel.models.values()]
    rows = choose_rows(moments, [measured, *errors], MOST_KEPT_ROWS)
    described: dict[str, object] = {
        "name": channel.name,
        "measured": _describe_column(channel, measured, rows),
        "errors": [_describe_column(channel, values, rows, errors) for values in errors],
        "models": list(channel.models),
    }
    return described, rows


def _read_samples(title: str, channel: TimeChannel, values: ArrayLike, count: int) -> Array:
    samples = as_samples(values)
    if samples.size != count:
        raise ValueError(
            f"figure {title!r}, {channel.name!r}: {samples.size} values for {count} samples; give one each"
        )
    return samples


def _describe_column(
    channel: TimeChannel, values: Array, rows: np.ndarray, together: Sequence[Array] | None = None
) -> dict[str, object]:
    """A column as the script reads it; its unit has the prefix that suits the columns ``together`` with it."""
    shown = np.concatenate([column[np.isfinite(column)] for column in together or [values]])
    quantity = scale_quantity(f"x ({channel.unit})", float(np.abs(shown).max(initial=0.0)))
    return {"unit": quantity.unit, "factor": quantity.factor, "base": channel.unit} | pack_quantized(values[rows])


def pack_quantized(values: Array) -> dict[str, object]:
    """Pack numbers in 16 bits.

    Args:
        values: Numbers, (T,); NaN is a gap.

    Returns:
        ``low`` and ``step``, and the count of steps above ``low`` as little-endian integers in base64.

    """
    finite = values[np.isfinite(values)]
    low, step = 0.0, 0.0
    if finite.size:
        low = float(finite.min())
        step = (float(finite.max()) - low) / MOST_STEPS
    counts = np.zeros(values.size)
    if step > 0:
        counts = (values - low) / step
    steps = np.where(np.isfinite(values), counts.round(), MOST_STEPS + 1)
    return {"low": low, "step": step, "data": base64.b64encode(steps.astype("<u2").tobytes()).decode("ascii")}
