"""The fit without any effect, and the orders of a ripple that it leaves."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class NullModelSettings:
    """The fit without any effect, and the orders of a ripple that it leaves."""

    fit_steps: int = declare_setting(2, "steps", "steps of the fit: enough for its residual torque")
    largest_ripple_order: int = declare_setting(
        96, "cycles in a turn of the motor", "orders up to it are examined: cogging and commutation"
    )
    clear_order_gain: float = declare_setting(
        12.0, "times the median gain of all orders", "an order stands out from here"
    )
    most_ripple_orders: int = declare_setting(3, "orders", "orders that are tried: each is one candidate more")


NULL_MODEL = NullModelSettings()
