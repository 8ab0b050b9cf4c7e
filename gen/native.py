"""C text of the fast right-hand side: drives in vector lanes, the chain in scalars, and the batch over trajectories."""

from __future__ import annotations

from gen.emit import body, signature, vector_operation
from gen.functions import Graphs, Lane
from gen.model import Model

BATCH = """/* Width of a batch: the widest vector that the target has. */
#if defined(__AVX512F__)
#define HDA_BATCH_WIDTH 8
#elif defined(__AVX__)
#define HDA_BATCH_WIDTH 4
#else
#define HDA_BATCH_WIDTH 2
#endif
#define HDA_W HDA_BATCH_WIDTH
#define HDA_V hda_batch
#include "hda_vector.h"
#undef HDA_W
#undef HDA_V

#define HDA_BATCH_ONE(mask) ((hda_batch)((mask) & (hda_batch_bits)(1.0 - (hda_batch){0})))

"""
HEADER = '#include "hda.h"\n\n#include <math.h>\n\n'


def rhs(graphs: Graphs) -> str:
    """hda_rhs with the joints side by side in vectors."""
    widths = sorted({lane.width for lane in graphs.lanes})
    parts = [HEADER]
    for width in widths:
        parts.append(
            f'#define HDA_W {width}\n#define HDA_V v{width}\n#include "hda_vector.h"\n#undef HDA_W\n#undef HDA_V\n\n'
        )
    # joint -> (lane's number, its place in the lane, entry of `handed` before its own)
    place: dict[int, tuple[int, int, int]] = {}
    offset = 0
    for number, lane in enumerate(graphs.lanes):
        for k, j in enumerate(lane.joints):
            place[j] = (number, k, offset)
            offset += lane.exact.n_out()
        parts.append(_lane(graphs, lane, number))
    parts.append(_chain(graphs, place))
    outputs = "\n".join(f"    double h{k}[{lane.smooth.n_out()}][{lane.width}];" for k, lane in enumerate(graphs.lanes))
    calls = "\n".join(f"    lane_{k}(x, u, c, h{k});" for k in range(len(graphs.lanes)))
    handed = ", ".join(f"h{k}" for k in range(len(graphs.lanes)))
    rhs_function = next(f for f in graphs.functions if f.name == "rhs").graph
    parts.append(f"{signature(rhs_function, 'rhs')} {{\n{outputs}\n{calls}\n    chain(x, u, {handed}, c, rate);\n}}\n")
    return "".join(parts)


def _lane(graphs: Graphs, lane: Lane, number: int) -> str:
    f, kind = lane.smooth, f"v{lane.width}"
    base = _constants_before(graphs.model, graphs.lanes, number)
    joints = [*lane.joints, *[lane.joints[0]] * (lane.width - len(lane.joints))]

    def read(argument: int, entry: int) -> str:
        if argument < len(lane.states):
            index = [*lane.states[argument], *[lane.states[argument][0]] * (lane.width - len(lane.joints))]
            return f"{{{', '.join(f'x[{i}]' for i in index)}}}"
        if argument == len(lane.states):
            return f"{{{', '.join(f'u[{j - 1}]' for j in joints)}}}"
        return f"*(const {kind}_loose *)(c + {base + entry * lane.width})"

    lines = body(f, read, lambda k, _: f"*({kind}_loose *)h[{k}]", vector_operation(kind), kind)
    arguments = f"const double *x, const double *u, const double *c, double (*h)[{lane.width}]"
    text = "".join(f"    {line}\n" for line in ["(void)u;", *lines])
    return f"static inline void lane_{number}({arguments}) {{\n{text}}}\n\n"


def _constants_before(model: Model, lanes: tuple[Lane, ...], number: int) -> int:
    return (
        len(model.quantities)
        + sum(s.numel() for s in model.inverse.values())
        + sum(int(lane.constants.numel()) for lane in lanes[:number])
    )


def _chain(graphs: Graphs, place: dict[int, tuple[int, int, int]]) -> str:
    starts = sorted((offset, j) for j, (_, _, offset) in place.items())

    def read(argument: int, entry: int) -> str:
        if argument != 2:
            return f"{('x', 'u', '', 'c')[argument]}[{entry}]"
        offset, j = max((start for start in starts if start[0] <= entry), default=starts[0])
        number, lane_place, _ = place[j]
        return f"h{number}[{entry - offset - 1}][{lane_place}]"  # the smooth form hands over no friction level

    lines = body(graphs.chain, read, lambda _, i: f"rate[{i}]")
    lines.sort(key=lambda line: line.startswith("rate["))  # x is read before rate, which may be the same, is written
    arrays = ", ".join(f"double (*h{k})[{lane.width}]" for k, lane in enumerate(graphs.lanes))
    head = f"static inline void chain(const double *x, const double *u, {arrays}, const double *c, double *rate) {{\n"
    ignored = "".join(f"    (void)h{k};\n" for k in range(len(graphs.lanes)))
    return head + "    (void)u;\n" + ignored + "".join(f"    {line}\n" for line in lines) + "}\n\n"


def batch(graphs: Graphs) -> str:
    """The right-hand side over vectors of trajectories, as a header that `hda_batch.c` includes."""
    f = next(f for f in graphs.functions if f.name == "rhs").graph
    lines = body(
        f,
        lambda k, i: f"{f.name_in(k)}[{i}]",
        lambda _, i: f"rate[{i}]",
        vector_operation("hda_batch"),
        "hda_batch",
    )
    arguments = "const hda_batch *x, const hda_batch *u, const hda_batch *c, hda_batch *rate"
    text = "".join(f"    {line}\n" for line in lines)
    return f"{BATCH}static inline void batch_rhs({arguments}) {{\n{text}}}\n"
