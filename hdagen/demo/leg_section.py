"""The first sections of the demo's page: the gap between log and model, its cause, and the gap after."""

from __future__ import annotations

import numpy as np

from hdagen.adoption.verdict import FACTOR
from hdagen.arm.arrays import Array
from hdagen.demo.leg_diagnosis import HIDDEN_EFFECT, JOINT_LABELS, LegDiagnosis
from hdagen.diagnosis.report.effect_words import join_effects, name_effect, name_kind
from hdagen.model_export.mujoco_machine import MUJOCO_MISSING
from hdagen.pages import figure, page
from hdagen.pages.number_table import TableCell
from hdagen.prediction.window_replay import REPLAY_WINDOW

LEG_LINK = "leg"  # the figures that share the time of the leg's log
SHOWN_HYPOTHESES = 5
NO_BREAK_SPACE = "\N{NO-BREAK SPACE}"


def build_leg_sections(leg: LegDiagnosis) -> list[page.Section]:
    """Build the sections on the diagnosis.

    Args:
        leg: The results.

    Returns:
        The gap, the cause, the gap after.

    """
    return [_build_gap_section(leg), _build_cause_section(leg), _build_after_section(leg)]


def describe_leg(leg: LegDiagnosis) -> str:
    """Describe the diagnosis in a few sentences, with its numbers.

    Args:
        leg: The results.

    Returns:
        The sentences.

    """
    knee = leg.joints[1]
    before, after = (_find_rms(predicted - knee.measured) for predicted in (knee.before, knee.after))
    text = (
        f"In windows of {REPLAY_WINDOW:g}{NO_BREAK_SPACE}s the model of a leg leaves its log by {_format_angle(before)}"
    )
    text += f" at the knee (rms). {_describe_cause(leg)} With the corrected file it is {_format_angle(after)}."
    if leg.proof is None:
        return text
    first, second = leg.proof.gaps[:2]
    return (
        f"{text} MuJoCo replays the held-out motion to {first:.4g} times the noise with the file as it was and to"
        f" {second:.3g} times with the exported one."
    )


def _describe_cause(leg: LegDiagnosis) -> str:
    """One sentence on the verdict."""
    share = 100 * leg.content["hypotheses"][0]["probability"]
    if not leg.names_hidden_effect:
        named = join_effects(leg.content["verdict"], JOINT_LABELS) or "no effect"
        return f"The diagnosis names {named} and misses the hidden effect, {name_effect(HIDDEN_EFFECT, JOINT_LABELS)}."
    return (
        f"The cause is the dry friction of the knee, too small in the robot file by {_find_factor(leg):.1f} times "
        f"(probability {share:.0f}{NO_BREAK_SPACE}%)."
    )


def _find_factor(leg: LegDiagnosis) -> float:
    """The knee's dry friction as found, over the robot file's."""
    found = next(c for c in leg.content["causes"] if f"{c['effect']}@{c['joint']}" == HIDDEN_EFFECT)
    return float(found["parameters"]["coulomb_friction"]["value"] / leg.arm.parameters["coulomb_friction_2"])


def _build_gap_section(leg: LegDiagnosis) -> page.Section:
    panels = [
        figure.Panel(
            "position (rad)",
            [
                figure.Series("log", one.measured, "ink", "solid", width=1.4),
                figure.Series("robot file", one.before, "vermilion", "dashed"),
            ],
            heading=label,
        )
        for label, one in zip(JOINT_LABELS, leg.joints, strict=True)
    ]
    drawn = figure.draw_panels(
        "Log and model", leg.log.time, panels, columns=2, bands=_list_held_out(leg), link=LEG_LINK
    )
    text = (
        "The log is simulated, not measured: MuJoCo moved a leg of hip and knee under PD control, and one of its"
        " numbers is not that of the robot file. The diagnosis does not know which."
        f"\n\nEvery {REPLAY_WINDOW:g}{NO_BREAK_SPACE}s the model starts at the state that the log gives, and from there"
        " follows the logged torque commands alone. Shaded: motion that the diagnosis held back, to measure the gap on"
        " it."
    )
    return page.Section("The gap", text, [drawn])


def _list_held_out(leg: LegDiagnosis) -> list[tuple[float, float, str]]:
    return [(start, end, "") for start, end in leg.content["data"]["hold_out"][0]["spans"]]


def _build_cause_section(leg: LegDiagnosis) -> page.Section:
    rows: list[list[TableCell]] = [
        [join_effects(one["effects"], JOINT_LABELS) or "no effect", 100 * one["probability"]]
        for one in leg.content["hypotheses"][:SHOWN_HYPOTHESES]
    ]
    ranking = figure.draw_table(
        "Most probable explanations",
        ("effects", "probability (%)"),
        rows,
        digits=3,
    )
    numbers: list[list[TableCell]] = []
    for cause in leg.content["causes"]:
        if f"{cause['effect']}@{cause['joint']}" not in leg.content["verdict"]:
            continue
        for name, entry in ((name, entry) for name, entry in cause["parameters"].items() if name != FACTOR):
            own = leg.arm.parameters.get(f"{name}_{cause['joint']}")
            change = None if not own else f"{entry['value'] / own:.3g} times"
            label = f"{name_kind(name)}, {JOINT_LABELS[cause['joint'] - 1]}"
            numbers.append([label, own, entry["value"], entry["std"], change, entry["unit"]])
    found = figure.draw_table(
        "The wrong number",
        ("number", "robot file", "found", "±", "change", "unit"),
        numbers,
        digits=3,
        caption="At the motor; ± is one standard deviation.",
    )
    remarks = {True: "The diagnosis is sure.", False: "The diagnosis is not sure."}
    text = (
        f"{_describe_cause(leg)} {remarks[leg.content['sure']]} It tried every effect that the project knows, at every"
        " joint, alone and together, and compared how well each explains motion that it was not fitted to. The full"
        " report of such a diagnosis has a page of its own, which hdagen diagnose writes."
    )
    return page.Section("The cause", text, [found, ranking])


def _build_after_section(leg: LegDiagnosis) -> page.Section:
    panels = [
        figure.Panel(
            "error (rad)",
            [
                figure.Series("robot file", one.before - one.measured, "vermilion", "dashed", width=1.2),
                figure.Series("corrected", one.after - one.measured, "blue", "solid"),
            ],
            heading=label,
        )
        for label, one in zip(JOINT_LABELS, leg.joints, strict=True)
    ]
    drawn = figure.draw_panels(
        "Error before and after",
        leg.log.time,
        panels,
        columns=2,
        share_y=True,
        bands=_list_held_out(leg),
        link=LEG_LINK,
    )
    named, further = leg.split_changes()
    changed = "\n".join(
        f"    {change.where}\n        {_format_number(change.before)} -> {change.after:.4g} {change.unit}"
        for change in named
    )
    text = (
        "hdagen adopt writes the verdict into the robot file; comments and all else stay. The verdict's number:"
        f"\n\n{changed or '    none'}\n\n{len(further)} further numbers of the file moved by less, within their"
        " tolerance or for the integration.\n\n"
    )
    if leg.proof is None:
        return page.Section("The gap after", text + MUJOCO_MISSING, [drawn, _build_own_table(leg)])
    text += (
        "hdagen export mjcf writes the corrected numbers as a MuJoCo model, and with --prove MuJoCo replays the log"
        f" with the model before and after. {leg.proof.sentence}"
    )
    return page.Section("The gap after", text, [drawn, _build_proof_table(leg)])


def _build_own_table(leg: LegDiagnosis) -> str:
    """Errors over the whole log, ours alone."""
    rows: list[list[TableCell]] = [
        [label, _find_rms(one.before - one.measured), _find_rms(one.after - one.measured)]
        for label, one in zip(JOINT_LABELS, leg.joints, strict=True)
    ]
    columns = ("joint", "robot file, rms (rad)", "corrected, rms (rad)")
    return figure.draw_table("Errors over the log", columns, rows, digits=3)


def _build_proof_table(leg: LegDiagnosis) -> str:
    """Errors on held-out motion, MuJoCo's beside ours."""
    assert leg.proof is not None
    rows: list[list[TableCell]] = [
        [
            f"{channel.channel.rpartition('_')[0].replace('_', ' ')}, {channel.joint}",
            *(channel.mujoco_before, channel.mujoco_after, channel.ours_before, channel.ours_after),
            channel.unit,
        ]
        for channel in leg.proof.channels
    ]
    rows.append(["gap", *leg.proof.gaps, "× noise"])
    columns = ("rms on held-out motion", "MuJoCo before", "after", "hdagen before", "after", "unit")
    return figure.draw_table("Proved in MuJoCo", columns, rows, digits=3)


def _find_rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _format_angle(value: float) -> str:
    return f"{1e3 * value:.2g}{NO_BREAK_SPACE}mrad" if value < 0.1 else f"{1e3 * value:.3g}{NO_BREAK_SPACE}mrad"


def _format_number(value: float | None) -> str:
    return "not stated" if value is None else f"{value:.4g}"
