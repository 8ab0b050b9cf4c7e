"""The search over windows in which something unknown acts all the time."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class LongHorizonSettings:
    """The search over windows in which something unknown acts all the time."""

    tried_sizes: tuple[float, float] = declare_setting(
        (0.5, 2.0), "usual sizes", "sizes that are tried of each effect: below and above the usual size"
    )
    tried_phases: int = declare_setting(
        6, "directions", "directions of two amplitudes, a sine and a cosine: all phases"
    )
    rollouts_at_once: int = declare_setting(64, "lanes", "simulations that run at once: memory")
    most_effects: int = declare_setting(3, "effects", "effects at once: time")
    candidates_per_round: int = declare_setting(3, "effects", "effects that are fitted in each round: time")
    most_fit_steps: int = declare_setting(5, "steps", "steps of a fit at most: bound of the loop")
    most_fold_steps: int = declare_setting(
        2, "steps", "steps of a fit to parts of the log, from where the whole fit stands"
    )
    step_fractions: tuple[float, ...] = declare_setting(
        (1.0, 0.5, 0.25, 0.1), "of a step", "fractions of a step that are tried, the whole first"
    )
    difference_step: float = declare_setting(0.1, "standard deviations", "a size is moved by it for its column")
    least_step_gain: float = declare_setting(0.1, "of what is lowered", "a step with less was the last")
    windows_of_part: int = declare_setting(2, "windows", "windows for each part of the log at least")
    largest_error_ratio: float = declare_setting(
        0.9, "of one channel's error", "an effect must lower the error to it in every window: by a tenth"
    )


LONG_HORIZON = LongHorizonSettings()
