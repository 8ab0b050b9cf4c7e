"""The compiled arm: found or built, checked, loaded, and called from numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names

if TYPE_CHECKING:
    from hdagen.arm.arm_parameters import Parameter
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import Arm, load
    from hdagen.arm.compiled_model import StepJacobians

__all__ = ["Arm", "Parameter", "PlantError", "StepJacobians", "load"]
__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "arm_parameters": ("Parameter",),
        "build_loader": ("PlantError",),
        "compiled_arm": ("Arm", "load"),
        "compiled_model": ("StepJacobians",),
    },
)
