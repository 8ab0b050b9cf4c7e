"""What the checks of single channels and of encoders count as a mistake."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class ChannelCheckSettings:
    """What the checks of single channels and of encoders count as a mistake."""

    least_rows_per_term: int = declare_setting(
        5, "rows", "rows for each term of a least-squares fit: fewer leave it to the noise"
    )
    most_unstated_current: float = declare_setting(
        200.0, "A", "a larger current is in mA, unless the robot file states such a drive"
    )
    usual_rows_share: float = declare_setting(
        0.99, "of the rows", "the largest current of these rows is the usual largest one"
    )
    most_stated_ratio: float = declare_setting(
        2.0, "largest stated currents", "a misread current is above it: no drive gives more"
    )
    most_usual_ratio: float = declare_setting(5.0, "usual largest currents", "and above this, too")
    least_leap_ratio: float = declare_setting(
        5.0, "fastest usual moves", "no drive moves so far in a row: it is a leap"
    )
    least_leap_noise: float = declare_setting(20.0, "multiples of the noise", "a leap reaches this, too")
    neighbour_rows: int = declare_setting(2, "rows", "rows on each side of one whose median move is the usual one")
    most_glitch_rows: int = declare_setting(3, "rows", "a leap that comes back within these rows is a glitch")
    wrap_tolerance: float = declare_setting(
        0.03, "of the period", "a leap that is this near to the period of an encoder is a wrap"
    )
    least_move_steps: float = declare_setting(
        10.0, "steps or noise", "a joint that moves so far in a row cannot stand still in the next"
    )
    least_other_move: float = declare_setting(
        0.1, "of its range", "the other encoder moves so far while one that froze stands still"
    )
    least_held_time: float = declare_setting(
        0.05, "s", "a measured current that keeps one value so long while its command moves has frozen"
    )
    least_command_change: tuple[float, float] = declare_setting(
        (0.05, 4.0), "of its range; multiples of the noise", "the command moves by the larger of both meanwhile"
    )
    least_input_run: float = declare_setting(0.01, "s", "an input at one value counts from here")
    least_position_run: float = declare_setting(
        0.03, "s", "a position at one value counts from here: a coarse encoder stands still at a reversal"
    )
    least_run_rows: int = declare_setting(5, "rows", "rows at one value that count at least")
    speed_rows: int = declare_setting(4, "rows", "rows beside a run whose median move is its speed")
    least_speed_share: float = declare_setting(
        0.2, "of the usual speed", "a motion as fast as this is not about to turn"
    )
    abrupt_ratio: float = declare_setting(
        2.0, "largest other changes of speed", "a position that was cut off stops and continues so abruptly"
    )
    commanded_rows_share: float = declare_setting(
        0.95, "of the rows", "a measurement that equals its command in these rows is the command again"
    )
    commanded_noise_multiple: float = declare_setting(
        4.0, "multiples of the noise", "difference up to which both are equal"
    )
    passive_input_share: float = declare_setting(
        0.25, "of the strongest joint's input", "a joint without a drive may read up to this"
    )
    least_error_ratio: float = declare_setting(
        3.0, "errors of the fit", "the motion requires so much more than an input that was cut off"
    )
    least_bound_share: float = declare_setting(0.05, "of the bound", "the same, beside the error of the fit")
    lost_row_ratios: tuple[float, float] = declare_setting(
        (1.7, 3.3),
        "usual moves",
        "a row moves so far, against the rows beside it, where one or two rows before it were lost",
    )
    least_lost_share: float = declare_setting(0.003, "of the moving rows", "rows were lost from this share on")
    following_correlation: float = declare_setting(0.95, "correlation", "a position follows a reference from here")
    largest_span: float = declare_setting(
        25.0, "rad", "a joint that spans more turns like a wheel, or is logged in degrees"
    )
    related_correlation: float = declare_setting(0.7, "correlation", "a velocity can belong to a position from here")
    close_correlation: float = declare_setting(
        0.9, "correlation", "its slope against the derivative is accurate from here"
    )
    unit_factor_tolerance: float = declare_setting(
        1.02, "ratio", "a slope so near to the factor between two units counts as it"
    )
    sure_drift_deviations: float = declare_setting(
        6.0, "standard errors", "a drift of the encoders' clocks is sure from here"
    )
    jackknife_blocks: int = declare_setting(10, "blocks", "blocks of time that the jackknife leaves out in turn")
    least_drift_noise: float = declare_setting(
        2.0, "multiples of the noise", "a drift counts if it moves the reading by this"
    )
    largest_drift_rate: float = declare_setting(0.01, "of a clock's rate", "more is no drift of a clock")


CHANNEL_CHECK = ChannelCheckSettings()
