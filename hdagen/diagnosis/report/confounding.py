"""Sentences on the alternatives that a log does not exclude, and the motions that would separate them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.separating_experiments import suggest_experiments
from hdagen.diagnosis.report.effect_words import JointNames, name_effect
from hdagen.diagnosis.report.report_settings import REPORT

ENTRY = re.compile(r"\b[a-z][a-z0-9_]*@\d+\b")


def explain_confounding(effects: EffectCatalogue, content: dict[str, Any]) -> str:
    """Explain the alternatives that the log does not exclude, and the motions that would separate them.

    Args:
        effects: how each effect shows itself.
        content: of diagnosis.json.

    Returns:
        Paragraphs on each named effect, or on the effects that may be present where none is named.

    """
    joints = content.get("joints", ())
    return ENTRY.sub(lambda found: name_effect(found[0], joints), _explain_alternatives(effects, content))


def _explain_alternatives(effects: EffectCatalogue, content: dict[str, Any]) -> str:
    """The same, in which experiments still name effects as name@joint."""
    causes, joints = {f"{c['effect']}@{c['joint']}": c for c in content["causes"]}, content.get("joints", ())
    shown = causes.keys() - set(content["undetectable"])  # the report says those for themselves
    likely = [
        name for name, c in causes.items() if c["probability"] >= DECISION.least_mentioned_probability and name in shown
    ]
    named = [name for name in content["verdict"] if name in causes]
    if not named:
        if content["verdict"] and not likely:
            return "No known effect explains the log nearly as well as something unknown."
        if not likely:
            return "Of what this motion shows, nothing explains the log nearly as well as no effect."
        each = ", ".join(f"{name_effect(name, joints)} ({causes[name]['probability']:.2f})" for name in likely)
        may_be = "one that is small, or that shows little in this motion, may be there"
        if content["contradicted"]:
            may_be = "the log alone says"
        text = f"No effect is named; {may_be}: {each}."
        if len(likely) == 1:
            return text
        return (
            f"{text}\n\nWhat would tell {name_effect(likely[0], joints)} from the others:"
            f" {suggest_experiments(effects, likely[0], likely[1:])}"
        )
    said = [
        _say_alternatives(effects, name, causes[name]["confounded_with"], joints)
        for name in named
        if causes[name]["confounded_with"]
    ]
    if not said:
        return "Nothing else explains this log nearly as well: no pair is confounded."
    return "What this log cannot tell apart, and the motion that would:\n\n" + "\n\n".join(said)


def _say_alternatives(effects: EffectCatalogue, name: str, others: Sequence[str], joints: JointNames) -> str:
    """The alternatives of an effect of the verdict, the nearest first, and the motions that would separate them.

    Of many alternatives only the nearest are named: such a motion says little of the effect.
    """
    few, more = others[: REPORT.most_named_alternatives], len(others) - REPORT.most_named_alternatives
    named = name_effect(name, joints)
    said = f"{named[0].upper()}{named[1:]} may also be {', '.join(name_effect(o, joints) for o in few)}"
    if more > 0:
        said += f", or one of {more} others (diagnosis.json has them): this motion tells little of it"
    return f"{said}. {suggest_experiments(effects, name, few)}"
