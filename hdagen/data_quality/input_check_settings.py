"""What the checks of currents and torques, against each other, the motion and the model, count as a mistake."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class InputCheckSettings:
    """What the checks of currents and torques, against each other, the motion and the model, count as a mistake."""

    longest_lag: float = declare_setting(0.1, "s", "longest lag that is searched between a command and its measurement")
    earliest_lag_rows: int = declare_setting(
        -5, "rows", "earliest lag that is searched: a measurement logged before its command"
    )
    clear_misfit_ratio: float = declare_setting(
        0.5, "of the usual misfit", "a lag before the command is a mistake if it leaves at most this"
    )
    least_early_rows: int = declare_setting(
        3, "rows", "from here the motion decides whether command or measurement stands in the wrong row"
    )
    most_inertia_ratio: float = declare_setting(
        3.0, "ratio", "inertia against the robot file's that effects can explain: torque constant, payload, wrong mass"
    )
    least_correlation: float = declare_setting(
        0.3, "correlation", "below it, input and inertial torque determine nothing of each other"
    )
    rotor_misfit_ratio: float = declare_setting(
        1.5, "of the misfit", "more than the inertia times a factor leaves: then the file does not just lack a rotor"
    )
    milli_tolerance: float = declare_setting(3.0, "ratio", "a scale so near to 1000 counts as that of thousandths")
    driven_torque_ratio: float = declare_setting(
        2.0, "torques", "times the torque that moves a joint without its drive: from here it was driven"
    )
    breakaway_ratio: float = declare_setting(3.0, "dry frictions", "torque that moves any joint")
    exchanged_fit_ratio: float = declare_setting(1.5, "ratio", "the torsion fits so much better with exchanged joints")
    sure_reversed_inertia: float = declare_setting(
        -20.0, "standard deviations", "share of the joint's own inertia below which a sign is surely reversed"
    )
    sure_reversed_power: float = declare_setting(
        -0.03, "of the largest possible", "power that friction takes, with such an inertia"
    )
    likely_reversed_inertia: float = declare_setting(
        -5.0, "standard deviations", "the same inertia where the power is clear"
    )
    likely_reversed_power: float = declare_setting(-0.15, "of the largest possible", "power that is clear")
    least_explained: float = declare_setting(
        0.8, "of the variance", "a fit that explains less of the input says nothing of its sign"
    )
    most_delay_rows: int = declare_setting(12, "rows", "delays that are searched between an input and the motion")
    least_rows_ahead: int = declare_setting(
        4, "rows", "a skew is reported from here: motion determines it to about two rows"
    )


INPUT_CHECK = InputCheckSettings()
