"""Long polynomials of a lane in vectors twice as wide: even and odd powers side by side halve the operations.

A polynomial is found in the list of instructions, in any scheme of evaluation: constants that follow each other
in c times the powers of one value, all summed up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

WIDEST_PACKED = 4  # of the vectors that are made
SHORTEST_PACKED = 8  # coefficients


@dataclass(frozen=True)
class Polynomial:
    """Σ c[entry] x^power: x by its instruction's number (None: a constant), ``terms`` power -> entry of the
    constants."""

    x: int | None
    terms: dict[int, int]


def packed_width(width: int) -> int:
    """Find the width of the vectors in which a lane's polynomials are computed.

    Args:
        width: The lane's width.

    Returns:
        Twice the width, or the same where that would be wider than WIDEST.

    """
    if 2 * width <= WIDEST_PACKED:
        return 2 * width
    return width


def pack_polynomials(
    f: ca.Function, lines: list[str], constants: int, width: int, at: Callable[[int], str]
) -> list[str]:
    """Pack the long polynomials of a lane.

    Args:
        f: The lane's graph.
        lines: Its statements (`emit.body`).
        constants: Number of the argument that holds the constants.
        width: The lane's width.
        at: C text of the place of a constant, by its entry.

    Returns:
        The statements with packed polynomials.

    """
    if packed_width(width) == width:
        return lines
    reads = _instructions_read(f)
    found = {k: p for k, p in _find_polynomials(f, reads, constants).items() if _is_worth_packing(p)}
    packed: dict[int, list[str]] = {}
    wanted: set[int | None] = set()
    for k in reversed(range(len(lines))):
        if k not in wanted and f.instruction_id(k) != ca.OP_OUTPUT:
            continue
        if k in found:
            packed[k] = _emit_estrin(k, found[k], width, at)
            wanted.add(found[k].x)
        else:
            packed[k] = [lines[k]]
            wanted.update(reads[k])
    return [line for k in sorted(packed) for line in packed[k]]


def _instructions_read(f: ca.Function) -> list[tuple[int, ...]]:
    """For each instruction, the instructions whose results it reads."""
    holds: dict[int, int] = {}
    out: list[tuple[int, ...]] = []
    for k in range(f.n_instructions()):
        op = f.instruction_id(k)
        if op in (ca.OP_INPUT, ca.OP_CONST):
            out.append(())
        else:
            out.append(tuple(holds[i] for i in f.instruction_input(k)))
        if op != ca.OP_OUTPUT:
            holds[f.instruction_output(k)[0]] = k
    return out


def _find_polynomials(f: ca.Function, reads: list[tuple[int, ...]], constants: int) -> dict[int, Polynomial]:
    """Every instruction whose result is a polynomial with plain constants as coefficients."""
    powers: dict[int, tuple[int, int]] = {}  # instruction -> (x, power)
    found: dict[int, Polynomial] = {}
    for k, read in enumerate(reads):
        op = f.instruction_id(k)
        if op == ca.OP_INPUT and f.instruction_input(k)[0] == constants:
            found[k] = Polynomial(None, {0: f.instruction_input(k)[1]})
        elif op == ca.OP_SQ:
            x, n = powers.get(read[0], (read[0], 1))
            powers[k] = (x, 2 * n)
        elif op == ca.OP_MUL and (read[0] in found) != (read[1] in found):
            factor, part = read
            if part not in found:
                factor, part = part, factor
            (x, n), p = powers.get(factor, (factor, 1)), found[part]
            if p.x in (None, x):
                found[k] = Polynomial(x, {m + n: entry for m, entry in p.terms.items()})
        elif op == ca.OP_ADD and read[0] in found and read[1] in found:
            p, q = found[read[0]], found[read[1]]
            bases = {p.x, q.x} - {None}
            if len(bases) <= 1 and not p.terms.keys() & q.terms.keys():
                found[k] = Polynomial(next(iter(bases), None), {**p.terms, **q.terms})
    return found


def _is_worth_packing(p: Polynomial) -> bool:
    powers = sorted(p.terms)
    first = p.terms[powers[0]]
    whole = powers == list(range(len(powers))) and all(p.terms[m] == first + m for m in powers)
    return len(powers) >= SHORTEST_PACKED and whole


def _emit_estrin(k: int, p: Polynomial, width: int, at: Callable[[int], str]) -> list[str]:
    """Statements for t<k>: Estrin's scheme in x² over pairs of coefficients, then even + x odd."""
    wide, kind, x, me = f"v{2 * width}", f"v{width}", f"t{p.x}", f"t{k}"
    repeated = ", ".join(f"{me}_square[{i}]" for i in [*range(width)] * 2)
    lines = [f"const {kind} {me}_square = {x} * {x};", f"const {wide} {me}_x0 = {{{repeated}}};"]
    terms = []
    for m in range(0, len(p.terms), 2):
        place = at(p.terms[m])
        pair = f"*(const {wide}_loose *)({place})"
        if m + 1 == len(p.terms):
            pair = f"{{{', '.join([f'({place})[{i}]' for i in range(width)] + ['0.0'] * width)}}}"
        terms.append(f"{me}_{m}")
        lines.append(f"const {wide} {terms[-1]} = {pair};")
    level = 0
    while len(terms) > 1:
        if level:
            lines.append(f"const {wide} {me}_x{level} = {me}_x{level - 1} * {me}_x{level - 1};")
        sums = []
        for i in range(0, len(terms) - 1, 2):
            sums.append(f"{terms[i]}_{level}")
            lines.append(f"const {wide} {sums[-1]} = {terms[i]} + {me}_x{level} * {terms[i + 1]};")
        terms, level = sums + terms[2 * len(sums) :], level + 1
    entries = [f"{terms[0]}[{i}]" for i in range(2 * width)]
    even, odd = ", ".join(entries[:width]), ", ".join(entries[width:])
    return [
        *lines,
        f"const {kind} {me}_even = {{{even}}};",
        f"const {kind} {me}_odd = {{{odd}}};",
        f"const {kind} {me} = {me}_even + {x} * {me}_odd;",
    ]
