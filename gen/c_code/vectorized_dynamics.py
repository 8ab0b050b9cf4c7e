"""C text of the fast right-hand sides and steps, smooth and set-valued: drives in vector lanes, the chain in scalars;
and the batch over trajectories.

Not bit for bit the interpreter's: products and sums are contracted, divisions become products with reciprocals, sine,
cosine, exp, atan and tanh are polynomials. The tests hold it to 1e-12 of each column.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from gen.c_code import polynomial_packing, statement_order
from gen.c_code.emitter import Operation, c_signature, emit_body, scalar_operation, vector_operation
from gen.model.arm_model import Model
from gen.model.right_hand_side import Graphs, Lane

BATCH_PREAMBLE = """\
/* Width of a batch: 1, 2, 4 or 8 as the compiler is told, else the widest vector of the target; OF makes one
 * from f(0), f(1), and so on. */
#if defined(HDA_BATCH_WIDTH)
#elif defined(__AVX512F__)
#define HDA_BATCH_WIDTH 8
#elif defined(__AVX__)
#define HDA_BATCH_WIDTH 4
#else
#define HDA_BATCH_WIDTH 2
#endif
#if HDA_BATCH_WIDTH == 8
#define HDA_BATCH_OF(f) {f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)}
#elif HDA_BATCH_WIDTH == 4
#define HDA_BATCH_OF(f) {f(0), f(1), f(2), f(3)}
#elif HDA_BATCH_WIDTH == 2
#define HDA_BATCH_OF(f) {f(0), f(1)}
#else
#define HDA_BATCH_OF(f) {f(0)}
#endif
#define HDA_W HDA_BATCH_WIDTH
#define HDA_V hda_batch
#include "hda_vector.h"
#undef HDA_W
#undef HDA_V

"""
NATIVE_PREAMBLE = '#include "hda_model.h"\n#include "hda_sliding.h"\n\n#include <math.h>\n\n'
JOINTWISE_ARRAYS = {
    "input": "u",
    "direction": "sliding",
}  # input of a drive's graph -> array with an entry for each joint
INLINE_VOID = "static inline __attribute__((always_inline)) void"
STEP_TEMPLATE = """
/* RK4 over whole lanes. */
%(head)s {
    state x, y, slope;
    spread(from, &x);
    y = x;
    const state start = x;
    %(evaluate)s;
    along(&start, 0.5 * %(h)s, &slope, &y);
    along(&x, %(h)s / 6.0, &slope, &x);
    %(evaluate)s;
    along(&start, 0.5 * %(h)s, &slope, &y);
    along(&x, %(h)s / 3.0, &slope, &x);
    %(evaluate)s;
    along(&start, %(h)s, &slope, &y);
    along(&x, %(h)s / 3.0, &slope, &x);
    %(evaluate)s;
    along(&x, %(h)s / 6.0, &slope, &x);
    gather(&x, to);
}
"""
SMOOTH_STEP = STEP_TEMPLATE % {
    "head": "void hda_step(const double *from, const double *u, const double *c, const double *h, double *to)",
    "evaluate": "rhs(&y, u, c, &slope)",
    "h": "*h",
}
SLIDING_STEP = STEP_TEMPLATE % {
    "head": "void hda_step_sliding(const double *from, const double *u, const double *sliding, const double *c, "
    "double h, double *to)",
    "evaluate": "rhs_exact(&y, u, sliding, c, &slope)",
    "h": "h",
}


@dataclass(frozen=True)
class Form:
    """One of the model's functions (``name``) that `functions` defines."""

    name: str
    chain: ca.Function
    exact: bool  # set-valued friction: the drives read directions and hand over levels

    def drive_graph(self, lane: Lane) -> ca.Function:
        """Choose the graph of a lane's drives.

        Args:
            lane: The lane.

        Returns:
            The exact graph for set-valued friction, else the smooth one.

        """
        if self.exact:
            return lane.exact
        return lane.smooth

    @property
    def drive_suffix(self) -> str:
        """Suffix of the functions of its drives."""
        return "_exact" if self.exact else ""

    @property
    def argument_names(self) -> tuple[str, ...]:
        """Names of the arrays that its functions read besides the state."""
        if self.exact:
            return "u", "sliding", "c"
        return "u", "c"

    @property
    def c_arguments(self) -> str:
        """The same as arguments in C."""
        return ", ".join(f"const double *{name}" for name in self.argument_names)

    @property
    def returns_rate(self) -> bool:
        """Whether its result is a rate, which stays in lanes."""
        return self.chain.n_out() == 1


def list_forms(graphs: Graphs) -> tuple[Form, ...]:
    """List the functions of the model that are evaluated in lanes.

    Args:
        graphs: The model's graphs.

    Returns:
        Smooth rate, exact rate, and the torques that hold motors.

    """
    return (
        Form("rhs", graphs.chain, False),
        Form("rhs_exact", graphs.exact_chain, True),
        Form("holding", graphs.holding_chain, True),
    )


def emit_native(graphs: Graphs) -> str:
    """Print hda_native.c: `list_forms`, and the RK4 steps, with the state in vectors, joints side by side.

    Args:
        graphs: The model's graphs.

    Returns:
        The C text.

    """
    widths = {lane.width for lane in graphs.lanes}
    widths |= {polynomial_packing.packed_width(width) for width in widths}
    rows = "".join(f"    v{lane.width} lane_{k}[{len(lane.state_entries)}];\n" for k, lane in enumerate(graphs.lanes))
    if shared := _list_shared_entries(graphs):
        rows += f"    double shared[{len(shared)}];\n"
    smooth, exact, holding = list_forms(graphs)
    parts = [
        NATIVE_PREAMBLE,
        *map(_include_vector_type, sorted(widths)),
        f"/* x, or its rate: entries of the joints' drives side by side. */\ntypedef struct {{\n{rows}}} state;\n\n",
        _emit_spread_and_gather(graphs),
        _emit_along(graphs),
        *_emit_drives(graphs, smooth),
        *_emit_drives(graphs, exact),
    ]
    for form in (smooth, exact, holding):
        parts += [_emit_evaluation(graphs, form), _emit_interface(graphs, form)]
    if not graphs.model.needs_stiff_step:
        parts.append(SMOOTH_STEP)
    return "".join([*parts, SLIDING_STEP])


def _emit_interface(graphs: Graphs, form: Form) -> str:
    """The function over plain doubles."""
    f = next(f for f in graphs.functions if f.name == form.name).graph
    given = ", ".join(form.argument_names)
    lines = [
        "state now, change;",
        "spread(x, &now);",
        f"{form.name}(&now, {given}, &change);",
        "gather(&change, rate);",
    ]
    if not form.returns_rate:
        out = ", ".join(form.chain.name_out(k) for k in range(form.chain.n_out()))
        lines = ["state now;", "spread(x, &now);", f"{form.name}(&now, {given}, {out});"]
    return f"{c_signature(f, form.name)} {{\n" + "".join(f"    {line}\n" for line in lines) + "}\n\n"


def _include_vector_type(width: int) -> str:
    return f'#define HDA_W {width}\n#define HDA_V v{width}\n#include "hda_vector.h"\n#undef HDA_W\n#undef HDA_V\n\n'


def _inline_function(name: str, arguments: str, lines: list[str]) -> str:
    return f"{INLINE_VOID} {name}({arguments}) {{\n" + "".join(f"    {line}\n" for line in lines) + "}\n\n"


def _pad_lane(lane: Lane, per_joint: list[str]) -> str:
    """A vector's entries; places without a joint repeat the first."""
    return f"{{{', '.join([*per_joint, *[per_joint[0]] * (lane.width - len(lane.joints))])}}}"


def _list_shared_entries(graphs: Graphs) -> list[int]:
    """Indices in x of states that no drive reads, as those of a base or a link that bends."""
    held = {i for lane in graphs.lanes for index in lane.state_entries for i in index}
    return [i for i in range(len(graphs.model.x_slots)) if i not in held]


def _locate_entries(graphs: Graphs) -> dict[int, str]:
    """Index in x -> where the state holds it."""
    lanes = {
        i: f"lane_{k}[{entry}][{place}]"
        for k, lane in enumerate(graphs.lanes)
        for entry, index in enumerate(lane.state_entries)
        for place, i in enumerate(index)
    }
    return lanes | {i: f"shared[{k}]" for k, i in enumerate(_list_shared_entries(graphs))}


def _fill_lanes(graphs: Graphs, pointer: str, source: str) -> list[str]:
    """Statements that make the lanes of a state from one text an entry of x, `source` with its index."""
    lines = []
    for k, lane in enumerate(graphs.lanes):
        for entry, index in enumerate(lane.state_entries):
            vector = _pad_lane(lane, list(map(source.format, index)))
            lines.append(f"{pointer}->lane_{k}[{entry}] = (v{lane.width}){vector};")
    shared = enumerate(_list_shared_entries(graphs))
    return [*lines, *(f"{pointer}->shared[{k}] = {source.format(i)};" for k, i in shared)]


def _emit_spread_and_gather(graphs: Graphs) -> str:
    """Between x and the state."""
    out = [f"x[{i}] = at->{place};" for i, place in sorted(_locate_entries(graphs).items())]
    return _inline_function(
        "spread", "const double *x, state *at", _fill_lanes(graphs, "at", "x[{}]")
    ) + _inline_function("gather", "const state *at, double *x", out)


def _emit_along(graphs: Graphs) -> str:
    lines = []
    for k, lane in enumerate(graphs.lanes):
        each = f"for (int i = 0; i < {len(lane.state_entries)}; i++)"
        lines.append(f"{each} y->lane_{k}[i] = x->lane_{k}[i] + reach * slope->lane_{k}[i];")
    if shared := _list_shared_entries(graphs):
        each = f"for (int i = 0; i < {len(shared)}; i++)"
        lines.append(f"{each} y->shared[i] = x->shared[i] + reach * slope->shared[i];")
    return _inline_function("along", "const state *x, double reach, const state *slope, state *y", lines)


def use_reciprocals(operation: Operation, kind: str) -> Operation:
    """Print divisions as products with the reciprocal: the divisor is known long before the dividend.

    Args:
        operation: Printer of all other operations.
        kind: C type of a value.

    Returns:
        The printer.

    """

    def chosen(op: int, name: str, a: str, b: str) -> str:
        if op == ca.OP_DIV:
            return f"const {kind} {name} = {a} * (1.0 / {b});"
        return operation(op, name, a, b)

    return chosen


def _emit_chain(graphs: Graphs, form: Form) -> list[str]:
    """The chain's statements; its results stay in values that are named as the outputs, with their entry."""
    places, handed = _locate_entries(graphs), []  # the lanes' results that the chain reads, in its order
    for k, lane in enumerate(graphs.lanes):
        outputs = form.drive_graph(lane).n_out()
        missing = [""] * (lane.exact.n_out() - outputs)  # the smooth form hands over no friction level
        for place in range(len(lane.joints)):
            handed += [*missing, *(f"h{k}[{out}][{place}]" for out in range(outputs))]

    def read(argument: int, entry: int) -> str:
        name = form.chain.name_in(argument)
        if name == "x":
            return f"x->{places[entry]}"
        if name == "handed":
            return handed[entry]
        return f"{name}[{entry}]"

    def write(argument: int, entry: int) -> str:
        return f"const double {form.chain.name_out(argument)}_{entry}"

    return emit_body(form.chain, read, write, use_reciprocals(scalar_operation, "double"))


def _emit_drives(graphs: Graphs, form: Form) -> list[str]:
    """The functions of the lanes; the results for which the chain waits longest come first."""
    lines, out = _emit_chain(graphs, form), []
    urgency = statement_order.measure_urgency(lines)
    for k, lane in enumerate(graphs.lanes):
        after = {}
        for entry in range(form.drive_graph(lane).n_out()):
            waits = [wait for wait, line in zip(urgency, lines, strict=True) if f"h{k}[{entry}]" in line]
            after[f"h[{entry}]"] = max(waits, default=0)
        out.append(_emit_lane(graphs, form, k, after))
    return out


def _emit_evaluation(graphs: Graphs, form: Form) -> str:
    """The lanes, then the chain that joins them, then the results, a rate lane by lane."""
    calls = [f"(void){name};" for name in form.argument_names]
    for k, lane in enumerate(graphs.lanes):
        calls.append(f"v{lane.width} h{k}[{form.drive_graph(lane).n_out()}];")
        calls.append(f"lane_{k}{form.drive_suffix}(x->lane_{k}, {', '.join(form.argument_names)}, h{k});")
    results, stored = "state *rate", _fill_lanes(graphs, "rate", "rate_{}")
    if not form.returns_rate:
        sizes = {form.chain.name_out(k): form.chain.numel_out(k) for k in range(form.chain.n_out())}
        results = ", ".join(f"double *{name}" for name in sizes)
        stored = [f"{name}[{i}] = {name}_{i};" for name, size in sizes.items() for i in range(size)]
    lines = [*calls, *statement_order.arrange_statements(_emit_chain(graphs, form)), *stored]
    return _inline_function(form.name, f"const state *x, {form.c_arguments}, {results}", lines)


def _emit_lane(graphs: Graphs, form: Form, number: int, after: dict[str, int]) -> str:
    """The drives of a lane. ``after``: the cycles that the chain takes from each output on."""
    lane = graphs.lanes[number]
    f, kind = form.drive_graph(lane), f"v{lane.width}"
    base = _constants_before(graphs.model, graphs.lanes, number)

    def constant(entry: int) -> str:
        return f"c + {base + entry * lane.width}"

    def read(argument: int, entry: int) -> str:
        name = f.name_in(argument)
        if name == "constants":
            return f"*(const {kind}_loose *)({constant(entry)})"
        if name in JOINTWISE_ARRAYS:
            return _pad_lane(lane, [f"{JOINTWISE_ARRAYS[name]}[{j - 1}]" for j in lane.joints])
        return f"x[{argument}]"

    lines = emit_body(f, read, lambda k, _: f"h[{k}]", use_reciprocals(vector_operation(kind), kind), kind)
    lines = polynomial_packing.pack_polynomials(f, lines, f.n_in() - 1, lane.width, constant)
    unused = [f"(void){name};" for name in form.argument_names]
    arguments = f"const {kind} *x, {form.c_arguments}, {kind} *h"
    return _inline_function(
        f"lane_{number}{form.drive_suffix}", arguments, [*unused, *statement_order.arrange_statements(lines, after)]
    )


def _constants_before(model: Model, lanes: tuple[Lane, ...], number: int) -> int:
    return (
        len(model.quantities)
        + sum(s.numel() for s in model.inverse_symbols.values())
        + sum(int(lane.constants.numel()) for lane in lanes[:number])
    )


def emit_batch(graphs: Graphs) -> str:
    """Print `list_forms` over vectors of trajectories, as a header that `hda_batch_step.h` includes.

    Args:
        graphs: The model's graphs.

    Returns:
        The C text.

    """
    by_name = {f.name: f.graph for f in graphs.functions}
    return BATCH_PREAMBLE + "".join(_emit_batched(by_name[form.name]) for form in list_forms(graphs))


def _emit_batched(f: ca.Function) -> str:
    """A function over vectors of trajectories."""
    operation = use_reciprocals(vector_operation("hda_batch"), "hda_batch")
    lines = emit_body(
        f, lambda k, i: f"{f.name_in(k)}[{i}]", lambda k, i: f"{f.name_out(k)}[{i}]", operation, "hda_batch"
    )
    given = [f"const hda_batch *{f.name_in(k)}" for k in range(f.n_in())]
    arguments = ", ".join([*given, *(f"hda_batch *{f.name_out(k)}" for k in range(f.n_out()))])
    text = "".join(f"    {line}\n" for line in lines)
    return f"static inline void batch_{f.name()}({arguments}) {{\n{text}}}\n\n"
