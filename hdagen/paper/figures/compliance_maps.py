"""Maps of settling time, overshoot and largest displacement over M, B, K, and the limits of each claim of III.C."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.paper.figures.compliance_figures import BASE_SET, FLAT_POWER, GAIN_UNITS, PUSHED_SECONDS
from hdagen.paper.figures.gain_sweeps import (
    DAMPING_REGIONS,
    LEAST_KEEPING_SHARE,
    Sweep,
    exponents_by_ratio,
    longest_range_that_keeps,
    mean_exponents,
    share_that_keeps,
    sweep_map,
)
from hdagen.paper.prototype.figure_result import Axes, Claim, Curve, Grid, Map, Part, Result
from hdagen.paper.prototype.step_response import RESPONSE_MEASURES
from hdagen.paper.prototype.virtual_prototype import (
    PUSH_FORCE,
    Bench,
    cartesian_gains,
    fine_sensors,
    paper_circle,
    simulate_pushed,
)

GAIN_LABELS = {letter: f"{letter} ({unit})" for letter, unit in GAIN_UNITS.items()}
RATIO_LABEL = "damping ratio B/(2 √(K M)) (1)"
MEASURE_LABELS = ("settling time (s)", "overshoot (1)", "largest displacement (m)")
MONOTONE_CLAIMS = (
    ("M", "settling", 1),
    ("M", "overshoot", 1),
    ("B", "settling", -1),
    ("B", "overshoot", -1),
    ("K", "largest", -1),
)
CLAIM_WORDS = {
    ("M", "settling"): "smaller M settles faster",
    ("M", "overshoot"): "smaller M overshoots less",
    ("B", "settling"): "larger B settles faster",
    ("B", "overshoot"): "larger B overshoots less",
    ("K", "largest"): "larger K moves less",
}


PHASE_REMARK = "Of a push that lasts 1 s the swing that follows goes by the phase in which it ends, too"


def make_maps11(bench: Bench) -> Result:
    """Make the maps of admittance control."""
    return _make_maps(bench, "maps11", "admittance")


def make_maps12(bench: Bench) -> Result:
    """Make the maps of impedance control."""
    return _make_maps(bench, "maps12", "impedance")


def _make_maps(bench: Bench, name: str, law: str) -> Result:
    sweep = sweep_map(bench, law)
    shares = {key[:2]: share_that_keeps(sweep, *key) for key in MONOTONE_CLAIMS}
    curves = [Curve(CLAIM_WORDS[key], *np.array(found).T) for key, found in shares.items()]
    by = {
        measure: {
            "arm": mean_exponents(sweep, sweep.arm_responses, measure),
            "ideal": mean_exponents(sweep, sweep.ideal_responses, measure),
        }
        for measure in RESPONSE_MEASURES
    }
    goes = {letter: exponents_by_ratio(sweep, sweep.arm_responses, letter, "settling") for letter in "MBK"}
    flat = longest_range_that_keeps(goes["K"], lambda power: abs(power) < FLAT_POWER)
    heading = "where claims hold: share of neighbours that keep each"
    parts: list[Part] = [
        *_draw_planes(sweep),
        Axes(heading, RATIO_LABEL, "share (1)", curves, log_x=True),
        _draw_exponents(sweep, "settling", "the settling time"),
        _draw_exponents(sweep, "overshoot", "the overshoot"),
        _make_table(by),
    ]
    lost = float(np.isnan(sweep.arm_responses[..., 0, 2]).mean())
    numbers = {
        "sets": sweep.M.size,
        "sweep_seconds": sweep.seconds,
        "sweep_processor_seconds": sweep.processor_seconds,
        "threads": bench.threads,
        "lost_share": lost,
        "exponents": by,
        "holds_for_damping_ratios": {
            CLAIM_WORDS[key]: longest_range_that_keeps(found) for key, found in shares.items()
        },
        "shares": {CLAIM_WORDS[key]: found for key, found in shares.items()},
        "settling_powers": goes,
        "settling_without_K_for_damping_ratios": flat,
    }
    text = (
        f"{sweep.M.size} sets of M, B and K, each 10 s in closed loop at 1 kHz on the prototype with encoders of 4096 "
        "counts: current loop, delay, friction with the smooth sign, hysteresis and torsion. Maps are planes of the "
        f"grid through the set nearest to that of Fig. {name[-2:]}; the push is {PUSH_FORCE:g} N in x. "
        "Empty: not settled 2 s after it, or lost."
    )
    claims = _make_claims(by, shares, flat, lost)
    if law == "impedance":
        claims.append(_claim_similar_trends(bench, by))
    path = paper_circle(PUSHED_SECONDS)
    middle = simulate_pushed(bench, law, cartesian_gains(*BASE_SET.values()), path, fine=True)
    logs, robots = {"middle": middle.log}, {"middle": bench.robot_file({}, sensors=fine_sensors())}
    title = f"{law.capitalize()} control, maps over M, B and K"
    return Result(name, title, text, parts, claims, numbers, 3, logs=logs, robots=robots)


def _claim_similar_trends(bench: Bench, by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]) -> Claim:
    """Claim that the exponents of M and B are similar in both laws."""
    other = sweep_map(bench, "admittance")
    apart = {}
    for measure in ("settling", "overshoot"):
        theirs = mean_exponents(other, other.arm_responses, measure)
        for letter in "MB":
            for region in DAMPING_REGIONS:
                apart[measure, letter, region] = abs(by[measure]["arm"][letter][region] - theirs[letter][region])
    seen = {key: value for key, value in apart.items() if np.isfinite(value)}
    worst = max(seen, key=lambda key: seen[key])
    under = max(value for (_, _, region), value in seen.items() if region == "under-damped")
    usual = [_describe_median(sweep, worst[0], worst[2]) for sweep in (other, sweep_map(bench, "impedance"))]
    return Claim(
        "admittance and impedance show similar trends for adjusting B and M",
        f"mean exponents of settling and overshoot by M and B differ by {under:.2f} at most under-damped, by "
        f"{seen[worst]:.2f} at most anywhere ({worst[0]} by {worst[1]}, {worst[2]})",
        bool(under < FLAT_POWER),
        f"held alike below {FLAT_POWER:g} under-damped; {worst[2]} the {worst[0]} is {usual[0]} (admittance) and"
        f" {usual[1]} (impedance) in the median",
    )


def _describe_median(sweep: Sweep, measure: str, region: str) -> str:
    """The median of a measure in a region, in words."""
    low, high = DAMPING_REGIONS[region]
    value = float(
        np.nanmedian(
            sweep.arm_responses[(sweep.ratio >= low) & (sweep.ratio < high)][:, 0, RESPONSE_MEASURES.index(measure)]
        )
    )
    if measure == "overshoot":
        return f"{100 * value:.2g} %"
    return f"{value:.2g} s"


def _draw_planes(sweep: Sweep) -> list[Map]:
    """Draw three measures over three planes of the grid."""
    sides = {"M": sweep.M[:, 0, 0], "B": sweep.B[0, :, 0], "K": sweep.K[0, 0, :]}
    at = {letter: int(np.argmin(np.abs(np.log(side / BASE_SET[letter])))) for letter, side in sides.items()}
    found = []
    for across, up, fixed in (("M", "B", "K"), ("K", "B", "M"), ("M", "K", "B")):
        for measure, label in enumerate(MEASURE_LABELS):
            plane = np.take(sweep.arm_responses[..., 0, measure], at[fixed], axis="MBK".index(fixed))
            if "MBK".index(across) < "MBK".index(up):
                plane = plane.T
            heading = f"{label.partition(' (')[0]}, {fixed} = {sides[fixed][at[fixed]]:.3g} {GAIN_UNITS[fixed]}"
            found.append(
                Map(
                    heading,
                    GAIN_LABELS[across],
                    GAIN_LABELS[up],
                    label,
                    _cell_edges(sides[across]),
                    _cell_edges(sides[up]),
                    plane,
                )
            )
    return found


def _draw_exponents(sweep: Sweep, measure: str, words: str) -> Axes:
    """Draw the powers of M, B and K in a measure, of the arm and of the ideal."""
    curves = []
    for of, table, dash in (("", sweep.arm_responses, "solid"), (", ideal", sweep.ideal_responses, "dotted")):
        for letter, color in zip("MBK", ("blue", "vermilion", "green"), strict=True):
            if found := exponents_by_ratio(sweep, table, letter, measure):
                ratio, power = zip(*found, strict=True)
                curves.append(Curve(f"{letter}{of}", ratio, power, color=color, dash=dash))
    return Axes(f"power with which {words} goes with M, B, K", RATIO_LABEL, "exponent (1)", curves, log_x=True)


def _describe_range(found: tuple[float, float] | None) -> str:
    if found is None:
        return "nowhere"
    return f"for damping ratios of {found[0]:.2g} to {found[1]:.2g}"


def _cell_edges(centres: Array) -> Array:
    middle = np.sqrt(centres[1:] * centres[:-1])
    return np.concatenate([[centres[0] ** 2 / middle[0]], middle, [centres[-1] ** 2 / middle[-1]]])


def _make_table(by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]) -> Grid:
    rows = []
    for measure in RESPONSE_MEASURES:
        for letter in "MBK":
            arm, ideal = by[measure]["arm"][letter], by[measure]["ideal"][letter]
            rows.append(
                (f"{measure} by {letter}", *(_format_pair(arm[region], ideal[region]) for region in DAMPING_REGIONS))
            )
    columns = ["exponent, arm (ideal)"]
    for low, high in DAMPING_REGIONS.values():
        columns.append(f"ratio {low:g} to {high:g}" if high < np.inf else f"above {low:g}")
    return Grid(f"how each measure goes with M, B and K: {', '.join(DAMPING_REGIONS)}", columns, rows)


def _format_pair(arm: float, ideal: float) -> str:
    first, second = (f"{value:.2f}" if np.isfinite(value) else "–" for value in (arm, ideal))
    return f"{first} ({second})"


def _make_claims(
    by: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]],
    shares: Mapping[tuple[str, str], list[tuple[float, float]]],
    flat: tuple[float, float] | None,
    lost: float,
) -> list[Claim]:
    settles, swings, largest = (by[measure]["arm"] for measure in RESPONSE_MEASURES)

    def where(key: tuple[str, str]) -> str:
        found, worst = longest_range_that_keeps(shares[key]), min(share for _, share in shares[key])
        most = f"{100 * LEAST_KEEPING_SHARE:.0f} % of neighbouring sets"
        if worst >= LEAST_KEEPING_SHARE:
            return f"in {most} or more everywhere in the grid"
        if found is None:
            return f"nowhere in {most}, {100 * worst:.0f} % at worst"
        return f"in {most} or more {_describe_range(found)}, {100 * worst:.0f} % at worst"

    under = "under-damped"
    return [
        Claim(
            "a smaller M settles faster, with less overshoot",
            f"faster {where(('M', 'settling'))}, settling ∝ M^{settles['M'][under]:.2f} under-damped; less overshoot "
            f"{where(('M', 'overshoot'))}, overshoot ∝ M^{swings['M'][under]:.2f} under-damped",
            settles["M"][under] > 0.5 and swings["M"][under] > 0.2,
            f"the envelope is e^(−B t/2M); over-damped the slow pole is K/B, without M. {PHASE_REMARK}",
        ),
        Claim(
            "a larger B settles faster, with less overshoot",
            f"faster {where(('B', 'settling'))}, settling ∝ B^{settles['B'][under]:.2f} under-damped and "
            f"B^{settles['B']['over-damped']:.2f} over-damped; less overshoot {where(('B', 'overshoot'))}, overshoot ∝ "
            f"B^{swings['B'][under]:.2f} under-damped",
            settles["B"][under] < -0.5 and swings["B"][under] < -0.5,
            f"over-damped a larger B is slower: the slow pole is K/B. {PHASE_REMARK}",
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
            f"less than the power {FLAT_POWER:g} {_describe_range(flat)}",
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
