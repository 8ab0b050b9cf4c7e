"""Robot arms with harmonic drives: compiled models to simulate, control and replay."""

import sys

if sys.platform == "win32":
    raise ImportError("hdagen does not run on Windows; use Linux, there or in the Windows Subsystem for Linux.")

from hdagen.control import Controller, Fault, Guard, Safe
from hdagen.log import Log, LogError
from hdagen.mpc.controller import MPC
from hdagen.plant import Arm, Parameter, PlantError, StepJacobians, load
from hdagen.reference import Reference, circle
from hdagen.simulate import Push, Sensors, Simulation, simulate

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
