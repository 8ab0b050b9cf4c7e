"""Every file of a build, as text: generated C, the fixed C beside it, and the manifest."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

import casadi as ca

from gen import native
from gen.compliance import Law
from gen.description import canonical
from gen.effect import Effect
from gen.emit import preparation, scalar_function, signature
from gen.emitted import Emitted
from gen.library import Library
from gen.model import Model

TOLERANCE = 1e-6  # of the L-stable step, as a share of each state's bound: 6e-8 rad at worst on a link after 3 s, where 1e-6 is asked
MOST_PARTS = 1024
TEMPLATES = resources.files("gen") / "templates"

STEPS = (
    ("step", (("x", "NX"), ("u", "NU"), ("c", "NC"), ("h", "1")), (("next", "NX"),), "one step with smooth friction"),
    ("step_exact", (("x", "NX"), ("u", "NU"), ("c", "NC"), ("h", "1")), (("next", "NX"),), "one step with set-valued friction"),
    (
        "step_jacobian",
        (("x", "NX"), ("u", "NU"), ("p", "NP"), ("h", "1")),
        (("next", "NX"), ("by_x", "NX * HDA_NX"), ("by_u", "NX * HDA_NU"), ("by_p", "NX * HDA_NP")),
        "one smooth step and its derivatives by x, u and p, column by column",
    ),
)


def sizes(model: Model, c: int, build: str, lanes: bool) -> str:
    """hda_sizes.h."""
    names = [slot.name for slot in model.x_slots]
    slide = [names.index(f"{'joint' if j in model.rigid else 'motor'}_velocity_{j}") for j in model.joints]
    defines: dict[str, Any] = {
        "HDA_N": model.n,
        "HDA_NX": len(model.x_slots),
        "HDA_NU": len(model.u_slots),
        "HDA_NP": len(model.quantities),
        "HDA_NC": c,
        "HDA_STIFF": int(model.stiff),
        "HDA_LANES": int(lanes),
        "HDA_TOLERANCE": TOLERANCE,
        "HDA_MOST_PARTS": MOST_PARTS,
        "HDA_POSITION": names.index("joint_position_1"),
        "HDA_SLIDE": "{" + ", ".join(map(str, slide)) + "}",
        "HDA_BOUND": "{" + ", ".join(repr(float(slot.bound)) for slot in model.x_slots) + "}",
        "HDA_NOMINAL": "{" + ", ".join(repr(float(q.nominal)) for q in model.quantities) + "}",
        "HDA_STEP": repr(model.robot.step),
        "HDA_BUILD": f'"{build}"',
    }
    lines = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    return f"/* Sizes of this model; p's nominal values; the step it is meant for, s; the build that the library belongs to. */\n#ifndef HDA_SIZES_H\n#define HDA_SIZES_H\n\n{lines}\n#endif\n"


def header(functions: tuple[Emitted, ...]) -> str:
    """hda.h, the whole interface of the library."""
    own = "".join(f"/* {f.meaning} */\nHDA_API {signature(f.graph, f.name)};\n" for f in functions)
    steps = "".join(f"/* {meaning} */\nHDA_API {_declare(name, ins, outs)};\n" for name, ins, outs, meaning in STEPS)
    return (
        "/* A compiled robot arm. Vectors are plain doubles, matrices stand column by column; the manifest names every entry.\n"
        " * c comes from hda_prepare(p, c) and is made once for a set of parameters. Nothing allocates, nothing keeps state. */\n"
        "#ifndef HDA_H\n#define HDA_H\n\n"
        '#include "hda_guard.h"\n#include "hda_sizes.h"\n\n'
        '#ifdef __cplusplus\nextern "C" {\n#endif\n\n'
        f"{own}\n{steps}\n"
        "/* Rollouts: row k of u is held for dt[k] (s), in steps of at most `most`; x gets rows + 1 rows, the first is x0. */\n"
        "HDA_API void hda_rollout(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, double *x);\n"
        "HDA_API void hda_rollout_exact(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, double *x);\n"
        "/* `count` trajectories, row after row of each; own: each has its own c. Smooth friction. */\n"
        "HDA_API void hda_rollout_batch(const double *x0, const double *u, const double *c, const double *dt, long rows, double most, long count, int own, double *x);\n"
        "/* Trajectories that are advanced at once. */\n"
        "HDA_API int hda_batch_width(void);\n\n"
        "#ifdef __cplusplus\n}\n#endif\n\n#endif\n"
    )


def _declare(name: str, ins: Any, outs: Any) -> str:
    arguments = [f"const double *{a}" for a, _ in ins] + [f"double *{a}" for a, _ in outs]
    return f"void hda_{name}({', '.join(arguments)})"


def table(functions: tuple[Emitted, ...]) -> str:
    """hda_table.h: what Python may call, with the length of every array."""
    entries = [(f.name, [(a, str(n)) for a, n in f.inputs], [(a, str(n)) for a, n in f.outputs]) for f in functions]
    entries += [(name, [_sized(a) for a in ins], [_sized(a) for a in outs]) for name, ins, outs, _ in STEPS]
    calls, rows = [], []
    for name, ins, outs in entries:
        arguments = ", ".join(f"a[{k}]" for k in range(len(ins) + len(outs)))
        calls.append(f"static void call_{name}(void *const *a) {{ hda_{name}({arguments}); }}\n")
        cells = [f'{{"{a}", \'d\', {n}, 0}}' for a, n in ins] + [f'{{"{a}", \'d\', {n}, 1}}' for a, n in outs]
        rows.append(f'    {{"{name}", {len(cells)}, call_{name}, {{{", ".join(cells)}}}}},\n')
    return (
        "/* The functions that can be called by name, with the length and kind of every array. */\n"
        "typedef struct {\n    const char *name;\n    char kind; /* d float64, i int32, B bytes */\n    long count;\n    int writable;\n} hda_argument;\n"
        "typedef struct {\n    const char *name;\n    int count;\n    void (*call)(void *const *);\n    hda_argument arguments[12];\n} hda_entry;\n\n"
        + '#include "hda_bridge.h"\n\n'
        + "".join(calls)
        + "\nstatic const hda_entry hda_table[] = {\n"
        + "".join(rows)
        + "    HDA_BRIDGE_ENTRIES\n"
        + "    {NULL, 0, NULL, {{NULL, 0, 0, 0}}},\n};\n"
    )


def laws_header(laws: tuple[Law, ...]) -> str:
    """hda_laws.h: the controllers by number, with the bounds of their gains."""
    most = {what: max(len(getattr(law, what)) for law in laws) for what in ("gains", "reference", "state")}
    rows = " \\\n".join(f"  HDA_LAW({law.name}, {len(law.gains)}, {len(law.reference)}, {len(law.state)})" for law in laws)
    numbers = "".join(f"#define HDA_LAW_{law.name} {k}\n" for k, law in enumerate(laws))

    def bounds(which: str) -> str:
        return "{" + ", ".join("{" + ", ".join(repr(float(getattr(g, which))) for g in law.gains) + "}" for law in laws) + "}"

    return (
        "/* The controllers: name, and numbers of gains, reference values and memory. The manifest names every entry. */\n"
        "#ifndef HDA_LAWS_H\n#define HDA_LAWS_H\n\n"
        f"{numbers}#define HDA_LAW_LIST(HDA_LAW) \\\n{rows}\n"
        f"#define HDA_GAINS_MOST {most['gains']}\n#define HDA_REFERENCE_MOST {most['reference']}\n#define HDA_MEMORY_MOST {most['state']}\n"
        f"#define HDA_GAINS_NOMINAL {bounds('nominal')}\n#define HDA_GAINS_LOW {bounds('low')}\n#define HDA_GAINS_HIGH {bounds('high')}\n"
        "\n#endif\n"
    )


def _sized(argument: tuple[str, str]) -> tuple[str, str]:
    name, size = argument
    return name, size if size == "1" else f"HDA_{size}"


def operations(f: ca.Function) -> int:
    """Arithmetic operations of a function, elementary functions counted as one each."""
    moves = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
    return sum(f.instruction_id(k) not in moves for k in range(f.n_instructions()))


def manifest(made: Library, effects: tuple[Effect, ...], build: str, how: dict[str, Any]) -> dict[str, Any]:
    """What goes with the library: order, names, units, bounds, citations, sizes, robot, compiler."""
    model = made.graphs.model
    shapes = [
        {"name": f.name, "meaning": f.meaning, "inputs": f.inputs, "outputs": f.outputs, "operations": operations(f.graph)}
        for f in made.functions
    ]
    return {
        "schema": 1,
        "build": build,
        "robot": canonical(model.robot),
        "effects": [
            {"name": e.name, "place": e.port.place, "joints": model.applies(e), "amplitudes": e.amplitudes, "citation": e.citation}
            for e in effects
        ],
        "state": [vars(slot) for slot in model.x_slots],
        "input": [vars(slot) for slot in model.u_slots],
        "parameters": [vars(q) for q in model.quantities],
        "constants": int(made.graphs.c.numel()),
        "flexible": model.flexible,
        "stiff": model.stiff,
        "spring_inverse": vars(model.plan),
        "functions": shapes,
        "controllers": [
            {"name": law.name, "gains": [vars(g) for g in law.gains], "reference": law.reference, "state": law.state}
            for law in made.laws
        ],
        **how,
    }


def texts(made: Library, effects: tuple[Effect, ...], build: str, how: dict[str, Any], lanes: bool) -> dict[str, str]:
    """File name -> text; the same model gives the same bytes."""
    graphs, functions = made.graphs, made.functions
    scalar = [f for f in functions if not (lanes and f.name == "rhs")]
    files = {file.name: file.read_text(encoding="utf-8") for file in TEMPLATES.iterdir() if file.name.endswith((".c", ".h", ".txt"))}
    files["hda.h"] = header(functions)
    files["hda_sizes.h"] = sizes(graphs.model, int(graphs.c.numel()), build, lanes)
    files["hda_table.h"] = table(functions)
    files["hda_laws.h"] = laws_header(made.laws)
    ticks = {f.name for law in made.laws for f in (law.start, law.tick)}
    groups = {  # a file each, so that two compilers share the work
        "hda_laws.c": [f for f in scalar if f.name in ticks],
        "hda_model.c": [f for f in scalar if f.name != "prepare" and f.name not in ticks],
    }
    files["hda_prepare.c"] = '#include "hda.h"\n\n#include <math.h>\n\n' + preparation(graphs.preparation)
    for file, group in groups.items():
        files[file] = '#include "hda.h"\n\n#include <math.h>\n\n' + "\n".join(scalar_function(f.graph, f.name) for f in group)
    if lanes:
        files["hda_native.c"] = native.rhs(graphs)
        files["hda_batch_rhs.h"] = native.batch(graphs)
    files["manifest.json"] = json.dumps(manifest(made, effects, build, how), indent=1, sort_keys=True) + "\n"
    return files
