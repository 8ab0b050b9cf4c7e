"""Where a motor's input shows a line of torque ripple."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class RippleLineSettings:
    """Where a motor's input shows a line of torque ripple."""

    most_cycles: int = declare_setting(40, "cycles a turn", "largest that is searched")
    parabola_time: float = declare_setting(
        0.02, "s", "length of the parabolas that take the encoder's steps out of the angle"
    )
    moving_speed_share: float = declare_setting(0.5, "of the rms speed", "a stretch counts above it")
    least_turns: float = declare_setting(16.0, "turns", "a stretch of fewer does not resolve two lines")
    neighbour_offsets: tuple[float, float, float, float, float] = declare_setting(
        (0.3, 0.34, 0.38, 0.42, 0.46), "cycles a turn", "places beside a line where the background is measured"
    )
    least_peak_ratio: float = declare_setting(
        5.0, "medians beside it", "an amplitude above it is a line: of 400 logs of noise 8 have one"
    )
    most_cycles_per_row: float = declare_setting(0.4, "cycles a row", "faster lines are sampled too coarsely")
    trend_degree: int = declare_setting(3, "degree", "polynomial that is taken off a stretch")
    most_named_lines: int = declare_setting(5, "lines", "lines that are reported")
    most_gap_periods: float = declare_setting(3.5, "periods", "longest pause without a row within a stretch")
    steady_speed_spread: float = declare_setting(
        0.1, "of the speed", "below it, a line of time looks like one of the angle"
    )


RIPPLE_LINE = RippleLineSettings()
