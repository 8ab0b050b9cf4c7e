"""Files of a controller, as text: sizes, the stage over vectors of nodes, the fixed C beside them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import resources
from typing import Any

import casadi as ca

from gen.c_code.emitter import emit_body, scalar_function, vector_operation
from gen.c_code.headers import add_include_guard, slide_velocities
from gen.c_code.vectorized_dynamics import BATCH_PREAMBLE, use_reciprocals
from gen.model.emitted_function import make_dense_function
from gen.model.function_library import Library
from gen.mpc.horizon_stage import VELOCITY_UNIT, Stage, make_stage
from gen.mpc.osqp_code import osqp_files
from gen.mpc.problem_structure import Structure

MPC_TEMPLATES = resources.files("gen") / "templates" / "mpc"
NODE_ARGUMENTS = {"x", "T", "F"}  # arguments that differ from node to node


def make_mpc_files(library: Library, structure: Structure, native: bool) -> tuple[dict[str, str], dict[str, Any]]:
    """Write the files of a predictive controller.

    Args:
        library: The library.
        structure: The controller's structure.
        native: Whether divisions may become products with reciprocals.

    Returns:
        The text of each file by its name, and the controller's part of the manifest.

    """
    model = library.graphs.model
    fixed = ca.vertcat(model.p, *model.inverse_symbols.values())
    made = make_stage(model, structure, fixed)
    out = {f.name: f.read_text(encoding="utf-8") for f in MPC_TEMPLATES.iterdir() if f.name.endswith((".c", ".h"))}
    out["hda_mpc_sizes.h"] = emit_mpc_sizes(made)
    out["hda_mpc_stage.h"] = emit_stage(made, native)
    out["hda_mpc_jacobian.h"] = emit_jacobians(library)
    out["hda_mpc_axes.h"] = emit_axes(made, library.graphs.c)
    out |= osqp_files(made, find_simple_entries(made))
    return out, describe_controller(made)


def find_simple_entries(made: Stage) -> list[int]:
    """Entries of the horizon's state with limits of their own: joint positions, then the motors' speeds."""
    names = [made.model.x_slots[k].name for k in made.horizon_entries]
    positions = [f"joint_position_{j}" for j in made.model.joints]
    return [names.index(name) for name in (*positions, *slide_velocities(made.model))]


def describe_controller(made: Stage) -> dict[str, Any]:
    """The controller's part of the manifest."""
    names = [slot.name for slot in made.model.x_slots]
    n, simple = made.model.n, find_simple_entries(made)
    of = [names[made.horizon_entries[k]] for k in simple]
    torques = [f"joint_torque_{j}" for j in made.model.flexible]
    walls = [f"wall_{k + 1}" for k in range(made.structure.walls)]
    rows = [f"{what}_{j}" for what in ("motor_torque", "torque_rate") for j in range(1, n + 1)]
    return {
        "nodes": made.structure.nodes,
        "walls": made.structure.walls,
        "space": made.structure.space,
        "state": [names[k] for k in made.horizon_entries],
        "scale": made.state_units,
        "torque": made.torque_units,
        "rows": [*rows, *of, *torques, "tip_speed", *walls],
        "speed": VELOCITY_UNIT,
        "axes": made.axes.count,
        "orientation": made.axes.orientation_size,
        "outputs": made.ny,
        "simple": simple,
        "shared": made.shared_offsets["end"],
        "statuses": read_statuses(),
    }


def emit_axes(made: Stage, c: Any) -> str:
    """hda_mpc_axes.h: the target's axes."""
    parts = [_print_static(f) for f in made.axes.list_functions(c)]
    return add_include_guard("HDA_MPC_AXES_H", "The axes of the target.", "#include <math.h>\n\n" + "\n".join(parts))


def _print_static(f: ca.Function) -> str:
    """A function over doubles for one file."""
    arguments = [f"const double *{f.name_in(k)}" for k in range(f.n_in())]
    arguments += [f"double *{f.name_out(k)}" for k in range(f.n_out())]
    return scalar_function(f, "", f"static void {f.name()}({', '.join(arguments)})")


def emit_jacobians(library: Library) -> str:
    """hda_mpc_jacobian.h: the derivatives that the estimator needs, and the gears' constants."""
    model, c = library.graphs.model, library.graphs.c
    whole = next(f.graph for f in library.functions if f.name == "rhs_jacobian")
    by_x, by_u, _ = whole(model.x, model.u, c)
    step = make_dense_function("mpc_jacobian", {"x": model.x, "u": model.u, "c": c}, {"by_x": by_x, "by_u": by_u})
    names = [f"torque_constant_{j}" for j in model.joints]
    constants = ca.vertcat(*(model.by_name.get(name, 1.0) for name in names))
    ratios = ca.vertcat(*(model.joint_parameters(j)["ratio"] for j in model.joints))
    damping = ca.vertcat(*(model.joint_parameters(j).get("torsional_damping", 0.0) for j in model.joints))
    gear = make_dense_function("mpc_gear", {"c": c}, {"ratio": ratios, "damping": damping})
    torque = make_dense_function("mpc_torque_constants", {"c": c}, {"constant": constants})
    parts = [_print_static(f) for f in (step, gear, torque)]
    return add_include_guard(
        "HDA_MPC_JACOBIAN_H", "What the estimator takes from the model.", "#include <math.h>\n\n" + "\n".join(parts)
    )


def read_statuses() -> list[tuple[int, str]]:
    """Codes and sentences of hda_mpc.h; an entry may go on in the next line."""
    text = (MPC_TEMPLATES / "hda_mpc.h").read_text(encoding="utf-8").replace("\\\n", " ")
    return [(int(code), words) for code, words in re.findall(r'HDA_STATUS\(\w+, (-?\d+),\s*"([^"]*)"\)', text)]


def _c_list(values: Iterable[Any]) -> str:
    return "{" + ", ".join(map(repr, values)) + "}"


def emit_mpc_sizes(made: Stage) -> str:
    """hda_mpc_sizes.h."""
    held = made.held_entries or (0,)
    names = [slot.name for slot in made.model.x_slots]
    defines: dict[str, Any] = {
        "NODES": made.structure.nodes, "NX": made.nx, "NY": made.ny, "NG": made.ng, "SIMPLES": 2 * made.model.n,
        "NX_WIDE": _next_power_of_two(made.nx), "N_WIDE": _next_power_of_two(max(2, made.model.n)),
        "WALLS": made.structure.walls, "FLEXIBLE": len(made.model.flexible),
        "TURNING": int(all(joint.kind == "revolute" for joint in made.model.robot.joints)),
        "JOINT_SPACE": int(made.structure.space == "joint"), "AXES_COUNT": made.axes.count,
        "POSITIONS": made.axes.positions, "ORIENTATION": made.axes.orientation_size,
        "SIMPLE": _c_list(find_simple_entries(made)),
        "INDEX": _c_list(made.horizon_entries), "SCALE": _c_list(made.state_units),
        "TORQUE": _c_list(made.torque_units), "MEMORIES": len(made.held_entries), "MEMORY": _c_list(held),
        "SPEED": VELOCITY_UNIT, "CONSTANTS": made.shared_offsets["disturbance"],
        "AT_DISTURBANCE": made.shared_offsets["disturbance"],
        "AT_SMOOTHING": made.shared_offsets["smoothing"], "AT_HELD": made.shared_offsets["held"],
        "AT_WALLS": made.shared_offsets["walls"],
        "SHARED": made.shared_offsets["end"],
        "FLEXIBLE_JOINTS": _c_list([j - 1 for j in made.model.flexible] or [0]),
        "IS_FLEXIBLE": _c_list([int(j in made.model.flexible) for j in made.model.joints]),
        "PLACES": _c_list(_slide_entries(made, "position")),
        "MOTORS": _c_list(map(made.horizon_entries.index, _slide_entries(made, "position"))),
        "SPEEDS": _c_list(_slide_entries(made, "velocity")),
        "LINKS": _c_list([names.index(f"joint_position_{j}") for j in made.model.joints]),
        "TURNS": _c_list([names.index(f"joint_velocity_{j}") for j in made.model.joints]),
    }  # fmt: skip
    lines = "".join(f"#define HDA_MPC_{name} {value}\n" for name, value in defines.items())
    meaning = (
        "Sizes of this controller; entries of x that its state is made of (INDEX), that its effects remember "
        "(MEMORY),\n"
        " * SI of 1 in its units (SCALE, TORQUE); where each motor's position stands in its state (MOTOR)."
    )
    return add_include_guard("HDA_MPC_SIZES_H", meaning, f'#include "hda_sizes.h"\n\n{lines}')


def _next_power_of_two(count: int) -> int:
    """The least power of two that is not smaller."""
    return 1 << (count - 1).bit_length()


def _slide_entries(made: Stage, quantity: str) -> list[int]:
    """The entries of x that hold each motor's position or velocity, or the joint's where the drive is rigid."""
    names = [slot.name for slot in made.model.x_slots]
    return [names.index(name.replace("velocity", quantity)) for name in slide_velocities(made.model)]


def emit_stage(made: Stage, native: bool) -> str:
    """hda_mpc_stage.h: the stage over vectors of nodes, and its constants."""
    operation = vector_operation("hda_batch")
    if native:
        operation = use_reciprocals(operation, "hda_batch")
    parts = [BATCH_PREAMBLE]
    for f in (made.rate, made.output_graph):
        lines = emit_body(f, _read_argument(f), lambda k, i, f=f: f"{f.name_out(k)}[{i}]", operation, "hda_batch")  # type: ignore[misc]
        names = [f.name_in(k) for k in range(f.n_in())]
        types = dict.fromkeys(names, "double") | dict.fromkeys(NODE_ARGUMENTS, "hda_batch")
        ins = [f"const {types[name]} *{name}" for name in names]
        outs = [f"hda_batch *{f.name_out(k)}" for k in range(f.n_out())]
        head = f"static void stage_{f.name()}({', '.join(ins + outs)})"
        unused = "".join(f"    (void){name};\n" for name in names)
        parts.append(f"{head} {{\n{unused}" + "".join(f"    {line}\n" for line in lines) + "}\n\n")
    head = "static void stage_constants(const double *c, double *k)"
    parts.append(scalar_function(made.constants, "", head))
    return add_include_guard(
        "HDA_MPC_STAGE_H", "One node of the horizon, over vectors of nodes.", "#include <math.h>\n\n" + "".join(parts)
    )


def _read_argument(f: ca.Function) -> Any:
    def read(argument: int, entry: int) -> str:
        name = f.name_in(argument)
        if name in NODE_ARGUMENTS:
            return f"{name}[{entry}]"
        return f"{name}[{entry}] - (hda_batch){{0}}"

    return read
