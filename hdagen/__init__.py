"""Robot arms with harmonic drives: compiled models to simulate, control and replay."""

from hdagen.log import Log, LogError
from hdagen.plant import Arm, Parameter, PlantError, StepJacobians, load

__all__ = ["Arm", "Log", "LogError", "Parameter", "PlantError", "StepJacobians", "load"]
__version__ = "0.1.0"
