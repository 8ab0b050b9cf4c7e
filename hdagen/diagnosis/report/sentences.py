"""Sentences of a diagnosis: the verdict with its gap, and the alternatives that the log does not exclude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.separating_experiments import suggest_experiments
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.report.number_sentences import (
    find_wrong_numbers,
    say_strained_numbers,
    say_wrong_numbers,
)
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.pages.quantity import format_number


def write_verdict(content: dict[str, Any]) -> str:
    """Write the verdict as sentences: its effects, how sure it is, the gap, and remarks.

    Args:
        content: of diagnosis.json.

    Returns:
        One paragraph.

    """
    gap = content["gap"]
    text = f"{_say_verdict(content)}. {_say_gap(content)}{_compare_with_best(gap)}."
    if content["contradicted"]:
        text += f" {say_contradiction(content['contradicted'])}"
    for remark in (
        say_strained_numbers,
        _say_remainder,
        _say_moments,
        _say_bounds,
        _say_nuisance_effect,
        _say_repairs,
        _say_unmoved_joints,
    ):
        text += remark(content)
    return text


def _say_verdict(content: dict[str, Any]) -> str:
    """The verdict, and that it is not sure where it is not."""
    verdict = content["verdict"]
    named = [entry for entry in verdict if not entry.startswith("unknown@")]
    if not verdict:
        said = _say_no_effect(content)
    elif not named:
        said = f"{_say_joints(verdict)} something that no known effect explains{_say_doubt(content['doubts'])}"
    else:
        said = f"{_say_named(content, named)}{_say_probability(content, named)}"
    if not content["sure"] and not content["contradicted"]:
        said += "; this is not sure"
    return said


def _say_named(content: dict[str, Any], named: Sequence[str]) -> str:
    """The wrong numbers of the robot file first, then the effects that the model lacks."""
    numbers = say_wrong_numbers(content)
    effects = [entry for entry in named if entry not in find_wrong_numbers(content)]
    if not effects:
        return numbers
    each, verb = _join_effects(effects), _agree_in_number(effects, "is", "are")
    missing = f"{each[0].upper()}{each[1:]} {verb} missing in the model"
    if not numbers:
        return missing
    return f"{numbers}. {missing}"


def _say_probability(content: dict[str, Any], named: Sequence[str]) -> str:
    """The probability of a verdict with ``named`` effects, in brackets; "" where no hypothesis has these."""
    sets = sorted(named), sorted(content["verdict"])
    p = next((h["probability"] for h in content["hypotheses"] if sorted(h["effects"]) in sets), None)
    if p is None:
        return ""
    return f" (probability {p:.2f}{note_calibration(content)})"


def _say_gap(content: dict[str, Any]) -> str:
    """The gap before and after, and the share of it that is closed."""
    gap = content["gap"]
    said = "On held-out motion the gap goes"
    if content["parameters"] and not content["verdict"]:
        said = "Base parameters within their tolerance take the gap on held-out motion"
    said += f" from {_format_multiple(gap['before'])} to {_format_multiple(gap['after'])} times the noise"
    if gap["before"] >= REPORT.gap_said_in_units:
        said += _say_worst_channel(gap)
    if gap["shrink"] is None:
        return said
    spread = ""
    if gap["interval"]:
        low, high = gap["interval"]
        spread = f" [{100 * low:.0f}, {100 * high:.0f}]"
    return f"{said}: {100 * gap['shrink']:.0f} %{spread} of what lies above the noise is closed"


def _agree_in_number(entries: Sequence[Any], one: str, several: str) -> str:
    """The word for one entry, or that for several."""
    if len(entries) == 1:
        return one
    return several


def say_contradiction(contradicted: Mapping[str, Any]) -> str:
    """Say why a hold-out does not seem to be of the log's machine, and how to mend that.

    Args:
        contradicted: of diagnosis.json.

    Returns:
        Two sentences.

    """
    named = ""
    if contradicted["verdict"]:
        named = f"{_join_effects(contradicted['verdict'])} and "
    return (
        f"What the log alone says ({named}base parameters within their tolerance) closes "
        f"{100 * contradicted['closed']:.0f} % of its own gap and leaves {100 * contradicted['left']:.0f} % of the "
        "hold-out's: they do not seem to be of the same machine, or the hold-out moves as the log never does. Give "
        "another motion of the log's machine, within its range and speed, as hdagen excite designs one, or no "
        "hold-out: a fifth of the log is then kept from the fit."
    )


def _say_moments(content: dict[str, Any]) -> str:
    """Where nearly all that is left acts once, and a log that would show it."""
    each = "; ".join(
        f"joint {one['joint']}, {one['span'][0]:.4g} to {one['span'][1]:.4g} s of {one['log']}"
        for one in content["moments"]
    )
    if not each:
        return ""
    return (
        f" Nearly all that is left lies within one second ({each}): what acts once cannot be told. Record a log in "
        "which the joint goes there several times."
    )


def _say_unmoved_joints(content: dict[str, Any]) -> str:
    """The joints that no log moves, and the motion that would."""
    still = content.get("data", {}).get("still", ())
    if not still:
        return ""
    which = _agree_in_number(still, f"Joint {still[0]} does", f"Joints {', '.join(map(str, still))} do")
    return (
        f" {which} not move in the log: of what acts in motion nothing can be told there (hdagen excite robot.toml "
        f"--joint {still[0]} designs a motion that shows it)."
    )


def _say_joints(entries: Sequence[str]) -> str:
    """The joints of entries name@joint that miss something."""
    numbers = [entry.partition("@")[2] for entry in entries]
    return _agree_in_number(numbers, f"Joint {numbers[0]} misses", f"Joints {', '.join(numbers)} miss")


def _say_remainder(content: dict[str, Any]) -> str:
    """The errors beside the named effects that no known effect explains."""
    beside = {int(entry.partition("@")[2]) for entry in content["verdict"] if entry.startswith("unknown@")}
    if len(beside) == len(content["verdict"]):  # the verdict names no effect
        return ""
    much = [one for one in content["remains"] if one["joint"] in beside]
    if not much:
        return ""
    shares = " and ".join(f"{100 * one['share']:.0f} % of the error at joint {one['joint']}" for one in much)
    return f" What no known effect explains remains beside it: {shares}."


def _say_repairs(content: dict[str, Any]) -> str:
    """Channels that were left out or scaled, as they contradict another."""
    repaired = content.get("data", {}).get("repaired", ())
    return "".join(f" {one['what']}" for one in repaired if one["name"] == "contradicted")


def _format_multiple(multiples: float) -> str:
    """A multiple of the noise with three digits."""
    return format_number(float(f"{multiples:.3g}"), 3)


def _say_nuisance_effect(content: dict[str, Any]) -> str:
    """An effect within tolerance that would close much of the rest of the gap."""
    closer = [
        one for one in content["nuisance_effects"] if one["gap"] < REPORT.notable_gap_share * content["gap"]["after"]
    ]
    if not closer:
        return ""
    what = name_effect(f"{closer[0]['effect']}@{closer[0]['joint']}")
    return f" Within what is tolerated, {what} would bring it to {_format_multiple(closer[0]['gap'])}."


def _say_bounds(content: dict[str, Any]) -> str:
    """Parameters of the verdict's effects that stand at an end of their range."""
    at = []
    for cause in content["causes"]:
        entry = f"{cause['effect']}@{cause['joint']}"
        if entry not in content["verdict"]:
            continue
        for name, q in cause["parameters"].items():
            if q["end"]:
                at.append(
                    f"{name.replace('_', ' ')} of {name_effect(entry)}, {format_number(q['value'], 3)}{_format_unit(q)}"
                )
    if not at:
        return ""
    return f" At the end of what it may be: {'; '.join(at)}. There may be more of it, or another effect."


def _format_unit(q: dict[str, Any]) -> str:
    """The unit of a parameter after its value; "" where it has none."""
    if q["unit"] == "1":
        return ""
    return f" {q['unit']}"


def _say_no_effect(content: dict[str, Any]) -> str:
    """The reason why no effect is named: none is likely, none is sure enough, or there is no gap to explain."""
    first = content["hypotheses"][0]
    if content["contradicted"]:
        return "What is missing cannot be told, as log and hold-out contradict each other"
    if content["as_good_as_it_gets"]:
        return "The model is as good as it gets here: nothing that was fitted closes much of the gap"
    if not first["effects"]:
        p = f"{first['probability']:.2f}{note_calibration(content)}"
        return f"No effect above the size that counts was found (probability {p})"
    each, p = _join_effects(first["effects"]), first["probability"]
    if content["gap"]["before"] < HOLDOUT_CHECK.least_explainable_gap:
        return f"There is no gap to explain, although the log may have {each} ({p:.2f})"
    none = sum(h["probability"] for h in content["hypotheses"] if not h["effects"])
    return f"No effect is sure enough to be named: perhaps {each} ({p:.2f}), or none ({none:.2f})"


def _join_effects(entries: Sequence[str]) -> str:
    """Several effects in a row."""
    return " and ".join(name_effect(entry) for entry in entries)


def _say_doubt(doubted: dict[str, Any] | None) -> str:
    """The verdict that held-out motion did not confirm."""
    if doubted is None:
        return ""
    left = f"{100 * doubted['left']:.0f} % of what this joint errs by on held-out motion"
    if not doubted["verdict"]:
        return f": the model that tells most of the log names none and leaves {left}"
    return f": of what is known {_join_effects(doubted['verdict'])} tells most of the log, but leaves {left}"


def _compare_with_best(gap: dict[str, Any]) -> str:
    """The verdict beside the best of all that was fitted."""
    before, after, least = gap["before"], gap["after"], gap["achievable"]
    if least >= before:
        return "; nothing that was fitted closes more"
    if after <= least:
        return "; nothing else that was fitted, a flexible correction without structure included, closes more"
    best = "the best of all that was fitted, a flexible correction without structure included"
    share = 100 * (before - after) / (before - least)
    return f"; {best}, brings it to {_format_multiple(least)}; the verdict closes {share:.0f} % of what that does"


def _say_worst_channel(gap: dict[str, Any]) -> str:
    """The channel that errs most, in SI units, for a reader to whom multiples of a very small noise say little."""
    name, c = max(gap["by_channel"].items(), key=lambda item: item[1]["before"])
    before, after = (c[when] * c["noise"] for when in ("before", "after"))
    return f" ({name.replace('_', ' ')}: {before:.3g} to {after:.3g} in SI units, rms)"


def name_effect(entry: str) -> str:
    """Name an effect as people say it, without the prefix "missing".

    Args:
        entry: effect@joint, joint 0 being the whole arm.

    Returns:
        The name with its place.

    """
    effect, _, joint = entry.partition("@")
    name = effect.removeprefix("missing_").replace("_", " ")
    if joint == "0":
        return f"{name} of the whole arm"
    return f"{name} on joint {joint}"


def note_calibration(content: dict[str, Any]) -> str:
    """Note after a probability that it is not calibrated.

    Args:
        content: of diagnosis.json.

    Returns:
        The words, "" where the probabilities are calibrated.

    """
    if content.get("method", {}).get("calibrated"):
        return ""
    return ", not calibrated"


def explain_confounding(effects: EffectCatalogue, content: dict[str, Any]) -> str:
    """Explain the alternatives that the log does not exclude, and the motions that would separate them.

    Args:
        effects: how each effect shows itself.
        content: of diagnosis.json.

    Returns:
        Paragraphs on each named effect, or on the effects that may be present where none is named.

    """
    causes = {f"{c['effect']}@{c['joint']}": c for c in content["causes"]}
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
        each = ", ".join(f"{name_effect(name)} ({causes[name]['probability']:.2f})" for name in likely)
        may_be = "one that is small, or that shows little in this motion, may be there"
        if content["contradicted"]:
            may_be = "the log alone says"
        text = f"No effect is named; {may_be}: {each}."
        if len(likely) == 1:
            return text
        return (
            f"{text}\n\nWhat would tell {name_effect(likely[0])} from the others:"
            f" {suggest_experiments(effects, likely[0], likely[1:])}\n\n    hdagen excite robot.toml --separate"
            f" {','.join(likely[: REPORT.most_separated])}\n\ndesigns a motion that does."
        )
    said = [
        _say_alternatives(effects, name, causes[name]["confounded_with"])
        for name in named
        if causes[name]["confounded_with"]
    ]
    if not said:
        return "Nothing else explains this log nearly as well: no pair is confounded."
    return "What this log cannot tell apart, and the motion that would:\n\n" + "\n\n".join(said)


def _say_alternatives(effects: EffectCatalogue, name: str, others: Sequence[str]) -> str:
    """The alternatives of an effect of the verdict, the nearest first, and the motions that would separate them.

    Of many alternatives only the nearest are named: such a motion says little of the effect.
    """
    few, more = others[: REPORT.most_named_alternatives], len(others) - REPORT.most_named_alternatives
    said = f"{name_effect(name)[0].upper()}{name_effect(name)[1:]} may also be {', '.join(name_effect(o) for o in few)}"
    if more > 0:
        said += f", or one of {more} others (diagnosis.json has them): this motion tells little of it"
    return f"{said}. {suggest_experiments(effects, name, few)}"
