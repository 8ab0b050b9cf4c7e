"""The report: verdict and gap, the hypotheses, places and pictures of the effects, measured against model,
parameters, residuals, the data, and how to reproduce it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from hdagen.adoption.verdict import is_uninformed
from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.inference.candidate_priors import PRESENT_SIZE
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.report.effect_plots import draw_effect
from hdagen.diagnosis.report.gap_section import list_gap_levels, show_gap
from hdagen.diagnosis.report.residual_maps import draw_residual_maps
from hdagen.diagnosis.report.sentences import explain_confounding, name_effect, note_calibration, write_verdict
from hdagen.diagnosis.report.signal_plots import show_signals
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.whiteness import LJUNG_BOX_LAGS, measure_replay_whiteness
from hdagen.pages import page
from hdagen.pages.bar_chart import BarGroup, draw_bars
from hdagen.pages.curves import Panel, Series, draw_panels
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section
from hdagen.prediction.window_replay import REPLAY_WINDOW, Replay

MOST_DRAWN_CANDIDATES = 8  # hypotheses in the figure of probabilities
LEAST_LISTED_PROBABILITY = 1e-3  # probability below which a hypothesis is not listed
LEAST_PRINTED_PROBABILITY = 1e-4  # probability below which its value is not printed
LITTLE_PROBABILITY_WORDS = f"less than {LEAST_PRINTED_PROBABILITY:g}"
INFORMATIVE_WIDTH_RATIO = 0.5  # posterior by prior width, up to which the data determine a parameter well
CORRELATION_SECONDS = 0.25  # s, of the correlations of the residuals


def write_report(diagnosis: DiagnosisResult, path: Path, again: str) -> None:
    """Write report.html.

    Args:
        diagnosis: to be reported.
        path: of the page.
        again: the command that makes it again.

    """
    content, held, sight = diagnosis.content, diagnosis.holdout, diagnosis.residual_torque
    page.write_page(
        path,
        f"Diagnosis of {content['robot']['name']}",
        write_verdict(content),
        [
            show_gap(content),
            _show_candidates(sight.motion.arm.effects, content),
            *_show_location(sight, content),
            show_signals(held.portion, held.before, diagnosis.after),
            _show_parameters(sight, content),
            *_show_control(content),
            _show_whiteness(held.portion, held.before, diagnosis.after),
            _show_data(content),
        ],
        again,
    )


def _show_candidates(effects: EffectCatalogue, content: dict[str, Any]) -> Section:
    """The hypotheses: on held-out motion, by probability, and the effects that the log shows or would not show."""
    rows = [[_name_effects(h["effects"]) or "none", h["probability"]] for h in content["hypotheses"]]
    named = min(max(sum(float(r[1]) >= LEAST_LISTED_PROBABILITY for r in rows), 3), 2 * MOST_DRAWN_CANDIDATES)
    shown = rows[: min(named, MOST_DRAWN_CANDIDATES)]
    figures = [
        _show_ranking(content),
        draw_bars(
            "Most probable hypotheses",
            [str(r[0]) for r in shown],
            [BarGroup("", [round(float(r[1]), 4) for r in shown])],
            value_label=f"probability{note_calibration(content)}",
        ),
    ]
    text = (
        "Every effect of the model was tried on every joint, with the base parameters refitted within their tolerance"
        f" and every other effect within a small size. An effect below {100 * PRESENT_SIZE:g} % of its usual size"
        f" counts as none.{_explain_long_horizon(content)}\n\n{explain_confounding(effects, content)}"
    )
    if unseen := content["undetectable"]:
        this = "This"
        if _names_unknown(content):
            this = "Beside what is unknown this"
        text += (
            f"\n\n{this} log would not show, even in their usual size: {', '.join(name_effect(o) for o in unseen)}. "
            "hdagen excite designs a motion that does, of those that show in the encoders and the current at all."
        )
    return Section("How sure", text, [*figures, _show_hypotheses(rows, named), *_show_direct_evidence(content)])


def _show_hypotheses(rows: list[list[Any]], named: int) -> str:
    """A table of the first ``named`` hypotheses, each with its probability."""
    caption = ""
    if len(rows) > named:
        others = sum(float(r[1]) for r in rows[named:])
        together = LITTLE_PROBABILITY_WORDS
        if others >= LEAST_PRINTED_PROBABILITY:
            together = f"{others:.2g}"
        caption = f"The other {len(rows) - named} hold {together} together."
    listed = [list(row) for row in rows[:named]]
    for row in listed:
        if float(row[1]) < LEAST_PRINTED_PROBABILITY:
            row[1] = LITTLE_PROBABILITY_WORDS
    return draw_table("Hypotheses", ["hypothesis", "probability"], listed, caption=caption)


def _name_effects(entries: Sequence[str]) -> str:
    """Several effects in a row."""
    return " and ".join(name_effect(entry) for entry in entries)


def _names_unknown(content: dict[str, Any]) -> bool:
    """Whether the verdict names something unknown."""
    return any(name.startswith("unknown@") for name in content["verdict"])


def _explain_long_horizon(content: dict[str, Any]) -> str:
    """A remark where the verdict comes from long windows."""
    if content["method"]["calibrated"]:
        return ""
    return (
        f"\n\nWindows of {REPLAY_WINDOW:g} s told which known effect is the most probable: shorter ones leave much "
        "unexplained, whatever is named. Sealed checks have too few such cases, so its probability is not calibrated."
    )


def _show_direct_evidence(content: dict[str, Any]) -> list[str]:
    """A table of the effects that commands and encoders show by themselves; no table where there are none."""
    rows: list[list[str | float | None]] = []
    for one in content["direct_evidence"]:
        values = ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in one["parameters"].items())
        rows.append([name_effect(f"{one['effect']}@{one['joint']}"), values, 100 * one["left"]])
    if not rows:
        return []
    return [
        draw_table(
            "What commands and encoders show by themselves",
            ["effect", "as large as (SI)", "leaves, of what there is without it (%)"],
            rows,
            caption="Measured inputs beside their commands, and the two encoders of a joint beside the torsion, before "
            "any model is fitted: what no unknown torque can bend.",
        )
    ]


def _show_ranking(content: dict[str, Any]) -> str:
    """The gaps of the leading hypotheses on held-out motion."""
    gap, rungs = content["gap"], content["ranking"]
    return draw_bars(
        "Candidates on held-out motion",
        [_label_model(one) for one in rungs],
        [BarGroup("", [one["gap"] for one in rungs], _split_intervals(rungs))],
        value_label="replay error in multiples of noise",
        levels=list_gap_levels(gap),
        log=True,
        caption="What each leaves where no fit saw the motion, with base parameters of its own within their "
        "tolerance; 95 % by drawing blocks of windows anew.",
    )


def _split_intervals(entries: Iterable[dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Low and high ends of the intervals of some entries, NaN where one has none."""
    low, high = zip(*(one["interval"] or (math.nan, math.nan) for one in entries), strict=True)
    return list(low), list(high)


def _label_model(one: dict[str, Any]) -> str:
    """Label of an entry of the ranking."""
    if one["model"] == "robot file":
        return "robot file"
    named = _name_effects(one["effects"]) or "base parameters alone"
    if one["model"] == "verdict":
        return f"verdict: {named}"
    return named


def _show_location(sight: ResidualTorque, content: dict[str, Any]) -> list[Section]:
    """The place and regime of the gap, and the picture of each effect that is named."""
    entries, verdict = content["where"], content["verdict"]
    main: dict[str, Any] = {"joint": 1, "place": "motor"}
    if entries:
        main = entries[0]
    joint = max(main["joint"], 1)
    figures = [*_show_shares(content), *draw_residual_maps(sight, joint, main["place"], next(iter(verdict), ""))]
    balance = (
        "Missing torque is what the measured motion needs beyond what the model gives in the measured states, through "
        "one filter for both; it needs no replay."
    )
    said = [e["when"] for e in entries[: max(len(verdict), 1)] if e["when"]]
    located = Section("Where and when", "\n\n".join([*said, balance]), figures)
    drawn = []
    for k, entry in enumerate(verdict or [f"none@{joint}"]):
        place = main["place"]
        if k < len(entries):
            place = entries[k]["place"]
        drawn += draw_effect(sight, entry, place)
    if not verdict:
        return [located, Section("What is missing, by what it goes with", "", drawn)]
    heading = "The effect itself"
    if "unknown" in verdict[0]:
        heading = "What is missing, by what it goes with"
    return [Section(heading, "", drawn), located]


def _show_shares(content: dict[str, Any]) -> list[str]:
    """The share of each named effect in the closed gap, and that of base parameters; no figure where none is known."""
    verdict, named = content["verdict"], []
    known: list[dict[str, Any]] = []
    for k, entry in enumerate(content["where"]):
        name = f"base parameters, {entry['place']} {entry['joint'] or ''}".strip()
        if k < len(verdict):
            name = verdict[k]
        if entry["share"] is None or name.startswith("unknown@"):  # the share of the latter is of the remaining gap
            continue
        if "@" in name:
            name = f"{name_effect(name)} ({entry['place']})"
        named.append(name)
        known.append(entry)
    if not known:
        return []
    return [
        draw_bars(
            "Share of the closed gap by joint and place",
            named,
            [BarGroup("", [entry["share"] for entry in known], _split_intervals(known))],
            value_label="share (1)",
            caption="What comes back when it is taken out of the model after the verdict, of all that comes back; "
            "95 % by drawing seconds of held-out motion anew.",
        )
    ]


def _show_parameters(sight: ResidualTorque, content: dict[str, Any]) -> Section:
    """Prior and posterior of each parameter, and how much the data determine it."""
    rows: list[list[str | float | None]] = []
    for cause in content["causes"]:
        entry = f"{cause['effect']}@{cause['joint']}"
        if entry in content["verdict"]:
            suffix = ""
            if cause["joint"]:
                suffix = f"_{cause['joint']}"
            rows += [_make_row(sight, k + suffix, v) for k, v in cause["parameters"].items()]
    count = len(rows)
    rows += [_make_row(sight, name, value) for name, value in content["parameters"].items()]
    columns = ["name", "robot file", "± prior", "fitted", "± std", "unit", "ratio", "said"]
    text = (
        "As re-estimated with the verdict. The prior of a base parameter is its tolerance about the robot file's "
        "value; that of an effect's size is what is usually met. Ratio: posterior by prior width; where it is 1 the "
        "data said nothing of this one by itself. What they said nothing of keeps the robot file's number."
    )
    if count:
        text += f" Those of the verdict's effects come first ({count})."
    return Section("Parameters", text, [draw_table("Parameters", columns, rows, digits=3)])


def _make_row(sight: ResidualTorque, name: str, estimate: dict[str, Any]) -> list[str | float | None]:
    """A row of the table of parameters."""
    q = sight.motion.arm.parameters.described.get(name)
    std, unit = estimate.get("std"), estimate.get("unit", "")
    if q is None:
        return [name, None, None, estimate["value"], std, unit, None, "–"]
    prior = estimate.get("prior") or q.tolerance * abs(q.nominal) or (q.typical or None)
    ratio = None
    if std is None:
        said = "no width"
    elif not prior:
        said = "–"
    else:
        ratio = std / prior
        said = _say_informed(ratio, is_uninformed(estimate["value"] - q.nominal, std, prior))
    if estimate["end"]:
        said += "; at the end of its range"
    return [name, q.nominal, prior, estimate["value"], std, unit, ratio, said]


def _say_informed(ratio: float, kept: bool) -> str:
    """How much the data say of a parameter, by posterior over prior width; ``kept`` where it keeps its number."""
    if ratio < INFORMATIVE_WIDTH_RATIO:
        return "much"
    if kept:
        return "nothing"
    return "a little"


def _show_control(content: dict[str, Any]) -> list[Section]:
    """The effect of the verdict on a controller; no section where it was not simulated."""
    control = content["control"]
    if control is None:
        return []
    title = "What it changes for a controller"
    if "refused" in control:
        return [Section(title, f"Not simulated: {control['refused']}")]
    tracking, force = control["tracking"], control["contact_force"]
    rows: list[list[str | float | None]] = [
        ["rms distance of the tip from its path (mm)", 1e3 * tracking["before"], 1e3 * tracking["after"]],
        ["largest force at a wall (N)", force["before"], force["after"]],
    ]
    text = (
        f"In simulation: the machine is the model with the verdict, the controller {control['law']} with its default "
        "gains knows the robot file, or the verdict, as hdagen adopt and a build give it. It follows a swing within "
        "the log's motion, then joint 1 leads the tip 10 mm into a stiff wall. Its disturbance observer makes up for "
        "much of what a model misses at the motors, so a gap in replay may change little here."
    )
    columns = ["", "controller knows the robot file", "controller knows the verdict"]
    return [Section(title, text, [draw_table("Controllers", columns, rows, digits=3)])]


def _show_whiteness(held: LogPortion, before: Replay, after: Replay) -> Section:
    """The residuals' correlations, which show whether they are noise."""
    count, period = int(held.rows.sum()), held.log.period
    lags = max(LJUNG_BOX_LAGS, min(round(CORRELATION_SECONDS / period), count // 3))
    if count <= 2 * lags:
        return Section("What is left", "The held-out motion is too short for a test of whiteness.")
    each = [measure_replay_whiteness(seen, held, lags) for seen in (before, after)]
    rows: list[list[str | float | None]] = []
    figures = []
    for name in each[1]:
        a, b = each[0][name], each[1][name]
        rows.append([name.replace("_", " "), a.correlation[1], b.correlation[1], a.statistic, b.statistic, b.p])
    shown = [
        Panel(
            "correlation",
            [
                Series("before", each[0][name].correlation, color="orange", dash="dashed"),
                Series("after", each[1][name].correlation, color="blue", dash="solid"),
            ],
            name.replace("_", " "),
            levels=[(each[1][name].bound, ""), (-each[1][name].bound, "")],
        )
        for name in each[1]
    ]
    time = [k * period for k in range(lags + 1)]
    figures.append(
        draw_panels("Autocorrelation of the replay error", time, shown, x_label="lag (s)", columns=2, share_y=True)
    )
    columns = [
        "channel",
        "at lag 1, before",
        "at lag 1, after",
        f"Ljung–Box Q({LJUNG_BOX_LAGS}), before",
        "after",
        "p after",
    ]
    figures.append(draw_table("Is what is left white?", columns, rows, digits=3))
    text = (
        "A model that is right leaves noise, each sample by itself: correlations within the two lines. An error in "
        "position grows over a window and is correlated whatever its size; the less of it is left, the more the noise "
        "shows."
    )
    return Section("What is left", text, figures)


def _show_data(content: dict[str, Any]) -> Section:
    """Rate, lost rows, repairs and missing channels of the log; noise and step of every channel."""
    data = content["data"]
    jitter = data.get("jitter", 0.0)
    beside = f"jitter {1e6 * jitter:.2g} µs, {100 * jitter * data['rate']:.2g} % of a period"
    lost = f"{data.get('dropped', 0)} rows dropped, {data.get('gaps', 0)} gaps, {beside}"
    said = [f"{data['duration']:.3g} s at {data['rate']:.5g} Hz; {lost}."]
    said += [f"Repaired: {one['what']}" for one in data.get("repaired", ())]
    for heading, key in (
        ("Not logged", "missing"),
        ("Warnings", "warnings"),
        ("Noticed", "noticed"),
        ("Skews", "skews"),
        ("Notes", "notes"),
    ):
        said += [f"{heading}: {line}" for line in data.get(key, ())]
    figures = []
    if channels := data.get("channels"):
        rows: list[list[str | float | None]] = [
            [name.replace("_", " "), c["low"], c["high"], c["noise"], c["step"] or None] for name, c in channels.items()
        ]
        figures.append(draw_table("Channels", ["channel", "lowest", "highest", "noise (std)", "step"], rows, digits=3))
    if lags := data.get("lags"):
        rows = [[name.replace("_", " "), value] for name, value in lags.items()]
        figures.append(draw_table("Measured inputs behind their commands", ["channel", "lag (s)"], rows, digits=3))
    return Section("The data", "\n\n".join(said), figures)
