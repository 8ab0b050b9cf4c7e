"""The report: the first screen, then the effect itself, where and when, certainty, errors, signals, numbers, data."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hdagen.diagnosis.report.arm_picture import draw_arm_motion
from hdagen.diagnosis.report.certainty_section import show_certainty
from hdagen.diagnosis.report.data_section import show_control, show_data
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.report.effect_picture import EffectPicture
from hdagen.diagnosis.report.effect_plots import draw_effect
from hdagen.diagnosis.report.effect_words import name_effect, name_joint
from hdagen.diagnosis.report.gap_section import show_gap
from hdagen.diagnosis.report.gap_words import list_named_effects
from hdagen.diagnosis.report.opening import open_report
from hdagen.diagnosis.report.parameter_table import show_parameters
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles, format_commands
from hdagen.diagnosis.report.residual_maps import draw_residual_maps
from hdagen.diagnosis.report.sentences import write_verdict
from hdagen.diagnosis.report.signal_plots import show_signals
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.pages import page
from hdagen.pages.figure import place_abreast
from hdagen.pages.page import Section

SIGNIFICANCE = re.compile(r" \(p = [^)]*\)")  # in the sentences of diagnosis.json; a page has the picture


def write_report(diagnosis: DiagnosisResult, path: Path, files: DiagnosedFiles) -> None:
    """Write report.html.

    Args:
        diagnosis: to be reported.
        path: of the page.
        files: of the diagnosis, for the commands that repeat it and follow from it.

    """
    content, held, sight = diagnosis.content, diagnosis.holdout, diagnosis.residual_torque
    arm = sight.motion.arm
    pictures = _draw_effects(sight, content)
    page.write_page(
        path,
        f"Diagnosis of {content['robot']['name']}",
        write_verdict(content),
        [
            _show_effects(content, pictures),
            _show_location(sight, content, draw_arm_motion(arm, held.portion.log, content)),
            show_certainty(arm.effects, arm.parameters, content),
            show_gap(content),
            show_signals(content, held.portion, held.before, diagnosis.after),
            show_parameters(content, arm.parameters),
            *show_control(content),
            show_data(content),
        ],
        format_commands(
            files, content["robot"].get("identity") or "not known", is_complete=not content.get("not_tried")
        ),
        first_screen=open_report(content, arm.parameters, files, _list_warnings(content, pictures)),
    )


def _draw_effects(sight: ResidualTorque, content: dict[str, Any]) -> dict[str, list[EffectPicture]]:
    """The pictures of each effect that is named, by effect@joint; of what is missing where none is."""
    entries, verdict, main = content["where"], content["verdict"], _find_main_place(content)
    drawn = {}
    for k, entry in enumerate(verdict or [f"none@{max(main['joint'], 1)}"]):
        place = entries[k]["place"] if k < len(entries) else main["place"]
        drawn[entry] = draw_effect(sight, entry, place)
    return drawn


def _find_main_place(content: dict[str, Any]) -> dict[str, Any]:
    """Joint and place that matter most; the first motor where none does."""
    nowhere: dict[str, Any] = {"joint": 1, "place": "motor"}
    return next(iter(content["where"]), nowhere)


def _list_warnings(content: dict[str, Any], pictures: dict[str, list[EffectPicture]]) -> list[str]:
    """A sentence for each named effect whose picture contradicts it."""
    warnings = []
    for entry in list_named_effects(content):
        against = [one.agreement for one in pictures[entry] if one.agreement and one.agreement.is_contradicted]
        if against:
            warnings.append(
                f"The picture of {name_effect(entry, content.get('joints', ()))} does not follow the log, which shows "
                f"{against[0].slope:.2g} times what the effect adds: something else may be at work."
            )
    return warnings


def _show_effects(content: dict[str, Any], pictures: dict[str, list[EffectPicture]]) -> Section:
    heading = "What is missing, by what it goes with"
    if list_named_effects(content):
        heading = "The effect itself"
    figures = [one.markup for drawn in pictures.values() for one in drawn if one.markup]
    text = ""
    if not figures:
        text = "What is left goes with nothing that was looked at: speed, load, angle, frequency, time."
    return Section(heading, text, _arrange_figures(figures))


def _arrange_figures(figures: list[str]) -> list[str]:
    """Two figures or more beside each other, where there is room."""
    if len(figures) < 2:
        return figures
    return [place_abreast(figures)]


def _show_location(sight: ResidualTorque, content: dict[str, Any], pictures: list[str]) -> Section:
    """The share of the closed gap of each place, its regime in words, then ``pictures``, and maps of the joint that
    matters most."""
    entries, verdict, joints = content["where"], content["verdict"], content.get("joints", ())
    main = _find_main_place(content)
    said = []
    for name, entry in zip(verdict or [""], entries, strict=False):
        regime = SIGNIFICANCE.sub("", entry["when"]).split(". ")[0].rstrip(".")
        if name:
            of = "remaining error" if name.startswith("unknown@") else "closed gap"
            share = "" if entry["share"] is None else f", {100 * entry['share']:.0f} % of the {of}"
            named = name_effect(name, joints)
            said.append(f"{named[0].upper()}{named[1:]} ({entry['place']}{share}). {regime}.")
    rest = [
        f"{entry['place']} of {name_joint(entry['joint'], joints)} {100 * entry['share']:.0f} %"
        for entry in entries[len(verdict) :]
        if entry["share"] is not None
    ]
    if rest:
        said.append(f"Refitted numbers, of the closed gap: {', '.join(rest)}.")
    maps = draw_residual_maps(sight, max(main["joint"], 1), main["place"], next(iter(verdict), ""))
    return Section("Where and when", "\n\n".join(said), [*pictures, *_arrange_figures(maps)])
