"""The generated headers: sizes, the interface, the table of callable functions, the controllers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from gen.c_code.emitter import c_signature
from gen.model.arm_model import Model
from gen.model.control_loop import Law
from gen.model.emitted_function import EmittedFunction

# of the L-stable step, as a share of each state's bound: 6e-8 rad at worst on a link after 3 s, where 1e-6 is allowed
STEP_TOLERANCE = 1e-6
MOST_STEP_PARTS = 1024

# of the Python module and the manifest together, compiled into the library; one more whenever either changes so that a
# program of before or after would call or read it wrongly, which tests/builder/test_interface.py notices
INTERFACE = 2

STEP_FUNCTIONS = (
    ("step", (("x", "NX"), ("u", "NU"), ("c", "NC"), ("h", "1")), (("next", "NX"),), "one step with smooth friction"),
    (
        "step_exact",
        (("x", "NX"), ("u", "NU"), ("c", "NC"), ("h", "1")),
        (("next", "NX"),),
        "one step with set-valued friction",
    ),
    (
        "step_jacobian",
        (("x", "NX"), ("u", "NU"), ("p", "NP"), ("h", "1")),
        (("next", "NX"), ("by_x", "NX * HDA_NX"), ("by_u", "NX * HDA_NU"), ("by_p", "NX * HDA_NP")),
        "one smooth step and its derivatives by x, u and p, column by column",
    ),
)


def emit_sizes(model: Model, c: int, build: str, lanes: bool, reference: int | None = None) -> str:
    """Print hda_sizes.h.

    Args:
        model: The model.
        c: Number of constants.
        build: Hash of the build.
        lanes: Whether the right-hand sides run in lanes.
        reference: The largest number of reference values where it is not the guard's own.

    Returns:
        The C text.

    """
    names = [slot.name for slot in model.x_slots]
    slide = [names.index(name) for name in slide_velocities(model)]
    defines: dict[str, Any] = {
        "HDA_N": model.n,
        "HDA_NX": len(model.x_slots),
        "HDA_MECHANICAL": 2 * (model.n + len(model.flexible)),
        "HDA_NU": len(model.u_slots),
        "HDA_TIP": len(model.chain.axes),
        "HDA_WRENCH": len(model.u_slots) - model.n,
        "HDA_NP": len(model.quantities),
        "HDA_NC": c,
        "HDA_STIFF": int(model.needs_stiff_step),
        "HDA_LANES": int(lanes),
        "HDA_TOLERANCE": STEP_TOLERANCE,
        "HDA_MOST_PARTS": MOST_STEP_PARTS,
        "HDA_POSITION": names.index("joint_position_1"),
        "HDA_SLIDE": "{" + ", ".join(map(str, slide)) + "}",
        "HDA_BOUND": _c_array(slot.bound for slot in model.x_slots),
        "HDA_INPUT_BOUND": _c_array(slot.bound for slot in model.u_slots),
        "HDA_WIDTH": _c_array(_difference_widths(model)),
        "HDA_NOMINAL": _c_array(q.nominal for q in model.quantities),
        "HDA_STEP": repr(model.robot.step),
        "HDA_BUILD": f'"{build}"',
        "HDA_INTERFACE": INTERFACE,
    }
    if reference is not None:
        defines["HDA_REFERENCE_MAX"] = reference
    lines = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    meaning = "Sizes of this model, p's nominal values, the step it is meant for (s), the build it belongs to."
    return add_include_guard("HDA_SIZES_H", meaning, lines)


def slide_velocities(model: Model) -> list[str]:
    """Name the velocity in x whose sign is the direction of sliding at each joint.

    Args:
        model: The model.

    Returns:
        Names of entries of x: the motor's velocity, or the joint's where the drive is rigid.

    """
    names = []
    for j in model.joints:
        if j in model.rigid:
            names.append(f"joint_velocity_{j}")
        else:
            names.append(f"motor_velocity_{j}")
    return names


def _c_array(values: Iterable[float]) -> str:
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _difference_widths(model: Model) -> Iterator[float]:
    """A size of every entry of x, u and p, for differences where it is 0; wide for u, where a step is nearly linear."""
    yield from (0.01 * slot.bound for slot in model.x_slots)
    yield from (slot.bound for slot in model.u_slots)
    for q in model.quantities:
        yield 1e-3 * abs(q.nominal) or (q.high - q.low) or 1e-3


def emit_interface(functions: tuple[EmittedFunction, ...]) -> str:
    """Print hda_model.h, the interface of the model.

    Args:
        functions: The functions to emit.

    Returns:
        The C text.

    """
    own = "".join(f"/* {f.meaning} */\nHDA_API {c_signature(f.graph, f.name)};\n" for f in functions)
    steps = "".join(
        f"/* {meaning} */\nHDA_API {_declare_function(name, ins, outs)};\n"
        for name, ins, outs, meaning in STEP_FUNCTIONS
    )
    meaning = (
        "A compiled robot arm. Vectors are plain doubles, matrices stand column by column; the manifest\n"
        " * names every entry. c comes from hda_prepare(p, c), once for a set of parameters.\n"
        " * Nothing allocates, nothing keeps state. Sources of the model include this and not hda_guard.h:\n"
        " * their objects serve every number of reference values that a tick may carry."
    )
    includes = '#include "hda_input.h"\n#include "hda_rollout.h"\n#include "hda_sizes.h"\n'
    opened, closed = '#ifdef __cplusplus\nextern "C" {\n#endif\n', "#ifdef __cplusplus\n}\n#endif\n"
    return add_include_guard("HDA_MODEL_H", meaning, f"{includes}\n{opened}\n{own}\n{steps}\n{closed}")


def add_include_guard(name: str, meaning: str, text: str) -> str:
    """Print a header that may be included twice.

    Args:
        name: The macro that guards it.
        meaning: Its comment.
        text: Its content.

    Returns:
        The C text.

    """
    return f"/* {meaning} */\n#ifndef {name}\n#define {name}\n\n{text}\n#endif\n"


def _declare_function(name: str, ins: Any, outs: Any) -> str:
    arguments = [f"const double *{a}" for a, _ in ins] + [f"double *{a}" for a, _ in outs]
    return f"void hda_{name}({', '.join(arguments)})"


def emit_call_table(functions: tuple[EmittedFunction, ...], mpc: bool = False) -> str:
    """Print hda_table.h: the functions that Python may call, with the length of every array.

    Args:
        functions: The functions to emit.
        mpc: Whether the predictive controller is among them.

    Returns:
        The C text.

    """
    entries: list[Any] = [(f.name, f.inputs, f.outputs) for f in functions]
    entries += [
        (name, list(map(_with_size_macro, ins)), list(map(_with_size_macro, outs)))
        for name, ins, outs, _ in STEP_FUNCTIONS
    ]
    calls, rows = [], []
    for name, ins, outs in entries:
        arguments = ", ".join(f"a[{k}]" for k in range(len(ins) + len(outs)))
        calls.append(f"static void call_{name}(void *const *a) {{ hda_{name}({arguments}); }}\n")
        cells = [f"{{\"{a}\", 'd', {n}, 0}}" for a, n in ins] + [f"{{\"{a}\", 'd', {n}, 1}}" for a, n in outs]
        rows.append(f'    {{"{name}", {len(cells)}, call_{name}, {{{", ".join(cells)}}}}},\n')
    listed = (
        "".join(rows)
        + "    HDA_BRIDGE_ENTRIES\n"
        + "    HDA_MPC_BRIDGE_ENTRIES\n" * mpc
        + "    {NULL, 0, NULL, {{NULL, 0, 0, 0}}},\n"
    )
    text = f"{''.join(calls)}\nstatic const hda_entry hda_table[] = {{\n{listed}}};\n"
    included = '#include "hda_bridge.h"\n' + '#include "hda_mpc_bridge.h"\n' * mpc + '#include "hda_entry.h"\n'
    return add_include_guard("HDA_TABLE_H", "What Python may call.", f"{included}\n{text}")


def emit_laws(found: tuple[Law, ...]) -> str:
    """Print hda_laws.h: the controllers by number, with the bounds of their gains.

    Args:
        found: The controllers.

    Returns:
        The C text.

    """
    rows = " \\\n".join(
        f"  HDA_LAW({law.name}, {len(law.gains)}, {len(law.reference)}, {len(law.state)})" for law in found
    )
    numbers = "".join(f"#define HDA_LAW_{law.name} {k}\n" for k, law in enumerate(found))

    defines: dict[str, Any] = {
        "GAINS_MOST": max(len(law.gains) for law in found),
        "REFERENCE_MOST": max(len(law.reference) for law in found),
        "MEMORY_MOST": max(len(law.state) for law in found),
        "GAINS_NOMINAL": _rows_of_gains(found, "nominal"),
        "GAINS_LOW": _rows_of_gains(found, "low"),
        "GAINS_HIGH": _rows_of_gains(found, "high"),
    }
    lines = "".join(f"#define HDA_{name} {value}\n" for name, value in defines.items())
    meaning = (
        "The controllers: name, and numbers of gains, reference values and memory. The manifest names every entry."
    )
    return add_include_guard("HDA_LAWS_H", meaning, f"{numbers}#define HDA_LAW_LIST(HDA_LAW) \\\n{rows}\n{lines}")


def _rows_of_gains(found: tuple[Law, ...], which: str) -> str:
    """Nominal, low or high values of every law's gains as a C array."""
    rows = [_c_array(getattr(gain, which) for gain in law.gains) for law in found]
    return "{" + ", ".join(rows) + "}"


def _with_size_macro(argument: tuple[str, str]) -> tuple[str, str]:
    """The argument with its size as a macro."""
    name, size = argument
    if size == "1":
        return name, size
    return name, f"HDA_{size}"
