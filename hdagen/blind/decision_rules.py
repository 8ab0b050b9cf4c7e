"""The rules of the decision, each with the values at which it changes nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.long_horizon_settings import LONG_HORIZON

BEYOND_EVERY_SIZE, BELOW_EVERY_SIZE = 1e9, 1e-9  # finite, as products with 0 have to be numbers


@dataclass(frozen=True)
class Rule:
    """A rule of the decision.

    Attributes:
        words: the rule in words.
        settings: the object that has its numbers.
        neutral: the values, by name of the number, at which the rule changes nothing.

    """

    words: str
    settings: Any
    neutral: Mapping[str, float]

    @property
    def name(self) -> str:
        """Its numbers, as the settings name them."""
        return ", ".join(self.neutral)

    @contextmanager
    def switch_off(self) -> Iterator[None]:
        """Give the rule's numbers their neutral values as long as the block lasts; no diagnosis may run beside it."""
        usual = {name: getattr(self.settings, name) for name in self.neutral}
        try:
            for name, value in self.neutral.items():
                object.__setattr__(self.settings, name, value)  # every stage reads this one frozen object
            yield
        finally:
            for name, value in usual.items():
                object.__setattr__(self.settings, name, value)


RULES = (
    Rule("a further effect is less usual than one", DECISION, {"prior_further_effect": 1.0}),
    Rule("something unknown is a hypothesis", DECISION, {"negligible_unknown_odds": BEYOND_EVERY_SIZE}),
    Rule("a large remainder says no more than a plain one", DECISION, {"largest_unknown_size": BEYOND_EVERY_SIZE}),
    Rule(
        "a set stands for that with its rare base parameters",
        DECISION,
        {"rare_parameter_deviation": BEYOND_EVERY_SIZE},
    ),
    Rule("only what the data determine strains or is rare", DECISION, {"informative_std_ratio": BEYOND_EVERY_SIZE}),
    Rule("a fit far behind tells nothing of its set", DECISION, {"most_evidence_deficit": BEYOND_EVERY_SIZE}),
    Rule("a correction of a formula is not named", DECISION, {"form_correction_share": BELOW_EVERY_SIZE**9}),
    Rule("no effect is named where none is in doubt", DECISION, {"no_effect_threshold": 1.0}),
    Rule("numbers that the motion cannot part are combined", DECISION, {"confusable_odds": 1.0}),
    Rule("a robot file of another machine is refused", DECISION, {"least_file_probability": 0.0}),
    Rule("a surely corrected file is no other machine's", DECISION, {"largest_share_left": 0.0}),
    Rule("likelier and fewer numbers stand for effects", DECISION, {"largest_gap_of_likelier": 0.0}),
    Rule("a number at an end of its range makes unsure", DECISION, {"bound_tolerance": -BEYOND_EVERY_SIZE}),
    Rule("a small effect does not count as present", CANDIDATES, {"present_size": BELOW_EVERY_SIZE}),
    Rule("twice its tolerance is as the file states", CANDIDATES, {"base_deviation_limit": 0.0}),
    Rule("an error near the noise does not count", DATA, {"significant_noise_multiple": 1.0}),
    Rule("an effect must close a third of its joint's error", HOLDOUT_CHECK, {"most_remaining_share": 1.0}),
    Rule("less than a tenth of an error is next to nothing", HOLDOUT_CHECK, {"unclosed_share": 1.0}),
    Rule("a gap at the noise explains nothing", HOLDOUT_CHECK, {"least_explainable_gap": 0.0}),
    Rule("a very large remaining gap makes unsure", HOLDOUT_CHECK, {"largest_sure_gap": BEYOND_EVERY_SIZE}),
    Rule("odds of something unknown fall steeply", HOLDOUT_CHECK, {"unknown_odds_power": 1.0}),
    Rule("a set that leaves several times more does not lead", HOLDOUT_CHECK, {"leading_gap_ratio": BEYOND_EVERY_SIZE}),
    Rule("a set that took the lead is not sure", HOLDOUT_CHECK, {"former_leader_odds": 0.0}),
    Rule("long windows weigh the sets", HOLDOUT_CHECK, {"error_margin": BEYOND_EVERY_SIZE}),
    Rule("a gap slightly larger is alike", HOLDOUT_CHECK, {"negligible_gap_ratio": 1.0}),
    Rule("no channel may be clearly worse", HOLDOUT_CHECK, {"negligible_channel_ratio": BEYOND_EVERY_SIZE}),
    Rule("beside a large remainder more is alike", HOLDOUT_CHECK, {"negligible_remainder_ratio": 1.05}),
    Rule(
        "an effect that closes little is not named",
        HOLDOUT_CHECK,
        {"negligible_gap_ratio": 0.0, "negligible_channel_ratio": 0.0, "negligible_remainder_ratio": 0.0},
    ),
    Rule("a large remainder is named beside the effects", HOLDOUT_CHECK, {"named_remainder_share": BEYOND_EVERY_SIZE}),
    Rule("a gap that nothing closes names nothing", HOLDOUT_CHECK, {"least_closable_share": -BEYOND_EVERY_SIZE}),
    Rule("long windows are searched for effects", LONG_HORIZON, {"most_effects": 0}),
)
