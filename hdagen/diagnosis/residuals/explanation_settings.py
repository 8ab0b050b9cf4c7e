"""Where and when a gap lies: residual torque, tests of regressors, spectra."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class ExplanationSettings:
    """Where and when a gap lies: residual torque, tests of regressors, spectra."""

    velocity_filter_width: float = declare_setting(
        0.007, "s", "moving average before the velocity that friction depends on: it keeps reversals in place"
    )
    sharp_friction_width: float = declare_setting(
        1e-6,
        "rad/s (or m/s) at the motor",
        "width of friction's smooth sign in a torque balance: below any speed of a log",
    )
    neighbour_gap: float = declare_setting(3.5, "periods", "rows further apart are no neighbours")
    reversal_reach: float = declare_setting(
        0.5, "of the filter's width", "rows this close to a reversal mix friction of both signs"
    )
    torsion_step_share: float = declare_setting(
        1e-3, "of the largest torque of the links", "step for the springs' slope"
    )
    infinite_log_gap: float = declare_setting(1e3, "1", "replaces the logarithm of an infinite gap")
    least_place_share: float = declare_setting(
        0.01,
        "of the closed gap",
        "the base parameters of a place with less are not named: a smaller place is not worth a line",
    )
    constant_share: float = declare_setting(0.8, "of the rms", "with a larger mean a quantity is mostly constant")
    least_explained_share: float = declare_setting(
        0.2, "of a variance", "a regressor that explains less is not named: less describes little"
    )
    integration_step: float = declare_setting(1e-3, "s", "longest step of an integration")
    largest_motor_order: int = declare_setting(
        24, "cycles in a turn of the motor", "orders up to it are examined: cogging and gear orders"
    )
    counted_second: float = declare_setting(
        1.0, "s", "length of the blocks that the share's interval and the test of signs count"
    )
    quantile_bins: int = declare_setting(8, "bins", "bins of equally many samples: each with enough rows")
    circular_shifts: int = declare_setting(
        999, "shifts", "equally spaced; the smallest significance of one regressor is 1 in 1000"
    )
    significance_level: float = declare_setting(
        0.05, "probability", "a regime above it is not named, after correction for the number of tests"
    )
    most_tested_samples: int = declare_setting(6000, "samples", "samples that are tested at most: time")
    small_shift_divisor: int = declare_setting(50, "parts of a series", "a shift by less than one of them is small")
    segment_length: float = declare_setting(1.0, "s", "length of a segment")
    passband_share: float = declare_setting(
        0.4, "of the first zero of the torque balance's filter", "the highest frequency of use"
    )
    slope_blocks: int = declare_setting(
        8, "blocks", "blocks of a motion, whose slopes give the standard error of the slope of all"
    )
    sure_standard_errors: float = declare_setting(
        2.0, "standard errors", "a plot contradicts an effect beyond them only"
    )
    contradicting_ratio: float = declare_setting(
        2.0, "ratio of slopes", "from here a plot contradicts the effect that it shows: half or twice is another effect"
    )
    most_cached_inputs: int = declare_setting(4, "inputs", "inputs that are kept for other parameters: memory")


EXPLANATION = ExplanationSettings()
