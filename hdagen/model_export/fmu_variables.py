"""The variables of an FMU in the order of its numbers (`hda_fmi.h`), and the header with their values."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.compiled_arm import Arm

FIXED_PARAMETERS = (  # geometry, and what belongs to the integration: everything else may change in a run
    *("length", "ratio", "law_torque"),
    *("friction_smoothing", "memory_step"),
)
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class FmuVariable:
    """A variable, a Float64 each.

    Attributes:
        reference: Its number.
        name: Its name.
        causality: "independent", "input", "parameter" or "output".
        variability: "continuous", "tunable" or "fixed".
        unit: Its unit; "" where it has none.
        description: A phrase on it.
        start: Its value at the start; None where the FMU calculates it.
        low: The smallest value; None where there is no bound.
        high: The largest value.

    """

    reference: int
    name: str
    causality: str
    variability: str
    unit: str
    description: str
    start: float | None = None
    low: float | None = None
    high: float | None = None


def list_variables(arm: Arm) -> list[FmuVariable]:
    """List the variables of an arm's FMU.

    Args:
        arm: The arm; its present parameters are the start values.

    Returns:
        The variables, by number.

    """
    rows = [
        ("time", "independent", "continuous", "s", "time", None, None, None),
        *_describe_inputs(arm),
        *_describe_parameters(arm),
        *_describe_outputs(arm),
    ]
    return [FmuVariable(number, *row) for number, row in enumerate(rows)]


Row = tuple[str, str, str, str, str, float | None, float | None, float | None]


def _describe_inputs(arm: Arm) -> Iterator[Row]:
    for k, slot in enumerate(arm.manifest["input"]):
        name, meaning = slot["name"], "force of the surroundings on the tip, base frame"
        if name.startswith("tip_moment"):
            meaning = "moment of the surroundings on the tip, base frame"
        if k < arm.n:
            kind, _, joint = name.rpartition("_")
            name, meaning = f"{kind}_command_{joint}", f"command of joint {joint}, held over a communication step"
        yield name, "input", "continuous", slot["unit"], meaning, 0.0, None, None


def _describe_parameters(arm: Arm) -> Iterator[Row]:
    for name, q in arm.parameters.described.items():
        variability = "tunable"
        if _is_fixed(name):
            variability = "fixed"
        yield name, "parameter", variability, q.unit, q.meaning, arm.parameters[name], q.low, q.high
    for j, joint in enumerate(arm.robot["joints"], 1):
        meaning = "joint position at which the arm begins at rest"
        unit = _name_position_unit(joint)
        yield f"joint_position_start_{j}", "parameter", "fixed", unit, meaning, 0.0, None, None
    meaning = "longest step of the integration; smaller where tuned parameters make the arm stiffer"
    yield "longest_step", "parameter", "tunable", "s", meaning, arm.stable_step, None, None


def _describe_outputs(arm: Arm) -> Iterator[Row]:
    def row(name: str, unit: str, meaning: str) -> Row:
        return name, "output", "continuous", unit, meaning, None, None, None

    for slot in arm.manifest["input"][: arm.n]:
        yield row(slot["name"], slot["unit"], "motor input that acts, as its sensor reads it")
    meanings = {
        "motor_position": "reading of the motor's encoder, without noise",
        "motor_velocity": "rate of the motor's reading",
        "torsion": "torsion of the drive's springs",
        "beyond_law": "torsion beyond the spring law's range",
        "joint_torque": "reading of the joint's torque sensor",
        "joint_position": "reading of the joint's encoder, without noise",
        "joint_velocity": "rate of the joint's reading",
        "joint_angle": "joint position without errors of its sensor",
        "tip": "position of the tip, base frame",
        "tip_velocity": "velocity of the tip, base frame",
    }
    for output, length in _list_readings(arm):
        meaning = meanings.get(output, output.replace("_", " "))
        if output.startswith("tip"):
            unit = {"tip": "m", "tip_velocity": "m/s"}[output]
            yield from (row(f"{output}_{axis}", unit, meaning) for axis in AXES[:length])
            if length > len(AXES):  # in space a velocity goes on with the turning
                turning = "angular velocity of the tip, base frame"
                yield from (row(f"tip_angular_velocity_{axis}", "rad/s", turning) for axis in AXES)
        else:
            joints = enumerate(arm.robot["joints"], 1)
            yield from (row(f"{output}_{j}", _name_unit(output, joint), meaning) for j, joint in joints)


def _list_readings(arm: Arm) -> Sequence[tuple[str, int]]:
    """Names and lengths of the outputs of the compiled `outputs`, in its order."""
    return next(f["outputs"] for f in arm.manifest["functions"] if f["name"] == "outputs")


def _is_fixed(name: str) -> bool:
    return name in FIXED_PARAMETERS or name.rpartition("_")[0] in FIXED_PARAMETERS


def _name_position_unit(joint: dict[str, str]) -> str:
    return {"prismatic": "m", "revolute": "rad"}[joint["kind"]]


def _name_unit(output: str, joint: dict[str, str]) -> str:
    """The unit of a joint's output."""
    position = _name_position_unit(joint)
    if output.startswith("motor"):
        position = "rad"
    if output == "joint_torque":
        return {"m": "N", "rad": "N m"}[position]
    if output.endswith("velocity"):
        return f"{position}/s"
    return position


def write_table(arm: Arm, variables: Sequence[FmuVariable], token: str) -> str:
    """Write hda_fmi_table.h: the values with which an FMU starts, and where things stand in its vectors.

    Args:
        arm: The arm.
        variables: Its variables.
        token: The token by which its description and its library know each other.

    Returns:
        The C text.

    """
    parameters = variables[1 + arm.nu :][: len(arm.p)]
    readings, first, pointers = _list_readings(arm), 0, []
    torsion = 0
    for output, length in readings:
        if output == "torsion":
            torsion = first
        pointers.append(f"(y) + {first}")
        first += length
    names = list(arm.parameters)
    springs = [
        f"{{{j - 1}, {names.index(f'ratio_{j}')}, {arm.index(f'motor_position_{j}')}}}"
        for j in arm.manifest["flexible"]
    ]
    defines = {
        "TOKEN": json.dumps(token),
        "STEP": repr(float(arm.stable_step)),
        "PARAMETERS": _format_array(arm.p),
        "LOW": _format_array(q.low for q in parameters),
        "HIGH": _format_array(q.high for q in parameters),
        "FIXED": _format_array(int(q.variability == "fixed") for q in parameters),
        "POSITIONS": _format_array(np.zeros(arm.n)),
        "SPRINGS": f"{{{', '.join([*springs, '{-1, 0, 0}'])}}}",
        "TORSION": str(torsion),
        "READINGS": str(first),
        "OUTPUTS(y)": ", ".join(pointers),
    }
    lines = "".join(f"#define HDA_FMI_{name} {value}\n" for name, value in defines.items())
    return (
        "/* The values with which this unit starts, their bounds, and where things stand in its vectors. */\n"
        f"#ifndef HDA_FMI_TABLE_H\n#define HDA_FMI_TABLE_H\n\n{lines}\n#endif\n"
    )


def _format_array(values: Iterable[float | None]) -> str:
    return "{" + ", ".join(_format_number(value) for value in values) + "}"


def _format_number(value: float | None) -> str:
    if isinstance(value, int):
        return str(value)
    number = float(value)  # type: ignore[arg-type]
    if np.isinf(number):
        return "1e308" if number > 0 else "-1e308"
    return repr(number)
