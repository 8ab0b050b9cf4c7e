"""`python -m gen time`: every compiled function beside CasADi's interpreter and CasADi's own C of the same graph, in
one run.

The contestants take turns over the same states. Each is called in a loop in C through a pointer, no Python in between,
and the clock is read in C: in a row (`CALLS_PER_ROW` calls between two readings; ratios are made of these, round by
round) and singly (a reading before and after each call, the clock's own time taken off), which shows the tail that a
control loop meets. CasADi's own C is printed by its code generator and compiled -O2. Its interpreter is called through
CasADi's C interface, which copies nothing.
"""

from __future__ import annotations

import ctypes
import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from gen.builder import compiler
from gen.builder.build import BuildError, assemble_library, build_robot
from gen.builder.ownership import find_other_writer
from gen.model.arm_model import Model
from gen.model.emitted_function import make_dense_function
from gen.model.function_library import Library
from gen.robot.load_robot import load

SX = ca.SX
Floats = NDArray[np.float64]
CONTESTANTS = ("native", "portable", "casadi_c", "interpreter")
CALLS_PER_ROW = 256  # in a row, over as many states
SINGLE_CALLS = 30  # single calls a round
ARGUMENT_SPREADS = {  # of random arguments, uniform about 0; of others 0.5
    "q": 2.0, "v": 0.2, "a": 2.0, "joint_position": 2.0, "joint_velocity": 0.2, "motor_position": 200.0,
    "motor_velocity": 20.0, "motor_acceleration": 200.0, "joint_torque": 10.0, "tip_force": 10.0, "sliding": 1.0,
}  # fmt: skip
TORSION_SPREAD, SPEED_SPREAD = 5e-4, 0.2  # rad (3.5 N m), rad/s at the joint: spread of random states
DRIVER = """
#include <time.h>
typedef long long whole;
typedef int (*their_c)(const double **, double **, whole *, double *, int);
typedef int (*interpreter)(int, const double **, double **, whole *, double *, int);
typedef struct { void (*function)(void); int number; whole *iw; double *w; } contestant;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* ns[b] is the time of a call in batch b; row k of the pointers goes with call k, modulo rows. */
#define SAMPLE(name, call) \\
    void name(const contestant *me, const double **in, int ins, double **out, int outs, long rows, long calls, \\
              long batches, double *ns) { \\
        for (long b = 0, row = 0; b < batches; b++) { \\
            const double begin = now(); \\
            for (long k = 0; k < calls; k++, row = row + 1 < rows ? row + 1 : 0) { \\
                const double **i = in + row * ins; \\
                double **o = out + row * outs; \\
                call; \\
            } \\
            ns[b] = (now() - begin) / (double)calls; \\
        } \\
    }
SAMPLE(sample_nothing, (void)i; (void)o; __asm__ volatile("" : : "r"(me)))
SAMPLE(sample_casadi_c, ((their_c)me->function)(i, o, me->iw, me->w, 0))
SAMPLE(sample_interpreter, ((interpreter)me->function)(me->number, i, o, me->iw, me->w, 0))
"""


class Contestant(ctypes.Structure):
    """As in DRIVER."""

    _fields_ = (
        ("function", ctypes.c_void_p),
        ("number", ctypes.c_int),
        ("iw", ctypes.c_void_p),
        ("w", ctypes.c_void_p),
    )


@dataclass(frozen=True)
class Arguments:
    """Pointers to every row of inputs and outputs, and the arrays that they point into."""

    ins: NDArray[np.intp]
    outs: NDArray[np.intp]
    owned_arrays: tuple[Floats, ...]

    @classmethod
    def from_arrays(cls, inputs: list[Floats], outputs: list[Floats], width: tuple[int, int] = (0, 0)) -> Arguments:
        """Tables of CALLS rows, at least as wide as asked; an array of one row serves all."""
        tables = []
        for arrays, least in ((inputs, width[0]), (outputs, width[1])):
            table = np.zeros((CALLS_PER_ROW, max(len(arrays), least)), np.intp)
            for k, a in enumerate(arrays):
                table[:, k] = a.ctypes.data + np.arange(CALLS_PER_ROW) * (a.strides[0] if len(a) > 1 else 0)
            tables.append(table)
        return cls(tables[0], tables[1], (*inputs, *outputs))


Sample = Callable[[int, int], Floats]  # (calls, batches) -> ns a call (batches)


def make_step_graph(made: Library) -> ca.Function:
    """Write RK4 over the same right-hand side, in the order of operations of hda_step.c.

    Args:
        made: The library.

    Returns:
        The step as a function (x, u, c, h) -> next.

    """
    rhs = next(f.graph for f in made.functions if f.name == "rhs")
    x, u, c = (SX.sym(rhs.name_in(k), rhs.numel_in(k)) for k in range(3))
    h = SX.sym("h")
    k1 = rhs(x, u, c)
    k2 = rhs(x + 0.5 * h * k1, u, c)
    k3 = rhs(x + 0.5 * h * k2, u, c)
    k4 = rhs(x + h * k3, u, c)
    return make_dense_function(
        "step", {"x": x, "u": u, "c": c, "h": h}, {"next": x + h / 6.0 * ((k1 + k4) + 2.0 * (k2 + k3))}
    )


# -- arguments --------------------------------------------------------------------------------------------------------


def sample_states(model: Model, count: int) -> dict[str, Floats]:
    """Draw states and inputs near the arm's work, the same every time.

    Joints are anywhere within 2 rad, springs under a few N m, joint speeds about 0.2 rad/s: motors also turn slowly
    enough for friction to be between its ends.

    Args:
        model: The model.
        count: Number of states.

    Returns:
        x and u by name (count × k each).

    """
    random = np.random.default_rng(1)
    bounds = np.array([slot.bound for slot in model.x_slots])
    x = random.uniform(-0.1, 0.1, (count, bounds.size)) * bounds
    place = {slot.name: k for k, slot in enumerate(model.x_slots)}
    for j in model.joints:
        q, v = random.uniform(-2.0, 2.0, count), random.normal(size=count) * SPEED_SPREAD
        x[:, place[f"joint_position_{j}"]], x[:, place[f"joint_velocity_{j}"]] = q, v
        if j in model.flexible:
            ratio = model.robot.joints[j - 1].drive.ratio.nominal
            x[:, place[f"motor_position_{j}"]] = ratio * (q + random.normal(size=count) * TORSION_SPREAD)
            x[:, place[f"motor_velocity_{j}"]] = ratio * v * random.normal(1.0, 0.1, count)
    return {"x": x, "u": random.uniform(-0.2, 0.2, (count, len(model.u_slots))) * [s.bound for s in model.u_slots]}


def sample_inputs(name: str, graph: ca.Function, made: Library, known: Mapping[str, Floats]) -> list[Floats]:
    """Draw the arguments of a function.

    Args:
        name: The function's name.
        graph: Its graph.
        made: The library.
        known: Arguments that are known, by name.

    Returns:
        The arguments, (CALLS × k) or (1 × k) each.

    """
    random = np.random.default_rng(2)
    laws = {f.name: law for law in made.laws for f in (law.start_function, law.tick_function)}
    out = []
    for k in range(graph.n_in()):
        argument, length = graph.name_in(k), graph.numel_in(k)
        if argument == "gains":
            out.append(np.array([[gain.nominal for gain in laws[name].gains]]))
        elif argument in known:
            out.append(known[argument])
        else:
            out.append(random.uniform(-1, 1, (CALLS_PER_ROW, length)) * ARGUMENT_SPREADS.get(argument, 0.5))
    return out


# -- contestants ------------------------------------------------------------------------------------------------------


class TimingRig:
    """The driver, CasADi's C and our libraries, loaded; makes a contestant of each for a function."""

    def __init__(self, graphs: Mapping[str, ca.Function], folder: Path, builds: Mapping[str, Path]) -> None:
        generator = ca.CodeGenerator("theirs.c")
        for name, graph in graphs.items():  # renamed: a plain `step` would be the C library's own
            renamed = ca.Function(f"casadi_{name}", graph.sx_in(), graph.call(graph.sx_in()))
            generator.add(renamed)
            renamed.save(str(folder / f"{name}.casadi"))
        generator.generate(f"{folder}/")
        shapes = sorted({(graph.n_in(), graph.n_out()) for graph in graphs.values()})
        (folder / "driver.c").write_text(DRIVER + "".join(_sampler_code(*shape) for shape in shapes))
        compiler.plain_library(folder, ["theirs.c", "driver.c"], "theirs.so")
        self.folder, self.theirs = folder, ctypes.CDLL(str(folder / "theirs.so"))
        self.ours = {profile: ctypes.CDLL(str(_find_library(place))) for profile, place in builds.items()}
        self.interpreter = ctypes.CDLL(str(min(Path(ca.__file__).parent.glob("libcasadi.*"))))

    def make_sampler(
        self, who: str, name: str, graph: ca.Function, inputs: list[Floats], outputs: list[Floats]
    ) -> Sample:
        """Make the sampler of a contestant.

        Args:
            who: The contestant.
            name: The function's name.
            graph: Its graph.
            inputs: Its arguments.
            outputs: Arrays for its results.

        Returns:
            A function that times the contestant's calls.

        """
        kept: tuple[Any, ...] = ()
        if who in self.ours:
            symbol = getattr(self.ours[who], f"hda_{name}")
            me = Contestant(ctypes.cast(symbol, ctypes.c_void_p), 0, None, None)
            kind, given = f"ours_{len(inputs)}_{len(outputs)}", Arguments.from_arrays(inputs, outputs)
        else:
            sizes = (graph.sz_arg(), graph.sz_res(), graph.sz_iw(), graph.sz_w())
            kind, given = who, Arguments.from_arrays(inputs, outputs, (sizes[0], sizes[1]))
            kept = (np.zeros(sizes[2] + 1, np.int64), np.zeros(sizes[3] + 1))
            number, symbol = 0, getattr(self.theirs, f"casadi_{name}")
            if who == "interpreter":
                number, symbol = self._load_function(name), self.interpreter.casadi_c_eval_id
            me = Contestant(ctypes.cast(symbol, ctypes.c_void_p), number, kept[0].ctypes.data, kept[1].ctypes.data)
        return self._bind_sampler(kind, me, given, kept)

    def _load_function(self, name: str) -> int:
        if self.interpreter.casadi_c_push_file(str(self.folder / f"{name}.casadi").encode()):
            raise RuntimeError(f"CasADi does not read its own file of {name}")
        number = int(self.interpreter.casadi_c_id(f"casadi_{name}".encode()))
        self.interpreter.casadi_c_checkout_id(number)
        return number

    def clock_sampler(self) -> Sample:
        """The clock alone."""
        return self._bind_sampler(
            "nothing", Contestant(), Arguments.from_arrays([np.zeros((1, 1))], [np.zeros((1, 1))]), ()
        )

    def _bind_sampler(self, kind: str, me: Contestant, given: Arguments, kept: tuple[Any, ...]) -> Sample:
        call = getattr(self.theirs, f"sample_{kind}")
        call.restype = None
        tables: list[Any] = []
        for table in (given.ins, given.outs):
            tables += [ctypes.c_void_p(table.ctypes.data), ctypes.c_int(table.shape[1])]

        def sample(calls: int, batches: int) -> Floats:
            ns = np.empty(batches)
            counts = (ctypes.c_long(CALLS_PER_ROW), ctypes.c_long(calls), ctypes.c_long(batches))
            call(ctypes.byref(me), *tables, *counts, ctypes.c_void_p(ns.ctypes.data))
            assert given.owned_arrays is not None and kept is not None  # the arrays into which the call points
            return ns

        return sample

    def close(self) -> None:
        """Give CasADi's functions back."""
        self.interpreter.casadi_c_clear()


def _sampler_code(ins: int, outs: int) -> str:
    kinds = ", ".join(["const double *"] * ins + ["double *"] * outs)
    given = ", ".join([f"i[{k}]" for k in range(ins)] + [f"o[{k}]" for k in range(outs)])
    return f"SAMPLE(sample_ours_{ins}_{outs}, ((void (*)({kinds}))me->function)({given}))\n"


def _find_library(folder: Path) -> Path:
    library = folder / str(json.loads((folder / "manifest.json").read_text())["library"])
    if why := find_other_writer(library):
        raise BuildError(f"{folder}: compiled code is not run from there, for {why}; name your own with --out.")
    return library


@contextmanager
def open_rig(graphs: Mapping[str, ca.Function], builds: Mapping[str, Path]) -> Iterator[TimingRig]:
    """Load the contestants, and remove their files at the end.

    Args:
        graphs: The functions by name.
        builds: The folder of each profile's build.

    Yields:
        The loaded contestants.

    """
    with tempfile.TemporaryDirectory() as folder:
        rig = TimingRig(graphs, Path(folder), builds)
        try:
            yield rig
        finally:
            rig.close()


# -- the run ----------------------------------------------------------------------------------------------------------


def measure_times(robot: str, out: Path, rounds: int) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Time every function of a robot.

    Args:
        robot: A preset's name or the path of a robot.toml.
        out: The folder of all builds.
        rounds: Turns of every contestant.

    Returns:
        For each function and contestant: "row", ns a call in a row of CALLS, for each round; "single", median, p99,
        p99.9 and largest of single calls, ns.

    """
    library, _, _ = assemble_library(robot, load(robot), ())
    builds = {profile: build_robot(robot, profile, out)[0] for profile in ("native", "portable")}
    graphs = {f.name: f.graph for f in library.functions}
    model = library.graphs.model
    if not model.needs_stiff_step:
        graphs["step"] = make_step_graph(library)
    p = np.array([[q.nominal for q in model.quantities]])
    c, h = np.array(graphs["prepare"](p.ravel())).T, np.array([[model.robot.step]])
    known = {**sample_states(model, CALLS_PER_ROW), "p": p, "c": c, "h": h}
    with open_rig(graphs, builds) as contest:
        clock = float(np.median(contest.clock_sampler()(1, 1000)))
        result = {}
        for name, graph in graphs.items():
            inputs = sample_inputs(name, graph, library, known)
            outputs = [np.zeros((CALLS_PER_ROW, graph.numel_out(k))) for k in range(graph.n_out())]
            if name == "step":  # each from where the last one ended: a rollout
                path = np.tile(known["x"][:1], (CALLS_PER_ROW + 1, 1))
                inputs[0], outputs[0] = path[:-1], path[1:]
            runs = {who: contest.make_sampler(who, name, graph, inputs, outputs) for who in CONTESTANTS}
            result[name] = _time_in_turns(runs, rounds, clock)
    return result


def _time_in_turns(runs: Mapping[str, Sample], rounds: int, clock: float) -> dict[str, dict[str, list[float]]]:
    rows: dict[str, list[float]] = {who: [] for who in runs}
    singles: dict[str, list[Floats]] = {who: [] for who in runs}
    for turn in range(rounds + 1):  # the first one warms up
        for who, run in runs.items():
            row, single = run(CALLS_PER_ROW, 1), run(1, SINGLE_CALLS)
            if turn:
                rows[who].append(float(row[0]))
                singles[who].append(single - clock)
    return {who: {"row": rows[who], "single": _tail_percentiles(np.concatenate(singles[who]))} for who in runs}


def _tail_percentiles(values: Floats) -> list[float]:
    return [float(v) for v in (*np.percentile(values, [50, 99, 99.9]), values.max())]


def run_timing(options: Any) -> int:
    """Print the figures of `python -m gen time` as JSON.

    Args:
        options: The command's options: robot, out, rounds.

    Returns:
        Exit code 0.

    """
    print(json.dumps(measure_times(options.robot, options.out, options.rounds)))
    return 0
