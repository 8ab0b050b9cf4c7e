"""Files of a controller, as text: sizes, the stage over vectors of nodes, the fixed C beside them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import resources
from typing import Any

import casadi as ca

from gen.c_code.emitter import body, scalar_function, vector_operation
from gen.c_code.headers import guarded, slide_velocities
from gen.c_code.vectorized_dynamics import BATCH, fast
from gen.model.emitted_function import dense
from gen.model.function_library import Library
from gen.mpc.horizon_stage import SPEED, Stage, stage
from gen.mpc.osqp_code import osqp_files
from gen.mpc.problem_structure import Structure

TEMPLATES = resources.files("gen") / "templates" / "mpc"
LANE = {"x", "T", "F"}  # arguments that differ from node to node


def files(library: Library, structure: Structure, native: bool) -> tuple[dict[str, str], dict[str, Any]]:
    """Write the files of a predictive controller.

    Args:
        library: The library.
        structure: The controller's structure.
        native: Whether divisions may become products with reciprocals.

    Returns:
        The text of each file by its name, and the controller's part of the manifest.

    """
    model = library.graphs.model
    fixed = ca.vertcat(model.p, *model.inverse.values())
    made = stage(model, structure, fixed)
    out = {f.name: f.read_text(encoding="utf-8") for f in TEMPLATES.iterdir() if f.name.endswith((".c", ".h"))}
    out["hda_mpc_sizes.h"] = sizes(made)
    out["hda_mpc_stage.h"] = functions(made, native)
    out["hda_mpc_jacobian.h"] = jacobians(library)
    out |= osqp_files(made, simples(made))
    return out, described(made)


def simples(made: Stage) -> list[int]:
    """Entries of the horizon's state with limits of their own: joint positions, then the motors' speeds."""
    names = [made.model.x_slots[k].name for k in made.index]
    positions = [f"joint_position_{j}" for j in made.model.joints]
    return [names.index(name) for name in (*positions, *slide_velocities(made.model))]


def described(made: Stage) -> dict[str, Any]:
    """The controller's part of the manifest."""
    names = [slot.name for slot in made.model.x_slots]
    n, simple = made.model.n, simples(made)
    of = [names[made.index[k]] for k in simple]
    torques = [f"joint_torque_{j}" for j in made.model.flexible]
    walls = [f"wall_{k + 1}" for k in range(made.structure.walls)]
    rows = [f"{what}_{j}" for what in ("motor_torque", "torque_rate") for j in range(1, n + 1)]
    return {
        "nodes": made.structure.nodes,
        "walls": made.structure.walls,
        "space": made.structure.space,
        "state": [names[k] for k in made.index],
        "scale": made.scale,
        "torque": made.torque,
        "rows": [*rows, *of, *torques, "tip_speed", *walls],
        "speed": SPEED,
        "outputs": made.ny,
        "simple": simple,
        "shared": made.places["end"],
        "statuses": statuses(),
    }


def jacobians(library: Library) -> str:
    """hda_mpc_jacobian.h: the derivatives that the estimator needs, and the gears' constants."""
    model, c = library.graphs.model, library.graphs.c
    whole = next(f.graph for f in library.functions if f.name == "rhs_jacobian")
    by_x, by_u, _ = whole(model.x, model.u, c)
    step = dense("mpc_jacobian", {"x": model.x, "u": model.u, "c": c}, {"by_x": by_x, "by_u": by_u})
    names = [f"torque_constant_{j}" for j in model.joints]
    constants = ca.vertcat(*(model.by_name.get(name, 1.0) for name in names))
    ratios = ca.vertcat(*(model.of_joint(j)["ratio"] for j in model.joints))
    damping = ca.vertcat(*(model.of_joint(j).get("torsional_damping", 0.0) for j in model.joints))
    gear = dense("mpc_gear", {"c": c}, {"ratio": ratios, "damping": damping})
    torque = dense("mpc_torque_constants", {"c": c}, {"constant": constants})
    parts = []
    for f in (step, gear, torque):
        arguments = [f"const double *{f.name_in(k)}" for k in range(f.n_in())]
        arguments += [f"double *{f.name_out(k)}" for k in range(f.n_out())]
        parts.append(scalar_function(f, "", f"static void {f.name()}({', '.join(arguments)})"))
    return guarded(
        "HDA_MPC_JACOBIAN_H", "What the estimator takes from the model.", "#include <math.h>\n\n" + "\n".join(parts)
    )


def statuses() -> list[tuple[int, str]]:
    """Codes and sentences of hda_mpc.h; an entry may go on in the next line."""
    text = (TEMPLATES / "hda_mpc.h").read_text(encoding="utf-8").replace("\\\n", " ")
    return [(int(code), words) for code, words in re.findall(r'HDA_STATUS\(\w+, (-?\d+),\s*"([^"]*)"\)', text)]


def _list(values: Iterable[Any]) -> str:
    return "{" + ", ".join(map(repr, values)) + "}"


def sizes(made: Stage) -> str:
    """hda_mpc_sizes.h."""
    held = made.memory or (0,)
    names = [slot.name for slot in made.model.x_slots]
    defines: dict[str, Any] = {
        "NODES": made.structure.nodes, "NX": made.nx, "NY": made.ny, "NG": made.ng, "SIMPLES": 2 * made.model.n,
        "NX_WIDE": _power(made.nx), "N_WIDE": _power(max(2, made.model.n)),
        "WALLS": made.structure.walls, "FLEXIBLE": len(made.model.flexible),
        "TURNING": int(all(joint.kind == "revolute" for joint in made.model.robot.joints)),
        "JOINT_SPACE": int(made.structure.space == "joint"),
        "SIMPLE": _list(simples(made)), "INDEX": _list(made.index), "SCALE": _list(made.scale),
        "TORQUE": _list(made.torque), "MEMORIES": len(made.memory), "MEMORY": _list(held),
        "SPEED": SPEED, "CONSTANTS": made.places["disturbance"], "AT_DISTURBANCE": made.places["disturbance"],
        "AT_SMOOTHING": made.places["smoothing"], "AT_HELD": made.places["held"], "AT_WALLS": made.places["walls"],
        "SHARED": made.places["end"],
        "FLEXIBLE_JOINTS": _list([j - 1 for j in made.model.flexible] or [0]),
        "IS_FLEXIBLE": _list([int(j in made.model.flexible) for j in made.model.joints]),
        "PLACES": _list(_motors(made, "position")),
        "MOTORS": _list(map(made.index.index, _motors(made, "position"))),
        "SPEEDS": _list(_motors(made, "velocity")),
        "LINKS": _list([names.index(f"joint_position_{j}") for j in made.model.joints]),
        "TURNS": _list([names.index(f"joint_velocity_{j}") for j in made.model.joints]),
    }  # fmt: skip
    lines = "".join(f"#define HDA_MPC_{name} {value}\n" for name, value in defines.items())
    meaning = (
        "Sizes of this controller; entries of x that its state is made of (INDEX), that its effects remember "
        "(MEMORY),\n"
        " * SI of 1 in its units (SCALE, TORQUE); where each motor's position stands in its state (MOTOR)."
    )
    return guarded("HDA_MPC_SIZES_H", meaning, f'#include "hda_sizes.h"\n\n{lines}')


def _power(count: int) -> int:
    """The least power of two that is not smaller."""
    return 1 << (count - 1).bit_length()


def _motors(made: Stage, quantity: str) -> list[int]:
    """The entries of x that hold each motor's position or velocity, or the joint's where the drive is rigid."""
    names = [slot.name for slot in made.model.x_slots]
    return [names.index(name.replace("velocity", quantity)) for name in slide_velocities(made.model)]


def functions(made: Stage, native: bool) -> str:
    """hda_mpc_stage.h: the stage over vectors of nodes, and its constants."""
    operation = vector_operation("hda_batch")
    if native:
        operation = fast(operation, "hda_batch")
    parts = [BATCH]
    for f in (made.rate, made.look):
        lines = body(f, _read(f), lambda k, i, f=f: f"{f.name_out(k)}[{i}]", operation, "hda_batch")  # type: ignore[misc]
        names = [f.name_in(k) for k in range(f.n_in())]
        types = dict.fromkeys(names, "double") | dict.fromkeys(LANE, "hda_batch")
        ins = [f"const {types[name]} *{name}" for name in names]
        outs = [f"hda_batch *{f.name_out(k)}" for k in range(f.n_out())]
        head = f"static void stage_{f.name()}({', '.join(ins + outs)})"
        unused = "".join(f"    (void){name};\n" for name in names)
        parts.append(f"{head} {{\n{unused}" + "".join(f"    {line}\n" for line in lines) + "}\n\n")
    head = "static void stage_constants(const double *c, double *k)"
    parts.append(scalar_function(made.constants, "", head))
    return guarded(
        "HDA_MPC_STAGE_H", "One node of the horizon, over vectors of nodes.", "#include <math.h>\n\n" + "".join(parts)
    )


def _read(f: ca.Function) -> Any:
    def read(argument: int, entry: int) -> str:
        name = f.name_in(argument)
        if name in LANE:
            return f"{name}[{entry}]"
        return f"{name}[{entry}] - (hda_batch){{0}}"

    return read
