"""What remains: how much of what each joint errs by no known effect explains.

It is said beside what is named, as `unknown@joint`, and replaces none of it: a friction that closes nine tenths of a
gap is there, whatever the last tenth is. Where no effect is named, and nothing that was fitted closes a share of the
gap worth speaking of, the model is as good as it gets on this motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.diagnosis.gap import ABOVE

SHARE = 1 / 3  # of what a joint errs by, from which on what remains is said in the verdict
CLOSABLE = 0.2  # of a gap, below which the best of all that was fitted closes nothing worth speaking of
FEW = 2.0 * ABOVE  # multiples of the noise, up to which that is as good as a model gets: beyond it nothing is good


def measure_remainders(channels: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """`remains` of diagnosis.json.

    Args:
        channels: `by_channel` of its gap.

    Returns:
        For each joint that has a channel ``joint``, ``share`` of what it erred by before that is left, the smallest of
        its channels', as one that is explained shows that the joint is, and ``noise``: what is left there, in multiples
        of that channel's noise.

    """
    found: dict[int, dict[str, Any]] = {}
    for name, channel in channels.items():
        joint = int(name.rpartition("_")[2])
        one = {"joint": joint, "share": channel["after"] / channel["before"], "noise": channel["after"]}
        encoder = "position" in name
        if encoder or channel["before"] > ABOVE:  # a sensor that did not err shows nothing
            found[joint] = min(one, found.get(joint, one), key=lambda each: float(each["share"]))
    return [found[joint] for joint in sorted(found)]


def name_remainders(verdict: Sequence[str], remains: Sequence[Mapping[str, Any]]) -> list[str]:
    """A verdict with what remains.

    Args:
        verdict: as diagnosis.json has it, without what remains.
        remains: as `measure_remainders` has it.

    Returns:
        The verdict, and after its effects `unknown@joint` for each joint of which much remains.

    """
    if not verdict or any(name.startswith("unknown@") for name in verdict):
        return list(verdict)
    much = (one["joint"] for one in remains if one["share"] > SHARE and one["noise"] > ABOVE)
    return [*verdict, *(f"unknown@{joint}" for joint in much)]


def is_as_good_as_it_gets(gap: Mapping[str, Any]) -> bool:
    """Whether nothing that was fitted closes more of a gap than is worth speaking of.

    Args:
        gap: as diagnosis.json has it.

    Returns:
        True where the robot file leaves few times the noise, and the best of all that was fitted about as much.

    """
    return bool(gap["before"] <= FEW and gap["achievable"] >= (1.0 - CLOSABLE) * gap["before"])
