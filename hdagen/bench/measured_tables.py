"""Tables of measured figures: what the project reaches, and every bar of the benches, as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from hdagen.bench.simulator_race import RACED_RUNS

SourceContents = Mapping[str, Any]  # content of each source, by name
OWN_RUNS = ("step upon step in C", "batch")  # loops of ours that the bars of `hdagen bench panda` rest on


# -- words ------------------------------------------------------------------------------------------------------------


def _format_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def _format_number(value: float) -> str:
    """Three digits, without an exponent where that is shorter."""
    shown = f"{value:.3g}"
    return f"{value:.0f}" if "e+" in shown and abs(value) < 1e6 else shown


def _format_verdict(bar: Mapping[str, Any]) -> str:
    """Whether a bar is met; ``asked``, ``reached`` and ``bound`` "least" or "most"."""
    asked, reached, least = bar["asked"], bar["reached"], bar["bound"] == "least"
    if (reached >= asked) if least else (reached <= asked):
        return "met"
    over = asked / reached if least else reached / asked
    return f"**missed by {100 * (over - 1):.0f} %**"


def _format_limit(bar: Mapping[str, Any]) -> str:
    return f"at {bar['bound']} {_format_number(bar['asked'])} {bar.get('unit', '')}".rstrip()


def _find_bench_bars(found: SourceContents) -> dict[str, dict[str, Any]]:
    """The bars of `hdagen bench` by name; those that this machine's vectors are too narrow for are not judged."""
    return _list_bars(found["bench"])


def _list_bars(bench: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    return {bar["name"]: bar | {"asked": bar["bar"]} for bar in bench["bars"]}


def _list_predictive_bars(found: SourceContents) -> list[dict[str, Any]]:
    return [bar | {"bound": bar["kind"]} for bar in found["predictive"]["bars"]]


def _find_timing(found: SourceContents, name: str) -> Mapping[str, Any]:
    (timing,) = (t for t in found["bench"]["timings"] if t["name"] == name)
    return dict(timing)


def _find_claim(found: SourceContents, figure: str, paper: str) -> str:
    """The result here beside a sentence of the paper that begins with ``paper``."""
    (content,) = (content for content in found["paper"] if content["name"] == figure)
    (claim,) = (claim for claim in content["claims"] if claim["paper"].startswith(paper))
    return str(claim["here"])


def _describe_machine(machine: Mapping[str, str]) -> str:
    """A sentence on where and when."""
    busy = float(machine["load"]) > 0.5
    load = f", while {machine['load']} other programs ran on average: trust the ratios alone" if busy else ", idle"
    versions = ", ".join(
        f"{label} {machine[key]}" for key, label in (("python", "Python"), ("casadi", "CasADi"), ("hdagen", "hdagen"))
    )
    compiler = f"{machine['compiler']}, " if "compiler" in machine else ""
    return f"{machine['date']}, {machine['processors']} processors {machine['processor']}{load}; {compiler}{versions}."


# -- docs/method/accuracy.md ------------------------------------------------------------------------------------------


def build_reached_table(found: SourceContents) -> str:
    """Tabulate the figures that the project reaches.

    Args:
        found: Content of each source, by name.

    Returns:
        Markdown.

    """
    rows = [*_list_compiled_rows(found), *_list_control_rows(found), *_list_paper_rows(found), *_list_emps_rows(found)]
    heads = ("what", "figure", "bar", "command")
    return f"Measured on {_describe_machine(found['bench']['machine'])}\n\n{_format_table(heads, rows)}"


def _judge_bar(bar: Mapping[str, Any]) -> str:
    return f"{_format_limit(bar)}: {_format_verdict(bar)}"


def _list_compiled_rows(found: SourceContents) -> list[tuple[str, str, str, str]]:
    bars, command = _find_bench_bars(found), "`hdagen bench`"
    rows = []
    for what, name in (
        ("one evaluation of the two-joint arm, springs inverted to 1e-12 rad, native profile", "rhs"),
        ("one RK4 step", "step"),
    ):
        timing, others = _find_timing(found, name), _find_timing(found, name)["against"]
        ours = f"{timing['row']:.0f} ns; CasADi's own C {others['casadi_c']:.0f} ns, its interpreter"
        judged = (bars[f"native_{name}_against_{who}"] for who in ("casadi_c", "interpreter"))
        rows.append((what, f"{ours} {others['interpreter']:.0f} ns", "; ".join(map(_judge_bar, judged)), command))
    lanes = found["bench"]["machine"]["lanes"]
    batch = bars["batch_against_native_step"]
    rows.append(
        (
            f"the same in a batch, {lanes} lanes",
            f"{_find_timing(found, 'batch')['row']:.0f} ns a trajectory",
            "not judged: needs 8 lanes" if batch["met"] is None else _judge_bar(batch),
            command,
        )
    )
    for what, name in (
        ("a step from Python on bound buffers, over an empty call", "python_call_over_empty_call"),
        ("error of a link angle after 3 s at 0.5 ms, smooth friction", "error_without_bristles"),
        ("the same with bristles", "error_with_bristles"),
        ("build of `paper` from nothing", "build_cold"),
        ("the same, unchanged", "build_unchanged"),
    ):
        rows.append(
            (what, f"{_format_number(bars[name]['reached'])} {bars[name]['unit']}", _judge_bar(bars[name]), command)
        )
    return rows


def _list_control_rows(found: SourceContents) -> list[tuple[str, str, str, str]]:
    demo, mpc = found["demo"], found["predictive"]
    shares = [100 * one["largest_gap_share"] for one in demo["followed"].values()]
    bars = {bar["name"]: bar for bar in _list_predictive_bars(found)}
    osqp = bars["osqp at 1e-3 over riccati"]
    rows = [
        (
            "circle with two pushes of 15 N, friction on: tip against the ideal motion, impedance and admittance",
            f"{shares[0]:.1f} % and {shares[1]:.1f} % of the largest displacement",
            _judge_bar({"asked": 100 * demo["bar"], "reached": max(shares), "bound": "most", "unit": "%"}),
            "`hdagen demo`",
        ),
        (
            "predictive control, two joints, 20 nodes, walls and tip speed: whole tick",
            f"{mpc['timing']['phases'][2]['median']:.0f} µs in the median",
            "",
            "`hdagen bench --mpc`",
        ),
        (
            "its solver beside OSQP at 1e-3",
            f"{osqp['reached']:.0f} times faster",
            _judge_bar(osqp | {"unit": "times"}),
            "`hdagen bench --mpc`",
        ),
    ]
    if mpc["comparison"]:
        wall = [row["outcome"] for row in mpc["comparison"]["rows"] if row["course"].endswith("wall")]
        forces = ", ".join(f"{one['contact']:.1f}" for one in wall)
        what = "against a wall that may bear 20 N: contact force under impedance, admittance and predictive control"
        rows.append((what, f"{forces} N", "", "`hdagen bench --mpc`"))
    if mpc["runs"]:
        kept, legal = (sum(one[key] for one in mpc["runs"]) for key in ("kept", "legal"))
        what = f"{len(mpc['runs'])} random runs of predictive control"
        rows.append((what, f"inputs legal in {legal}, soft limits kept in {kept}", "", "`hdagen bench --mpc`"))
    return rows


def _list_paper_rows(found: SourceContents) -> list[tuple[str, str, str, str]]:
    rows = [
        (
            "joint torque without a torque sensor, kinematic torsion compensated, 4096 counts and 2¹⁸",
            _find_claim(found, "fig15", "after the system is stable"),
            "",
            "`hdagen paper fig15`",
        ),
        (
            "compliant control on these torques in place of a force sensor, 10 N at the tip",
            _find_claim(found, "sensorless", "the torque estimation results"),
            "",
            "`hdagen paper sensorless`",
        ),
    ]
    for content in found["paper"]:
        if "sweep" in content:  # of runs that kept how long it took
            sweep = content["sweep"]
            what = f"{sweep['sets']} sets of M, B and K, each 10 s of closed loop at 1 kHz: {content['title']}"
            took = (
                f"{sweep['sweep_seconds']:.0f} s by the clock, {sweep['sweep_processor_seconds']:.0f} s of processors"
            )
            rows.append((what, took, "", f"`hdagen paper {content['name']}`"))
    return rows


def _list_emps_rows(found: SourceContents) -> list[tuple[str, str, str, str]]:
    logs = found["identification"], found["pulses"]
    errors = [1e3 * log["errors"]["joint_position_1"] for log in logs]
    forces = [100 * log["force_error"][0] for log in logs]
    link = "`hdagen replay`, [EMPS](../examples/emps/README.md)"
    return [
        (
            "EMPS, a real machine: replay in windows of 0.25 s, identification and pulses",
            f"{errors[0]:.3f} mm, {errors[1]:.3f} mm rms",
            "",
            link,
        ),
        (
            "EMPS: force error of the inverse dynamics (published 4.08 % and 5.98 %)",
            f"{forces[0]:.2f} %, {forces[1]:.2f} %",
            "",
            link,
        ),
    ]


# -- pages of their own -----------------------------------------------------------------------------------------------


def build_bench_tables(found: SourceContents) -> str:
    """Tabulate every bar of `hdagen bench`, then the times of each function.

    Args:
        found: Content of each source, by name.

    Returns:
        Markdown.

    """
    times = [
        (
            t["name"],
            *(
                f"{v:.0f}" if v is not None else ""
                for v in (t["row"], *map(t["against"].get, ("portable", "casadi_c")))
            ),
            *(f"{t[key]:.0f}" for key in ("median", "p99", "p999")),
        )
        for t in found["bench"]["timings"]
    ]
    heads = ("function or loop", "in a row", "portable", "CasADi's C", "median", "p99", "p99.9")
    return (
        f"{_build_bars_table(found['bench'])}\n"
        f"Nanoseconds a call, of loops a step, native profile:\n\n{_format_table(heads, times)}"
    )


def build_panda_tables(found: SourceContents) -> str:
    """Tabulate every bar of `hdagen bench panda`, then the times beside other simulators.

    Args:
        found: Content of each source, by name.

    Returns:
        Markdown.

    """
    timings = {t["name"]: t for t in found["panda"]["timings"]}
    times = [(name, f"{timings[name]['row']:.0f}") for name in (*RACED_RUNS, *OWN_RUNS) if name in timings]
    return (
        f"{_build_bars_table(found['panda'])}\n"
        f"Nanoseconds a call, of loops a step, native profile:\n\n{_format_table(('run', 'median'), times)}"
    )


def _build_bars_table(bench: Mapping[str, Any]) -> str:
    """The machine, and every bar of one robot."""
    bars = []
    for name, bar in _list_bars(bench).items():
        low, high = (_format_number(value) for value in bar["spread"])
        verdict = "not judged: vectors are narrower here" if bar["met"] is None else _format_verdict(bar)
        bars.append((f"`{name}`", _format_limit(bar), _format_number(bar["reached"]), f"{low} to {high}", verdict))
    heads = ("bar", "asked", "reached", "10 to 90 %", "")
    return f"{_describe_machine(bench['machine'])}\n\n{_format_table(heads, bars)}"


def build_mpc_tables(found: SourceContents) -> str:
    """Tabulate every bar of the predictive controller, the times of its parts, and the courses.

    Args:
        found: Content of each source, by name.

    Returns:
        Markdown.

    """
    mpc = found["predictive"]
    bars = [
        (bar["name"], _format_limit(bar), _format_number(bar["reached"]), _format_verdict(bar))
        for bar in _list_predictive_bars(found)
    ]
    parts = [
        (t["name"], *(f"{t[key]:.0f}" for key in ("median", "p99", "largest")), f"{100 * t['solved']:.1f} %")
        for t in (*mpc["timing"]["phases"], *mpc["timing"]["solvers"])
    ]
    made = [
        _describe_machine(mpc["machine"]) + "\n",
        _format_table(("bar", "asked", "reached", ""), bars),
        "Microseconds of thread time on the closed loop of the second course:\n",
        _format_table(("part", "median", "p99", "largest", "solved"), parts),
    ]
    if mpc["scaling"] and mpc["comparison"]:  # a quick run has neither
        made += [*_build_size_table(mpc["scaling"]), *_build_course_table(mpc["comparison"])]
    return "\n".join(made)


def _build_size_table(scaling: Mapping[str, Any]) -> list[str]:
    sizes = [
        (str(size["joints"]), str(size["nodes"]), *(f"{size[key]:.3g}" for key in ("before", "iteration", "tick")))
        for size in (*scaling["by_nodes"], *scaling["by_joints"])
    ]
    return [
        "By size, µs: what is before the measurement, an iteration of the interior point, a whole tick:\n",
        _format_table(("joints", "nodes", "before", "iteration", "tick"), sizes),
    ]


def _build_course_table(comparison: Mapping[str, Any]) -> list[str]:
    courses = [
        (
            row["course"],
            row["controller"],
            *(f"{1e3 * row['outcome'][key]:.3f}" for key in ("distance", "largest")),
            f"{row['outcome']['contact']:.1f}",
            ", ".join(f"{name} {value:.2g}" for name, value in row["outcome"]["violated"].items() if value > 0)
            or "none",
        )
        for row in comparison["rows"]
    ]
    medians = (f"{name} {1e3 * float(np.median(values)):.4f} mm" for name, values in comparison["free"].items())
    return [
        "Tip against the ideal motion, mm; contact force, N; limits exceeded, SI:\n",
        _format_table(("course", "controller", "median", "largest", "contact", "exceeded"), courses),
        f"No limit near, median over seeds of the noise: {', '.join(medians)}.\n",
    ]


def build_sensing_table(found: SourceContents) -> str:
    """Tabulate the accuracy and the delay of the predictive controller's estimator.

    Args:
        found: Content of each source, by name.

    Returns:
        Markdown.

    """
    sensed = found["sense"]
    rows = [
        (
            f"normalised innovations, {one['plant']}",
            f"mean {one['mean']:.2f} of {one['readings']} expected; {100 * one['below']:.1f} % below the 95 % "
            f"quantile; neighbours correlate by {one['correlation']:.2f}",
        )
        for one in sensed["consistency"]
    ]
    rows += [
        (
            f"step of {step['size']:.0f} N without a force sensor, by the {step['by']}",
            f"half of it after {1e3 * step['half']:.1f} ms, nine tenths after {1e3 * step['nine']:.1f} ms; "
            f"bias {step['bias']:+.2f} N",
        )
        for step in sensed["steps"]
    ]
    rows += [
        (
            f"collision of {hit['size']:.0f} N, called at {sensed['threshold']:g} N",
            f"{100 * hit['share']:.0f} % of {hit['hits']}; after {1e3 * hit['median']:.1f} ms in the median, "
            f"{1e3 * hit['largest']:.1f} ms at most",
        )
        for hit in sensed["detections"]
    ]
    rows.append((f"false alarms in {sensed['seconds']:.0f} s of motion without contact", str(sensed["alarms"])))
    return _format_table(("what", "figure"), rows)
