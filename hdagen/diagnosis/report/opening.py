"""The first screen of a report: what, where, how much, how sure, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hdagen.arm.arm_parameters import Parameters
from hdagen.diagnosis.report.effect_words import name_channel
from hdagen.diagnosis.report.gap_words import (
    find_effect_credit,
    find_shown_channel,
    format_channel_error,
    format_closed_share,
    format_multiple,
    list_named_effects,
)
from hdagen.diagnosis.report.parameter_table import draw_changed_numbers
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles, list_next_commands
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.report.sentences import (
    find_set_probability,
    format_probability,
    list_effect_probabilities,
    list_remarks,
    note_calibration,
    say_doubt,
    write_headline,
)
from hdagen.pages.first_screen import Fact, build_first_screen


def open_report(content: dict[str, Any], parameters: Parameters, files: DiagnosedFiles, warnings: list[str]) -> str:
    """Build the first screen.

    Args:
        content: of diagnosis.json.
        parameters: of the model that was diagnosed.
        files: of the diagnosis.
        warnings: sentences on pictures that contradict the verdict.

    Returns:
        Markup of the header.

    """
    doubt = say_doubt(content)
    remarks = [f"{doubt[0].upper()}{doubt[1:]}."] if doubt else []
    return build_first_screen(
        f"Diagnosis of {content['robot']['name']}",
        f"{write_headline(content)}.",
        [_state_certainty(content), *_state_error(content), _state_credit(content), _state_next_step(content)],
        remarks=[*remarks, *warnings, *list_remarks(content)],
        body=draw_changed_numbers(content, parameters),
        commands=list_next_commands(content, files),
    )


def _state_certainty(content: dict[str, Any]) -> Fact:
    """How sure: the probability of each effect, summed over all sets, and that of exactly this set."""
    word = "Sure" if content["sure"] else "Not sure"
    named, noted = list_named_effects(content), note_calibration(content)
    each, together = list_effect_probabilities(content), find_set_probability(content)
    if named and each:
        value = " and ".join(map(format_probability, each))
        if len(each) > 2:
            value = f"{format_probability(min(each))} or more"
        detail = f"probability that {'each is' if len(each) > 1 else 'it is'} there"
        if together is not None:
            detail += f"; {format_probability(together)} that exactly {'these are' if len(each) > 1 else 'this is'}"
        return Fact("How sure", f"{word}: {value}", f"{detail}{noted}")
    if together is None:
        return Fact("How sure", word)
    said = "that something unknown is there" if content["verdict"] else "that nothing of size is missing"
    return Fact("How sure", f"{word}: {format_probability(together)}", f"probability {said}{noted}")


def _state_error(content: Mapping[str, Any]) -> list[Fact]:
    """The error before and after, in its unit and in multiples of the noise; nothing where no channel counts."""
    name, gap = find_shown_channel(content), content["gap"]
    multiples = f"{format_multiple(gap['before'])} → {format_multiple(gap['after'])} times the noise over all channels"
    if name is None:
        return [Fact("Error", multiples)]
    error = format_channel_error(content, name)
    where = name_channel(name, content.get("joints", ()))
    return [Fact("Error, file → found", error, f"{where}, rms on held-out motion; {multiples}")]


def _state_credit(content: Mapping[str, Any]) -> Fact:
    """The closed share, and apart what the effects and what refitted numbers close."""
    gap, own, named = content["gap"], find_effect_credit(content), list_named_effects(content)
    if gap["shrink"] is None:
        return Fact("Closed", "No gap", "the file's model is as good as the sensors")
    parts = []
    if named and own is not None:
        effects = "the effects" if len(named) > 1 else "the effect"
        parts.append(f"of that {100 * own:.0f} % by {effects}, {100 * (1 - own):.0f} % by refitted numbers of the file")
    elif content["parameters"]:
        parts.append("by refitted numbers of the file alone")
    if gap["achievable"] < gap["after"]:
        parts.append(f"the best of all fits leaves {format_multiple(gap['achievable'])} times the noise")
    else:
        parts.append("nothing that was fitted closes more")
    return Fact("Closed", format_closed_share(gap), "; ".join(parts))


def _state_next_step(content: Mapping[str, Any]) -> Fact:
    """What to do, in a few words."""
    gap, named = content["gap"], list_named_effects(content)
    if content["contradicted"]:
        value, detail = "Give another hold-out", "log and hold-out do not seem to be of one machine"
    elif content.get("not_tried"):
        value, detail = "Give it more time", "not everything was tried"
    elif named and content["sure"]:
        value, detail = "Adopt it", "or export it; the commands stand below"
    elif named:
        value, detail = "Record one more motion", "as designed below, and diagnose both logs together"
    elif not content["verdict"]:
        value, detail = "Keep the file", "its numbers hold, or adopt the refitted ones"
        if content["as_good_as_it_gets"]:
            detail = "nothing that was fitted does much better"
    elif gap["achievable"] < REPORT.notable_gap_share * gap["after"]:
        value, detail = (
            "Look at where it errs",
            "a correction without structure closes much: an effect is not in the list",
        )
    else:
        value, detail = (
            "Check the log",
            "units, signs, clocks, forces that are not logged; then record the motion below",
        )
    return Fact("What to do", value, detail)
