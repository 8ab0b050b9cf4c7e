"""An axis: from values to pixels, and where its ticks stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hdagen.pages.decimation import Array
from hdagen.pages.quantity import SUPERSCRIPTS, Quantity, format_fixed, scale_quantity

TICK_SLACK = 0.01  # of a step: a record of 9.999 s still ends at a tick of 10 s


@dataclass(frozen=True)
class Axis:
    """``low`` < ``high`` in base units; both positive where ``log``."""

    low: float
    high: float
    quantity: Quantity
    log: bool = False

    def to_pixels(self, values: Array, pixels: float) -> Array:
        """Turn values into distances from the low end of the axis.

        Args:
            values: Values in base units; NaN stays NaN.
            pixels: Length of the axis, px.

        Returns:
            Distances, px, of the same shape.

        """
        if not self.log:
            return (values - self.low) / (self.high - self.low) * pixels
        with np.errstate(invalid="ignore", divide="ignore"):
            logs = np.log(np.where(values > 0, values, np.nan))
        return (logs - math.log(self.low)) / (math.log(self.high) - math.log(self.low)) * pixels

    def ticks(self, count: int) -> list[tuple[float, str]]:
        """Choose round values for ticks.

        Args:
            count: About how many ticks there is room for.

        Returns:
            Each tick's value in base units, with its text.

        """
        if self.log and self.high / self.low >= 10:
            return _list_decade_ticks(self, count)
        return _list_step_ticks(self, count)

    def with_span(self, span: float) -> Axis:
        """Change the length of the axis and keep its middle.

        Args:
            span: Distance from low to high, base units.

        Returns:
            The changed axis.

        """
        middle = (self.low + self.high) / 2
        return replace(self, low=middle - span / 2, high=middle + span / 2)


def fit_axis(label: str, columns: Sequence[Array], *, log: bool = False, margin: float = 0.05) -> Axis:
    """Choose the axis that holds all finite values (all positive ones on a logarithmic axis).

    Args:
        label: "name (unit)" or "name", in base units.
        columns: Values in base units.
        log: Whether the axis is logarithmic.
        margin: Share of the span that is left free at each end.

    Returns:
        The axis; from 0 (logarithmic: 0.1) to 1 where there is no value.

    """
    values = np.concatenate([np.ravel(column) for column in columns] or [np.zeros(0)])
    values = values[np.isfinite(values) & ((values > 0) | (not log))]
    if values.size == 0 and log:
        return Axis(0.1, 1.0, scale_quantity(label, 1.0), log)
    if values.size == 0:
        return Axis(0.0, 1.0, scale_quantity(label, 1.0), log)
    low, high = float(values.min()), float(values.max())
    if log:
        spare = 2.0
        if high > low:
            spare = (high / low) ** margin
        return Axis(low / spare, high * spare, scale_quantity(label, 1.0), True)
    named = scale_quantity(label, max(abs(low), abs(high)))
    span = high - low
    if span <= 1e-9 * max(abs(low), abs(high)):  # constant: a picture of rounding errors would mislead
        half = max(abs(low), abs(high)) / 2 or 1.0
        return Axis(low - half, high + half, named)
    return Axis(low - margin * span, high + margin * span, named)


def _list_step_ticks(axis: Axis, count: int) -> list[tuple[float, str]]:
    """Multiples of 1, 2 or 5 times a power of ten, at least two of them."""
    factor = axis.quantity.factor
    low, high = axis.low * factor, axis.high * factor
    rough = (high - low) / max(count, 3)
    power = math.floor(math.log10(rough))
    step = max(step for step in (1, 2, 5, 10) if step * 10.0**power <= 1.5 * rough) * 10.0**power
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - TICK_SLACK), math.floor(high / step + TICK_SLACK)
    return [(at * step / factor, format_fixed(at * step, decimals)) for at in range(first, last + 1)]


def _list_decade_ticks(axis: Axis, count: int) -> list[tuple[float, str]]:
    """Powers of ten; with 2 and 5 between them where there is room, and with some left out where there is not."""
    first, last = math.ceil(math.log10(axis.low) - 1e-9), math.floor(math.log10(axis.high) + 1e-9)
    decades = last - first + 1
    if 3 * decades <= count:
        values = [(m, p) for p in range(first - 1, last + 1) for m in (1, 2, 5) if axis.low <= m * 10.0**p <= axis.high]
    else:
        values = [(1, power) for power in range(first, last + 1, max(1, math.ceil(decades / max(count, 1))))]
    plain = first >= -3 and last <= 4
    return [(m * 10.0**p, _format_power(m, p, plain)) for m, p in values]


def _format_power(mantissa: int, power: int, plain: bool) -> str:
    if plain or power == 0:
        return format_fixed(mantissa * 10.0**power, max(0, -power))
    raised = f"10{str(power).translate(SUPERSCRIPTS)}"
    if mantissa == 1:
        return raised
    return f"{mantissa}·{raised}"
