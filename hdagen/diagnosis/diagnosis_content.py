"""The content of diagnosis.json, made once from the results of all stages."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hdagen.adoption.robot_identity import compute_robot_identity
from hdagen.arm.channel_units import find_channel_unit
from hdagen.diagnosis.checked_verdict import CheckedVerdict
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.held_out_rows import name_rows
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.decision.verdict_content import describe_decision
from hdagen.diagnosis.explanation import Explanation
from hdagen.diagnosis.holdout.hypothesis_ranking import find_gap_after
from hdagen.diagnosis.report.sentences import say_contradiction
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.diagnosis.settings import record_settings

HALF_TEXT = "every other second, the rest having decided what stands,"
BLOCKS_TEXT = f"blocks all over each log, {100 * DATA.holdout_share:g} % of it"


def describe_diagnosis(
    models: Models,
    data: PreparedData,
    search: SearchResult,
    checked: CheckedVerdict,
    explained: Explanation,
    failures: Sequence[str],
) -> dict[str, Any]:
    """Describe a diagnosis as diagnosis.json has it.

    Args:
        models: of the robot.
        data: of the diagnosis.
        search: the result of the search.
        checked: the verdict after its check on held-out motion.
        explained: its explanation.
        failures: a sentence for every stage and simulation that failed.

    Returns:
        The whole content.

    """
    statement, final = checked.settled.statement, explained.final
    alternatives = final.alternatives
    confirmed, decision = statement.confirmed, statement.decision
    if checked.contradiction:
        decision = replace(decision, verdict=())
    described = describe_decision(search, decision)
    where: Any = explained.where
    if where is None:
        where = [] if confirmed.is_withdrawn else described["where"]
    causes = [cause | {"gap_after": find_gap_after(cause, alternatives.ranking)} for cause in described["causes"]]
    return described | {
        "verdict": list(final.effects),
        "sure": final.is_sure,
        "where": where,
        "causes": causes,
        "parameters": confirmed.base_parameters,
        "gap": {**alternatives.gap, "by_channel": _add_units(alternatives.gap["by_channel"], models)},
        "doubts": checked.settled.doubts,
        "direct_evidence": [one.content for one in checked.direct_evidence],
        "small": list(checked.settled.small_effects),
        "contradicted": checked.contradiction,
        "nuisance_effects": alternatives.nuisance_effects,
        "ranking": alternatives.ranking,
        "remains": final.remainders,
        "as_good_as_it_gets": final.is_as_good_as_it_gets,
        "moments": final.moments,
        "control": explained.control,
        "not_tried": list(explained.not_tried),
        "robot": _describe_robot(models),
        "joints": [joint.get("name") for joint in models.nominal.robot["joints"]],
        "settings": record_settings(),
        "data": _describe_data(data, checked, failures),
    }


def _add_units(channels: Mapping[str, Any], models: Models) -> dict[str, Any]:
    """The errors by channel, each with the unit of its channel."""
    return {name: {**one, "unit": find_channel_unit(models.nominal, name)} for name, one in channels.items()}


def _describe_robot(models: Models) -> dict[str, Any]:
    """Name and identity of the robot, and the SHA-256 of its file; None for a preset."""
    path, digest = Path(models.robot), None
    if path.is_file():
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    robot = models.nominal.robot
    return {"name": robot["name"], "identity": compute_robot_identity(robot), "sha256": digest}


def _describe_data(data: PreparedData, checked: CheckedVerdict, failures: Sequence[str]) -> Mapping[str, Any]:
    """The logs, the held-out rows, and everything that is to be said of them."""
    motion, held = checked.motion, BLOCKS_TEXT
    notes = [note for log in data.logs for note in log.notes]
    if count := len(motion.before.guessed_starts):
        notes.append(f"{count} window(s) of a replay begin in motion, without a velocity: the gap leaves them out.")
    if data.holdout:
        held = f"{HALF_TEXT} of {', '.join(log.source for log in data.holdout)}"
    described = {
        "log": ", ".join(log.source for log in data.logs),
        "rate": 1 / data.logs[0].period,
        "duration": sum(float(log.time[-1] - log.time[0]) for log in data.logs),
        "held_out": held,
        "hold_out": name_rows(motion.portion, data.judged_logs),
        "notes": list(dict.fromkeys([*notes, *failures])),
        **data.description,
    }
    if checked.contradiction:
        described["warnings"] = [*described["warnings"], say_contradiction(checked.contradiction)]
    return described
