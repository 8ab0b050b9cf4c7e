"""C text of closed loops in lanes: sensors, controllers and right-hand side over vectors of trajectories, as a header
that `hda_loops.c` includes.

A lane is a trajectory with gains of its own; the model's constants c and the reference are shared. Expressions of a
controller's gains alone are taken out of its tick and computed once.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from gen.c_code.emitter import emit_body, scalar_function, vector_operation
from gen.c_code.vectorized_dynamics import use_reciprocals
from gen.model.control_loop import Law
from gen.model.right_hand_side import Graphs, hoist_constants

SX = ca.SX
VECTOR_TYPE = "hda_batch"
SHARED_ARGUMENTS = {"c", "reference"}  # plain doubles, the same in every lane
SENSED_OUTPUTS = ("motor_position", "joint_position", "tip")


@dataclass(frozen=True)
class SplitTick:
    """A controller's tick, apart from the expressions of its gains alone."""

    prepare: ca.Function  # gains -> k
    tick: ca.Function  # (measured, sent, reference, gains, k, c, state) -> (torque, next)


def split_tick(law: Law) -> SplitTick:
    """Take the expressions of the gains alone out of a law's tick."""
    f = law.tick_function.graph
    names = [f.name_in(i) for i in range(f.n_in())]
    ins = {name: SX.sym(name, f.numel_in(i)) for i, name in enumerate(names)}
    changed, symbols, definitions = hoist_constants(f.call(list(ins.values())), ins["gains"])
    k = SX(0, 1)
    if symbols:
        k = ca.vertcat(*symbols)
    prepare = ca.Function("prepare", [ins["gains"]], [ca.vertcat(*definitions)], ["gains"], ["k"], {"cse": True})
    given = {**{name: ins[name] for name in names if name not in ("c", "state")}, "k": k, "c": ins["c"]}
    given["state"] = ins["state"]
    tick = ca.Function("tick", list(given.values()), changed, list(given), ["torque", "next"], {"cse": True})
    return SplitTick(prepare, tick)


def emit_loops(graphs: Graphs, laws: tuple[Law, ...]) -> str:
    """Print hda_loops_laws.h: sensors, controllers and right-hand side over vectors of trajectories.

    Args:
        graphs: The model's graphs.
        laws: The controllers.

    Returns:
        The C text.

    """
    rhs = next(f for f in graphs.functions if f.name == "rhs").graph
    ticks = {law.name: split_tick(law) for law in laws}
    most = max([1, *(found.prepare.numel_out(0) for found in ticks.values())])
    parts = [
        '#include "hda_batch_rhs.h"\n',
        f"enum {{ LOOPS_PREPARED = {most} }};\n",
        _emit_over_lanes(rhs, "loops_rhs"),
        _emit_over_lanes(_sensor_graph(graphs), "loops_sensed"),
    ]
    for name, found in ticks.items():
        head = f"static void {name}_prepare(const double *gains, double *k)"
        parts += [scalar_function(found.prepare, "", head), _emit_over_lanes(found.tick, f"{name}_lanes")]
    rows = ", ".join(f"{{{name}_prepare, {found.prepare.numel_out(0)}, {name}_lanes}}" for name, found in ticks.items())
    arguments = "const hda_batch *, const hda_batch *, const double *, const hda_batch *, const hda_batch *, "
    parts.append(
        "static const struct {\n    void (*prepare)(const double *, double *);\n    int prepared;\n"
        f"    void (*tick)({arguments}const double *, const hda_batch *, hda_batch *, hda_batch *);\n"
        f"}} loops_laws[] = {{{rows}}};\n"
    )
    return "\n".join(parts)


def _sensor_graph(graphs: Graphs) -> ca.Function:
    """The readings of sensors without noise, and the tip."""
    f = next(f for f in graphs.functions if f.name == "outputs").graph
    ins = [SX.sym(f.name_in(i), f.numel_in(i)) for i in range(f.n_in())]
    found = dict(zip((f.name_out(i) for i in range(f.n_out())), f.call(ins), strict=True))
    names = [f.name_in(i) for i in range(f.n_in())]
    return ca.Function(
        "sensed", ins, [found[name] for name in SENSED_OUTPUTS], names, list(SENSED_OUTPUTS), {"cse": True}
    )


def _emit_over_lanes(f: ca.Function, name: str) -> str:
    """The function over vectors; shared arguments come as plain doubles."""
    names = [f.name_in(k) for k in range(f.n_in())]

    def read(argument: int, entry: int) -> str:
        source = f"{names[argument]}[{entry}]"
        if names[argument] in SHARED_ARGUMENTS:
            return f"{source} - ({VECTOR_TYPE}){{0}}"
        return source

    operation = use_reciprocals(vector_operation(VECTOR_TYPE), VECTOR_TYPE)
    lines = emit_body(f, read, lambda k, i: f"{f.name_out(k)}[{i}]", operation, VECTOR_TYPE)
    types = dict.fromkeys(names, VECTOR_TYPE) | dict.fromkeys(SHARED_ARGUMENTS, "double")
    ins = [f"const {types[name]} *{name}" for name in names]
    outs = [f"{VECTOR_TYPE} *{f.name_out(k)}" for k in range(f.n_out())]
    unused = "".join(f"    (void){argument};\n" for argument in names)
    text = "".join(f"    {line}\n" for line in lines)
    return f"static void {name}({', '.join(ins + outs)}) {{\n{unused}{text}}}\n"
