"""Long functions in parts, each a C function of its own: compilers work on several at once, and their time grows with
the square of a function's length.

A value that a later part needs goes through an array; inputs and constants are read again. The operations and their
order are those of the whole function, so its results are the same to the bit.
"""

from __future__ import annotations

import re

import casadi as ca

from gen.c_code.emitter import c_signature, emit_body, list_unused_inputs, scalar_function
from gen.model.right_hand_side import Preparation

LONGEST_FUNCTION = 16000  # statements, from which a function is printed in parts
LONGEST_PART = 8000  # statements of one part
DEFINITION = re.compile(r"const double (t\d+) = (.*);")
VALUE = re.compile(r"\bt\d+\b")


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
    computed = [line for line in lines if line.startswith("const ")]
    stored = [line for line in lines if not line.startswith("const ")]
    definitions = [(found[1], found[2]) for line in computed if (found := DEFINITION.fullmatch(line))]
    late = set(VALUE.findall(" ".join(stored[LONGEST_PART:])))  # read when results may lie where inputs were
    again = {value: text for value, text in definitions if not (VALUE.search(text) or "(" in text or value in late)}
    steps = [pair for pair in definitions if pair[0] not in again]
    blocks = [(steps[k : k + LONGEST_PART], list[str]()) for k in range(0, len(steps), LONGEST_PART)]
    blocks[-1] = (blocks[-1][0], stored[:LONGEST_PART])  # everything is read before anything is written
    blocks += [([], stored[k : k + LONGEST_PART]) for k in range(LONGEST_PART, len(stored), LONGEST_PART)]
    reads = []
    for block, stores in blocks:
        texts = [text for _, text in block] + stores
        reads.append(dict.fromkeys(value for text in texts for value in VALUE.findall(text)))
    places, size = _assign_places([block for block, _ in blocks], reads)
    parts, heads, calls = [], [], []
    for k, (block, stores) in enumerate(blocks, 1):
        names = [*map(f.name_in, range(f.n_in())), "w", *map(f.name_out, range(f.n_out() if stores else 0))]
        kinds = ["const double *"] * f.n_in() + ["double *"] * (len(names) - f.n_in())
        head = f"void hda_{name}_{k}({', '.join(map(''.join, zip(kinds, names, strict=True)))})"
        body = _print_part(block, list(reads[k - 1]), again, places) + stores
        unused = [f"(void){argument};" for argument in list_unused_inputs(f, " ".join(body))]
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


def _assign_places(blocks: list[list[tuple[str, str]]], reads: list[dict[str, None]]) -> tuple[dict[str, int], int]:
    """The place in the array of each value that crosses parts, used again once it was read for the last time."""
    made = {value: k for k, block in enumerate(blocks) for value, _ in block}
    last = {value: k for k, read in enumerate(reads) for value in read if value in made}
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
        free += [places[value] for value in reads[k] if value in places and last[value] == k]
    return places, max(size, 1)


def _print_part(
    block: list[tuple[str, str]], read: list[str], again: dict[str, str], places: dict[str, int]
) -> list[str]:
    """The statements of one part: values from before, its own, and those that a later part needs."""
    own = {value for value, _ in block}
    lines = []
    for value in read:
        if value in again:
            lines.append(f"const double {value} = {again[value]};")
        elif value not in own:
            lines.append(f"const double {value} = w[{places[value]}];")
    lines += [f"const double {value} = {text};" for value, text in block]
    return lines + [f"w[{places[value]}] = {value};" for value, _ in block if value in places]
