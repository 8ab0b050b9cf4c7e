"""Collision with the bottle: the set-up of Fig. 18, the trajectories of Figs. 19 to 21, Table V."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hdagen.paper.bottle import FRICTION, GRAVITY, MASS, RADIUS
from hdagen.paper.collided import (
    BY_B,
    BY_K,
    DEEP,
    FAST,
    PLACE,
    SENSIBLE,
    TABLE_5,
    Collided,
    collided,
    sets,
    starts,
    vibrations,
)
from hdagen.paper.prototype import Bench
from hdagen.paper.result import Axes, Choice, Claim, Curve, Grid, Result, path
from hdagen.plant import Array


def fig18(bench: Bench) -> Result:
    """The set-up, the bottle's path, force and clearance."""
    runs = sets(bench, "admittance")
    parts = [
        _plan(runs[0], runs[2]),
        _over_time("contact force", "force on the tip (N)", runs, [np.linalg.norm(one.force, axis=1) for one in runs]),
        _over_time("way of the bottle", "slid (m)", runs, [np.linalg.norm(r.place - r.place[0], axis=1) for r in runs]),
        _over_time("clearance of tip and bottle", "distance (m)", runs, [-one.depth for one in runs]),
    ]
    numbers = {f"set_{k + 1}": one.numbers() for k, one in enumerate(runs)}
    first = numbers["set_1"]
    claims = [
        Claim(
            "a six-litre bottle in the way results in a new trajectory",
            f"set 1 presses it with {first['largest_force']:.0f} N and slides it {1e3 * (first['slid'] or 0):.0f} mm; "
            f"the softer two go around it, at most {1e3 * (numbers['set_3']['pushed_back'] or 0):.0f} mm off the "
            "circle",
            None,
            f"it slides from {FRICTION * MASS * GRAVITY:.1f} N on",
        )
    ]
    text = (
        f"A bottle of {MASS:g} kg and {1e3 * RADIUS:g} mm radius stands {1e3 * DEEP:g} mm inside the circle, presses "
        "back as a spring with a damper and slides with dry friction. Admittance control, sets as in Fig. 19."
    )
    return Result(
        "fig18",
        "Collision: set-up, force and clearance",
        text,
        parts,
        claims,
        numbers,
        2,
        _choices(),
        {"set1": runs[0].run.log},
    )


def _plan(stiff: Collided, soft: Collided) -> Axes:
    """From above: circle, bottle before and after, tips."""
    around = np.linspace(0, 2 * np.pi, 90)
    ring = RADIUS * np.stack([np.cos(around), np.sin(around)], axis=1)
    curves = [
        path("circle", stiff.run.path, color="grey", dash="dashed", width=1.0),
        path("bottle, before", np.array(PLACE) + ring, color="ink", dash="dotted", width=1.0),
        path("bottle, after set 1", stiff.place[-1] + ring, color="ink", dash="solid", width=1.0),
        path("tip, set 1", stiff.run.simulation.tip, color="blue", dash="solid"),
        path("tip, set 3", soft.run.simulation.tip, color="vermilion", dash="dash-dotted"),
    ]
    return Axes("(b) from above", "x (m)", "y (m)", curves, equal=True)


def _over_time(heading: str, label: str, runs: Sequence[Collided], values: Sequence[Array]) -> Axes:
    """A curve for each set."""
    curves = [
        Curve(f"set {k}", one.run.log.time, column) for k, (one, column) in enumerate(zip(runs, values, strict=True), 1)
    ]
    return Axes(heading, "time (s)", label, curves)


def _trajectories(bench: Bench, name: str, law: str) -> Result:
    found = {"": sets(bench, law), "Table V, ": sets(bench, law, published=True)}
    parts = []
    for words, runs in found.items():
        for axis, letter in enumerate("xy"):
            time = runs[0].run.log.time
            curves = [
                Curve("trajectory input", time, runs[0].run.path[:, axis], color="grey", dash="dashed", width=1.0)
            ]
            curves += [Curve(f"MBK{k + 1}", time, _seen(one)[:, axis]) for k, one in enumerate(runs)]
            label = f"({'ab'[axis]}) {letter}-direction" if not words else f"{words}{letter}"
            parts.append(Axes(label, "time (s)", f"{letter} (m)", curves))
    numbers: dict[str, object] = {
        "sensible": [one.numbers() for one in found[""]],
        "published": [one.numbers() for one in found["Table V, "]],
    }
    text = (
        f"The circle with the bottle in its way under {law} control; below with the sets of Table V as published, "
        "drawn until the guard stops the arm."
    )
    numbers["vibration"] = vibrations(bench, law)
    if law == "impedance":
        numbers["start"] = starts(bench)
    logs = {f"set{k + 1}": one.run.log for k, one in enumerate(found[""])}
    return Result(name, f"Collision, {law} control", text, parts, _claims(law, bench), numbers, 2, logs=logs)


def _seen(one: Collided) -> Array:
    """The tip until the arm was lost."""
    tip = one.run.simulation.tip.copy()
    if one.run.lost is not None:
        tip[one.run.log.time > one.run.lost] = np.nan
    return tip


def fig19(bench: Bench) -> Result:
    """Admittance control."""
    return _trajectories(bench, "fig19", "admittance")


def fig20(bench: Bench) -> Result:
    """Impedance control."""
    return _trajectories(bench, "fig20", "impedance")


def _claims(law: str, bench: Bench) -> list[Claim]:
    runs, published = sets(bench, law), sets(bench, law, published=True)
    back = [1e3 * one.pushed_back for one in runs]
    other = [1e3 * one.pushed_back for one in sets(bench, "impedance" if law == "admittance" else "admittance")]
    by = vibrations(bench, law)
    falls_with_b = bool(np.all(np.diff(by["B"]) < 0))
    lost = [
        f"set {k + 1} stopped at {one.run.lost:.2f} s"
        if one.run.lost is not None
        else f"set {k + 1} {1e3 * one.pushed_back:.1f} mm"
        for k, one in enumerate(published)
    ]
    shown = {letter: " / ".join(f"{1e6 * v:.0f}" for v in values) for letter, values in by.items()}
    claims = [
        Claim(
            "controller 3, of the least K and the largest B, exhibits the highest compliance",
            f"{back[0]:.1f} / {back[1]:.1f} / {back[2]:.1f} mm off the path for sets 1 to 3",
            back[2] > back[1] > back[0],
        ),
        Claim(
            "a larger B reduces the vibration",
            f"B of {BY_B} N s/m: {shown['B']} µm rms above {FAST:g} Hz",
            falls_with_b,
        ),
        Claim(
            "a smaller K reduces the vibration",
            f"K of {BY_K} N/m: {shown['K']} µm rms above {FAST:g} Hz",
            by["K"][-1] > 1.1 * by["K"][0],
            "what vibrates is the drive against its friction and its Hall sensor, not the mass on the wanted spring",
        ),
        Claim(
            "as the compliance increases, the vibration becomes more significant (of Fig. 19 and 20)",
            f"sets 1 to 3: {' / '.join(f'{1e6 * one.vibration:.0f}' for one in runs)} µm rms",
            bool(runs[2].vibration > runs[0].vibration),
            "the paper says both this and the opposite; with B raised as K falls the damping grows",
        ),
        Claim(
            "the published sets of Table V",
            "; ".join(lost),
            None,
            "grams without springs are thrown by the sensor's noise"
            if law == "impedance"
            else "500 kg hardly notice a bottle, which is shoved out of the way",
        ),
    ]
    if law == "impedance":
        claims.append(_start(bench))
        less = all(ours <= theirs for ours, theirs in zip(back, other, strict=True))
        claims.insert(
            1,
            Claim(
                "after the collision impedance control is displaced less than admittance control",
                f"{' / '.join(f'{v:.2f}' for v in back)} mm against {' / '.join(f'{v:.2f}' for v in other)} mm for "
                "equal M, B, K",
                less,
                "equal M, B and K ask for equal displacement; what is left is how well each inner loop follows",
            ),
        )
    return claims


def _start(bench: Bench) -> Claim:
    found = starts(bench)
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


def fig21(bench: Bench) -> Result:
    """Both controllers with like compliance."""
    one, two = (collided(bench, law, SENSIBLE[1]) for law in ("impedance", "admittance"))
    fine = [collided(bench, law, SENSIBLE[1], fine=True) for law in ("impedance", "admittance")]
    time = one.run.log.time
    apart, apart_fine = (
        np.linalg.norm(a.run.simulation.tip - b.run.simulation.tip, axis=1) for a, b in ((one, two), fine)
    )
    touching = (one.depth > 0) | (two.depth > 0)
    parts = [
        Axes(
            f"{letter}-direction",
            "time (s)",
            f"{letter} (m)",
            [
                Curve("trajectory input", time, one.run.path[:, axis], color="grey", dash="dashed", width=1.0),
                Curve("impedance", time, one.run.simulation.tip[:, axis], color="blue", dash="solid"),
                Curve("admittance", time, two.run.simulation.tip[:, axis], color="vermilion", dash="dashed"),
            ],
        )
        for axis, letter in enumerate("xy")
    ]
    parts.append(
        Axes(
            "distance of the two tips",
            "time (s)",
            "distance (m)",
            [Curve("Hall sensors", time, apart), Curve("4096 counts", time, apart_fine)],
        )
    )
    published = collided(bench, "impedance", TABLE_5["impedance"][1])
    numbers = {
        "mean_apart": apart.mean(),
        "mean_apart_touching": apart[touching].mean(),
        "mean_apart_4096": apart_fine.mean(),
        "mean_apart_touching_4096": apart_fine[touching].mean(),
        "published_impedance_lost_at": published.run.lost,
    }
    claims = [
        Claim(
            "position tracking of both controllers is similar, 0.135 mm apart in the mean when colliding",
            f"{1e3 * apart.mean():.2f} mm in the mean ({1e3 * apart[touching].mean():.2f} mm while touching); with "
            f"4096 counts {1e3 * apart_fine.mean():.2f} mm ({1e3 * apart_fine[touching].mean():.2f} mm)",
            bool(apart.mean() < 0.135e-3),
            f"M, B, K of {SENSIBLE[1]} in both; the published pair cannot be compared, its impedance set stops the "
            f"arm at {published.run.lost} s. 0.135 mm is a third of the way by which a count of joint 1's Hall sensor "
            "moves the tip, 0.37 mm",
        ),
        Claim(
            "an approximate inverse relationship of the two controllers' parameters",
            "equal M, B and K give equal compliance in both laws here",
            False,
            "Table III's masses differ by 10⁶ because the impedance set is in another unit or another law; (25) and "
            "(26) have the same M, B, K",
        ),
    ]
    text = f"Both controllers with M, B, K = {SENSIBLE[1]} against the bottle."
    logs = {"impedance": one.run.log, "admittance": two.run.log}
    return Result("fig21", "Collision: both controllers compared", text, parts, claims, numbers, 2, logs=logs)


def table5(bench: Bench) -> Result:
    """The sets and what they do."""
    rows: list[tuple[str | float | None, ...]] = []
    numbers: dict[str, Mapping[str, float | None]] = {}
    for law in ("admittance", "impedance"):
        for published in (True, False):
            for k, (mbk, one) in enumerate(
                zip(TABLE_5[law] if published else SENSIBLE, sets(bench, law, published), strict=True)
            ):
                name = f"{law} {k + 1}{', Table V' if published else ''}"
                found = numbers[name] = one.numbers()
                stopped = f"{one.run.lost:.2f}" if one.run.lost is not None else "–"
                rows.append(
                    (
                        name,
                        *mbk,
                        found["largest_force"],
                        1e3 * (found["slid"] or 0.0),
                        found["work_on_bottle"],
                        1e3 * (found["pushed_back"] or 0.0),
                        1e3 * (found["clearance_after"] or 0.0),
                        stopped,
                    )
                )
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
    laws = {law: sets(bench, law) for law in ("admittance", "impedance")}
    words = [f"{law} {' / '.join(f'{1e3 * one.pushed_back:.1f}' for one in runs)} mm" for law, runs in laws.items()]
    softer = all(runs[2].pushed_back > runs[0].pushed_back for runs in laws.values())
    claims = [Claim("more compliant sets yield more", ", ".join(words), softer)]
    text = (
        "Largest contact force, way of the bottle, work on it, the tip's largest distance from its path while "
        "touching, and how near it comes on the second circle."
    )
    grid = Grid("Table V: parameters of the collision experiment, and what came of them", columns, rows, 3)
    return Result("table5", "Parameters of the collision experiment", text, [grid], claims, numbers, 1)


def _choices() -> list[Choice]:
    return [
        Choice(
            "place, stiffness and friction of the bottle",
            f"{1e3 * DEEP:g} mm inside the circle's top, 5000 N/m, μ = {FRICTION:g}",
            "a stiffer wall raises the first force peak; a smaller μ lets even soft sets move it",
        ),
        Choice(
            "parameters of Figs. 19 to 21",
            "sets with Table V's intent, equal for both controllers",
            "as published: drawn below them",
        ),
    ]
