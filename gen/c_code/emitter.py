"""C text from CasADi's instruction lists: single assignments, for scalars and for vectors. Pure: text in, text out.

CasADi's own C printer is not used for the product: the C printed here has one plain signature, needs no work vectors
and comes over vector types too. The tests hold the two printings against each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca

BINARY_OPERATORS = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}
COMPARISONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
C_FUNCTIONS = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil", ca.OP_FABS: "fabs", ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "fmin", ca.OP_FMAX: "fmax", ca.OP_ATAN2: "atan2", ca.OP_FMOD: "fmod",
    ca.OP_COPYSIGN: "copysign", ca.OP_LOG1P: "log1p",
    ca.OP_EXPM1: "expm1", ca.OP_HYPOT: "hypot", ca.OP_ERF: "erf",
}  # fmt: skip

EntryText = Callable[[int, int], str]  # (argument, entry) -> C expression
Operation = Callable[[int, str, str, str], str]  # (operation, result's name, operands) -> C statement
TWO_ARGUMENT_FUNCTIONS = {
    ca.OP_POW,
    ca.OP_CONSTPOW,
    ca.OP_FMIN,
    ca.OP_FMAX,
    ca.OP_ATAN2,
    ca.OP_FMOD,
    ca.OP_COPYSIGN,
    ca.OP_HYPOT,
}


class EmitError(Exception):
    """An operation that this printer does not know."""


def format_double(value: float) -> str:
    """Print a double as C text that reads back to the same bits.

    Args:
        value: The number; NaN and infinities too.

    Returns:
        The text.

    """
    if math.isnan(value):
        return "NAN"
    if value == math.inf:
        return "INFINITY"
    if value == -math.inf:
        return "-INFINITY"
    text = repr(float(value))
    if any(mark in text for mark in ".en"):
        return text
    return f"{text}.0"


def scalar_operation(op: int, name: str, a: str, b: str) -> str:
    """Print one operation over doubles, with the interpreter's meaning to the bit.

    Args:
        op: CasADi's number of the operation.
        name: Name of the result.
        a: First operand.
        b: Second operand; empty where there is none.

    Returns:
        The C statement.

    Raises:
        EmitError: This printer does not know the operation.

    """
    if op in BINARY_OPERATORS:
        text = f"{a} {BINARY_OPERATORS[op]} {b}"
    elif op in COMPARISONS:
        text = f"(double)({a} {COMPARISONS[op]} {b})"
    elif op in TWO_ARGUMENT_FUNCTIONS:
        text = f"{C_FUNCTIONS[op]}({a}, {b})"
    elif op in C_FUNCTIONS:
        text = f"{C_FUNCTIONS[op]}({a})"
    else:
        special = {
            ca.OP_NEG: f"-{a}",
            ca.OP_SQ: f"{a} * {a}",
            ca.OP_TWICE: f"2.0 * {a}",
            ca.OP_INV: f"1.0 / {a}",
            ca.OP_NOT: f"(double)({a} == 0.0)",
            ca.OP_AND: f"(double)({a} != 0.0 && {b} != 0.0)",
            ca.OP_OR: f"(double)({a} != 0.0 || {b} != 0.0)",
            ca.OP_IF_ELSE_ZERO: f"{a} != 0.0 ? {b} : 0.0",
            ca.OP_SIGN: f"{a} < 0.0 ? -1.0 : {a} > 0.0 ? 1.0 : {a}",
        }
        if op not in special:
            raise EmitError(f"no C for CasADi's operation number {op}")
        text = special[op]
    return f"const double {name} = {text};"


def vector_operation(kind: str) -> Operation:
    """Make the printer of operations over a vector type; functions take pointers, so no vector crosses a call.

    Args:
        kind: The vector type of `hda_vector.h`.

    Returns:
        A function as `scalar_operation`.

    """
    called = {
        ca.OP_SIGN, ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS, ca.OP_FLOOR, ca.OP_EXP, ca.OP_SIN, ca.OP_COS, ca.OP_TAN,
        ca.OP_ATAN, ca.OP_TANH,
    }  # fmt: skip

    def operation(op: int, name: str, a: str, b: str) -> str:
        if op in called:
            function = C_FUNCTIONS.get(op, "sign")
            operands = f"&{a}"
            if op in TWO_ARGUMENT_FUNCTIONS:
                operands = f"&{a}, &{b}"
            return f"{kind} {name}; {kind}_{function}({operands}, &{name});"
        if op in COMPARISONS:
            one = f"({kind}_bits)(1.0 - ({kind}){{0}})"  # a comparison is a mask
            return f"const {kind} {name} = ({kind})(({a} {COMPARISONS[op]} {b}) & {one});"
        simple = {ca.OP_NEG: f"-{a}", ca.OP_SQ: f"{a} * {a}", ca.OP_TWICE: f"{a} + {a}", ca.OP_INV: f"1.0 / {a}"}
        if op in BINARY_OPERATORS:
            simple[op] = f"{a} {BINARY_OPERATORS[op]} {b}"
        if op in simple:
            return f"const {kind} {name} = {simple[op]};"
        one = scalar_operation(op, "one", f"{a}[i]", f"{b}[i]")  # without a vector form: lane by lane
        lanes = f"(int)(sizeof {name} / sizeof(double))"
        return f"{kind} {name} = {a}; for (int i = 0; i < {lanes}; i++) {{ {one} {name}[i] = one; }}"

    return operation


def emit_body(
    f: ca.Function, read: EntryText, write: EntryText, operation: Operation = scalar_operation, kind: str = "double"
) -> list[str]:
    """Print the instructions of a function.

    Args:
        f: The function.
        read: C text of an input's entry, by argument and entry.
        write: C text of an output's entry, by result and entry.
        operation: Printer of the operations.
        kind: C type of a value.

    Returns:
        The C statements.

    Raises:
        EmitError: The printer does not know an operation.

    """
    lines: list[str] = []
    holds: dict[int, str] = {}  # work entry -> name of the assignment that it holds, or a number
    for k in range(f.n_instructions()):
        op, into, out = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        name = f"t{k}"
        if op == ca.OP_OUTPUT:
            lines.append(f"{write(out[0], out[1])} = {holds[into[0]]};")
            continue
        if op == ca.OP_CONST and kind == "double":
            lines.append(f"const double {name} = {format_double(f.instruction_constant(k))};")
        elif op == ca.OP_CONST:
            lines.append(f"const {kind} {name} = {format_double(f.instruction_constant(k))} - ({kind}){{0}};")
        elif op == ca.OP_INPUT:
            lines.append(f"const {kind} {name} = {read(into[0], into[1])};")
        else:
            operands = [*(holds[entry] for entry in into), ""]  # a single operand is followed by an empty one
            lines.append(operation(op, name, operands[0], operands[1]))
        holds[out[0]] = name
    return lines


def c_signature(f: ca.Function, name: str) -> str:
    """Print the signature `void hda_<name>(const double *…, double *…)`.

    Args:
        f: The function.
        name: Its name without prefix.

    Returns:
        The signature, without a semicolon.

    """
    ins = [f"const double *{f.name_in(k)}" for k in range(f.n_in())]
    outs = [f"double *{f.name_out(k)}" for k in range(f.n_out())]
    return f"void hda_{name}({', '.join(ins + outs)})"


def scalar_function(f: ca.Function, name: str, head: str = "") -> str:
    """Print a whole function over doubles.

    Inputs may overlap outputs: everything is read before anything is written.

    Args:
        f: The function.
        name: Its name without prefix.
        head: A signature in place of the exported one; its arguments are named as the function's.

    Returns:
        The C text.

    Raises:
        EmitError: The printer does not know an operation.

    """
    lines = emit_body(f, lambda k, i: f"{f.name_in(k)}[{i}]", lambda k, i: f"{f.name_out(k)}[{i}]")
    computed = [line for line in lines if line.startswith("const ")]
    stored = [line for line in lines if not line.startswith("const ")]
    unused = [f"(void){name};" for name in list_unused_inputs(f, " ".join(lines))]
    return (
        f"{head or c_signature(f, name)} {{\n" + "".join(f"    {line}\n" for line in unused + computed + stored) + "}\n"
    )


def list_unused_inputs(f: ca.Function, text: str) -> list[str]:
    """List the inputs that a function's C text does not read.

    Args:
        f: The function.
        text: Its statements.

    Returns:
        Names of inputs.

    """
    return [f.name_in(k) for k in range(f.n_in()) if f" {f.name_in(k)}[" not in f" {text}"]
