"""Collision with the bottle: the set-up of Fig. 18, the trajectories of Figs. 19 to 21, Table V."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.collision_runs import (
    BOTTLE_OVERLAP,
    BOTTLE_PLACE,
    COLLISION_SETS,
    DAMPING_VALUES,
    STIFFNESS_VALUES,
    TABLE_5,
    VIBRATION_FREQUENCY,
    CollisionRun,
    compare_push_back,
    measure_start_errors,
    measure_vibrations,
    run_collision,
    run_parameter_sets,
)
from hdagen.paper.prototype.bottle import BOTTLE_FRICTION, BOTTLE_MASS, BOTTLE_RADIUS, BOTTLE_STIFFNESS, GRAVITY
from hdagen.paper.prototype.figure_result import Axes, Choice, Claim, Curve, Grid, Result, plot_path
from hdagen.paper.prototype.virtual_prototype import Bench

NOISE_SEEDS = (1, 2)  # of the sensors' noise


def make_fig18(bench: Bench) -> Result:
    """Make Fig. 18: the set-up, the bottle's path, force and clearance."""
    runs = run_parameter_sets(bench, "admittance")
    predictive = run_collision(bench, "predictive", COLLISION_SETS[1])
    parts = [
        _draw_plan(runs[0], runs[2]),
        _draw_over_time(
            "contact force",
            "force on the tip (N)",
            runs,
            [np.linalg.norm(one.force, axis=1) for one in runs],
            Curve(
                "predictive, set 2",
                predictive.run.log.time,
                np.linalg.norm(predictive.force, axis=1),
                color="ink",
                dash="dotted",
            ),
        ),
        _draw_over_time(
            "way of the bottle", "slid (m)", runs, [np.linalg.norm(r.place - r.place[0], axis=1) for r in runs]
        ),
        _draw_over_time("clearance of tip and bottle", "distance (m)", runs, [-one.depth for one in runs]),
    ]
    numbers = {f"set_{k + 1}": one.collect_numbers() for k, one in enumerate(runs)} | {
        "predictive": predictive.collect_numbers()
    }
    first = numbers["set_1"]
    claims = [
        Claim(
            "a six-litre bottle in the way results in a new trajectory",
            f"set 1 presses it with {first['largest_force']:.0f} N and slides it {1e3 * (first['slid'] or 0):.0f} mm; "
            f"the softer two go around it, at most {1e3 * (numbers['set_3']['pushed_back'] or 0):.0f} mm off the "
            "circle",
            None,
            f"it slides from {BOTTLE_FRICTION * BOTTLE_MASS * GRAVITY:.1f} N on",
        )
    ]
    text = (
        f"A bottle of {BOTTLE_MASS:g} kg and {1e3 * BOTTLE_RADIUS:g} mm radius stands {1e3 * BOTTLE_OVERLAP:g} mm"
        " inside the circle, presses back as a spring with a damper and slides with dry friction. Admittance control,"
        " sets as in Fig. 19."
    )
    return Result(
        "fig18",
        "Collision: set-up, force and clearance",
        text,
        parts,
        claims,
        numbers,
        2,
        _make_choices(bench),
        {f"set{k}": one.run.log for k, one in enumerate(runs, 1)} | {"predictive": predictive.run.log},
    )


def _draw_plan(stiff: CollisionRun, soft: CollisionRun) -> Axes:
    """From above: circle, bottle before and after, tips."""
    around = np.linspace(0, 2 * np.pi, 90)
    ring = BOTTLE_RADIUS * np.stack([np.cos(around), np.sin(around)], axis=1)
    curves = [
        plot_path("circle", stiff.run.path, color="grey", dash="dashed", width=1.0),
        plot_path("bottle, before", np.array(BOTTLE_PLACE) + ring, color="ink", dash="dotted", width=1.0),
        plot_path("bottle, after set 1", stiff.place[-1] + ring, color="ink", dash="solid", width=1.0),
        plot_path("tip, set 1", stiff.run.simulation.tip, color="blue", dash="solid"),
        plot_path("tip, set 3", soft.run.simulation.tip, color="vermilion", dash="dash-dotted"),
    ]
    return Axes("(b) from above", "x (m)", "y (m)", curves, equal=True)


def _draw_over_time(
    heading: str, label: str, runs: Sequence[CollisionRun], values: Sequence[Array], *beside: Curve
) -> Axes:
    """A curve for each set, and others beside them."""
    curves = [
        Curve(f"set {k}", one.run.log.time, column) for k, (one, column) in enumerate(zip(runs, values, strict=True), 1)
    ]
    return Axes(heading, "time (s)", label, [*curves, *beside])


def _make_trajectories(bench: Bench, name: str, law: str) -> Result:
    found = {"": run_parameter_sets(bench, law), "Table V, ": run_parameter_sets(bench, law, published=True)}
    predictive = run_collision(bench, "predictive", COLLISION_SETS[1])
    parts = []
    for words, runs in found.items():
        for axis, letter in enumerate("xy"):
            time = runs[0].run.log.time
            label = f"{words}{letter}"
            curves = [
                Curve("trajectory input", time, runs[0].run.path[:, axis], color="grey", dash="dashed", width=1.0)
            ]
            curves += [
                Curve(f"MBK{k + 1}", time, _tip_until_lost(one)[:, axis], width=width)
                for k, (one, width) in enumerate(zip(runs, (2.6, 1.9, 1.2), strict=True))
            ]
            if not words:
                label = f"({'ab'[axis]}) {letter}-direction"
                tip = predictive.run.simulation.tip[:, axis]
                curves.append(Curve("predictive, MBK2", time, tip, color="ink", dash="dotted", width=1.2))
            parts.append(Axes(label, "time (s)", f"{letter} (m)", curves))
    numbers: dict[str, object] = {
        "sensible": [one.collect_numbers() for one in found[""]],
        "published": [one.collect_numbers() for one in found["Table V, "]],
    }
    text = (
        f"The circle with the bottle in its way under {law} control; below with the sets of Table V as published, "
        "drawn until the guard stops the arm."
    )
    numbers["vibration"] = measure_vibrations(bench, law)
    if law == "impedance":
        numbers["start"] = measure_start_errors(bench)
    logs = {f"set{k}": one.run.log for k, one in enumerate(found[""], 1)}
    logs |= {f"table5_set{k}": one.run.log for k, one in enumerate(found["Table V, "], 1)}
    logs["predictive_set2"] = predictive.run.log
    return Result(name, f"Collision, {law} control", text, parts, _make_claims(law, bench), numbers, 2, logs=logs)


def _tip_until_lost(one: CollisionRun) -> Array:
    """The tip until the guard stopped the arm."""
    tip = one.run.simulation.tip.copy()
    if one.run.lost_at is not None:
        tip[one.run.log.time > one.run.lost_at] = np.nan
    return tip


def make_fig19(bench: Bench) -> Result:
    """Make Fig. 19: admittance control against the bottle."""
    return _make_trajectories(bench, "fig19", "admittance")


def make_fig20(bench: Bench) -> Result:
    """Make Fig. 20: impedance control against the bottle."""
    return _make_trajectories(bench, "fig20", "impedance")


def _make_claims(law: str, bench: Bench) -> list[Claim]:
    runs, published = run_parameter_sets(bench, law), run_parameter_sets(bench, law, published=True)
    back = [1e3 * one.largest_push_back for one in runs]
    by = measure_vibrations(bench, law)
    falls_with_b = bool(np.all(np.diff(by["B"]) < 0))
    lost = [f"set {k} {_describe_outcome(one)}" for k, one in enumerate(published, 1)]
    shown = {letter: _in_micrometres(values) for letter, values in by.items()}
    reasons = {
        "impedance": "grams without springs are thrown by the sensor's noise",
        "admittance": "500 kg hardly notice a bottle, which is shoved out of the way",
    }
    claims = [
        Claim(
            "controller 3, of the least K and the largest B, exhibits the highest compliance",
            f"{back[0]:.1f} / {back[1]:.1f} / {back[2]:.1f} mm off the path for sets 1 to 3",
            back[2] > back[1] > back[0],
        ),
        Claim(
            "a larger B reduces the vibration",
            f"B of {DAMPING_VALUES} N s/m: {shown['B']} µm rms above {VIBRATION_FREQUENCY:g} Hz",
            falls_with_b,
        ),
        Claim(
            "a smaller K reduces the vibration",
            f"K of {STIFFNESS_VALUES} N/m: {shown['K']} µm rms above {VIBRATION_FREQUENCY:g} Hz",
            by["K"][-1] > 1.1 * by["K"][0],
            "what vibrates is the drive against its friction and its Hall sensor, not the mass on the wanted spring",
        ),
        Claim(
            "as the compliance increases, the vibration becomes more significant (of Fig. 19 and 20)",
            f"sets 1 to 3: {_in_micrometres([one.vibration_rms for one in runs])} µm rms",
            bool(runs[2].vibration_rms > runs[0].vibration_rms),
            "the paper says both this and the opposite; with B raised as K falls the damping grows",
        ),
        Claim(
            "the published sets of Table V",
            "; ".join(lost),
            None,
            reasons[law],
        ),
    ]
    if law == "impedance":
        claims.append(_claim_start_error(bench))
        claims.insert(1, _claim_smaller_displacement(bench))
    return claims


def _describe_outcome(one: CollisionRun) -> str:
    """The largest distance from the path, or the time at which the guard stopped the arm, in words."""
    if one.run.lost_at is None:
        return f"{1e3 * one.largest_push_back:.1f} mm"
    return f"stopped at {one.run.lost_at:.2f} s"


def _in_micrometres(values: Sequence[float]) -> str:
    """Values, m, in µm."""
    return " / ".join(f"{1e6 * value:.0f}" for value in values)


def _in_millimetres(values: Sequence[float], form: str) -> str:
    """Values, m, in mm with a number format."""
    return " / ".join(format(1e3 * value, form) for value in values)


def _claim_smaller_displacement(bench: Bench) -> Claim:
    """Claim that impedance control yields less, with other noise and other encoders too."""
    found = {f"noise {seed}": compare_push_back(bench, False, seed) for seed in NOISE_SEEDS} | {
        "4096 counts": compare_push_back(bench, True, 1)
    }
    most = max(one.largest_push_back for one in run_parameter_sets(bench, "impedance"))
    words = "; ".join(f"{name} {_in_millimetres(values, '+.2f')}" for name, values in found.items())
    return Claim(
        "after the collision impedance control is displaced less than admittance control",
        f"equal M, B, K, sets 1 to 3: less by {words} mm, of {1e3 * most:.0f} at most",
        all(value > 0 for values in found.values() for value in values),
        "equal M, B and K ask for equal displacement; what is left is how each inner loop bears its Hall sensor, "
        "which favours the claim in the stiffest set, and the noise",
    )


def _claim_start_error(bench: Bench) -> Claim:
    found = measure_start_errors(bench)
    words = "; ".join(
        f"{name}: {1e3 * first:.2f} mm in the first second, {1e3 * later:.2f} mm after it"
        for name, (first, later) in found.items()
    )
    with_friction, without = found["no observer"], found["no observer, no dry friction"]
    return Claim(
        "a more noticeable error in x at the beginning, from the starting torque of the drive",
        words,
        with_friction[0] > 2 * without[0] and with_friction[0] > with_friction[1],
        "dry friction makes the error, switched off it is gone; it comes back at every reversal, not at the "
        "beginning only",
    )


def make_table5(bench: Bench) -> Result:
    """Make Table V: the sets and their runs."""
    rows: list[tuple[str | float | None, ...]] = []
    numbers: dict[str, Mapping[str, float | None]] = {}
    tried = []
    for law in ("admittance", "impedance"):
        tried += [(f"{law} {k}, Table V", law, mbk) for k, mbk in enumerate(TABLE_5[law], 1)]
        tried += [(f"{law} {k}", law, mbk) for k, mbk in enumerate(COLLISION_SETS, 1)]
    tried += [(f"predictive {k}", "predictive", mbk) for k, mbk in enumerate(COLLISION_SETS, 1)]
    for name, law, mbk in tried:
        one = run_collision(bench, law, mbk)
        found = numbers[name] = one.collect_numbers()
        stopped = "–" if one.run.lost_at is None else f"{one.run.lost_at:.2f}"
        slid, off, clear = (1e3 * (found[key] or 0.0) for key in ("slid", "pushed_back", "clearance_after"))
        rows.append((name, *mbk, found["largest_force"], slid, found["work_on_bottle"], off, clear, stopped))
    columns = (
        "",
        "M (kg)",
        "B (N s/m)",
        "K (N/m)",
        "force (N)",
        "slid (mm)",
        "work (J)",
        "off path (mm)",
        "clearance (mm)",
        "stopped (s)",
    )
    laws = {law: run_parameter_sets(bench, law) for law in ("admittance", "impedance", "predictive")}
    words = []
    for law, runs in laws.items():
        back = [one.largest_push_back for one in runs]
        words.append(f"{law} {_in_millimetres(back, '.1f')} mm")
    softer = all(runs[2].largest_push_back > runs[0].largest_push_back for runs in laws.values())
    claims = [Claim("more compliant sets yield more", ", ".join(words), softer)]
    text = (
        "Largest contact force, way of the bottle, work on it, the tip's largest distance from its path while "
        "touching, and how near it comes on the second circle."
    )
    grid = Grid("Table V: parameters of the collision experiment, and what came of them", columns, rows, 3)
    return Result("table5", "Parameters of the collision experiment", text, [grid], claims, numbers, 1)


def _make_choices(bench: Bench) -> list[Choice]:
    """The choices of the bottle, the sets, and the unit of Table V."""

    def words(stiffness: float = BOTTLE_STIFFNESS, friction: float = BOTTLE_FRICTION) -> str:
        found = run_collision(
            bench, "admittance", COLLISION_SETS[0], stiffness=stiffness, friction=friction
        ).collect_numbers()
        return f"{found['largest_force']:.1f} N, slid {1e3 * (found['slid'] or 0.0):.1f} mm"

    def off(runs: Sequence[CollisionRun]) -> str:
        return " / ".join(map(_describe_outcome, runs))

    admittance, impedance = (run_parameter_sets(bench, law, published=True) for law in ("admittance", "impedance"))
    kilograms = [run_collision(bench, "impedance", (1e3 * M, B, K)) for M, B, K in TABLE_5["impedance"]]
    return [
        Choice(
            "place, stiffness and friction of the bottle",
            f"{1e3 * BOTTLE_OVERLAP:g} mm inside the circle's top, {BOTTLE_STIFFNESS:g} N/m, μ = {BOTTLE_FRICTION:g}:"
            f" set 1 presses with {words()}",
            f"20 000 N/m: {words(stiffness=2e4)}; μ = 0.15: {words(friction=0.15)}",
        ),
        Choice(
            "parameters of Figs. 19 to 21",
            "sets with Table V's intent, equal for both controllers",
            f"as published: admittance {off(admittance)}; impedance {off(impedance)}",
        ),
        Choice(
            "unit of Table V's impedance masses: 1, 1.5 and 2",
            f"grams, as Table III and Fig. 21 have them: {off(impedance)}",
            f"kilograms: {off(kilograms)}",
        ),
    ]
