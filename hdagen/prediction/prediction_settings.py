"""The replay of a log in windows, and the filters that begin each window."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class PredictionSettings:
    """The replay of a log in windows, and the filters that begin each window."""

    replay_window: float = declare_setting(
        0.25,
        "s",
        "length of a window: long enough that a wrong force shows, short enough that errors do not accumulate",
    )
    least_error_multiple: float = declare_setting(
        1e-3, "multiples of the noise", "an error counts as this at least: keeps the geometric mean finite"
    )
    least_noise: float = declare_setting(
        1e-9, "rad, m, A or N m", "noise of a channel that shows none, and no other one like it either"
    )
    first_rows_time: float = declare_setting(0.01, "s", "rows that show whether a log begins in motion")
    least_motion_factor: float = declare_setting(
        4.0, "times noise and curvature", "the first speed moves a joint by then at least"
    )
    least_motion_share: float = declare_setting(
        0.03, "of the usual motion in as many rows", "a joint that moves less is at rest"
    )
    input_memory_rows: int = declare_setting(512, "rows", "rows of commands before a window that start the input stage")
    most_instants: int = declare_setting(20_000, "instants", "instants in the regression at most: time and memory")
    slow_speed_share: float = declare_setting(0.02, "of the usual speed", "tanh stands for half a direction here")
    time_blocks: int = declare_setting(10, "blocks", "blocks of time, over which standard errors are taken")
    held_standard_errors: float = declare_setting(3.0, "standard errors", "a held input is significant from here")
    end_filter_widths: int = declare_setting(
        3, "filter widths", "left out at each end of a log: the filter has too few rows there"
    )
    loop_bandwidth: float = declare_setting(
        20.0, "Hz", "a machine's fastest mode in closed loop; EMPS's, and usual for an arm"
    )
    butterworth_order: int = declare_setting(4, "1", "order of the filter; force error only")
    passed_nyquist_share: float = declare_setting(
        0.8, "of the thinned rate's Nyquist frequency", "the second filter passes up to it"
    )
    filter_horizon: float = declare_setting(
        0.15, "s", "rows that the filters see: a few times the memory of the most trusting one"
    )
    least_horizon_rows: int = declare_setting(12, "rows", "rows of the horizon at least: slow logs")
    most_horizon_rows: int = declare_setting(400, "rows", "rows of the horizon at most: very fast logs")
    filter_deviations: tuple[tuple[float, float], ...] = declare_setting(
        (
            (1e-2, 10.0),
            (1e-4, 10.0),
            (1e-2, 0.1),
            (1e-4, 0.1),
            (1e-6, 0.0),
            (1e-5, 0.0),
            (1e-4, 0.0),
            (1e-3, 0.0),
            (1e-2, 0.0),
            (1e-1, 0.0),
        ),
        "of a motor input's bound; of the torsion at the torque of that bound",
        "standard deviations in each filter, of a motor's extra torque and of the joint encoder's error; "
        "the first row is linearised about the first filter, which trusts the model least",
    )
    link_torque_share: float = declare_setting(
        0.1, "of its motor's, at the joint", "a link's extra torque: forces on a link are smaller"
    )
    disturbance_correlation_time: float = declare_setting(
        0.1, "s", "correlation time of extra torques and encoder errors: disturbances come and go"
    )
    burn_in_share: float = declare_setting(
        1 / 3, "of the horizon", "a filter is not judged here: it still forgets its initial state"
    )
    slope_rows: int = declare_setting(8, "rows", "rows of the straight line from which a filter starts")
    unseen_side_torsion_share: float = declare_setting(
        0.2,
        "of the torsion at full torque",
        "torsion of a side of the gear that no channel shows; 100 times it a second",
    )
    free_sliding_widths: float = declare_setting(
        6.0, "widths of the smooth sign", "beyond it from standstill dry friction has no slope"
    )
    recent_rows: int = declare_setting(
        2000, "rows", "rows before an instant that show the noise of a channel without a stated resolution"
    )
    state_bound_factor: float = declare_setting(
        100.0, "times the speed that the model is made for", "beyond it a speed is no state of the arm"
    )


PREDICTION = PredictionSettings()
