"""Robot arms with harmonic drives: compiled models to simulate, control and replay."""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

if sys.platform == "win32":
    raise ImportError("hdagen does not run on Windows; use Linux, there or in the Windows Subsystem for Linux.")

if TYPE_CHECKING:
    from hdagen.control import Controller, Fault, Guard, Safe
    from hdagen.log import Log, LogError
    from hdagen.mpc.controller import MPC
    from hdagen.plant import Arm, Parameter, PlantError, StepJacobians, load
    from hdagen.reference import Reference, circle
    from hdagen.simulation import Push, Sensors, Simulation, simulate

__all__ = [
    "MPC",
    "Arm",
    "Controller",
    "Fault",
    "Guard",
    "Log",
    "LogError",
    "Parameter",
    "PlantError",
    "Push",
    "Reference",
    "Safe",
    "Sensors",
    "Simulation",
    "StepJacobians",
    "circle",
    "load",
    "simulate",
]
__version__ = "0.1.0"
_HOMES = {
    "control": ("Controller", "Fault", "Guard", "Safe"),
    "log": ("Log", "LogError"),
    "mpc.controller": ("MPC",),
    "plant": ("Arm", "Parameter", "PlantError", "StepJacobians", "load"),
    "reference": ("Reference", "circle"),
    "simulation": ("Push", "Sensors", "Simulation", "simulate"),
}


def __getattr__(name: str) -> Any:
    """A public name, imported when it is first asked for: a command that is interrupted or asked for help, or that
    finds no memory, has not yet loaded numpy."""
    for home, names in _HOMES.items():
        if name in names:
            value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
