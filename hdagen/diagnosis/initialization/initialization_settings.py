"""Where fits start: guesses from the log, and regressions of residual torque."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class InitializationSettings:
    """Where fits start: guesses from the log, and regressions of residual torque."""

    wall_tail_shares: tuple[float, ...] = declare_setting(
        (0.005, 0.03, 0.1, 0.25),
        "of the rows",
        "rows beyond a wall, one wall for each share: a wall is touched at an end of the range",
    )
    input_size_ends: tuple[float, float] = declare_setting(
        (0.1, 10.0), "usual sizes", "ends of a geometric grid of sizes of an input effect: the log has the size itself"
    )
    input_size_count: int = declare_setting(25, "sizes", "points of that grid")
    input_share_ends: tuple[float, float] = declare_setting(
        (0.1, 1.0), "of an input effect's size", "ends of a grid of sizes that are tried beside a second input effect"
    )
    input_share_count: int = declare_setting(19, "shares", "points of that grid")
    friction_share: float = declare_setting(
        0.25,
        "of the usual motor torque",
        "usual dry friction where the robot file states none: nothing else is known of the drive",
    )
    least_scanned_guess: float = declare_setting(
        0.1, "usual sizes", "an initial guess is used as a step, and tried in the scan, from here"
    )
    largest_error_ratio: float = declare_setting(
        0.99,
        "of the input's error without the effect",
        "a size with a smaller error is suggested: any clear improvement is tried",
    )
    largest_regressed_set: int = declare_setting(4, "effects", "effects of a set: time")
    beam_width: int = declare_setting(3, "sets", "sets of each size that are enlarged: time")
    largest_remaining_ratio: float = declare_setting(
        0.9, "of a balance's residual (rms)", "one more effect may leave as much at most"
    )
    distant_size: float = declare_setting(
        2.0, "usual sizes", "a larger effect is far from the robot file; a smaller one is found from there"
    )
    most_regressed_rows: int = declare_setting(6000, "rows", "rows of a log that are used: time")
    regressed_stretches: int = declare_setting(4, "stretches", "stretches that those rows come in")
    fewest_instants: int = declare_setting(50, "instants", "instants of a balance at least")
    balance_tolerance: float = declare_setting(
        1e-2,
        "of the logarithm of a balance's residual",
        "a smaller change ends the reweighting: the weights have converged",
    )
    balance_reweightings: int = declare_setting(5, "reweightings", "reweightings of the balances: bound of the loop")
    scale_free_precision: float = declare_setting(1e-6, "1", "prior precision of a size that spans orders of magnitude")
    least_regressor_ratio: float = declare_setting(
        1e-9, "of the residual torque (rms)", "a smaller column shows nothing of an effect"
    )


INITIALIZATION = InitializationSettings()
