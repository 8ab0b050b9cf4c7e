"""Long functions in parts, each a C function of its own: compilers work on several at once, and their time grows with
the square of a function's length.

A value that a later part needs goes through an array; inputs and constants are read again. The operations and their
order are those of the whole function, so its results are the same to the bit.

Results wait in the same array until every part has read its inputs, for they may lie where inputs were. The last parts
only bring them to their places, one after the other: thousands of values that wait for their stores take a compiler
longer than all the arithmetic. Runs of zeros, of which derivatives are full, are filled by loops.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from typing import Any

import casadi as ca

from gen.c_code.emitter import c_signature, emit_body, format_double, scalar_function
from gen.model.right_hand_side import Preparation

LONGEST_FUNCTION = 16000  # statements, from which a function is printed in parts
LONGEST_PART = 2500  # statements of one part
DEFINITION = re.compile(r"const double (t\d+) = (.*);")
RESULT = re.compile(r"(\w+)\[(\d+)\] = (t\d+);")
VALUE = re.compile(r"\bt\d+\b")
ZERO = format_double(0.0)

LONG_RUN = 16  # zeros, from which they are filled by a loop

Definition = tuple[str, str]  # name of a value, and its C expression
Result = tuple[str, int, str]  # output, entry, and name of the value


def emit_function(f: ca.Function, name: str) -> tuple[str, list[str]]:
    """Print a function over doubles, a long one in parts.

    Args:
        f: The function.
        name: Its name without prefix.

    Returns:
        The C text of the function, and those of its parts.

    Raises:
        EmitError: The printer does not know an operation.

    """
    if f.n_instructions() <= LONGEST_FUNCTION:
        return scalar_function(f, name), []
    lines = emit_body(f, lambda k, i: f"{f.name_in(k)}[{i}]", lambda k, i: f"{f.name_out(k)}[{i}]")
    definitions = [(found[1], found[2]) for line in lines if (found := DEFINITION.fullmatch(line))]
    results = [(found[1], int(found[2]), found[3]) for line in lines if (found := RESULT.fullmatch(line))]
    kept = {value for _, _, value in results}
    zeros = {value for value, text in definitions if text == ZERO}
    plain = {value: text for value, text in definitions if not (VALUE.search(text) or "(" in text)}
    again = {value: text for value, text in plain.items() if value not in kept - zeros}
    steps = [pair for pair in definitions if pair[0] not in again]
    blocks = list(_cut(steps))
    places, size = _assign_places(blocks, kept)
    inputs = [f.name_in(k) for k in range(f.n_in())]
    outputs = [f.name_out(k) for k in range(f.n_out())]
    bodies = [([*inputs, "w"], len(inputs), _print_part(block, again, places)) for block in blocks]
    bodies += [(["w", *outputs], 1, stores) for stores in _cut(_print_stores(results, zeros, places))]
    parts, heads, calls = [], [], []
    for k, (names, given, body) in enumerate(bodies, 1):
        kinds = ["const double *"] * given + ["double *"] * (len(names) - given)
        head = f"void hda_{name}_{k}({', '.join(map(''.join, zip(kinds, names, strict=True)))})"
        text = " ".join(body)
        unused = [f"(void){argument};" for argument in names if not re.search(rf"\b{argument}\[", text)]
        parts.append(f"{head};\n\n{head} {{\n" + "".join(f"    {line}\n" for line in unused + body) + "}\n")
        heads.append(f"{head};\n")
        calls.append(f"    hda_{name}_{k}({', '.join(names)});\n")
    whole = f"{''.join(heads)}\n{c_signature(f, name)} {{\n    double w[{size}];\n{''.join(calls)}}}\n"
    return whole, parts


def emit_preparation(prepared: Preparation) -> tuple[str, list[str]]:
    """Print `hda_prepare`: the springs' inverses joint by joint, then all other constants.

    Args:
        prepared: The two parts of the function p -> c.

    Returns:
        The C text, and those of the parts of its long function.

    """
    parts, count = [], 0
    if prepared.inverse is not None:
        count = prepared.inverse.numel_out(0)
        parts.append(scalar_function(prepared.inverse, "", "static void inverse(const double *i0, double *o0)"))
        rows = ", ".join("{" + ", ".join(map(str, row)) + "}" for row in prepared.keys)
        width = len(prepared.keys[0])
        parts.append(f"static const int taken[][{width}] = {{{rows}}};\n")
    name, split = "rest", list[str]()
    if prepared.rest.n_instructions() > LONGEST_FUNCTION:
        text, split = emit_function(prepared.rest, "prepare_rest")
        name = "hda_prepare_rest"
    else:
        text = scalar_function(prepared.rest, "", "static void rest(const double *i0, const double *i1, double *o0)")
    parts.append(text)
    lines = [f"double coefficients[{max(1, count * len(prepared.keys))}] = {{0}};"]
    if prepared.inverse is not None:
        lines += [
            f"for (int j = 0; j < {len(prepared.keys)}; j++) {{",
            f"    double keys[{width}];",
            f"    for (int k = 0; k < {width}; k++) keys[k] = p[taken[j][k]];",
            f"    inverse(keys, coefficients + j * {count});",
            "}",
        ]
    lines.append(f"{name}(p, coefficients, c);")
    body_text = "".join(f"    {line}\n" for line in lines)
    return "\n".join(parts) + f"\nvoid hda_prepare(const double *p, double *c) {{\n{body_text}}}\n", split


def _cut(statements: list[Any]) -> Iterator[list[Any]]:
    """The statements in blocks of at most LONGEST_PART."""
    for first in range(0, len(statements), LONGEST_PART):
        yield statements[first : first + LONGEST_PART]


def _print_stores(results: list[Result], zeros: set[str], places: dict[str, int]) -> list[str]:
    """The statements that bring results from the array to their places; long runs of zeros are loops."""
    lines = []
    for (output, is_zero), run in groupby(sorted(results), lambda result: (result[0], result[2] in zeros)):
        entries = [(entry, value) for _, entry, value in run]
        first, last = entries[0][0], entries[-1][0]
        if is_zero and len(entries) >= LONG_RUN:
            lines.append(f"for (int i = {first}; i <= {last}; i++) {output}[i] = {ZERO};")
        elif is_zero:
            lines += [f"{output}[{entry}] = {ZERO};" for entry, _ in entries]
        else:
            lines += [f"{output}[{entry}] = w[{places[value]}];" for entry, value in entries]
    return lines


def _assign_places(blocks: list[list[Definition]], kept: set[str]) -> tuple[dict[str, int], int]:
    """The place in the array of each value that crosses parts or is ``kept`` as a result, and the size of the array.

    A place is used again once its value was read for the last time.
    """
    reads = [{value for _, text in block for value in VALUE.findall(text)} for block in blocks]
    last = {value: k for k, read in enumerate(reads) for value in read} | dict.fromkeys(kept, len(blocks))
    places: dict[str, int] = {}
    free: list[int] = []
    size = 0
    for k, block in enumerate(blocks):
        for value, _ in block:
            if last.get(value, k) > k:
                if not free:
                    free.append(size)
                    size += 1
                places[value] = free.pop()
        free += sorted(places[value] for value in reads[k] if value in places and last[value] == k)
    return places, max(size, 1)


def _print_part(block: list[Definition], again: dict[str, str], places: dict[str, int]) -> list[str]:
    """The statements of one part. A value from before is read where it is needed first, and one that is needed later is
    put away at once, so that few wait for a register."""
    known: set[str] = set()
    lines = []
    for value, text in block:
        for operand in VALUE.findall(text):
            if operand not in known:
                known.add(operand)
                source = again.get(operand) or f"w[{places[operand]}]"
                lines.append(f"const double {operand} = {source};")
        known.add(value)
        lines.append(f"const double {value} = {text};")
        if value in places:
            lines.append(f"w[{places[value]}] = {value};")
    return lines
