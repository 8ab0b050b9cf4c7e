"""The page's section on certainty: the leading models on held-out motion, and what was tried at which joint."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from hdagen.arm.arm_parameters import Parameters
from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.report.confounding import explain_confounding
from hdagen.diagnosis.report.effect_words import (
    JointNames,
    format_values,
    join_effects,
    name_effect,
    name_joint,
    name_kind,
)
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.report.sentences import format_probability, note_calibration
from hdagen.pages import frame
from hdagen.pages.dot_chart import DotGroup, draw_dots
from hdagen.pages.markup import build_element, escape_html
from hdagen.pages.number_table import draw_table
from hdagen.pages.page import Section
from hdagen.pages.status_matrix import draw_status_matrix
from hdagen.prediction.window_replay import REPLAY_WINDOW

STATES = {  # of an effect at a joint: symbol and meaning
    "named": ("●", "named"),
    "likely": ("◐", "may be there"),
    "excluded": ("–", "excluded"),
    "untested": ("?", "cannot be tested with this motion"),
}
LITTLE_PROBABILITY_WORDS = f"less than {REPORT.least_printed_probability:g}"


def show_certainty(effects: EffectCatalogue, parameters: Parameters, content: dict[str, Any]) -> Section:
    """Make the section of the page.

    Args:
        effects: how each effect shows itself.
        parameters: of the model that was diagnosed.
        content: of diagnosis.json.

    Returns:
        The ranking, the matrix of effects and joints, and the alternatives.

    """
    text = (
        "Every effect was tried at every joint, with the numbers of the file refitted within their tolerance. An "
        f"effect below {100 * CANDIDATES.present_size:g} % of its usual size counts as none."
        f"{_explain_long_horizon(content)}\n\n{explain_confounding(effects, content)}"
    )
    figures = [
        _show_ranking(content),
        *_show_matrix(content),
        _fold_hypotheses(content),
        *_show_direct_evidence(content, parameters),
    ]
    return Section("How sure", text, figures)


def _explain_long_horizon(content: dict[str, Any]) -> str:
    """A remark where the verdict comes from long windows."""
    if content["method"]["calibrated"]:
        return ""
    return (
        f" Windows of {REPLAY_WINDOW:g} s decided which known effect is the most probable: shorter ones leave much "
        "unexplained, whatever is named. Sealed checks have too few such cases, so its probability is not calibrated."
    )


def _show_ranking(content: dict[str, Any]) -> str:
    """The gaps of the leading hypotheses on held-out motion, and that of a correction without structure."""
    gap, joints = content["gap"], content.get("joints", ())
    named = [(_label_model(one, joints), one["gap"], one["interval"]) for one in content["ranking"]]
    if gap["flexible"] is not None:
        named.append(("correction without structure", gap["flexible"], None))
    return draw_dots(
        "The leading models on held-out motion",
        [label for label, _, _ in named],
        [DotGroup("", [value for _, value, _ in named], _split_intervals(interval for _, _, interval in named))],
        value_label="gap in multiples of the noise",
        levels=[(gap["floor"], "noise alone")],
        log=True,
        caption=f"In brackets behind a name: its probability as a set{note_calibration(content)}. Each model has "
        "refitted numbers of its own. Intervals: 95 %, by drawing blocks of windows again; where they overlap, this "
        "motion alone does not decide.",
    )


def _split_intervals(entries: Iterable[Any]) -> tuple[list[float], list[float]]:
    """Low and high ends of intervals, NaN where there is none."""
    low, high = zip(*(one or (math.nan, math.nan) for one in entries), strict=True)
    return list(low), list(high)


def _label_model(one: dict[str, Any], joints: JointNames) -> str:
    """Label of an entry of the ranking, with its probability."""
    if one["model"] == "robot file":
        return "robot file"
    named = join_effects(one["effects"], joints) or "refitted numbers alone"
    if one["probability"] is not None:
        named += f" ({format_probability(one['probability'])})"
    if one["model"] == "verdict":
        return f"verdict: {named}"
    return named


def _show_matrix(content: dict[str, Any]) -> list[str]:
    """Each effect that was tried, by joint: named, likely, excluded or untested; no figure from older diagnoses."""
    tried = content.get("tried", ())
    if not tried:
        return []
    numbers = sorted({int(entry.partition("@")[2]) for entry in tried}, key=lambda j: (j == 0, j))
    effects = sorted({entry.partition("@")[0] for entry in tried})
    rows = []
    for effect in effects:
        cells = [_find_state(f"{effect}@{joint}", content) for joint in numbers]
        rows.append((name_kind(effect), cells))
    rows.sort(key=lambda row: min(list(STATES).index(cell) for cell in row[1] if cell))
    heads = [name_joint(joint, content.get("joints", ())) if joint else "arm" for joint in numbers]
    return [draw_status_matrix("Each effect at each joint", heads, rows, STATES)]


def _find_state(entry: str, content: dict[str, Any]) -> str:
    """The state of one effect at one joint; "" where it was not tried."""
    chances = {f"{cause['effect']}@{cause['joint']}": cause["probability"] for cause in content["causes"]}
    if entry in content["verdict"]:
        return "named"
    if entry in content["undetectable"]:
        return "untested"
    if chances.get(entry, 0.0) >= DECISION.least_mentioned_probability:
        return "likely"
    if entry in content["tried"]:
        return "excluded"
    return ""


def _fold_hypotheses(content: dict[str, Any]) -> str:
    """A folded table of the most probable sets of effects."""
    joints, every = content.get("joints", ()), content["hypotheses"]
    listed, rest = every[: REPORT.most_listed_hypotheses], every[REPORT.most_listed_hypotheses :]
    rows = [[join_effects(one["effects"], joints) or "none", _print_probability(one["probability"])] for one in listed]
    if rest:
        together = sum(float(one["probability"]) for one in rest)
        rows.append([f"the other {len(rest)} together", _print_probability(together)])
    summary = build_element("summary", escape_html(f"Sets of effects by probability{note_calibration(content)}"))
    return build_element("details", summary, frame.build_rows_table(("effects", "probability"), rows))


def _print_probability(p: float) -> str:
    if p < REPORT.least_printed_probability:
        return LITTLE_PROBABILITY_WORDS
    return f"{p:.2g}"


def _show_direct_evidence(content: dict[str, Any], parameters: Parameters) -> list[str]:
    """A table of the effects that commands and encoders show by themselves; no table where there are none."""
    joints = content.get("joints", ())
    rows: list[list[str | float | None]] = []
    for one in content["direct_evidence"]:
        sizes = []
        for name, size in one["parameters"].items():
            q = parameters.described.get(name) or parameters.described.get(f"{name}_{one['joint']}")
            (value,), unit = format_values([size], q.unit if q else "")
            sizes.append(f"{name.replace('_', ' ')} {value} {unit}".rstrip())
        effect = name_effect(f"{one['effect']}@{one['joint']}", joints)
        rows.append([effect, ", ".join(sizes), f"{100 * one['left']:.2g} %"])
    if not rows:
        return []
    return [
        draw_table(
            "What commands and encoders show by themselves",
            ["effect", "size", "left of the difference"],
            rows,
            caption="Measured inputs beside their commands, and the two encoders of a joint beside the torsion, before "
            "any model is fitted.",
        )
    ]
