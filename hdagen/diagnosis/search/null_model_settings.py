"""The fit without any effect, and the orders of a ripple that it leaves."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import setting


@dataclass(frozen=True)
class NullModelSettings:
    """The fit without any effect, and the orders of a ripple that it leaves."""

    fit_steps: int = setting(2, "steps", "steps of the fit: enough for its residual torque")
    largest_ripple_order: int = setting(
        96, "cycles in a turn of the motor", "orders up to it are examined: cogging and commutation"
    )
    clear_order_gain: float = setting(12.0, "times the median gain of all orders", "an order stands out from here")
    most_ripple_orders: int = setting(3, "orders", "orders that are tried: each is one candidate more")


NULL_MODEL = NullModelSettings()
