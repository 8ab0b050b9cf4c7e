"""C text of the fast right-hand side and step: drives in vector lanes, the chain in scalars; and the batch over
trajectories.

Not bit for bit the interpreter's: products and sums are contracted, divisions become products with reciprocals, sine,
cosine, exp and tanh are polynomials. The tests hold it to 1e-12 of each column.
"""

from __future__ import annotations

import casadi as ca

from gen import packing, schedule
from gen.emit import Operation, body, scalar_operation, signature, vector_operation
from gen.functions import Graphs, Lane
from gen.model import Model

BATCH = """/* Width of a batch: the widest vector that the target has; OF makes one from f(0), f(1), and so on. */
#if defined(__AVX512F__)
#define HDA_BATCH_WIDTH 8
#define HDA_BATCH_OF(f) {f(0), f(1), f(2), f(3), f(4), f(5), f(6), f(7)}
#elif defined(__AVX__)
#define HDA_BATCH_WIDTH 4
#define HDA_BATCH_OF(f) {f(0), f(1), f(2), f(3)}
#else
#define HDA_BATCH_WIDTH 2
#define HDA_BATCH_OF(f) {f(0), f(1)}
#endif
#define HDA_W HDA_BATCH_WIDTH
#define HDA_V hda_batch
#include "hda_vector.h"
#undef HDA_W
#undef HDA_V

#define HDA_BATCH_ONE(mask) ((hda_batch)((mask) & (hda_batch_bits)(1.0 - (hda_batch){0})))

"""
HEADER = '#include "hda.h"\n\n#include <math.h>\n\n'
INLINE = "static inline __attribute__((always_inline)) void"
STEP = """
/* RK4 over whole lanes. */
void hda_step(const double *from, const double *u, const double *c, const double *h, double *to) {
    state x, y, slope;
    spread(from, &x);
    y = x;
    const state start = x;
    evaluate(&y, u, c, &slope);
    along(&start, 0.5 * *h, &slope, &y);
    along(&x, *h / 6.0, &slope, &x);
    evaluate(&y, u, c, &slope);
    along(&start, 0.5 * *h, &slope, &y);
    along(&x, *h / 3.0, &slope, &x);
    evaluate(&y, u, c, &slope);
    along(&start, *h, &slope, &y);
    along(&x, *h / 3.0, &slope, &x);
    evaluate(&y, u, c, &slope);
    along(&x, *h / 6.0, &slope, &x);
    gather(&x, to);
}
"""


def rhs(graphs: Graphs) -> str:
    """hda_native.c: hda_rhs, and hda_step where it is RK4, with the state in vectors, joints side by side."""
    widths = sorted({w for lane in graphs.lanes for w in (lane.width, packing.twice(lane.width))})
    rows = "".join(f"    v{lane.width} lane_{k}[{len(lane.states)}];\n" for k, lane in enumerate(graphs.lanes))
    f = next(f for f in graphs.functions if f.name == "rhs").graph
    calls = "spread(x, &now);\n    evaluate(&now, u, c, &change);\n    gather(&change, rate);"
    parts = [
        HEADER,
        *(_vector(width) for width in widths),
        f"/* x, or its rate: entries of the joints' drives side by side. */\ntypedef struct {{\n{rows}}} state;\n\n",
        _moves(graphs),
        *_evaluate(graphs),
        f"{signature(f, 'rhs')} {{\n    state now, change;\n    {calls}\n}}\n",
        "" if graphs.model.stiff else _along(graphs) + STEP,
    ]
    return "".join(parts)


def _vector(width: int) -> str:
    return f'#define HDA_W {width}\n#define HDA_V v{width}\n#include "hda_vector.h"\n#undef HDA_W\n#undef HDA_V\n\n'


def _function(name: str, arguments: str, lines: list[str]) -> str:
    return f"{INLINE} {name}({arguments}) {{\n" + "".join(f"    {line}\n" for line in lines) + "}\n\n"


def _padded(lane: Lane, per_joint: list[str]) -> str:
    """A vector's entries; places without a joint repeat the first."""
    return f"{{{', '.join([*per_joint, *[per_joint[0]] * (lane.width - len(lane.joints))])}}}"


def _places(graphs: Graphs) -> dict[int, str]:
    """Index in x -> where the state holds it."""
    return {
        i: f"lane_{k}[{entry}][{place}]"
        for k, lane in enumerate(graphs.lanes)
        for entry, index in enumerate(lane.states)
        for place, i in enumerate(index)
    }


def _fill(graphs: Graphs, pointer: str, source: str) -> list[str]:
    """Statements that make the lanes of a state from one text an entry of x, `source` with its index."""
    return [
        f"{pointer}->lane_{k}[{entry}] = (v{lane.width}){_padded(lane, [source.format(i) for i in index])};"
        for k, lane in enumerate(graphs.lanes)
        for entry, index in enumerate(lane.states)
    ]


def _moves(graphs: Graphs) -> str:
    """Between x and the state."""
    out = [f"x[{i}] = at->{place};" for i, place in sorted(_places(graphs).items())]
    return _function("spread", "const double *x, state *at", _fill(graphs, "at", "x[{}]")) + _function(
        "gather", "const state *at, double *x", out
    )


def _along(graphs: Graphs) -> str:
    lines = []
    for k, lane in enumerate(graphs.lanes):
        each = f"for (int i = 0; i < {len(lane.states)}; i++)"
        lines.append(f"{each} y->lane_{k}[i] = x->lane_{k}[i] + reach * slope->lane_{k}[i];")
    return _function("along", "const state *x, double reach, const state *slope, state *y", lines)


def fast(operation: Operation, kind: str) -> Operation:
    """Division as a product with the reciprocal: the divisor is a constant or known long before the dividend."""

    def chosen(op: int, name: str, a: str, b: str) -> str:
        return f"const {kind} {name} = {a} * (1.0 / {b});" if op == ca.OP_DIV else operation(op, name, a, b)

    return chosen


def _evaluate(graphs: Graphs) -> list[str]:
    """The lanes, then the chain that joins them, then the rate lane by lane."""
    places, lanes = _places(graphs), graphs.lanes
    handed: list[str] = []  # what the chain reads, in its order: the smooth form hands over no friction level
    for k, lane in enumerate(lanes):
        for place in range(len(lane.joints)):
            handed += ["", *(f"h{k}[{out}][{place}]" for out in range(lane.smooth.n_out()))]

    def read(argument: int, entry: int) -> str:
        if argument == 0:
            return f"x->{places[entry]}"
        return handed[entry] if argument == 2 else f"{'u' if argument == 1 else 'c'}[{entry}]"

    lines = body(graphs.chain, read, lambda _, i: f"const double r{i}", fast(scalar_operation, "double"))
    urgent = list(zip(schedule.urgency(lines), lines, strict=True))
    drives, calls = [], ["(void)u;"]
    for k, lane in enumerate(lanes):
        after = {
            f"h[{out}]": max((w for w, line in urgent if f"h{k}[{out}]" in line), default=0)
            for out in range(lane.smooth.n_out())
        }
        drives.append(_lane(graphs, lane, k, after))
        calls += [f"v{lane.width} h{k}[{lane.smooth.n_out()}];", f"lane_{k}(x->lane_{k}, u, c, h{k});"]
    lines = [*calls, *schedule.arrange(lines), *_fill(graphs, "rate", "r{}")]
    return [*drives, _function("evaluate", "const state *x, const double *u, const double *c, state *rate", lines)]


def _lane(graphs: Graphs, lane: Lane, number: int, after: dict[str, int]) -> str:
    """The drives of a lane. ``after``: how long the chain takes from each output on."""
    f, kind = lane.smooth, f"v{lane.width}"
    base = _constants_before(graphs.model, graphs.lanes, number)

    def constant(entry: int) -> str:
        return f"c + {base + entry * lane.width}"

    def read(argument: int, entry: int) -> str:
        if argument < len(lane.states):
            return f"x[{argument}]"
        if argument == len(lane.states):
            return _padded(lane, [f"u[{j - 1}]" for j in lane.joints])
        return f"*(const {kind}_loose *)({constant(entry)})"

    lines = body(f, read, lambda k, _: f"h[{k}]", fast(vector_operation(kind), kind), kind)
    lines = packing.pack(f, lines, len(lane.states) + 1, lane.width, constant)
    arguments = f"const {kind} *x, const double *u, const double *c, {kind} *h"
    return _function(f"lane_{number}", arguments, ["(void)u;", *schedule.arrange(lines, after)])


def _constants_before(model: Model, lanes: tuple[Lane, ...], number: int) -> int:
    return (
        len(model.quantities)
        + sum(s.numel() for s in model.inverse.values())
        + sum(int(lane.constants.numel()) for lane in lanes[:number])
    )


def batch(graphs: Graphs) -> str:
    """The right-hand side over vectors of trajectories, as a header that `hda_batch.c` includes."""
    f = next(f for f in graphs.functions if f.name == "rhs").graph
    operation = fast(vector_operation("hda_batch"), "hda_batch")
    lines = body(f, lambda k, i: f"{f.name_in(k)}[{i}]", lambda _, i: f"rate[{i}]", operation, "hda_batch")
    arguments = "const hda_batch *x, const hda_batch *u, const hda_batch *c, hda_batch *rate"
    text = "".join(f"    {line}\n" for line in lines)
    return f"{BATCH}static inline void batch_rhs({arguments}) {{\n{text}}}\n"
