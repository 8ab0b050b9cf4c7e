"""The swing and the press with which a verdict's change for a controller is shown."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class ControllerImpactSettings:
    """The swing and the press with which a verdict's change for a controller is shown."""

    safe_damping: float = declare_setting(0.02, "N m s/rad", "at each motor, once the guard has stopped the arm")
    full_torque_time: float = declare_setting(0.005, "s", "time in which a motor reaches its full torque")
    swing_quantiles: tuple[float, float] = declare_setting((0.2, 0.8), "of the log's angles", "ends of the swing")
    shortest_swing: float = declare_setting(1.0, "s", "shortest swing there and back")
    swing_count: int = declare_setting(2, "swings", "swings there and back")
    press_depth: float = declare_setting(0.01, "m", "depth of the reference behind the wall")
    wall_stiffness: float = declare_setting(1e4, "N/m", "steel table, rubber tip")
    rise_time: float = declare_setting(0.5, "s", "the way into the wall")
    hold_time: float = declare_setting(1.0, "s", "at its end")


CONTROLLER_IMPACT = ControllerImpactSettings()
