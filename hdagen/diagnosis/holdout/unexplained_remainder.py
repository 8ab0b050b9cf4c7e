"""Remainders: the share of each joint's error that no known effect explains.

The verdict names a remainder beside its effects, as `unknown@joint`. It replaces none of them: a friction that closes
nine tenths of a gap is present, whatever the last tenth is. Where no effect is named, and no fit closes a notable share
of the gap, the model is as good as it gets on this motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.diagnosis.data.gap import SIGNIFICANT_NOISE_MULTIPLE

NAMED_REMAINDER_SHARE = 1 / 3  # of what a joint errs by, from which on what remains is said in the verdict
LEAST_CLOSABLE_SHARE = 0.2  # of a gap, below which the best of all that was fitted closes nothing worth speaking of
LARGEST_GOOD_GAP = (
    2.0 * SIGNIFICANT_NOISE_MULTIPLE
)  # multiples of the noise, up to which that is as good as a model gets: beyond it nothing is good


def measure_remainders(channels: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Measure the remainder of each joint, as `remains` of diagnosis.json.

    Args:
        channels: `by_channel` of its gap.

    Returns:
        For each ``joint`` with a channel the ``share`` of its error before that is left, and that error in multiples of
        the ``noise``. Of several channels the best explained one counts, as it shows that the joint is explained.

    """
    found: dict[int, dict[str, Any]] = {}
    for name, channel in channels.items():
        joint = int(name.rpartition("_")[2])
        one = {"joint": joint, "share": channel["after"] / channel["before"], "noise": channel["after"]}
        encoder = "position" in name
        if encoder or channel["before"] > SIGNIFICANT_NOISE_MULTIPLE:  # a sensor that did not err shows nothing
            found[joint] = min(one, found.get(joint, one), key=lambda each: float(each["share"]))
    return [found[joint] for joint in sorted(found)]


def name_remainders(verdict: Sequence[str], remains: Sequence[Mapping[str, Any]]) -> list[str]:
    """Add the remainders to a verdict.

    Args:
        verdict: as diagnosis.json has it, without remainders.
        remains: as `measure_remainders` has it.

    Returns:
        The verdict, and after its effects `unknown@joint` for each joint with a large remainder.

    """
    if not verdict or any(name.startswith("unknown@") for name in verdict):
        return list(verdict)
    much = (
        one["joint"]
        for one in remains
        if one["share"] > NAMED_REMAINDER_SHARE and one["noise"] > SIGNIFICANT_NOISE_MULTIPLE
    )
    return [*verdict, *(f"unknown@{joint}" for joint in much)]


def is_as_good_as_it_gets(gap: Mapping[str, Any]) -> bool:
    """Say whether no fit closes a notable share of the gap.

    Args:
        gap: as diagnosis.json has it.

    Returns:
        True where the robot file leaves few times the noise, and the best of all that was fitted about as much.

    """
    return bool(gap["before"] <= LARGEST_GOOD_GAP and gap["achievable"] >= (1.0 - LEAST_CLOSABLE_SHARE) * gap["before"])
