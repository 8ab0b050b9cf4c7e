"""The priors of effects, and the steps and units of their parameters."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.data.development_logs import KNOWN_EFFECTS
from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class CandidateSettings:
    """The priors of effects, and the steps and units of their parameters."""

    spike_scales: tuple[float, ...] = declare_setting(
        (0.05, 0.025, 0.0125),
        "usual sizes",
        "standard deviation of an effect outside the hypothesis; a fit uses the first until the log shows"
        " how much of every effect the machine has",
    )
    nuisance_limit: float = declare_setting(
        3.0, "standard deviations", "largest size of an effect outside the hypothesis; a larger one is present"
    )
    slab_width: float = declare_setting(
        1.0,
        "usual sizes",
        "standard deviation of an effect of the hypothesis: a present effect has about its usual size",
    )
    shape_fit_threshold: float = declare_setting(
        0.3, "spike widths", "the shapes of a larger nuisance effect are fitted, too; below it shapes change nothing"
    )
    silent_spike_width: float = declare_setting(
        1e-4, "usual sizes", "spike width of a candidate that only its own hypothesis uses: below any share of any size"
    )
    present_size: float = declare_setting(
        0.2, "usual sizes", "an effect counts as present from here; a smaller one changes little", KNOWN_EFFECTS
    )
    least_absent_number: float = declare_setting(
        0.05,
        "usual sizes",
        "a number that the robot file states as 0 is present from here: none is 0, and rotors differ by 30 times",
    )
    base_deviation_limit: float = declare_setting(
        2.0,
        "tolerances",
        "a base parameter shifted beyond it counts as an effect; within it the robot file is right",
    )
    local_step: float = declare_setting(
        0.1, "usual sizes", "step of a hypothesis' own parameters, about its present point"
    )
    column_step: float = declare_setting(
        0.1, "usual sizes", "step of every other column: small, as nuisance effects are small; a scan tries large sizes"
    )
    least_shape_unit: float = declare_setting(1e-3, "of its range", "unit of a shape parameter whose value is 0")
    shape_unit_share: float = declare_setting(
        0.5, "of its value", "unit of a shape parameter: it is known to about half its value"
    )
    wall_position_unit: float = declare_setting(
        0.02,
        "rad or m",
        "unit of a wall's position, which has to be this fine for a hard wall: its range says nothing about one",
    )


CANDIDATES = CandidateSettings()
