"""What a diagnosis fits, holds out and counts a gap over."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.data.development_logs import EARLIER_LOGS, JOINT_ARMS
from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class DataSettings:
    """What a diagnosis fits, holds out and counts a gap over."""

    holdout_share: float = declare_setting(
        0.2, "of each log", "share of a log that is held out: four fifths remain for the fit"
    )
    holdout_span: float = declare_setting(
        5.0, "s", "one block of each span is held out, so that blocks lie all over the log"
    )
    fewest_holdout_spans: int = declare_setting(
        4, "spans", "a shorter log is cut into as many spans, so that its blocks lie all over it, too"
    )
    window_length: float = declare_setting(
        0.1,
        "s",
        "short: a wrong parameter bends the motion little; long: what torque moves grows with the square of the time, "
        "what an encoder errs by does not",
        JOINT_ARMS,
    )
    fewest_window_rows: int = declare_setting(25, "rows", "rows of a window at least: slow logs get longer windows")
    shortest_last_window: float = declare_setting(
        0.5, "of a window", "the last window of a stretch may be this short; a shorter rest is left out"
    )
    selected_rows: int = declare_setting(3600, "rows", "rows that the fitted windows have together: time and memory")
    fewest_selected_windows: int = declare_setting(
        48, "windows", "windows that are fitted at least, however many rows they have: they lie all over the log"
    )
    most_selected_windows: int = declare_setting(
        96, "windows", "windows that are fitted at most, however few rows they have: initial states take time, too"
    )
    most_sampled_values: int = declare_setting(
        18_000, "rows times channels", "values that are fitted at most: time and memory"
    )
    initial_state_reach: float = declare_setting(
        0.01, "s", "to each side of a window's first row; a start only, as the initial state is fitted"
    )
    following_time: float = declare_setting(
        0.05, "s", "past commands that a measured torque may depend on: longer than a torque loop"
    )
    block_windows: int = declare_setting(
        4,
        "windows",
        "windows of a bootstrap block: one second of motion, so that neighbours with alike errors stay together",
    )
    bootstrap_draws: int = declare_setting(500, "draws", "draws of the gap's bootstrap interval")
    confidence_level: float = declare_setting(0.95, "1", "level of the gap's bootstrap interval")
    significant_noise_multiple: float = declare_setting(
        10.0, "multiples of the noise", "a remaining error counts from here; below it is near the noise", EARLIER_LOGS
    )


DATA = DataSettings()
