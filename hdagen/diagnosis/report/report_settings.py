"""How much a report draws and says."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class ReportSettings:
    """How much a report draws and says."""

    most_drawn_points: int = declare_setting(1200, "points", "points of the log that are drawn in one plane")
    curve_bins: int = declare_setting(60, "bins", "bins of the abscissa, for a curve of means")
    fewest_points: int = declare_setting(5, "points", "points that a bin must have to be drawn")
    bin_growth: float = declare_setting(
        2.5, "exponent", "exponent of the bins' edges, so that bins are narrow near standstill"
    )
    settling_rows: int = declare_setting(20, "rows", "rows of a log in which commands from before it may still act")
    scene_seconds: float = declare_setting(0.25, "s", "a stretch of commands and currents")
    delay_scene_seconds: float = declare_setting(0.06, "s", "the same, where milliseconds are to be seen")
    most_drawn_regressors: int = declare_setting(3, "regressors", "regressors that are drawn where no effect is named")
    loop_seconds: float = declare_setting(10.0, "s", "torque over torsion: more loops hide each other")
    largest_drawn_frequency: float = declare_setting(0.1, "of the sampling rate", "up to it a response is drawn")
    largest_drawn_travel: float = declare_setting(2.0, "rad", "travel of the motor after a reversal that is drawn")
    speed_cells: int = declare_setting(18, "cells", "cells of speed in the map of speed and load")
    load_cells: int = declare_setting(10, "cells", "cells of load in the same map")
    fewest_samples: int = declare_setting(5, "samples", "samples that a cell or bin must have to be drawn")
    angle_bins: int = declare_setting(72, "bins", "bins of a motor turn")
    reversal_margin: float = declare_setting(0.15, "s", "before and after a reversal")
    time_bins: int = declare_setting(60, "bins", "bins of time over the log")
    most_separated: int = declare_setting(
        4, "candidates", "candidates that a motion is designed for, where none is named"
    )
    most_untried_effects: int = declare_setting(4, "effects", "effects that are named where the time was up")
    most_named_alternatives: int = declare_setting(6, "alternatives", "alternatives of an effect that are named")
    notable_gap_share: float = declare_setting(
        0.75, "of the gap that is left", "an effect within tolerance must bring it below this to be spoken of"
    )
    least_told_ratio: float = declare_setting(
        1.25, "ratio of found and file", "a number is wrong by times from it on, by percent below it"
    )
    least_file_share: float = declare_setting(0.02, "of the file's number", "below it the log has hardly any of it")
    most_named_sizes: int = declare_setting(2, "sizes", "sizes of one effect in a sentence")
    most_sized_effects: int = declare_setting(2, "effects", "effects that are named with their numbers")
    largest_shared_ratio: float = declare_setting(
        1000.0, "ratio of two values", "beyond it two values share the prefix between theirs"
    )
    value_digits: int = declare_setting(3, "digits", "significant digits of a value without a standard deviation")
    most_digits: int = declare_setting(5, "digits", "significant digits of any value")
    least_told_jitter: float = declare_setting(1e-9, "s", "below it only the rounding of stamps shows")
    least_noise_share: float = declare_setting(
        1e-9, "of a channel's range", "a channel with less noise was computed, and its noise is not printed"
    )
    notable_move: float = declare_setting(
        1.0, "standard deviations before the log", "a number of the file that moved further is on the first screen"
    )
    most_first_base_numbers: int = declare_setting(3, "numbers", "refitted numbers of the file on the first screen")
    least_notable_share: float = declare_setting(
        0.05, "of the variance", "a picture of what no effect explains shows nothing that goes less with its abscissa"
    )
    most_drawn_chance: float = declare_setting(
        0.5, "probability", "nor one that chance makes as good with a larger probability"
    )
    most_listed_hypotheses: int = declare_setting(8, "hypotheses", "hypotheses that are listed")
    least_listed_probability: float = declare_setting(1e-3, "probability", "a hypothesis below it is not listed")
    least_printed_probability: float = declare_setting(1e-4, "probability", "below it its value is not printed")
    shown_hypotheses: int = declare_setting(5, "hypotheses", "hypotheses in the summary of a notebook")


REPORT = ReportSettings()
