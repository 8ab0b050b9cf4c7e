"""Robot arms with harmonic drives: compiled models to simulate, control and replay."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names
from hdagen.support.version import __version__ as __version__

if sys.platform == "win32":
    raise ImportError("hdagen does not run on Windows; use Linux, there or in the Windows Subsystem for Linux.")

if TYPE_CHECKING:
    from hdagen.arm.arm_parameters import Parameter
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import Arm, load
    from hdagen.arm.compiled_model import StepJacobians
    from hdagen.control.guard_limits import Guard, Safe
    from hdagen.control.guarded_controller import Controller, Fault
    from hdagen.control.reference_motion import Reference, circle
    from hdagen.log.data_table import LogError
    from hdagen.log.measured_log import Log
    from hdagen.mpc.predictive_controller import MPC
    from hdagen.simulation.simulated_sensors import Sensors
    from hdagen.simulation.simulator import Push, Simulation, simulate

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
_HOMES = {
    "control.guard_limits": ("Guard", "Safe"),
    "control.guarded_controller": ("Controller", "Fault"),
    "log.data_table": ("LogError",),
    "log.measured_log": ("Log",),
    "mpc.predictive_controller": ("MPC",),
    "arm.arm_parameters": ("Parameter",),
    "arm.build_loader": ("PlantError",),
    "arm.compiled_arm": ("Arm", "StepJacobians", "load"),
    "control.reference_motion": ("Reference", "circle"),
    "simulation.simulator": ("Push", "Sensors", "Simulation", "simulate"),
}
__getattr__, __dir__ = lazy_names(__name__, _HOMES)
