"""Every file of a build, as text: generated C, the fixed C beside it, and the manifest."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

import casadi as ca

from gen.builder.effect_description import describe_catalogue
from gen.c_code import headers, vectorized_closed_loop, vectorized_dynamics
from gen.c_code.function_parts import emit_function, emit_preparation
from gen.effects.effect import Effect
from gen.effects.file_numbers import FILE_NUMBERS, FileNumber
from gen.model.arm_model import Model
from gen.model.control_loop import Law
from gen.model.emitted_function import EmittedFunction
from gen.model.function_library import Library
from gen.mpc.problem_structure import Structure
from gen.robot.description import describe_robot

INCLUDES = '#include "hda_model.h"\n\n#include <math.h>\n\n'
TEMPLATES = resources.files("gen") / "templates"


PARTS_IN_FILE = 1  # of long functions


def count_operations(f: ca.Function) -> int:
    """Arithmetic operations of a function, elementary functions counted as one each."""
    moves = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    return sum(f.instruction_id(k) not in moves for k in range(f.n_instructions()))


def make_manifest(made: Library, effects: tuple[Effect, ...], build: str, how: dict[str, Any]) -> dict[str, Any]:
    """Describe the library: order, names, units, bounds, citations, sizes, robot, compiler.

    Args:
        made: The library.
        effects: The effects in it.
        build: Hash of the build.
        how: The compiler's part of the manifest.

    Returns:
        The manifest, as JSON can hold it.

    """
    model = made.graphs.model
    return {
        "schema": 1,
        "interface": headers.INTERFACE,
        "build": build,
        "robot": describe_robot(model.robot),
        "effects": [_describe_effect(model, effect) for effect in effects],
        "numbers": [_describe_number(model, number) for number in FILE_NUMBERS],
        "catalogue": describe_catalogue(model.robot.in_space),
        "state": [vars(slot) for slot in model.x_slots],
        "input": [vars(slot) for slot in model.u_slots],
        "parameters": [vars(q) for q in model.quantities],
        "constants": int(made.graphs.c.numel()),
        "flexible": model.flexible,
        "stiff": model.needs_stiff_step,
        "spring_inverse": vars(model.plan),
        "functions": [_describe_function(function) for function in made.functions],
        "controllers": [_describe_law(law) for law in made.laws],
        **how,
    }


def _describe_effect(model: Model, effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "place": effect.port.place,
        "joints": model.joints_of_effect(effect),
        "amplitudes": [name for name in effect.amplitudes if _has_parameter(model, name)],
        "states": [state.name for state in effect.states],
        "shapes": [parameter.name for parameter in effect.parameters if parameter.name not in effect.amplitudes],
        "citation": effect.citation,
    }


def _describe_number(model: Model, number: FileNumber) -> dict[str, Any]:
    own = [q for q in model.quantities if q.effect == number.name]
    joints = [*dict.fromkeys(q.joint for q in own)]
    amplitudes = [*dict.fromkeys(q.name.removesuffix(f"_{q.joint}") for q in own)] or [number.name]
    return {
        "name": number.name,
        "place": number.place,
        "joints": joints,
        "amplitudes": amplitudes,
        "states": [],
        "shapes": [],
    }


def _describe_function(function: EmittedFunction) -> dict[str, Any]:
    return {
        "name": function.name,
        "meaning": function.meaning,
        "inputs": function.inputs,
        "outputs": function.outputs,
        "operations": count_operations(function.graph),
    }


def _describe_law(law: Law) -> dict[str, Any]:
    gains = [vars(gain) for gain in law.gains]
    return {"name": law.name, "gains": gains, "reference": law.reference, "state": law.state}


def _has_parameter(model: Model, key: str) -> bool:
    """Whether a joint, or the arm, has a parameter of that name."""
    return any(q.name in (key, f"{key}_{q.joint}") for q in model.quantities)


def _print_group(file: str, printed: list[tuple[str, list[str]]]) -> dict[str, str]:
    """A file of functions, and numbered ones beside it of the parts of long functions."""
    files = {file: INCLUDES + "\n".join(text for text, _ in printed)}
    parts = [part for _, own in printed for part in own]
    for k in range(0, len(parts), PARTS_IN_FILE):
        name = file.replace(".c", f"_{k // PARTS_IN_FILE + 1}.c")
        files[name] = INCLUDES + "\n".join(parts[k : k + PARTS_IN_FILE])
    return files


def make_files(
    made: Library,
    effects: tuple[Effect, ...],
    build: str,
    how: dict[str, Any],
    lanes: bool,
    mpc: Structure | None = None,
) -> dict[str, str]:
    """Write every file of a build.

    Args:
        made: The library.
        effects: The effects in it.
        build: Hash of the build.
        how: The compiler's part of the manifest.
        lanes: Whether right-hand sides and batches run in vector lanes.
        mpc: Structure of the predictive controller; None leaves it out.

    Returns:
        The text of each file by its name.

    """
    graphs, functions = made.graphs, made.functions
    scalar = list(functions)
    if lanes:
        in_lanes = {form.name for form in vectorized_dynamics.list_forms(graphs)}
        scalar = [f for f in functions if f.name not in in_lanes]
    files = {
        file.name: file.read_text(encoding="utf-8")
        for file in TEMPLATES.iterdir()
        if file.name.endswith((".c", ".h", ".txt"))
    }
    files["hda_model.h"] = headers.emit_interface(functions)
    files["hda_sizes.h"] = headers.emit_sizes(graphs.model, int(graphs.c.numel()), build, lanes)
    files["hda_table.h"] = headers.emit_call_table(functions, mpc is not None)
    if mpc is not None:
        from gen.mpc.controller_files import make_mpc_files as controller  # osqp, which other builds do not need

        added, described = controller(made, mpc, lanes)
        files |= added
        path = max(64, 2 * described["axes"] * (mpc.nodes + 1))
        files["hda_sizes.h"] = headers.emit_sizes(graphs.model, int(graphs.c.numel()), build, lanes, path)
        how = how | {"mpc": described}
    files["hda_laws.h"] = headers.emit_laws(made.laws)
    ticks = {f.name for law in made.laws for f in (law.start_function, law.tick_function)}
    groups = {  # a file each, so that two compilers share the work
        "hda_laws.c": [f for f in scalar if f.name in ticks],
        "hda_model.c": [f for f in scalar if f.name != "prepare" and f.name not in ticks],
    }
    files |= _print_group("hda_prepare.c", [emit_preparation(graphs.preparation)])
    for file, group in groups.items():
        files |= _print_group(file, [emit_function(f.graph, f.name) for f in group])
    if lanes:
        files["hda_native.c"] = vectorized_dynamics.emit_native(graphs)
        files["hda_batch_rhs.h"] = vectorized_dynamics.emit_batch(graphs)
        files["hda_loops_laws.h"] = vectorized_closed_loop.emit_loops(graphs, made.laws)
    files["manifest.json"] = json.dumps(make_manifest(made, effects, build, how), indent=1, sort_keys=True) + "\n"
    return files
