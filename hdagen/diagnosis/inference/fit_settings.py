"""The steps of a fit, and when it ends."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class FitSettings:
    """The steps of a fit, and when it ends."""

    most_chord_steps: int = declare_setting(3, "steps", "steps with one set of sensitivities: time")
    trust_radii: tuple[float, ...] = declare_setting(
        (0.3, 0.1, 0.03),
        "prior standard deviations",
        "trust radii of a step that are tried after the whole step, which may leave the valley",
    )
    least_step_ratio: float = declare_setting(
        0.25, "of the promised improvement", "a step that brings more is accepted without a smaller radius"
    )
    largest_chi2_rise: float = declare_setting(
        4.0, "1", "chi² of a window may grow by as much before its initial state is restored"
    )
    bad_window_ratio: float = declare_setting(
        2.0, "of the chi² expected of noise", "a window with more begins again at the measured state"
    )
    least_evidence_step: float = declare_setting(
        0.1,
        "nats times the misfit temperature",
        "log evidence that a step must bring, or promise, for another one: a smaller gain decides nothing",
    )
    subset_margin: int = declare_setting(
        2, "effects", "a subset is evaluated if it has fewer effects than this, or lacks fewer than this"
    )
    misfit_of_temperature: float = declare_setting(
        100.0,
        "nats",
        "log evidence still to be gained, for each multiple of the least temperature: an effect must "
        "explain a share of the misfit",
    )
    stiff_torque_share: float = declare_setting(
        0.1, "of the residual torque", "a step allows as much first: all of it would replace the parameters' own change"
    )
    large_noise_level: float = declare_setting(
        2.0, "squared noise scale", "from here a step allows all of it first: no parameter explains most of the misfit"
    )
    most_active_set_changes: int = declare_setting(
        20, "changes", "changes of the active set at most: bound of the loop"
    )


FIT = FitSettings()
