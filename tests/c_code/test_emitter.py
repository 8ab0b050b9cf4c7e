"""Emitted C: the interpreter's bits, CasADi's own printing, the native profile's bound, operations, same bytes."""

from __future__ import annotations

import ctypes
import itertools
import json
import math
import os
import re
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import wrist
from arms import ALL_EFFECTS, CHAINS, MIXED, SMALL, WHOLE, arm
from compiled import Compiled
from graphs import Draw, Floats, Interpreted, assembled, bits, functions, toml
from hypothesis import given
from hypothesis import strategies as st
from stub_compiler import stub_compiler

from gen.c_code.emitter import (
    BINARY_OPERATORS,
    C_FUNCTIONS,
    COMPARISONS,
    TWO_ARGUMENT_FUNCTIONS,
    EmitError,
    format_double,
    scalar_function,
    scalar_operation,
    vector_operation,
)

ROOT = Path(__file__).parents[2]
CHUNK, SHARED = 5000, 10  # rows evaluated at once, and how many of them share their parameters
ROBOTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "paper": ("paper", ()),
    "emps": ("emps", ()),
    "pendulum": ("dfki_1_0", ()),
    "every effect": (MIXED, ALL_EFFECTS),
}
IN_LANES = ("rhs", "rhs_exact", "holding")  # functions that the native profile evaluates in vectors
Builder = Callable[..., Compiled]


def chunks(made: Compiled, seed: int, rows: int, spread: float | None = None) -> Iterator[tuple[Draw, Floats, Floats]]:
    """(draw, parameters, c) with CHUNK rows of c each."""
    draw = Draw(made, np.random.default_rng(seed))
    for _ in range(math.ceil(rows / CHUNK)):
        p = draw.parameters(CHUNK // SHARED, spread)
        yield draw, p, np.repeat(made("prepare", p)[0], SHARED, axis=0)


def source(name: str, tmp_path: Path) -> tuple[str, tuple[str, ...]]:
    robot, effects = ROBOTS[name]
    return (toml(tmp_path, robot) if "\n" in robot else robot), effects


# -- portable: the interpreter's bits ---------------------------------------------------------------------------------


def _differing(build: Builder, name: str, tmp_path: Path, rows: int) -> dict[str, int]:
    robot, effects = ROBOTS[name]
    made = build(robot, "portable", effects)
    graphs = dict(functions(assembled(*source(name, tmp_path))))
    assert set(graphs) == {f["name"] for f in made.manifest["functions"]}
    interpreted = {f: Interpreted(graph, CHUNK // (SHARED if f == "prepare" else 1)) for f, graph in graphs.items()}
    differing = dict.fromkeys(graphs, 0)
    for seed, spread in ((1, None), (2, 0.2)):
        for draw, p, c in chunks(made, seed, rows // 2, spread):
            for f in made.manifest["functions"]:
                inputs = [p] if f["name"] == "prepare" else draw.inputs(f, c)
                expected, found = interpreted[f["name"]](*inputs), made(f["name"], *inputs)
                differing[f["name"]] += sum(
                    int((bits(a) != bits(b)).sum()) for a, b in zip(expected, found, strict=True)
                )
    return {f: count for f, count in differing.items() if count}


@pytest.mark.parametrize("name", ROBOTS)
def test_portable_is_the_interpreter_bit_for_bit(build: Builder, name: str, tmp_path: Path) -> None:
    assert _differing(build, name, tmp_path, 20_000) == {}


@pytest.mark.campaign
@pytest.mark.parametrize("name", ROBOTS)
def test_portable_is_the_interpreter_at_ten_million_states(build: Builder, name: str, tmp_path: Path) -> None:
    assert _differing(build, name, tmp_path, 10_000_000) == {}


def test_random_states_reach_both_sides_of_the_spring_law(build: Builder) -> None:
    made = build("paper")
    outputs = next(f for f in made.manifest["functions"] if f["name"] == "outputs")
    beyond = [name for name, _ in outputs["outputs"]].index("beyond_law")
    for draw, _, c in chunks(made, 1, CHUNK, 0.2):
        share = made("outputs", *draw.inputs(outputs, c))[beyond].mean()
        assert 0.2 < share < 0.8


# -- native: its bound ------------------------------------------------------------------------------------------------


def _well_posed(made: Compiled, name: str, inputs: list[Floats], outputs: list[Floats]) -> np.ndarray:
    """Rows at which the last bits of the inputs do not already move the result: off the arm's singular poses."""
    if name == "inverse_kinematics":  # the elbow's angle is an arc cosine
        return np.abs(np.sin(outputs[0][:, 1])) > 0.05
    if name == "force_map":  # (J Jᵀ)⁻¹
        q, c = inputs
        J = made("tip_jacobian", q, np.zeros_like(q), c)[0].reshape(len(q), -1, 2)
        return np.linalg.cond(J) < 20
    return np.ones(len(outputs[0]), dtype=bool)


def _worst(made: Compiled, name: str, inputs: list[Floats], expected: list[Floats], found: list[Floats]) -> float:
    rows = _well_posed(made, name, inputs, expected)
    worst = 0.0
    for a, b in ((a[rows], b[rows]) for a, b in zip(expected, found, strict=True)):
        assert (np.isnan(a) == np.isnan(b)).all(), name
        there = ~np.isnan(a)
        size = np.abs(np.where(there, a, 0.0)).max(axis=0, initial=0.0)
        error = np.abs(np.where(there, a - b, 0.0)).max(axis=0, initial=0.0)
        worst = max(worst, float((error / np.where(size == 0, 1.0, size)).max(initial=0.0)))
    return worst


def _native_errors(portable: Compiled, native: Compiled, names: tuple[str, ...]) -> dict[str, float]:
    """Worst error of the functions and of the steps, from rest too, scaled by column; each profile with the constants
    that it prepares itself, effects in their typical size."""
    step = np.array([portable.manifest["robot"]["step"]])
    shapes = {f["name"]: f for f in portable.manifest["functions"]}
    at_rest = np.array(["velocity" not in state for state in portable.states])
    worst: dict[str, float] = {}
    for draw, p, c in chunks(portable, 3, 20_000, 0.05):
        own = np.repeat(native("prepare", p)[0], SHARED, axis=0)
        for name in names:
            inputs = draw.inputs(shapes[name], c)
            found = native(name, *(own if given is c else given for given in inputs))
            error = _worst(portable, name, inputs, portable(name, *inputs), found)
            worst[name] = max(worst.get(name, 0.0), error)
        x, u = draw.made.random(draw.rng, 500, share=0.05), draw.made.random(draw.rng, 500, "input")
        x[::2] *= at_rest
        for f in ("step", "step_exact"):
            pair = [made(f, x, u, constants[:500], step) for made, constants in ((portable, c), (native, own))]
            worst[f] = max(worst.get(f, 0.0), _worst(portable, f, [x], *pair))
    return worst


@pytest.mark.parametrize("name", ROBOTS)
def test_native_keeps_its_bound(build: Builder, name: str) -> None:
    robot, effects = ROBOTS[name]
    portable, native = build(robot, "portable", effects), build(robot, "native", effects)
    names = tuple(f["name"] for f in portable.manifest["functions"])
    # without prepare: its polynomials' coefficients count by what they evaluate to
    worst = _native_errors(portable, native, tuple(name for name in names if name != "prepare"))
    assert {f: error for f, error in worst.items() if error > 1e-12} == {}


@pytest.mark.parametrize(
    "robot, count",
    [
        ("paper", len(WHOLE)),
        (wrist.ROBOT, 30),  # those of a rigid drive
        *(pytest.param(CHAINS[chain], len(WHOLE), marks=pytest.mark.campaign) for chain in ("RR", "RPR")),
        pytest.param(arm("RP", drive="friction_smoothing = 1.0"), len(WHOLE), marks=pytest.mark.campaign),
    ],
    ids=["springs", "rigid", "RR", "RPR", "RP"],
)
def test_lanes_keep_their_bound_with_all_effects_there_are(build: Builder, robot: str, count: int) -> None:
    """Arms whose native builds with all effects a diagnosis needs as well."""
    portable, native = (build(robot, profile, WHOLE) for profile in ("portable", "native"))
    assert len(native.manifest["effects"]) >= count
    worst = _native_errors(portable, native, IN_LANES)
    assert {f: error for f, error in worst.items() if error > 1e-12} == {}


# -- the printer ------------------------------------------------------------------------------------------------------


def compiled_with(folder: Path, text: str, flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    (folder / "text.c").write_text(text)
    command = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", *flags, "text.c", "-o", "text.so", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(folder / "text.so"))


@pytest.mark.parametrize("name", ["paper", "every effect"])
def test_our_printing_equals_casadis_own(build: Builder, name: str, tmp_path: Path) -> None:
    robot, effects = ROBOTS[name]
    made = build(robot, "portable", effects)
    generator = ca.CodeGenerator("own.c")
    graphs = dict(functions(assembled(*source(name, tmp_path))))
    for graph in graphs.values():
        generator.add(graph)
    generator.generate(f"{tmp_path}/")
    command = ["cc", "-O0", "-ffp-contract=off", "-shared", "-fPIC", "own.c", "-o", "own.so", "-lm"]  # to the letter
    subprocess.run(command, cwd=tmp_path, check=True)
    for draw, p, c in chunks(made, 4, CHUNK, 0.2):
        for f in made.manifest["functions"]:
            inputs = [p] if f["name"] == "prepare" else draw.inputs(f, c)
            theirs = Interpreted(ca.external(f["name"], str(tmp_path / "own.so")), len(inputs[0]))(*inputs)
            for a, b in zip(theirs, made(f["name"], *inputs), strict=True):
                assert (bits(a) == bits(b)).all(), f["name"]


UNARY = [op for op in C_FUNCTIONS if op not in TWO_ARGUMENT_FUNCTIONS]
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.0, 1e-310, 1e308, -1e308, math.inf, -math.inf, math.nan, 1e22, 7.0)


def _every_operation() -> tuple[ca.Function, list[int]]:
    """All that can be printed, applied to x and y, and in which order."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    pairs = [*BINARY_OPERATORS, *COMPARISONS, *TWO_ARGUMENT_FUNCTIONS, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO]
    alone = [*UNARY, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV, ca.OP_NOT, ca.OP_SIGN]
    results = [ca.SX.binary(op, x, y) for op in pairs] + [ca.SX.unary(op, x) for op in alone]
    return ca.Function("every", [x, y], [ca.vertcat(*results)], ["x", "y"], ["out"]), [*pairs, *alone]


def test_every_operation_has_the_interpreters_meaning_at_special_numbers(tmp_path: Path) -> None:
    f, order = _every_operation()
    used = {f.instruction_id(k) for k in range(f.n_instructions())}
    assert used >= {*BINARY_OPERATORS, *COMPARISONS, *C_FUNCTIONS} - {ca.OP_CONSTPOW}
    library = compiled_with(tmp_path, "#include <math.h>\n" + scalar_function(f, "every").replace("void", "void", 1))
    pairs = np.array(list(itertools.product(SPECIAL, SPECIAL)))
    expected = Interpreted(f, len(pairs))(pairs[:, :1], pairs[:, 1:])[0]
    found = np.empty_like(expected)
    pointer = ctypes.POINTER(ctypes.c_double)
    for row, (x, y) in enumerate(pairs):
        arguments = [np.array([value]).ctypes.data_as(pointer) for value in (x, y)]
        library.hda_every(*arguments, found[row].ctypes.data_as(pointer))
    zeros = (pairs[:, :1] == 0) & (pairs[:, 1:] == 0) & (expected == 0) & (found == 0)
    free = np.array([[op in (ca.OP_FMIN, ca.OP_FMAX) for op in order]])  # C leaves open which zero they return
    wrong = np.argwhere((bits(expected) != bits(found)) & ~(zeros & free))
    assert wrong.size == 0, [(pairs[row], column) for row, column in wrong[:5]]


def test_lane_by_lane_operations_equal_the_scalar_ones(tmp_path: Path) -> None:
    """What `hda_vector.h` has no form for: the same text over four lanes, compiled, against the scalar operations."""
    lines, count = [], 0
    forms = [*UNARY, ca.OP_NOT]
    skipped = {  # have a vector form
        ca.OP_SIN, ca.OP_COS, ca.OP_TAN, ca.OP_ATAN, ca.OP_EXP, ca.OP_TANH, ca.OP_FABS, ca.OP_FLOOR,
    }  # fmt: skip
    for op in (op for op in forms if op not in skipped):
        lines += [vector_operation("v4")(op, f"t{count}", "a", ""), f"*(v4 *)(out + {4 * count}) = t{count};"]
        count += 1
    scalar = [scalar_operation(op, f"s{k}", "x[i]", "") for k, op in enumerate(op for op in forms if op not in skipped)]
    text = "#include <math.h>\ntypedef double v4 __attribute__((vector_size(32), aligned(8)));\n"
    text += "void lanes(const double *x, double *out) { const v4 a = *(const v4 *)x;" + "\n".join(lines) + "}\n"
    stores = "".join(f"out[{4 * k} + i] = s{k};" for k in range(count))
    text += (
        "void scalars(const double *x, double *out) { for (int i = 0; i < 4; i++) {"
        + "\n".join(scalar)
        + stores
        + "} }\n"
    )
    library = compiled_with(tmp_path, text, ("-Wall", "-Wextra", "-Werror"))
    pointer = ctypes.POINTER(ctypes.c_double)
    for x in np.array(SPECIAL[:12]).reshape(3, 4):
        lanes, scalars = np.empty(4 * count), np.full(4 * count, 7.0)
        library.lanes(x.ctypes.data_as(pointer), lanes.ctypes.data_as(pointer))
        library.scalars(x.ctypes.data_as(pointer), scalars.ctypes.data_as(pointer))
        assert (bits(lanes) == bits(scalars)).all()


def test_the_arc_tangent_of_lanes_is_the_library_s_to_a_few_last_places(tmp_path: Path) -> None:
    header = ROOT / "gen" / "templates" / "hda_vector.h"
    text = f'#include <math.h>\n#define HDA_W 4\n#define HDA_V v4\n#include "{header}"\n'
    text += "void over(const double *x, double *out, int count) { for (int k = 0; k < count; k += 4) {"
    text += "v4 a = *(const v4_loose *)(x + k), r; v4_atan(&a, &r); *(v4_loose *)(out + k) = r; } }\n"
    library = compiled_with(tmp_path, text, ("-Wall", "-Wextra", "-Werror"))
    sides = np.concatenate([np.geomspace(1e-310, 1e300, 2001), np.linspace(0.3, 3.0, 2001), np.abs(SPECIAL)])
    x = np.concatenate([sides, -sides, np.zeros(-2 * len(sides) % 4)])
    found, pointer = np.empty_like(x), ctypes.POINTER(ctypes.c_double)
    library.over(x.ctypes.data_as(pointer), found.ctypes.data_as(pointer), len(x))
    expected = np.arctan(x)
    number_of = ~np.isnan(x)
    assert (np.isnan(found) == np.isnan(x)).all() and (np.signbit(found) == np.signbit(expected))[number_of].all()
    assert (np.abs(found - expected) <= 4 * np.spacing(np.abs(expected)))[number_of].all()


@pytest.mark.parametrize("operation", [scalar_operation, vector_operation("v4")], ids=["scalar", "vector"])
def test_an_unknown_operation_is_refused(operation: Callable[..., str]) -> None:
    for op in (ca.OP_ERFINV, ca.OP_LIFT, ca.OP_PRINTME, 10_000):
        with pytest.raises(EmitError, match=f"no C for CasADi's operation number {op}"):
            operation(op, "t0", "a", "b")
    x = ca.SX.sym("x")
    with pytest.raises(EmitError):
        scalar_function(ca.Function("f", [x], [ca.erfinv(x)], ["x"], ["y"]), "f")


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_numbers_read_back_to_the_same_bits(value: float) -> None:
    text = format_double(value)
    if math.isnan(value):
        assert text == "NAN"
    elif math.isinf(value):
        assert text == ("INFINITY" if value > 0 else "-INFINITY")
    else:
        assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]?\d+)?", text)
        assert re.search(r"[.e]", text), "C would read a whole number"
        assert struct.pack("d", float(text)) == struct.pack("d", value)


def test_numbers_read_back_to_the_same_bits_in_c(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = rng.integers(-(2**63), 2**63, 3000).view(np.float64)
    values = np.concatenate([values[np.isfinite(values)], [0.0, -0.0, 5e-324, 1.7976931348623157e308, 0.1, 1e22, 1e16]])
    text = "const double numbers[] = {" + ", ".join(map(format_double, values)) + "};\n"
    library = compiled_with(tmp_path, text, ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"))
    read = np.ctypeslib.as_array((ctypes.c_double * len(values)).in_dll(library, "numbers"))
    assert (read.view(np.int64) == values.view(np.int64)).all()


# -- arrays that overlap ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile", ["portable", "native"])
@pytest.mark.parametrize("name", ["paper", "every effect"])
def test_an_output_may_take_the_place_of_an_input(build: Builder, name: str, profile: str) -> None:
    robot, effects = ROBOTS[name]
    made = build(robot, profile, effects)
    draw, step, tried = Draw(made, np.random.default_rng(5)), np.array([[5e-4]]), set()
    c = made("prepare", draw.parameters(1, 0.05))[0]
    x, u = made.random(draw.rng, 1, share=0.05), made.random(draw.rng, 1, "input")
    calls = [(f["name"], draw.inputs(f, c)) for f in made.manifest["functions"] if f["name"] != "prepare"]
    calls += [("step", [x, u, c, step]), ("step_exact", [x, u, c, step])]
    for f, inputs in calls:
        lengths, widths = made.sizes(f)
        expected = made(f, *inputs)
        for (i, length), (o, width) in itertools.product(enumerate(lengths), enumerate(widths)):
            if length == width:
                arguments = [np.array(given, copy=True, order="C") for given in inputs]
                results = [np.empty((1, n)) for n in widths]
                results[o] = arguments[i]
                made.module.bind(f, *arguments, *results).run()
                assert all((bits(a) == bits(b)).all() for a, b in zip(expected, results, strict=True)), (f, i, o)
                tried.add(f)
    assert {"rhs", "step", "step_exact", "impedance_joint_tick"} <= tried


# -- counts and bytes -------------------------------------------------------------------------------------------------

# Arithmetic operations, with sin, exp and the like as one each. A change here is a change of speed, wanted or not.
OPERATIONS = {
    "paper": {"rhs": 233, "rhs_exact": 233, "rhs_jacobian": 886, "mass_matrix": 21, "energy": 309, "outputs": 231},
    "pendulum": {"rhs": 92, "rhs_exact": 102, "rhs_jacobian": 505, "mass_matrix": 34, "energy": 67, "outputs": 47},
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_counts(build: Builder, name: str, tmp_path: Path) -> None:
    made = build(*ROBOTS[name][:1])
    graphs = dict(functions(assembled(*source(name, tmp_path))))
    counted = {f["name"]: f["operations"] for f in made.manifest["functions"]}
    assert {f: counted[f] for f in OPERATIONS[name]} == OPERATIONS[name]
    for f, graph in graphs.items():
        moves = graph.n_instructions() - counted[f]
        assert sum(graph.nnz_out(k) for k in range(graph.n_out())) <= moves <= graph.n_instructions()


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_same_sources_same_bytes(tmp_path: Path, profile: str) -> None:
    """Two processes with other hash seeds, folders, times and users' settings write the same files."""
    stub, made = stub_compiler(tmp_path), []
    for k in range(2):
        work = tmp_path / f"place {k}"
        work.mkdir()
        command = [
            sys.executable,
            "-m",
            "gen",
            "build",
            toml(work, MIXED),
            "--out",
            str(work / "build"),
            "--profile",
            profile,
        ]
        changed = {"PYTHONHASHSEED": str(k), "CC": str(stub), "PYTHONPATH": str(ROOT), "LC_ALL": ("C", "C.UTF-8")[k]}
        changed |= {"TZ": ("UTC", "Asia/Tokyo")[k], "PYTHONUTF8": str(k)}
        command += ["--effects", ",".join(ALL_EFFECTS[:: 1 - 2 * k])]
        done = subprocess.run(command, cwd=work, env=os.environ | changed, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        made.append(Path(done.stdout.strip()))
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in made)
    assert made[0].name == made[1].name
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == []


def test_same_sources_same_library(tmp_path: Path) -> None:
    made = []
    for k in range(2):
        work = tmp_path / f"place {k}"
        work.mkdir()
        command = [sys.executable, "-m", "gen", "build", toml(work, SMALL), "--out", str(work / "build")]
        changed = {"PYTHONHASHSEED": str(k), "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, cwd=work, env=os.environ | changed, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        folder = Path(done.stdout.strip())
        made.append((folder / json.loads((folder / "manifest.json").read_text())["library"]).read_bytes())
    assert made[0] == made[1]
