"""What a verdict must show on motion that no fit saw."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.data.development_logs import EARLIER_LOGS, UNKNOWN_TORQUES
from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class HoldoutCheckSettings:
    """What a verdict must show on motion that no fit saw."""

    most_remaining_share: float = declare_setting(
        2 / 3,
        "of what every encoder of a joint errs by",
        "may be left: what leaves more explains something else",
        EARLIER_LOGS,
    )
    unclosed_share: float = declare_setting(
        0.9,
        "of the error or of a gap",
        "a verdict that leaves more closes next to nothing: an effect must close more than a tenth",
    )
    least_explainable_gap: float = declare_setting(
        1.2, "multiples of the noise", "below it there is nothing to explain"
    )
    largest_sure_gap: float = declare_setting(
        100.0, "multiples of the noise", "from here what is left is no small matter, whatever else leaves"
    )
    unknown_odds_power: float = declare_setting(
        4.0, "1", "power of what is left in the odds: odds fall steeply with the share left"
    )
    leading_gap_ratio: float = declare_setting(
        3.0, "times what another set leaves of the gap", "a set that leaves more does not lead"
    )
    most_tried_sets: int = declare_setting(
        4, "sets", "sets beside the leading one: each costs a replay of held-out motion"
    )
    former_leader_odds: float = declare_setting(
        1 / 4, "odds", "of the set that led, beside the one that took its place: the verdict is then not sure"
    )
    error_margin: float = declare_setting(
        1.5, "times the best set's error", "up to it short windows decide", EARLIER_LOGS
    )
    most_replayed_sets: int = declare_setting(8, "sets", "sets beside the null model: each costs a replay of the log")
    negligible_gap_ratio: float = declare_setting(
        1.05, "times the gap with an effect", "may be left without it: the effect is small"
    )
    negligible_channel_ratio: float = declare_setting(
        1.1, "times what any channel errs by", "the same: what acts on one of many channels shows little in their mean"
    )
    negligible_remainder_ratio: float = declare_setting(
        2.0**0.5, "times either", "the same where what is left counts beside the noise", UNKNOWN_TORQUES
    )
    named_remainder_share: float = declare_setting(
        1 / 3, "of what a joint errs by", "what remains is said in the verdict from here", UNKNOWN_TORQUES
    )
    least_closable_share: float = declare_setting(
        0.2, "of a gap", "the best of all that was fitted closes less: nothing worth a change"
    )
    largest_good_multiple: float = declare_setting(
        2.0,
        "times the multiple of the noise that counts",
        "up to it a gap that nothing closes is as good as a model gets: beyond it nothing is good",
    )
    most_ranked_hypotheses: int = declare_setting(
        3, "hypotheses", "hypotheses beside no effect and the verdict: each costs one replay"
    )
    clear_deviations: float = declare_setting(
        4.0, "standard deviations", "the data determine an effect's size from here"
    )
    most_replayed_effects: int = declare_setting(2, "effects", "effects that are tried: each costs one replay")
    least_listed_gain: float = declare_setting(
        0.05, "of the gap after the verdict", "an effect must close as much to be listed: worth a line"
    )


HOLDOUT_CHECK = HoldoutCheckSettings()
