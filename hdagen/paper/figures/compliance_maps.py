"""Maps of settling time, overshoot and largest displacement over M, B, K, and the limits of each claim of III.C."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.compliance_figures import BASE, FLAT, SECONDS, UNITS
from hdagen.paper.figures.gain_sweeps import KEEPS, REGIONS, Sweep, exponents, held, powers, share_that_keeps, whole
from hdagen.paper.prototype.figure_result import Axes, Claim, Curve, Grid, Map, Part, Result
from hdagen.paper.prototype.step_response import MEASURES
from hdagen.paper.prototype.virtual_prototype import PUSH, Bench, cartesian, fine_sensors, pushed, turns

LABELS = {letter: f"{letter} ({unit})" for letter, unit in UNITS.items()}
RATIO = "damping ratio B/(2 √(K M)) (1)"
VALUES = ("settling time (s)", "overshoot (1)", "largest displacement (m)")
CLAIMS = (
    ("M", "settling", 1),
    ("M", "overshoot", 1),
    ("B", "settling", -1),
    ("B", "overshoot", -1),
    ("K", "largest", -1),
)
WORDS = {
    ("M", "settling"): "smaller M settles faster",
    ("M", "overshoot"): "smaller M overshoots less",
    ("B", "settling"): "larger B settles faster",
    ("B", "overshoot"): "larger B overshoots less",
    ("K", "largest"): "larger K moves less",
}


PHASE = "Of a push that lasts 1 s the swing that follows goes by the phase in which it ends, too"


def maps11(bench: Bench) -> Result:
    """Make the maps of admittance control."""
    return _maps(bench, "maps11", "admittance")


def maps12(bench: Bench) -> Result:
    """Make the maps of impedance control."""
    return _maps(bench, "maps12", "impedance")


def _maps(bench: Bench, name: str, law: str) -> Result:
    sweep = whole(bench, law)
    shares = {key[:2]: share_that_keeps(sweep, *key) for key in CLAIMS}
    curves = [Curve(WORDS[key], *np.array(found).T) for key, found in shares.items()]
    by = {
        measure: {"arm": exponents(sweep, sweep.arm, measure), "ideal": exponents(sweep, sweep.ideal, measure)}
        for measure in MEASURES
    }
    goes = {letter: powers(sweep, sweep.arm, letter, "settling") for letter in "MBK"}
    flat = held(goes["K"], lambda power: abs(power) < FLAT)
    heading = "where claims hold: share of neighbours that keep each"
    parts: list[Part] = [
        *_planes(sweep),
        Axes(heading, RATIO, "share (1)", curves, log_x=True),
        _powers(sweep, "settling", "the settling time"),
        _powers(sweep, "overshoot", "the overshoot"),
        _table(by),
    ]
    lost = float(np.isnan(sweep.arm[..., 0, 2]).mean())
    numbers = {
        "sets": sweep.M.size,
        "sweep_seconds": sweep.seconds,
        "sweep_processor_seconds": sweep.processor_seconds,
        "threads": bench.threads,
        "lost_share": lost,
        "exponents": by,
        "holds_for_damping_ratios": {WORDS[key]: held(found) for key, found in shares.items()},
        "shares": {WORDS[key]: found for key, found in shares.items()},
        "settling_powers": goes,
        "settling_without_K_for_damping_ratios": flat,
    }
    text = (
        f"{sweep.M.size} sets of M, B and K, each 10 s in closed loop at 1 kHz on the prototype with encoders of 4096 "
        "counts: current loop, delay, friction with the smooth sign, hysteresis and torsion. Maps are planes of the "
        f"grid through the set nearest to that of Fig. {name[-2:]}; the push is {PUSH:g} N in x. "
        "Empty: not settled 2 s after it, or lost."
    )
    claims = _claims(by, shares, flat, lost)
    if law == "impedance":
        claims.append(_alike(bench, by))
    path = turns(SECONDS)
    middle = pushed(bench, law, cartesian(*BASE.values()), path, fine=True)
    logs, robots = {"middle": middle.log}, {"middle": bench.robot_file({}, sensors=fine_sensors())}
    title = f"{law.capitalize()} control, maps over M, B and K"
    return Result(name, title, text, parts, claims, numbers, 3, logs=logs, robots=robots)


def _alike(bench: Bench, by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]) -> Claim:
    """Claim that the exponents of M and B are similar in both laws."""
    other = whole(bench, "admittance")
    apart = {}
    for measure in ("settling", "overshoot"):
        theirs = exponents(other, other.arm, measure)
        for letter in "MB":
            for region in REGIONS:
                apart[measure, letter, region] = abs(by[measure]["arm"][letter][region] - theirs[letter][region])
    seen = {key: value for key, value in apart.items() if np.isfinite(value)}
    worst = max(seen, key=lambda key: seen[key])
    under = max(value for (_, _, region), value in seen.items() if region == "under-damped")
    usual = [_usual(sweep, worst[0], worst[2]) for sweep in (other, whole(bench, "impedance"))]
    return Claim(
        "admittance and impedance show similar trends for adjusting B and M",
        f"mean exponents of settling and overshoot by M and B differ by {under:.2f} at most under-damped, by "
        f"{seen[worst]:.2f} at most anywhere ({worst[0]} by {worst[1]}, {worst[2]})",
        bool(under < FLAT),
        f"held alike below {FLAT:g} under-damped; {worst[2]} the {worst[0]} is {usual[0]} (admittance) and {usual[1]} "
        "(impedance) in the median",
    )


def _usual(sweep: Sweep, measure: str, region: str) -> str:
    """The median of a measure in a region, in words."""
    low, high = REGIONS[region]
    value = float(np.nanmedian(sweep.arm[(sweep.ratio >= low) & (sweep.ratio < high)][:, 0, MEASURES.index(measure)]))
    if measure == "overshoot":
        return f"{100 * value:.2g} %"
    return f"{value:.2g} s"


def _planes(sweep: Sweep) -> list[Map]:
    """Draw three measures over three planes of the grid."""
    sides = {"M": sweep.M[:, 0, 0], "B": sweep.B[0, :, 0], "K": sweep.K[0, 0, :]}
    at = {letter: int(np.argmin(np.abs(np.log(side / BASE[letter])))) for letter, side in sides.items()}
    found = []
    for across, up, fixed in (("M", "B", "K"), ("K", "B", "M"), ("M", "K", "B")):
        for measure, label in enumerate(VALUES):
            plane = np.take(sweep.arm[..., 0, measure], at[fixed], axis="MBK".index(fixed))
            if "MBK".index(across) < "MBK".index(up):
                plane = plane.T
            heading = f"{label.partition(' (')[0]}, {fixed} = {sides[fixed][at[fixed]]:.3g} {UNITS[fixed]}"
            found.append(
                Map(heading, LABELS[across], LABELS[up], label, _edges(sides[across]), _edges(sides[up]), plane)
            )
    return found


def _powers(sweep: Sweep, measure: str, words: str) -> Axes:
    """Draw the powers of M, B and K in a measure, of the arm and of the ideal."""
    curves = []
    for of, table, dash in (("", sweep.arm, "solid"), (", ideal", sweep.ideal, "dotted")):
        for letter, color in zip("MBK", ("blue", "vermilion", "green"), strict=True):
            if found := powers(sweep, table, letter, measure):
                ratio, power = zip(*found, strict=True)
                curves.append(Curve(f"{letter}{of}", ratio, power, color=color, dash=dash))
    return Axes(f"power with which {words} goes with M, B, K", RATIO, "exponent (1)", curves, log_x=True)


def _range(found: tuple[float, float] | None) -> str:
    if found is None:
        return "nowhere"
    return f"for damping ratios of {found[0]:.2g} to {found[1]:.2g}"


def _edges(centres: Array) -> Array:
    middle = np.sqrt(centres[1:] * centres[:-1])
    return np.concatenate([[centres[0] ** 2 / middle[0]], middle, [centres[-1] ** 2 / middle[-1]]])


def _table(by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]) -> Grid:
    rows = []
    for measure in MEASURES:
        for letter in "MBK":
            arm, ideal = by[measure]["arm"][letter], by[measure]["ideal"][letter]
            rows.append((f"{measure} by {letter}", *(_both(arm[region], ideal[region]) for region in REGIONS)))
    columns = ["exponent, arm (ideal)"]
    for low, high in REGIONS.values():
        columns.append(f"ratio {low:g} to {high:g}" if high < np.inf else f"above {low:g}")
    return Grid(f"how each measure goes with M, B and K: {', '.join(REGIONS)}", columns, rows)


def _both(arm: float, ideal: float) -> str:
    first, second = (f"{value:.2f}" if np.isfinite(value) else "–" for value in (arm, ideal))
    return f"{first} ({second})"


def _claims(
    by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]],
    shares: Mapping[tuple[str, str], list[tuple[float, float]]],
    flat: tuple[float, float] | None,
    lost: float,
) -> list[Claim]:
    settles, swings, largest = (by[measure]["arm"] for measure in MEASURES)

    def where(key: tuple[str, str]) -> str:
        found, worst = held(shares[key]), min(share for _, share in shares[key])
        most = f"{100 * KEEPS:.0f} % of neighbouring sets"
        if worst >= KEEPS:
            return f"in {most} or more everywhere in the grid"
        if found is None:
            return f"nowhere in {most}, {100 * worst:.0f} % at worst"
        return f"in {most} or more {_range(found)}, {100 * worst:.0f} % at worst"

    under = "under-damped"
    return [
        Claim(
            "a smaller M settles faster, with less overshoot",
            f"faster {where(('M', 'settling'))}, settling ∝ M^{settles['M'][under]:.2f} under-damped; less overshoot "
            f"{where(('M', 'overshoot'))}, overshoot ∝ M^{swings['M'][under]:.2f} under-damped",
            settles["M"][under] > 0.5 and swings["M"][under] > 0.2,
            f"the envelope is e^(−B t/2M); over-damped the slow pole is K/B, without M. {PHASE}",
        ),
        Claim(
            "a larger B settles faster, with less overshoot",
            f"faster {where(('B', 'settling'))}, settling ∝ B^{settles['B'][under]:.2f} under-damped and "
            f"B^{settles['B']['over-damped']:.2f} over-damped; less overshoot {where(('B', 'overshoot'))}, overshoot ∝ "
            f"B^{swings['B'][under]:.2f} under-damped",
            settles["B"][under] < -0.5 and swings["B"][under] < -0.5,
            f"over-damped a larger B is slower: the slow pole is K/B. {PHASE}",
        ),
        Claim(
            "a larger K moves less",
            f"less {where(('K', 'largest'))}, largest displacement ∝ K^{largest['K'][under]:.2f} under-damped",
            largest["K"][under] < -0.5,
            "at rest F/K; a push of 1 s is too short for the softest, over-damped sets",
        ),
        Claim(
            "K does not affect the settling time, under-damped",
            f"settling ∝ K^{settles['K'][under]:.2f} under-damped, K^{settles['K']['over-damped']:.2f} over-damped; "
            f"less than the power {FLAT:g} {_range(flat)}",
            abs(settles["K"][under]) < 0.2,
            "over-damped a larger K is faster: K/B",
        ),
        Claim(
            "(the paper shows nine curves a law)",
            f"{100 * lost:.1f} % of the sets lose the arm",
            None,
            "",
        ),
    ]
