"""Robot arms with harmonic drives: compiled models to simulate, control, replay and diagnose."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from hdagen.support.lazy_names import lazy_names
from hdagen.support.version import __version__ as __version__

if sys.platform == "win32":
    raise ImportError("hdagen does not run on Windows; use Linux, there or in the Windows Subsystem for Linux.")

if TYPE_CHECKING:
    from hdagen.adoption.robot_update import AdoptedRobot
    from hdagen.api.diagnosis_pairs import compare
    from hdagen.api.log_check import LogCheck, check
    from hdagen.api.log_diagnosis import diagnose
    from hdagen.api.log_reading import read_log
    from hdagen.api.log_replay import replay
    from hdagen.api.motion_design import excite
    from hdagen.api.robot_adoption import adopt
    from hdagen.api.robot_export import export
    from hdagen.api.robot_loading import load_robot
    from hdagen.arm.arm_parameters import Parameter
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import Arm
    from hdagen.arm.compiled_model import StepJacobians
    from hdagen.comparison.diagnosis_comparison import DiagnosisComparison
    from hdagen.control.guard_limits import Guard, Safe
    from hdagen.control.guarded_controller import Controller, Fault
    from hdagen.control.reference_motion import Reference, circle
    from hdagen.diagnosis.diagnosis import Diagnosis
    from hdagen.diagnosis.report.diagnosis_summary import SavedDiagnosis, read_diagnosis
    from hdagen.diagnosis.stages.stage import Stage
    from hdagen.excitation.optimal_motion import Excitation
    from hdagen.log.column_map import ColumnsError
    from hdagen.log.data_table import LogError
    from hdagen.log.measured_log import Log
    from hdagen.mpc.predictive_controller import MPC
    from hdagen.pages.result_table import ResultTable
    from hdagen.prediction.window_replay import Replay
    from hdagen.simulation.simulated_sensors import Sensors
    from hdagen.simulation.simulator import Push, Simulation, simulate

__all__ = [
    "MPC",
    "AdoptedRobot",
    "Arm",
    "ColumnsError",
    "Controller",
    "Diagnosis",
    "DiagnosisComparison",
    "Excitation",
    "Fault",
    "Guard",
    "Log",
    "LogCheck",
    "LogError",
    "Parameter",
    "PlantError",
    "Push",
    "Reference",
    "Replay",
    "ResultTable",
    "Safe",
    "SavedDiagnosis",
    "Sensors",
    "Simulation",
    "Stage",
    "StepJacobians",
    "adopt",
    "check",
    "circle",
    "compare",
    "diagnose",
    "excite",
    "export",
    "load_robot",
    "read_diagnosis",
    "read_log",
    "replay",
    "simulate",
]
_HOMES = {
    "adoption.robot_update": ("AdoptedRobot",),
    "api.diagnosis_pairs": ("compare",),
    "api.log_check": ("LogCheck", "check"),
    "api.log_diagnosis": ("diagnose",),
    "api.log_reading": ("read_log",),
    "api.log_replay": ("replay",),
    "api.motion_design": ("excite",),
    "api.robot_adoption": ("adopt",),
    "api.robot_export": ("export",),
    "api.robot_loading": ("load_robot",),
    "arm.arm_parameters": ("Parameter",),
    "arm.build_loader": ("PlantError",),
    "arm.compiled_arm": ("Arm",),
    "arm.compiled_model": ("StepJacobians",),
    "comparison.diagnosis_comparison": ("DiagnosisComparison",),
    "control.guard_limits": ("Guard", "Safe"),
    "control.guarded_controller": ("Controller", "Fault"),
    "control.reference_motion": ("Reference", "circle"),
    "diagnosis.diagnosis": ("Diagnosis",),
    "diagnosis.report.diagnosis_summary": ("SavedDiagnosis", "read_diagnosis"),
    "diagnosis.stages.stage": ("Stage",),
    "excitation.optimal_motion": ("Excitation",),
    "log.column_map": ("ColumnsError",),
    "log.data_table": ("LogError",),
    "log.measured_log": ("Log",),
    "mpc.predictive_controller": ("MPC",),
    "pages.result_table": ("ResultTable",),
    "prediction.window_replay": ("Replay",),
    "simulation.simulated_sensors": ("Sensors",),
    "simulation.simulator": ("Push", "Simulation", "simulate"),
}
__getattr__, __dir__ = lazy_names(__name__, _HOMES)
