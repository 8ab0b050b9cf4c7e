"""Remainders: the share of each joint's error that no known effect explains.

The verdict names a remainder beside its effects, as `unknown@joint`. It replaces none of them: a friction that closes
nine tenths of a gap is present, whatever the last tenth is. Where no effect is named, and no fit closes a notable share
of the gap, the model is as good as it gets on this motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK

LARGEST_GOOD_GAP = HOLDOUT_CHECK.largest_good_multiple * DATA.significant_noise_multiple  # multiples of the noise


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
        if encoder or channel["before"] > DATA.significant_noise_multiple:  # a sensor that did not err shows nothing
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
        if one["share"] > HOLDOUT_CHECK.named_remainder_share and one["noise"] > DATA.significant_noise_multiple
    )
    return [*verdict, *(f"unknown@{joint}" for joint in much)]


def is_as_good_as_it_gets(gap: Mapping[str, Any]) -> bool:
    """Say whether no fit closes a notable share of the gap.

    Args:
        gap: as diagnosis.json has it.

    Returns:
        True where the robot file leaves few times the noise, and the best of all that was fitted about as much.

    """
    return bool(
        gap["before"] <= LARGEST_GOOD_GAP
        and gap["achievable"] >= (1.0 - HOLDOUT_CHECK.least_closable_share) * gap["before"]
    )
