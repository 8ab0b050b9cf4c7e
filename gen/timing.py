"""`python -m gen time`: every compiled function against CasADi's interpreter and CasADi's own C of the same graph, in
one run.

The contestants take turns in rounds over the same random states, each in a loop in C, so that no Python is timed; a
round gives each a mean time a call. CasADi's own C is what `Function.generate` prints, compiled -O2.
"""

from __future__ import annotations

import ctypes
import importlib.util
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np

from gen import compile as compiler
from gen.build import assembled, build
from gen.emitted import dense
from gen.library import Library
from gen.model import Model
from gen.robot import load

SX = ca.SX
CALLS = 512  # in a row, over as many states
TORSION = 5e-4  # rad, spread of the random torsion: 3.5 N m

DRIVER = """
long long {name}_work(long long *, long long *, long long *, long long *);
int {name}(const double **, double **, long long *, double *, int);
void time_{name}(const double *const *in, const long *stride, int ins, double *const *out, int outs, long calls) {{
    static const double *arg[64];
    static double *res[64], w[65536];
    static long long iw[4096];
    for (long k = 0; k < calls; k++) {{
        for (int i = 0; i < ins; i++) arg[i] = in[i] + k * stride[i];
        for (int i = 0; i < outs; i++) res[i] = out[i];
        {name}(arg, res, iw, w, 0);
    }}
}}
"""


def step_graph(made: Library) -> ca.Function:
    """RK4 over the same right-hand side, in the order of operations of hda_step.c."""
    rhs = next(f.graph for f in made.functions if f.name == "rhs")
    x, u, c, h = (
        SX.sym(name, size)
        for name, size in (*((n, k) for n, k in zip("xuc", (rhs.numel_in(i) for i in range(3)), strict=True)), ("h", 1))
    )
    k1 = rhs(x, u, c)
    k2 = rhs(x + 0.5 * h * k1, u, c)
    k3 = rhs(x + 0.5 * h * k2, u, c)
    k4 = rhs(x + h * k3, u, c)
    return dense("step", {"x": x, "u": u, "c": c, "h": h}, {"next": x + h / 6.0 * ((k1 + k4) + 2.0 * (k2 + k3))})


def states(model: Model, count: int) -> dict[str, Any]:
    """Random inputs by name near where the arm works, (count, k) each; the same every time."""
    random = np.random.default_rng(1)
    x = random.uniform(-0.5, 0.5, (count, len(model.x_slots))) * [slot.bound for slot in model.x_slots]
    names = [slot.name for slot in model.x_slots]
    for j in model.flexible:
        q = x[:, names.index(f"joint_position_{j}")]
        ratio = model.robot.joints[j - 1].drive.ratio.nominal
        x[:, names.index(f"motor_position_{j}")] = ratio * (q + random.normal(size=count) * TORSION)
    u = random.uniform(-0.5, 0.5, (count, len(model.u_slots))) * [slot.bound for slot in model.u_slots]
    return {"x": x, "u": u}


def measure(robot: str, out: Path, rounds: int) -> dict[str, Any]:
    """Nanoseconds a call, a list of rounds for each function and contestant: native, portable, casadi_c,
    interpreter."""
    made, _, _ = assembled(robot, load(robot), ())
    modules = {profile: _module(build(robot, profile, out)[0]) for profile in ("native", "portable")}
    model = made.graphs.model
    graphs = {f.name: f.graph for f in made.functions if f.name != "prepare"}
    if not model.stiff:
        graphs["step"] = step_graph(made)
    given = states(model, CALLS)
    given["c"] = np.array(
        next(f.graph for f in made.functions if f.name == "prepare")([q.nominal for q in model.quantities])
    ).ravel()
    given["h"] = np.array([model.robot.step])
    random = np.random.default_rng(2)
    with tempfile.TemporaryDirectory() as folder:
        library = _casadi_library(graphs, Path(folder))
        result = {}
        for name, graph in graphs.items():
            inputs = [
                np.ascontiguousarray(
                    given[a]
                    if (a := graph.name_in(i)) in given
                    else random.uniform(-0.5, 0.5, (CALLS, graph.numel_in(i)))
                )
                for i in range(graph.n_in())
            ]
            outputs = [np.empty((CALLS, graph.numel_out(i))) for i in range(graph.n_out())]
            runs = {profile: _ours(module, name, inputs, outputs) for profile, module in modules.items()}
            runs["casadi_c"] = _theirs(library, name, inputs, outputs)
            runs["interpreter"] = _interpreted(graph, inputs, outputs)
            result[name] = _race(runs, rounds)
    return result


def _race(runs: dict[str, Callable[[], None]], rounds: int) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {who: [] for who in runs}
    for run in runs.values():
        run()
    for _ in range(rounds):
        for who, run in runs.items():
            begin = time.perf_counter_ns()
            run()
            times[who].append((time.perf_counter_ns() - begin) / CALLS)
    return times


def _module(folder: Path) -> ModuleType:
    manifest = json.loads((folder / "manifest.json").read_text())
    spec = importlib.util.spec_from_file_location("hda", folder / manifest["library"])
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _ours(module: ModuleType, name: str, inputs: list[Any], outputs: list[Any]) -> Callable[[], None]:
    return lambda: module.map(name, CALLS, *inputs, *outputs)


def _casadi_library(graphs: dict[str, ca.Function], folder: Path) -> ctypes.CDLL:
    generator = ca.CodeGenerator("theirs.c")
    for name, graph in graphs.items():  # under another name: one named plainly `step` is taken by the C library's own
        generator.add(ca.Function(f"casadi_{name}", graph.sx_in(), graph.call(graph.sx_in())))
    generator.generate(f"{folder}/")
    (folder / "driver.c").write_text("".join(DRIVER.format(name=f"casadi_{name}") for name in graphs))
    compiler.plain_library(folder, ["theirs.c", "driver.c"], "theirs.so")
    return ctypes.CDLL(str(folder / "theirs.so"))


def _theirs(library: ctypes.CDLL, name: str, inputs: list[Any], outputs: list[Any]) -> Callable[[], None]:
    ins = (ctypes.c_void_p * len(inputs))(*(a.ctypes.data for a in inputs))
    strides = (ctypes.c_long * len(inputs))(*(a.shape[1] if a.ndim == 2 else 0 for a in inputs))
    outs = (ctypes.c_void_p * len(outputs))(*(a.ctypes.data for a in outputs))
    call = getattr(library, f"time_casadi_{name}")
    call.restype = None
    arguments = (ins, strides, len(inputs), outs, len(outputs), ctypes.c_long(CALLS))
    return lambda: call(*arguments)


def _interpreted(graph: ca.Function, inputs: list[Any], outputs: list[Any]) -> Callable[[], None]:
    mapped = graph.map(CALLS, "serial")
    pair: Any = mapped.buffer()  # CasADi's own annotations of it are wrong
    buffer, call = pair
    kept: list[Any] = [np.ascontiguousarray(np.broadcast_to(a, (CALLS, a.shape[-1]))) for a in inputs]
    for i, a in enumerate(kept):
        buffer.set_arg(i, memoryview(a).cast("B").cast("d"))
    for i, a in enumerate(outputs):
        buffer.set_res(i, memoryview(a).cast("B").cast("d"))

    def run() -> None:
        call()
        assert kept and mapped and buffer  # what the call points into

    return run


def command(options: Any) -> int:
    """`python -m gen time`: the table as JSON."""
    print(json.dumps(measure(options.robot, options.out, options.rounds)))
    return 0
