"""What is repaired or refused in a log, and which rows of two logs are the same."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class LogRepairSettings:
    """What is repaired or refused in a log, and which rows of two logs are the same."""

    shortest_motion: float = declare_setting(1.0, "s", "less motion determines nothing")
    most_repair_rounds: int = declare_setting(4, "rounds", "one mistake can hide another")
    empty_column_share: float = declare_setting(
        0.5, "of the rows", "a column with more missing values is left out, not its rows"
    )
    most_lost_row_share: float = declare_setting(0.1, "of the rows", "more lost rows leave no windows to fit")
    long_gap_time: float = declare_setting(0.01, "s", "a command is not known across a longer gap")
    long_gap_periods: float = declare_setting(3.5, "periods", "such a gap has this many periods, too")
    dropped_share_limits: tuple[float, float] = declare_setting(
        (0.005, 0.2), "of the rows", "missing rows of which a log is warned, and for which triage refuses it"
    )
    warned_gap_time: float = declare_setting(0.25, "s", "a gap as long as a window of the replay is reported")
    short_log_time: float = declare_setting(1.0, "s", "a shorter log is reported")
    slow_sample_rate: float = declare_setting(
        200.0, "Hz", "a slower log is reported: joint resonances lie at 15 to 140 Hz"
    )
    exact_noise_share: float = declare_setting(
        0.25,
        "of a position's noise",
        "rows that differ by less are the same: two recordings differ by more in most rows",
    )
    stretch_rows: int = declare_setting(100, "rows", "rows in motion that are compared at once")
    least_alike_share: float = declare_setting(0.9, "of the rows", "share of such a stretch that another log must hold")
    most_compared_stretches: int = declare_setting(
        64, "stretches", "stretches of a log that are looked for in another: time"
    )


LOG_REPAIR = LogRepairSettings()
