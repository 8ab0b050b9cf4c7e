"""How much a report draws and says."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import setting


@dataclass(frozen=True)
class ReportSettings:
    """How much a report draws and says."""

    most_drawn_points: int = setting(2500, "points", "points of the log that are drawn in one plane")
    curve_bins: int = setting(60, "bins", "bins of the abscissa, for a curve of means")
    fewest_points: int = setting(5, "points", "points that a bin must have to be drawn")
    bin_growth: float = setting(2.5, "exponent", "exponent of the bins' edges, so that bins are narrow near standstill")
    settling_rows: int = setting(20, "rows", "rows of a log in which commands from before it may still act")
    scene_seconds: float = setting(0.25, "s", "a stretch of commands and currents")
    most_drawn_regressors: int = setting(3, "regressors", "regressors that are drawn where no effect is named")
    loop_seconds: float = setting(10.0, "s", "torque over torsion: more loops hide each other")
    largest_drawn_frequency: float = setting(0.1, "of the sampling rate", "up to it a response is drawn")
    largest_drawn_travel: float = setting(2.0, "rad", "travel of the motor after a reversal that is drawn")
    speed_cells: int = setting(18, "cells", "cells of speed in the map of speed and load")
    load_cells: int = setting(10, "cells", "cells of load in the same map")
    fewest_samples: int = setting(5, "samples", "samples that a cell or bin must have to be drawn")
    angle_bins: int = setting(72, "bins", "bins of a motor turn")
    reversal_margin: float = setting(0.15, "s", "before and after a reversal")
    time_bins: int = setting(60, "bins", "bins of time over the log")
    coherence_chance: float = setting(0.05, "probability", "noise alone exceeds the line of coherence with it")
    most_separated: int = setting(4, "candidates", "candidates that a motion is designed for, where none is named")
    most_named_alternatives: int = setting(6, "alternatives", "alternatives of an effect that are named")
    notable_gap_share: float = setting(
        0.75, "of the gap that is left", "an effect within tolerance must bring it below this to be spoken of"
    )
    gap_said_in_units: float = setting(1000.0, "multiples of the noise", "from here the error is said in its unit, too")
    most_drawn_candidates: int = setting(8, "hypotheses", "hypotheses in the figure of probabilities")
    least_listed_probability: float = setting(1e-3, "probability", "a hypothesis below it is not listed")
    least_printed_probability: float = setting(1e-4, "probability", "below it its value is not printed")
    shown_hypotheses: int = setting(5, "hypotheses", "hypotheses in the summary of a notebook")
    correlation_seconds: float = setting(0.25, "s", "lags of the correlations of the residuals")


REPORT = ReportSettings()
