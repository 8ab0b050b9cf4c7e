"""The likelihood of a log: windows, residual torque, temperature and scales."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.diagnosis.data.development_logs import JOINT_ARMS
from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class LikelihoodSettings:
    """The likelihood of a log: windows, residual torque, temperature and scales."""

    likelihood_temperature: float = declare_setting(
        12.0, "1", "temperature in fits and decisions: local optima of one log differ by as much log evidence"
    )
    torque_steps: int = declare_setting(
        32,
        "steps",
        "steps of residual torque in a window, shared by all motors and links: bounds time and memory",
        JOINT_ARMS,
    )
    fewest_torque_steps: int = declare_setting(2, "steps", "steps for each motor or link at least")
    fewest_rows_of_step: int = declare_setting(3, "rows", "rows in a step at least: a step needs data of its own")
    impulses_of_step: int = declare_setting(
        5, "impulses", "impulses on a link in a step: a link has no input, so impulses act on it"
    )
    torque_unit_share: float = declare_setting(
        0.02, "of the usual motor torque", "unit of residual torque: a percent or two of the torque is usual"
    )
    initial_state_step: float = declare_setting(
        3.0, "standard deviations of noise", "an initial position is moved by it for its column: above the noise"
    )
    reaction_time: float = declare_setting(
        0.01, "s", "a moved initial velocity moves its position by a step of that size in this time"
    )
    largest_column_change: float = declare_setting(
        0.25,
        "of the columns of torques",
        "after more of a change columns of nuisance effects are computed anew: kept ones were off by up to 21 nats "
        "below it, and by 31 above, where a fit left hundreds",
        JOINT_ARMS,
    )
    least_visible_change: float = declare_setting(
        1e-3,
        "standard deviations of noise",
        "a usual size moves a channel that shows the effect by more: above rounding",
    )
    most_reweightings: int = declare_setting(
        12, "reweightings", "reweightings of the windows at most: bound of the loop"
    )
    scale_tolerance: float = declare_setting(
        0.05, "of log κ²", "a smaller change ends the reweighting: the scales have converged"
    )
    coarse_stride: int = declare_setting(
        8, "grid points", "stride of a coarse search over the sizes of residual torque"
    )
    refining_strides: tuple[int, int] = declare_setting(
        (2, 1), "grid points", "strides of the fine searches, one after the other"
    )
    torque_grid_ends: tuple[float, float] = declare_setting(
        (1e-3, 1e2), "units of residual torque", "ends of a geometric grid of sizes, beside 0"
    )
    torque_grid_size: int = declare_setting(41, "sizes", "points of that grid: each decade, refined near the best")
    chi2_allowance: float = declare_setting(
        3.0,
        "standard deviations of chi²",
        "a window may exceed its expectation by chance by as much; only windows beyond it count less",
    )
    scale_exponent: float = declare_setting(
        1.0, "1", "exponent of the scale in a window's misfit beyond chance; Huber's weights would take 0.5"
    )
    state_ridge: float = declare_setting(
        1e-10, "1", "added to the precision of an initial state that a window does not determine"
    )
    initial_torsion_limit: float = declare_setting(
        0.7,
        "of the torsion at the largest input",
        "largest torsion that a window begins with, unless the motion asks for more: two encoders may differ by more",
    )
    sequential_rollouts: int = declare_setting(2, "lanes", "so few lanes run faster one by one than in a vector")
    torque_quantile: float = declare_setting(0.999, "1", "quantile of the required torque that lanes are prepared for")
    torque_margin: float = declare_setting(1.5, "1", "factor by which a lane may exceed that quantile")
    most_cached_inputs: int = declare_setting(4, "inputs", "effective inputs that are kept for the next lanes: memory")


LIKELIHOOD = LikelihoodSettings()
