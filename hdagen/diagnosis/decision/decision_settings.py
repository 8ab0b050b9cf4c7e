"""From log evidence to probabilities, and from these to a verdict."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.data.development_logs import KNOWN_EFFECTS
from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class DecisionSettings:
    """From log evidence to probabilities, and from these to a verdict."""

    prior_no_effect: float = declare_setting(0.5, "probability", "prior of no effect: even odds")
    prior_further_effect: float = declare_setting(
        0.3, "probability", "prior of one more effect: further effects are less usual"
    )
    unknown_midpoints: tuple[float, float] = declare_setting(
        (0.6, 1.0),
        "units of residual torque; variance beyond the noise's, of that of the noise",
        "something unknown is as probable as not here",
        KNOWN_EFFECTS,
    )
    unknown_remaining_share: float = declare_setting(
        0.64, "of what the null model leaves", "something unknown is as probable as not here", KNOWN_EFFECTS
    )
    largest_unknown_size: float = declare_setting(
        2.0,
        "of the midpoints",
        "from here it is plain that something is left and more says no more: a real machine's motion is "
        "worth a percent of its torque where a simulated one's is worth a thousandth",
        KNOWN_EFFECTS,
    )
    negligible_unknown_odds: float = declare_setting(
        0.05, "odds", "something unknown below these odds is not counted", KNOWN_EFFECTS
    )
    rare_parameter_deviation: float = declare_setting(
        2.576, "tolerances", "one machine in a hundred whose robot file is right is off by as much"
    )
    informative_std_ratio: float = declare_setting(
        0.5, "posterior width by prior width", "the data determine a parameter up to here; else the prior speaks"
    )
    most_evidence_deficit: float = declare_setting(
        10.0,
        "nats",
        "a hypothesis that means a rare base parameter, or the fit of a set, may be behind by as much: "
        "what is rare is less probable",
    )
    form_correction_share: float = declare_setting(
        0.2,
        "of the gain of effects of its kind",
        "an effect with less makes up for the formula of another one and is not named: no machine has "
        "exactly the formula of the model",
    )
    look_alike_share: float = declare_setting(
        0.25,
        "of the log evidence that a verdict gains",
        "wrong numbers of the file that would gain as much may be what the verdict stands for: where no effect"
        " is fitted, the unexplained torque takes the rest",
        KNOWN_EFFECTS,
    )
    least_number_gain: float = declare_setting(
        3.0,
        "nats",
        "wrong numbers of the file that would gain less beside a verdict are not searched: odds of 20",
        KNOWN_EFFECTS,
    )
    sure_below: float = declare_setting(
        0.1,
        "probability",
        "a verdict is not sure where what else it may be has more: one wrong verdict in ten is not sure",
    )
    no_effect_threshold: float = declare_setting(
        1 / 3,
        "probability",
        "from this probability of no effect on, before any calibration, no effect is named: an alarm sends an "
        "engineer to change a model that may be right",
        "300 sealed logs without an effect, 297 of which left no effect 0.59 or more",
    )
    probability_margin: float = declare_setting(
        1e-6, "probability", "probabilities nearer to 0 or 1 count as this: log odds stay finite"
    )
    confusable_odds: float = declare_setting(
        100.0,
        "odds",
        "two effects whose expected evidence differs by less count as confounded: odds of 100 separate them",
    )
    present_from_deviations: float = declare_setting(
        2.0, "standard deviations", "one of several sizes of an effect counts as present from here"
    )
    bound_tolerance: float = declare_setting(
        1e-9,
        "of an end of a parameter's range, or of its nominal",
        "within it a parameter stands at that end: above rounding",
    )
    least_mentioned_probability: float = declare_setting(
        0.01, "probability", "another cause is named from here: a smaller one is not worth a line"
    )
    least_file_probability: float = declare_setting(
        1e-6,
        "probability",
        "of such deviations if the robot file is right; below it the log is refused: a refusal must be certain",
    )
    largest_share_left: float = declare_setting(
        0.5,
        "of the gap",
        "a file that looks like another machine's, but whose wrong numbers are surely named, leaves less on held-out "
        "motion: its numbers are causes, and no reason to refuse it",
    )
    largest_gap_of_likelier: float = declare_setting(
        1.5,
        "of what the other verdict leaves",
        "wrong numbers with fewer effects and clearly more log evidence leave less on held-out motion: small "
        "errors of any fit grow over a long motion",
    )
    most_shown_parameters: int = declare_setting(4, "parameters", "parameters that a refusal names")


DECISION = DecisionSettings()
