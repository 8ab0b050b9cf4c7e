"""Compliance under admittance control, Fig. 11, and impedance control, Fig. 12: the tip on a circle is pushed in x and
then in y, while M, B and K vary one at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.control.reference_motion import circle
from hdagen.paper.prototype.figure_result import Axes, Choice, Claim, Curve, Grid, Result
from hdagen.paper.prototype.step_response import measure_responses, simulate_ideal
from hdagen.paper.prototype.virtual_prototype import (
    CARTESIAN_LAWS,
    CIRCLE_PUSHES,
    CIRCLE_RADIUS,
    PERIOD,
    PUSH_BANDS,
    PUSH_FORCE,
    TURN_SECONDS,
    Bench,
    cartesian_gains,
    paper_circle,
    simulate_pushed,
)
from hdagen.simulation.simulator import Simulation

PUSHED_SECONDS = 10.0
BASE_SET = {"M": 4.0, "B": 40.0, "K": 500.0}  # kg, N s/m, N/m, assumed: damping ratio 0.45, so that overshoot is seen
VARIED_VALUES = {"M": (1.0, 4.0, 16.0), "B": (20.0, 40.0, 80.0), "K": (250.0, 500.0, 1000.0)}
LEAST_OVERSHOOT = 0.02  # smallest overshoot that stands out of noise and friction; a smaller one counts as this
FLAT_POWER = 0.3  # largest power of K at which the settling time counts as independent of K
OTHER_CIRCLES = (
    (0.2, 0.0, 2.5),
    (0.2, 0.0, 10.0),
    (0.15, 0.1, TURN_SECONDS),
)  # m, m, s a turn: alternatives to the one of III.C
UNITS = {"M": "kg", "B": "N s/m", "K": "N/m"}


@dataclass(frozen=True)
class VariedRuns:
    """A law with one of M, B, K at three values: displacement (T, 3, 2, m) of the arm and of the ideal, and the
    runs."""

    letter: str
    displacement: Array
    ideal_displacement: Array
    runs: tuple[Simulation, ...]

    def measure_arm_and_ideal(self) -> tuple[Array, Array]:
        """Measure the responses of the arm and of the ideal, each (3, 2, 3) as `hdagen.paper.prototype.step_response`
        has them."""
        return measure_responses(self.displacement, CIRCLE_PUSHES, PERIOD), measure_responses(
            self.ideal_displacement, CIRCLE_PUSHES, PERIOD
        )


def run_varied(bench: Bench, law: str, letter: str, fine: bool = False) -> VariedRuns:
    """Run a law with three values of M, B or K, with Hall sensors or with 4096 counts a turn."""
    path = paper_circle(PUSHED_SECONDS)
    sets = [tuple({**BASE_SET, letter: value}.values()) for value in VARIED_VALUES[letter]]
    runs = tuple(
        bench.compute_once(
            (law, fine, *one), partial(simulate_pushed, bench, law, cartesian_gains(*one), path, fine=fine)
        )
        for one in sets
    )
    moved = np.stack([run.tip - path.position for run in runs], axis=1)
    return VariedRuns(letter, moved, simulate_ideal(np.array(sets), CIRCLE_PUSHES, PUSHED_SECONDS, PERIOD), runs)


def _all_varied(bench: Bench, law: str, fine: bool = False) -> dict[str, VariedRuns]:
    """The runs of a law with each of M, B and K varied."""
    return {letter: run_varied(bench, law, letter, fine) for letter in VARIED_VALUES}


def make_fig11(bench: Bench) -> Result:
    """Make Fig. 11: admittance control."""
    return _make_figure(bench, "fig11", "admittance")


def make_fig12(bench: Bench) -> Result:
    """Make Fig. 12: impedance control."""
    return _make_figure(bench, "fig12", "impedance")


def _make_figure(bench: Bench, name: str, law: str) -> Result:
    path = paper_circle(PUSHED_SECONDS)
    every, fine = _all_varied(bench, law), _all_varied(bench, law, fine=True)
    parts: list[Axes | Grid] = []
    for row, (letter, one) in enumerate(every.items()):
        for axis, word in enumerate("xy"):
            values = [f"{letter} = {value:g} {UNITS[letter]}" for value in VARIED_VALUES[letter]]
            curves = [Curve(words, path.time, one.displacement[:, k, axis]) for k, words in enumerate(values)]
            curves += [
                Curve(label, path.time, one.ideal_displacement[:, k, axis], color="ink", dash="dotted", width=0.8)
                for k, label in enumerate(("ideal", "", ""))  # the legend names them once
            ]
            heading = f"({'abcdef'[2 * row + axis]}) {word}, {letter} varied"
            parts.append(Axes(heading, "time (s)", "tip off the circle (m)", curves, bands=[PUSH_BANDS[axis]]))
    parts.append(_make_table(every))
    gap = {
        letter: float(np.abs(one.displacement - one.ideal_displacement).max() / np.abs(one.ideal_displacement).max())
        for letter, one in every.items()
    }
    numbers = {}
    for letter, one in every.items():
        arm, ideal = one.measure_arm_and_ideal()
        numbers[letter] = {"arm": arm.tolist(), "ideal": ideal.tolist()}
    logs = {
        f"{letter}{value:g}": run.log
        for letter, one in every.items()
        for value, run in zip(VARIED_VALUES[letter], one.runs, strict=True)
    }
    text = (
        f"The tip on the circle of III.C, pushed by {PUSH_FORCE:g} N in x from 3 to 4 s and in y from 6 to 7 s; how far"
        f" it is off the moving point. Base: M = {BASE_SET['M']:g} kg, B = {BASE_SET['B']:g} N s/m, K ="
        f" {BASE_SET['K']:g} N/m. Hall sensors, current loop, delay, friction and torsion as in the prototype. Dotted:"
        " what M, B and K promise."
    )
    claims = _make_claims(law, every, fine, gap)
    if law == "impedance":
        claims.append(_claim_similar_trends(bench))
    return Result(
        name,
        f"{law.capitalize()} control, M, B and K varied",
        text,
        parts,
        claims,
        {"answers": numbers, "largest_gap_to_ideal": gap, "kept": check_claims(every), "kept_4096": check_claims(fine)},
        2,
        _make_choices(bench, law, every),
        logs,
    )


def _make_table(every: Mapping[str, VariedRuns]) -> Grid:
    columns = (
        "",
        "settling x (s)",
        "ideal",
        "overshoot x (%)",
        "ideal ",
        "largest x (mm)",
        "ideal  ",
        "largest y (mm)",
    )
    rows: list[tuple[str | float, ...]] = []
    for letter, one in every.items():
        arm, ideal = one.measure_arm_and_ideal()
        for k, value in enumerate(VARIED_VALUES[letter]):
            row: list[str | float] = [f"{letter} = {value:g} {UNITS[letter]}"]
            for measure, scale in ((0, 1.0), (1, 100.0), (2, 1e3)):
                row += [scale * float(arm[k, 0, measure]), scale * float(ideal[k, 0, measure])]
            rows.append((*row, 1e3 * float(arm[k, 1, 2])))
    return Grid("settling to 10 % after the push, swing past the path, largest displacement", columns, rows, digits=3)


def _describe_response(found: Array) -> str:
    settling, overshoot, largest = found
    return f"settled after {settling:.2f} s, overshoot {100 * overshoot:.0f} %, {1e3 * largest:.1f} mm"


def _join_values(values: Array, unit: str, scale: float = 1.0) -> str:
    words = ("never" if np.isnan(value) else f"{scale * value:.3g}" for value in values)
    return f"{' / '.join(words)} {unit}"


def check_claims(every: Mapping[str, VariedRuns]) -> dict[str, bool]:
    """Tell which of the paper's claims hold for the runs, in both axes."""
    M, B, K = (every[letter].measure_arm_and_ideal()[0] for letter in "MBK")
    rise = {
        "M settles": M[..., 0],
        "M swings": M[..., 1],
        "B settles": -B[..., 0],
        "B swings": -B[..., 1],
        "K moves": -K[..., 2],
        "K swings": -K[..., 1],
    }
    found = {name: bool((np.diff(values, axis=0) > 0).all()) for name, values in rise.items()}
    spread = np.log(K[..., 0].max(axis=0) / K[..., 0].min(axis=0)) / np.log(
        max(VARIED_VALUES["K"]) / min(VARIED_VALUES["K"])
    )
    found["K settles"] = bool((spread < FLAT_POWER).all())
    return found


def fit_powers(every: Mapping[str, VariedRuns]) -> Array:
    """Powers of M and of B in settling time and overshoot, between the ends of their ranges, in x and y: (2, 2, 2)."""
    found = []
    for letter in "MB":
        ends = every[letter].measure_arm_and_ideal()[0][[0, -1], :, :2]
        ends[..., 1] = np.maximum(ends[..., 1], LEAST_OVERSHOOT)
        found.append(np.log(ends[1] / ends[0]) / np.log(VARIED_VALUES[letter][-1] / VARIED_VALUES[letter][0]))
    return np.array(found)


def _claim_similar_trends(bench: Bench) -> Claim:
    """Claim that both laws have similar trends in B and M."""
    apart, words = {}, []
    for fine, sensors in ((False, "Hall sensors"), (True, "4096 counts")):
        impedance, admittance = (fit_powers(_all_varied(bench, law, fine)) for law in CARTESIAN_LAWS)
        apart[fine] = float(np.abs(impedance - admittance).max())
        differ = f"{apart[fine]:.2f}"
        if not np.isfinite(apart[fine]):
            differ = "impedance control does not settle for every set"
        words.append(f"{sensors}: {differ}")
    return Claim(
        "the two compliance control methods have similar trends for adjusting parameters B and M",
        f"powers of M and B with which settling and overshoot go differ by at most, {'; '.join(words)}",
        bool(apart[True] < FLAT_POWER),
        f"held alike below {FLAT_POWER:g}, with encoders that let both laws follow their M, B and K",
    )


def _make_claims(
    law: str, every: Mapping[str, VariedRuns], fine: Mapping[str, VariedRuns], gap: Mapping[str, float]
) -> list[Claim]:
    M, B, K = (every[letter].measure_arm_and_ideal()[0] for letter in "MBK")
    hall, with_encoders = check_claims(every), check_claims(fine)

    def claim(paper: str, here: str, names: Sequence[str], why: str = "") -> Claim:
        holds, other = all(hall[name] for name in names), all(with_encoders[name] for name in names)
        reasons = [why]
        if other and not holds:
            reasons.insert(0, "with 4096 counts a turn it holds")
        if holds and not other:
            reasons.insert(0, "with 4096 counts a turn it does not hold")
        return Claim(paper, here, holds, "; ".join(filter(None, reasons)))

    return [
        claim(
            "a smaller M answers faster with less overshoot",
            f"M of 1, 4, 16 kg: settled after {_join_values(M[:, 0, 0], 's')} in x, {_join_values(M[:, 1, 0], 's')} in"
            f" y; overshoot in x {_join_values(M[:, 0, 1], '%', 100)}",
            ("M settles", "M swings"),
        ),
        claim(
            "a larger B answers faster with less overshoot",
            f"B of 20, 40, 80 N s/m: settled after {_join_values(B[:, 0, 0], 's')} in x,"
            f" {_join_values(B[:, 1, 0], 's')} in y; overshoot in x {_join_values(B[:, 0, 1], '%', 100)}",
            ("B settles", "B swings"),
            "holds while under-damped; the maps show where it stops",
        ),
        claim(
            "a larger K moves less, so the compliance is worse",
            f"K of 250, 500, 1000 N/m: at most {_join_values(K[:, 0, 2], 'mm', 1e3)} in x,"
            f" {_join_values(K[:, 1, 2], 'mm', 1e3)} in y",
            ("K moves",),
        ),
        claim(
            "when K increases, the overshoot decreases",
            f"the swing past the path after the push, in x {_join_values(K[:, 0, 1], '%', 100)} of the largest"
            f" displacement, {_join_values(K[:, 0, 1] * K[:, 0, 2], 'mm', 1e3)}",
            ("K swings",),
            "a stiffer spring on the same M and B is less damped; what decreases is the displacement itself, above",
        ),
        claim(
            "K does not affect the settling time",
            f"settled after {_join_values(K[:, 0, 0], 's')} in x, {_join_values(K[:, 1, 0], 's')} in y",
            ("K settles",),
            f"held equal where it goes with less than the power {FLAT_POWER:g} of K (with M and B it goes with about"
            " 1): the envelope is 2 M/B for every K while under-damped, and settling to a band comes in half swings",
        ),
        _claim_arm_follows(law, fine, gap),
    ]


def _claim_arm_follows(law: str, fine: Mapping[str, VariedRuns], gap: Mapping[str, float]) -> Claim:
    """Claim that the arm follows its M, B and K: no claim of the paper, so it has no verdict."""
    gap_fine = max(
        float(np.abs(one.displacement - one.ideal_displacement).max() / np.abs(one.ideal_displacement).max())
        for one in fine.values()
    )
    return Claim(
        "the arm follows its M, B and K",
        f"at most {100 * max(gap.values()):.0f} % of the largest displacement off the ideal; with 4096 counts "
        f"{100 * gap_fine:.0f} %",
        None,
        f"{law} control over drives with Hall sensors: the inner loop has 25 rad/s, with encoders 50 rad/s",
    )


def _make_choices(bench: Bench, law: str, every: Mapping[str, VariedRuns]) -> list[Choice]:
    own = every["M"].measure_arm_and_ideal()[0][1, 0]
    words = []
    for x, y, turn in OTHER_CIRCLES:
        path = circle(CIRCLE_RADIUS, (x, y), turn, PUSHED_SECONDS)
        make = partial(simulate_pushed, bench, law, cartesian_gains(*BASE_SET.values()), path)
        run = bench.compute_once((law, x, y, turn), make)
        found = measure_responses((run.tip - path.position)[:, None], CIRCLE_PUSHES, PERIOD)[0, 0]
        words.append(f"({x:g}, {y:g}) m, {turn:g} s: {_describe_response(found)}")
    return [
        Choice(
            "M, B, K and the force of Fig. 11 and 12",
            f"M, B, K about {tuple(BASE_SET.values())}, {PUSH_FORCE:g} N",
            "the maps: 10 000 other sets",
        ),
        Choice(
            "centre and speed of the circle",
            f"(0.2, 0) m, 5 s a turn: {_describe_response(own)} in x",
            "; ".join(words),
        ),
    ]
