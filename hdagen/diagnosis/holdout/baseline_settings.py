"""The flexible correction that a verdict is compared with."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class BaselineSettings:
    """The flexible correction that a verdict is compared with."""

    fourier_features: int = declare_setting(100, "features", "random Fourier features")
    turn_harmonics: tuple[int, ...] = declare_setting((1, 2, 4), "harmonics", "harmonics of the motor's angle")
    direction_softness: float = declare_setting(
        0.02, "of the usual speed", "scale of the tanh that smooths a direction"
    )
    command_lags: int = declare_setting(8, "rows", "rows of the command among the features of the current's correction")
    ridge_ends: tuple[float, float] = declare_setting(
        (1e-6, 1e2), "of the mean square of the features", "ends of a geometric grid of ridges"
    )
    ridge_count: int = declare_setting(9, "ridges", "points of that grid: cross-validation takes one")
    cross_validation_blocks: int = declare_setting(
        8, "blocks", "blocks of time, each left out once in the cross-validation"
    )


BASELINE = BaselineSettings()
