"""Sentences of a diagnosis: the verdict with its sizes, how sure it is, the error before and after, and remarks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.report.effect_groups import say_many_effects
from hdagen.diagnosis.report.effect_words import join_effects, name_channel, name_effect, name_joint, say_effect
from hdagen.diagnosis.report.gap_words import (
    find_effect_credit,
    find_shown_channel,
    format_channel_error,
    format_closed_share,
    format_multiple,
    list_named_effects,
)
from hdagen.diagnosis.report.number_sentences import (
    say_combinations,
    say_overconfidence,
    say_strained_numbers,
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
    said = ": ".join(part for part in (write_headline(content), say_doubt(content)) if part)
    said = f"{say_overconfidence(content)}{said}{_say_probability(content)}"
    if not content["sure"] and not content["contradicted"]:
        said += "; this is not sure"
    text = f"{said}. {_say_gap(content)}{_compare_with_best(content['gap'])}."
    return " ".join([text, *_say_credit(content), *list_remarks(content)])


def write_headline(content: dict[str, Any]) -> str:
    """Write the verdict alone: each effect with its joint, its sign and its size.

    Args:
        content: of diagnosis.json.

    Returns:
        A sentence without its full stop.

    """
    verdict = content["verdict"]
    named = list_named_effects(content)
    if not verdict:
        return _say_no_effect(content)
    if not named:
        return f"{_say_joints(content, verdict)} something that no known effect explains"
    each = [say_effect(entry, content) for entry in named]
    if len(named) > REPORT.most_sized_effects:
        each = say_many_effects(named, content)
    said = ", and ".join(part for part in (", ".join(each[:-1]), each[-1]) if part)
    return f"{said[0].upper()}{said[1:]}"


def list_remarks(content: dict[str, Any]) -> list[str]:
    """List what a reader must know beside the verdict.

    Args:
        content: of diagnosis.json.

    Returns:
        Sentences.

    """
    said = []
    if content["contradicted"]:
        said.append(say_contradiction(content["contradicted"]))
    said += [say_combinations(content), say_strained_numbers(content)]
    for remark in (
        say_untried,
        _say_repairs,
        _say_remainder,
        _say_moments,
        _say_bounds,
        _say_nuisance_effect,
        _say_unmoved_joints,
    ):
        said += [remark(content)]
    return [one for one in said if one]


def find_set_probability(content: Mapping[str, Any]) -> float | None:
    """Find the probability of exactly the set of effects that the verdict names.

    Args:
        content: of diagnosis.json.

    Returns:
        The probability; None where no hypothesis has these.

    """
    sets = sorted(list_named_effects(content)), sorted(content["verdict"])
    return next((h["probability"] for h in content["hypotheses"] if sorted(h["effects"]) in sets), None)


def list_effect_probabilities(content: Mapping[str, Any]) -> list[float]:
    """List the probability that each named effect is there, summed over all sets that have it.

    Args:
        content: of diagnosis.json.

    Returns:
        A probability for each effect that the verdict names, in its order.

    """
    known = {f"{cause['effect']}@{cause['joint']}": cause["probability"] for cause in content["causes"]}
    return [known[entry] for entry in list_named_effects(content) if entry in known]


def format_probability(p: float) -> str:
    """Format a probability with two digits; none is said to be 0 or 1.

    Args:
        p: The probability.

    Returns:
        The text.

    """
    if p > 0.995:
        return "> 0.99"
    if p < 0.005:
        return "< 0.01"
    return f"{p:.2f}"


def _say_probability(content: dict[str, Any]) -> str:
    """The probability of each named effect and of the set; "" where nothing is named."""
    likely, p = list_effect_probabilities(content), find_set_probability(content)
    each = list(map(format_probability, likely))
    if not list_named_effects(content) or p is None:
        return ""
    of_set = format_probability(p)
    if not each or each == [of_set]:
        return f"; probability {of_set}{note_calibration(content)}"
    if len(each) > REPORT.most_sized_effects:
        least = format_probability(min(likely))
        return f"; probability of each {least} or more, of exactly this set {of_set}{note_calibration(content)}"
    return f"; probability {' and '.join(each)}, of exactly this set {of_set}{note_calibration(content)}"


def _say_gap(content: dict[str, Any]) -> str:
    """The gap before and after, and the share of it that is closed."""
    gap, name = content["gap"], find_shown_channel(content)
    said = "On held-out motion the gap goes"
    if content["parameters"] and not content["verdict"]:
        said = "Base parameters within their tolerance take the gap on held-out motion"
    said += f" from {format_multiple(gap['before'])} to {format_multiple(gap['after'])} times the noise"
    if name:
        error = format_channel_error(content, name, " to ")
        said += f" ({name_channel(name, content.get('joints', ()))}: {error} rms)"
    if gap["shrink"] is None:
        return said
    return f"{said}: {format_closed_share(gap)} of what lies above the noise is closed"


def _say_credit(content: dict[str, Any]) -> list[str]:
    """What the named effects close and what refitted numbers of the file close, apart; nothing where it is one."""
    own, named = find_effect_credit(content), list_named_effects(content)
    if own is None or not content["parameters"]:
        return []
    verb = _agree_in_number(named, "effect closes", "effects close")
    return [f"Of that the {verb} {100 * own:.0f} %, refitted numbers of the file {100 * (1 - own):.0f} %."]


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
        named = f"{join_effects(contradicted['verdict'])} and "
    return (
        f"What the log alone says ({named}base parameters within their tolerance) closes "
        f"{100 * contradicted['closed']:.0f} % of its own gap and leaves {100 * contradicted['left']:.0f} % of the "
        "hold-out's: they do not seem to be of the same machine, or the hold-out moves as the log never does. Give "
        "another motion of the log's machine, within its range and speed, as hdagen excite designs one, or no "
        "hold-out: a fifth of the log is then kept from the fit."
    )


def say_untried(content: Mapping[str, Any]) -> str:
    """Say what was not tried because the time was up.

    Args:
        content: of diagnosis.json.

    Returns:
        Two sentences; "" where nothing was left out.

    """
    parts = []
    for one in content.get("not_tried", ()):
        effects, more = one["effects"], len(one["effects"]) - REPORT.most_untried_effects
        named = ", ".join(effects[: REPORT.most_untried_effects])
        if more > 0:
            named += f" and {more} more"
        parts.append(f"{one['part']} ({named})" if effects else one["part"])
    if not parts:
        return ""
    return f"The time was up, so this was not tried: {'; '.join(parts)}. Give more time to be sure."


def _say_moments(content: dict[str, Any]) -> str:
    """Where nearly all that is left acts once, and a log that would show it."""
    joints = content.get("joints", ())
    each = "; ".join(
        f"{name_joint(one['joint'], joints)}, {one['span'][0]:.4g} to {one['span'][1]:.4g} s of {one['log']}"
        for one in content["moments"]
    )
    if not each:
        return ""
    return (
        f"Nearly all that is left lies within one second ({each}): what acts once cannot be told. Record a log in "
        "which the joint goes there several times."
    )


def _say_unmoved_joints(content: dict[str, Any]) -> str:
    """The joints that no log moves, and the motion that would."""
    still = content.get("data", {}).get("still", ())
    if not still:
        return ""
    which = _agree_in_number(still, f"Joint {still[0]} does", f"Joints {', '.join(map(str, still))} do")
    return (
        f"{which} not move in the log: of what acts in motion nothing can be told there (hdagen excite robot.toml "
        f"--joint {still[0]} designs a motion that shows it)."
    )


def _say_joints(content: Mapping[str, Any], entries: Sequence[str]) -> str:
    """The joints of entries name@joint that miss something."""
    joints = content.get("joints", ())
    names = [name_joint(int(entry.partition("@")[2]), joints) for entry in entries]
    if any(joints):
        return f"{' and '.join(names)} {_agree_in_number(names, 'misses', 'miss')}"
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
    shares = " and ".join(
        f"{100 * one['share']:.0f} % of the error at {name_joint(one['joint'], content.get('joints', ()))}"
        for one in much
    )
    return f"What no known effect explains remains beside it: {shares}."


def _say_repairs(content: dict[str, Any]) -> str:
    """Channels that were left out or scaled, as they contradict another."""
    repaired = content.get("data", {}).get("repaired", ())
    return " ".join(str(one["what"]) for one in repaired if one["name"] == "contradicted")


def _say_nuisance_effect(content: dict[str, Any]) -> str:
    """An effect within tolerance that would close much of the rest of the gap."""
    closer = [
        one for one in content["nuisance_effects"] if one["gap"] < REPORT.notable_gap_share * content["gap"]["after"]
    ]
    if not closer:
        return ""
    what = name_effect(f"{closer[0]['effect']}@{closer[0]['joint']}", content.get("joints", ()))
    return f"Within what is tolerated, {what} would bring it to {format_multiple(closer[0]['gap'])}."


def _say_bounds(content: dict[str, Any]) -> str:
    """Parameters of the verdict's effects that stand at an end of their range."""
    at = []
    for cause in content["causes"]:
        entry = f"{cause['effect']}@{cause['joint']}"
        if entry not in content["verdict"]:
            continue
        for name, q in cause["parameters"].items():
            if q["end"]:
                of = name_effect(entry, content.get("joints", ()))
                if name != cause["effect"]:
                    of = f"{name.replace('_', ' ')} of {of}"
                at.append(f"{of}, {format_number(q['value'], 3)}{_format_unit(q)}")
    if not at:
        return ""
    return f"At the end of what it may be: {'; '.join(at)}. There may be more of it, or another effect."


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
    each, p = join_effects(first["effects"], content.get("joints", ())), first["probability"]
    if content["gap"]["before"] < HOLDOUT_CHECK.least_explainable_gap:
        return f"There is no gap to explain, although the log may have {each} ({p:.2f})"
    none = sum(h["probability"] for h in content["hypotheses"] if not h["effects"])
    return f"No effect is sure enough to be named: perhaps {each} ({p:.2f}), or none ({none:.2f})"


def say_doubt(content: Mapping[str, Any]) -> str:
    """Say which verdict held-out motion did not confirm.

    Args:
        content: of diagnosis.json.

    Returns:
        A clause; "" where effects are named, or nothing is in doubt.

    """
    doubted = content["doubts"]
    if doubted is None or list_named_effects(content) or not content["verdict"]:
        return ""
    left = f"{100 * doubted['left']:.0f} % of what this joint errs by on held-out motion"
    if not doubted["verdict"]:
        return f"the model that explains most of the log names none and leaves {left}"
    named = join_effects(doubted["verdict"], content.get("joints", ()))
    return f"of the known effects, {named} explains most of the log, but leaves {left}"


def _compare_with_best(gap: dict[str, Any]) -> str:
    """The verdict beside the best of all that was fitted."""
    before, after, least = gap["before"], gap["after"], gap["achievable"]
    if least >= before:
        return "; nothing that was fitted closes more"
    if after <= least:
        return "; nothing else that was fitted, a flexible correction without structure included, closes more"
    best = "the best of all that was fitted, a flexible correction without structure included"
    share = 100 * (before - after) / (before - least)
    return f"; {best}, brings it to {format_multiple(least)}; the verdict closes {share:.0f} % of what that does"


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
