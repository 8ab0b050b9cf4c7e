"""Maps of settling time, overshoot and largest displacement over M, B, K, and the limits of each claim of III.C: closed
loops of thousands of sets on the prototype, controller and sensors in the compiled batch."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import groupby, pairwise

import numpy as np

from hdagen.loops import closed_loops
from hdagen.paper.answer import MEASURES, answers, damping_ratio, ideally
from hdagen.paper.compliance import BASE, FLAT, SECONDS, UNITS
from hdagen.paper.prototype import PERIOD, PUSH, PUSHES, Bench, cartesian, controller, fine_sensors, pushed, turns
from hdagen.paper.result import Axes, Claim, Curve, Grid, Map, Part, Result
from hdagen.plant import Array

RANGES = {"M": (0.5, 32.0), "B": (5.0, 500.0), "K": (200.0, 2000.0)}  # kg, N s/m, N/m
SHAPE = (16, 25, 25)  # 10 000 sets
LABELS = {letter: f"{letter} ({unit})" for letter, unit in UNITS.items()}
RATIO = "damping ratio B/(2 √(K M)) (1)"
VALUES = ("settling time (s)", "overshoot (1)", "largest displacement (m)")
REGIONS = {"under-damped": (0.0, 0.7), "near critical": (0.7, 1.4), "over-damped": (1.4, np.inf)}  # damping ratio
CLASSES = np.geomspace(0.05, 8.0, 15)  # of damping ratio
KEEPS = 0.9  # share of neighbouring sets from which a claim holds
TOGETHER, COARSE = 2000, 0.01  # sets of the ideal in a batch; s between its rows, at which it is exact


@dataclass(frozen=True)
class Sweep:
    """A grid of sets: ``M``, ``B``, ``K`` each (m, b, k); responses (m, b, k, axes, 3) of arm and ideal; duration of
    the arm's runs by the clock and of all processors, s."""

    M: Array
    B: Array
    K: Array
    arm: Array
    ideal: Array
    seconds: float
    processor_seconds: float

    @property
    def ratio(self) -> Array:
        """Damping ratio of each set (m, b, k)."""
        return damping_ratio(self.M, self.B, self.K)


def whole(bench: Bench, law: str) -> Sweep:
    """Sweep the grid of a law's map, once a bench."""
    return bench.once(("swept", law), partial(swept, bench, law, SHAPE))


def swept(bench: Bench, law: str, shape: tuple[int, int, int]) -> Sweep:
    """Run every set of a grid: 10 s each at 1 kHz, with encoders of 4096 counts, the same pushes and noise for all."""
    sides = [np.geomspace(*RANGES[letter], count) for letter, count in zip("MBK", shape, strict=True)]
    M, B, K = np.meshgrid(*sides, indexing="ij")
    path, arm = turns(SECONDS), bench.lean()
    gains = {
        f"{name}_{axis}": grid.ravel()
        for name, grid in (("mass", M), ("damping", B), ("stiffness", K))
        for axis in "xy"
    }
    law_of = controller(arm, law, fine=True)

    def judge(tip: Array, _: Array) -> Array:
        return answers(tip - path.position[:, None], PUSHES, PERIOD).reshape(tip.shape[1], -1)

    begun, worked = time.perf_counter(), time.process_time()
    found = closed_loops(arm, law_of, path, gains, judge, PUSHES, fine_sensors(), seed=1, threads=bench.threads)
    took = time.perf_counter() - begun, time.process_time() - worked
    ideal = bench.once(("ideal", shape), partial(_ideal, np.stack([M.ravel(), B.ravel(), K.ravel()], axis=1)))
    size = (*shape, len(PUSHES), len(MEASURES))
    return Sweep(M, B, K, found.reshape(size), ideal.reshape(size), *took)


def _ideal(sets: Array) -> Array:
    """Responses (W, axes, 3) of the ideal with ``sets`` (W, 3) of M, B, K, the same for every law."""
    parts = np.array_split(sets, max(1, len(sets) // TOGETHER))
    return np.concatenate([answers(ideally(part, PUSHES, SECONDS, COARSE), PUSHES, COARSE) for part in parts])


def exponents(sweep: Sweep, table: Array, measure: str) -> dict[str, dict[str, float]]:
    """Mean exponent of M, B and K in a measure of the push in x, by region. At −1 doubling the letter halves the
    measure. A mean, as the settling time moves in steps of half a swing."""
    found: dict[str, dict[str, float]] = {}
    for letter in "MBK":
        slope = _slopes(sweep, table, letter, measure)
        found[letter] = {}
        for region, (low, high) in REGIONS.items():
            inside = slope[(sweep.ratio >= low) & (sweep.ratio < high) & np.isfinite(slope)]
            found[letter][region] = float("nan")
            if len(inside) > 20:
                found[letter][region] = float(np.mean(inside))
    return found


def _slopes(sweep: Sweep, table: Array, letter: str, measure: str) -> Array:
    """d log measure / d log letter at every set (m, b, k), NaN where the measure is too small."""
    axis, values = "MBK".index(letter), table[..., 0, MEASURES.index(measure)]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(np.where(values > 1e-4, values, np.nan))
    side = np.log(np.moveaxis(getattr(sweep, letter), axis, 0)[:, 0, 0])
    slopes: Array = np.gradient(logs, side, axis=axis)
    return slopes


def powers(sweep: Sweep, table: Array, letter: str, measure: str) -> list[tuple[float, float]]:
    """(damping ratio, mean exponent of ``letter`` in the measure) of each class of damping ratio."""
    slope = _slopes(sweep, table, letter, measure)
    found = []
    for low, high in pairwise(CLASSES):
        inside = slope[(sweep.ratio >= low) & (sweep.ratio < high) & np.isfinite(slope)]
        if len(inside) >= 10:
            found.append((float(np.sqrt(low * high)), float(np.mean(inside))))
    return found


def share_that_keeps(sweep: Sweep, letter: str, measure: str, sign: int) -> list[tuple[float, float]]:
    """(damping ratio, share of neighbours along ``letter`` whose measure moves by ``sign``, or less than a tenth of a
    percent) of each class of damping ratio. A run that never settles counts as the last; a lost arm does not count."""
    axis, values = "MBK".index(letter), sweep.arm[..., 0, MEASURES.index(measure)]
    lost = np.isnan(sweep.arm[..., 0, MEASURES.index("largest")])
    values = np.where(np.isnan(values) & ~lost, np.inf, values)
    with np.errstate(invalid="ignore"):  # of two runs that never settle neither is first
        step = np.diff(values, axis=axis)
    usual = float(np.median(values[np.isfinite(values)]))
    middle = np.moveaxis(sweep.ratio, axis, 0)
    ratio = np.moveaxis(np.sqrt(middle[1:] * middle[:-1]), 0, axis)
    found = []
    for low, high in pairwise(CLASSES):
        inside = (ratio >= low) & (ratio < high) & ~np.isnan(step)
        if inside.sum() >= 10:
            keeps = sign * step[inside] > -1e-3 * usual
            found.append((float(np.sqrt(low * high)), float(keeps.mean())))
    return found


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


def _nine_in_ten(share: float) -> bool:
    return share >= KEEPS


def held(
    shares: list[tuple[float, float]], keeps: Callable[[float], bool] = _nine_in_ten
) -> tuple[float, float] | None:
    """The longest range of damping ratios whose classes all keep the claim, by default in nine of ten neighbours; None
    where no class does."""
    runs = [list(run) for kept, run in groupby(shares, lambda one: keeps(one[1])) if kept]
    if not runs:
        return None
    longest = max(runs, key=len)
    return longest[0][0], longest[-1][0]


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
