"""What a diagnosis says, in sentences: the verdict with its gap, and what else it may be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hdagen.diagnosis.separators import separate_by
from hdagen.diagnosis.standing import NOISE
from hdagen.pages.quantity import number

LIKELY = 0.01  # probability from which a candidate is spoken of
SEPARATED = 4  # candidates that a motion is designed for, where none is named
NEAREST = 6  # effects that one may also be, that are named
MORE = 0.75  # of the gap that is left, below which an effect within tolerance brings it if it is spoken of
FINE = 1000.0  # multiples of the noise, from which the error is said in its unit, too


def sentence(content: dict[str, Any]) -> str:
    """The verdict in one sentence, how sure it is, and the gap in another."""
    gap, verdict = content["gap"], content["verdict"]
    named = [entry for entry in verdict if not entry.startswith("unknown@")]
    if not verdict:
        what = _nothing(content)
    elif not named:
        what = f"{_joints(verdict)} something that no known effect explains{_though(content['doubted'])}"
    else:
        sets = sorted(named), sorted(verdict)
        p = next((h["probability"] for h in content["hypotheses"] if sorted(h["effects"]) in sets), None)
        each = _each(named)
        sized = "" if p is None else f" (probability {p:.2f}{calibrated(content)})"
        what = f"{each[0].upper()}{each[1:]} {'is' if len(named) == 1 else 'are'} missing in the model{sized}"
    sure = "" if content["sure"] or content["contradicted"] else "; this is not sure"
    within = "Base parameters within their tolerance take the gap on held-out motion"
    how = within if content["parameters"] and not verdict else "On held-out motion the gap goes"
    line = f"{what}{sure}. {how} from {_times(gap['before'])} "
    line += f"to {_times(gap['after'])} times the noise{_worst(gap) if gap['before'] >= FINE else ''}"
    if gap["shrink"] is not None:
        interval = gap["interval"]
        spread = f" [{100 * interval[0]:.0f}, {100 * interval[1]:.0f}]" if interval else ""
        line += f": {100 * gap['shrink']:.0f} %{spread} of what lies above the noise is closed"
    why = f" {say_contradiction(content['contradicted'])}" if content["contradicted"] else ""
    more = (_remains, _moments, _ends, _more, _contradictions, _still)
    return f"{line}{_beside(gap)}.{why}{''.join(each(content) for each in more)}"


def say_contradiction(contradicted: dict[str, Any]) -> str:
    """Why a hold-out does not seem to be of the log's machine, and what to do: `contradicted` of diagnosis.json."""
    named = f"{_each(contradicted['verdict'])} and " if contradicted["verdict"] else ""
    return (
        f"What the log alone says ({named}base parameters within their tolerance) closes "
        f"{100 * contradicted['closed']:.0f} % of its own gap and leaves {100 * contradicted['left']:.0f} % of the "
        "hold-out's: they do not seem to be of the same machine, or the hold-out moves as the log never does. Give "
        "another motion of the log's machine, within its range and speed, as hdagen excite designs one, or no "
        "hold-out: a fifth of the log is then kept from the fit."
    )


def _moments(content: dict[str, Any]) -> str:
    """What acts once, and what would tell it."""
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


def _still(content: dict[str, Any]) -> str:
    """The joints that no log moves, and the motion that would."""
    still = content.get("data", {}).get("still", ())
    if not still:
        return ""
    which = f"Joint {still[0]} does" if len(still) == 1 else f"Joints {', '.join(map(str, still))} do"
    return (
        f" {which} not move in the log: of what acts in motion nothing can be told there (hdagen excite robot.toml "
        f"--joint {still[0]} designs a motion that shows it)."
    )


def _joints(entries: Sequence[str]) -> str:
    """Which joints miss something, of entries name@joint."""
    numbers = [entry.partition("@")[2] for entry in entries]
    return f"Joint {numbers[0]} misses" if len(numbers) == 1 else f"Joints {', '.join(numbers)} miss"


def _remains(content: dict[str, Any]) -> str:
    """What no known effect explains beside those that are named."""
    beside = {int(entry.partition("@")[2]) for entry in content["verdict"] if entry.startswith("unknown@")}
    if len(beside) == len(content["verdict"]):  # it is all that is said
        return ""
    much = [one for one in content["remains"] if one["joint"] in beside]
    shares = " and ".join(f"{100 * one['share']:.0f} % of the error at joint {one['joint']}" for one in much)
    return f" What no known effect explains remains beside it: {shares}." if much else ""


def _contradictions(content: dict[str, Any]) -> str:
    """Channels that were left out or scaled, as they contradict another."""
    repaired = content.get("data", {}).get("repaired", ())
    return "".join(f" {one['what']}" for one in repaired if one["name"] == "contradicted")


def _times(multiples: float) -> str:
    return number(float(f"{multiples:.3g}"), 3)


def _more(content: dict[str, Any]) -> str:
    """What is within tolerance and would close much of what is left."""
    closer = [one for one in content["tolerated"] if one["gap"] < MORE * content["gap"]["after"]]
    if not closer:
        return ""
    what = words(f"{closer[0]['effect']}@{closer[0]['joint']}")
    return f" Within what is tolerated, {what} would bring it to {_times(closer[0]['gap'])}."


def _ends(content: dict[str, Any]) -> str:
    """Which parameters of the verdict's effects the fit could not move farther."""
    at = [
        f"{name.replace('_', ' ')} of {words(entry)}, {number(q['value'], 3)}{_unit(q)}"
        for cause in content["causes"]
        if (entry := f"{cause['effect']}@{cause['joint']}") in content["verdict"]
        for name, q in cause["parameters"].items()
        if q["end"]
    ]
    if not at:
        return ""
    return f" At the end of what it may be: {'; '.join(at)}. There may be more of it, or another effect."


def _unit(q: dict[str, Any]) -> str:
    return "" if q["unit"] == "1" else f" {q['unit']}"


def _nothing(content: dict[str, Any]) -> str:
    """Why no effect is named: none is likely, or one is, but not sure enough, or there is nothing to explain."""
    first = content["hypotheses"][0]
    if content["contradicted"]:
        return "What is missing cannot be told, as log and hold-out contradict each other"
    if content["as_good_as_it_gets"]:
        return "The model is as good as it gets here: nothing that was fitted closes much of the gap"
    if not first["effects"]:
        p = f"{first['probability']:.2f}{calibrated(content)}"
        return f"No effect above the size that counts was found (probability {p})"
    each, p = _each(first["effects"]), first["probability"]
    if content["gap"]["before"] < NOISE:
        return f"There is no gap to explain, although the log may have {each} ({p:.2f})"
    none = sum(h["probability"] for h in content["hypotheses"] if not h["effects"])
    return f"No effect is sure enough to be named: perhaps {each} ({p:.2f}), or none ({none:.2f})"


def _each(entries: Sequence[str]) -> str:
    """Several effects in a row."""
    return " and ".join(words(entry) for entry in entries)


def _though(doubted: dict[str, Any] | None) -> str:
    """What would have been said, had it stood up to motion that the fit did not see."""
    if doubted is None:
        return ""
    left = f"{100 * doubted['left']:.0f} % of what this joint errs by on held-out motion"
    if not doubted["verdict"]:
        return f": the model that tells most of the log names none and leaves {left}"
    return f": of what is known {_each(doubted['verdict'])} tells most of the log, but leaves {left}"


def _beside(gap: dict[str, Any]) -> str:
    """The verdict beside the best of all that was fitted."""
    before, after, least = gap["before"], gap["after"], gap["achievable"]
    if least >= before:
        return "; nothing that was fitted closes more"
    if after <= least:
        return "; nothing else that was fitted, a flexible correction without structure included, closes more"
    best = "the best of all that was fitted, a flexible correction without structure included"
    share = 100 * (before - after) / (before - least)
    return f"; {best}, brings it to {_times(least)}; the verdict closes {share:.0f} % of what that does"


def _worst(gap: dict[str, Any]) -> str:
    """The channel that errs most, in SI units, for a reader to whom multiples of a very small noise say little."""
    name, c = max(gap["by_channel"].items(), key=lambda item: item[1]["before"])
    before, after = (c[when] * c["noise"] for when in ("before", "after"))
    return f" ({name.replace('_', ' ')}: {before:.3g} to {after:.3g} in SI units, rms)"


def words(entry: str) -> str:
    """name@joint as people say it; what says of itself that it is missing need not be said to be so."""
    effect, _, joint = entry.partition("@")
    what = effect.removeprefix("missing_").replace("_", " ")
    return f"{what} {f'on joint {joint}' if joint != '0' else 'of the whole arm'}"


def calibrated(content: dict[str, Any]) -> str:
    """To add to a probability."""
    return "" if content.get("method", {}).get("calibrated") else ", not calibrated"


def confounded(content: dict[str, Any]) -> str:
    """What else each effect that is named may be, or which may be there where none is, and the motions that would
    tell."""
    causes = {f"{c['effect']}@{c['joint']}": c for c in content["causes"]}
    shown = causes.keys() - set(content["unseen"])  # the report says those for themselves
    likely = [name for name, c in causes.items() if c["probability"] >= LIKELY and name in shown]
    named = [name for name in content["verdict"] if name in causes]
    if not named:
        if content["verdict"] and not likely:
            return "No known effect explains the log nearly as well as something unknown."
        if not likely:
            return "Of what this motion shows, nothing explains the log nearly as well as no effect."
        each = ", ".join(f"{words(name)} ({causes[name]['probability']:.2f})" for name in likely)
        weak = "one that is small, or that shows little in this motion, may be there"
        text = f"No effect is named; {'the log alone says' if content['contradicted'] else weak}: {each}."
        if len(likely) == 1:
            return text
        return (
            f"{text}\n\nWhat would tell {words(likely[0])} from the others: {separate_by(likely[0], likely[1:])}\n\n"
            f"    hdagen excite robot.toml --separate {','.join(likely[:SEPARATED])}\n\ndesigns a motion that does."
        )
    said = [_alike(name, others) for name in named if (others := causes[name]["confounded_with"])]
    if not said:
        return "Nothing else explains this log nearly as well: no pair is confounded."
    return "What this log cannot tell apart, and the motion that would:\n\n" + "\n\n".join(said)


def _alike(name: str, others: Sequence[str]) -> str:
    """What an effect of the verdict may also be, the nearest first, and the motions that would tell; where that is
    nearly anything, the motion says little of it, and a list of all would say no more."""
    few, more = others[:NEAREST], len(others) - NEAREST
    said = f"{words(name)[0].upper()}{words(name)[1:]} may also be {', '.join(words(o) for o in few)}"
    if more > 0:
        said += f", or one of {more} others (diagnosis.json has them): this motion tells little of it"
    return f"{said}. {separate_by(name, few)}"
