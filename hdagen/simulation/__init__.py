"""Closed loops of a controller and the compiled arm: one with its log, or many at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.simulation.batch_closed_loop import closed_loops
    from hdagen.simulation.simulated_sensors import Sensors
    from hdagen.simulation.simulator import Push, Simulation, SpacePush, run, simulate

__all__ = ["Push", "Sensors", "Simulation", "SpacePush", "closed_loops", "run", "simulate"]
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "batch_closed_loop": ("closed_loops",),
        "simulated_sensors": ("Sensors",),
        "simulator": ("Push", "Simulation", "SpacePush", "run", "simulate"),
    },
)
