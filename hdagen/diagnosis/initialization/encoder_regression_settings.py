"""The regression of encoder readings, without any simulation."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import declare_setting


@dataclass(frozen=True)
class EncoderRegressionSettings:
    """The regression of encoder readings, without any simulation."""

    least_load_share: float = declare_setting(0.1, "of the rms torque", "a joint's torque has a certain sign from here")
    regression_reweightings: int = declare_setting(6, "reweightings", "reweightings of the rows: bound of the loop")
    wall_tail_ends: tuple[float, float] = declare_setting(
        (0.002, 0.3), "of the rows", "ends of a geometric grid of shares of rows beyond a wall"
    )
    wall_tail_count: int = declare_setting(60, "walls", "points of that grid: one wall is tried for each")
    wall_refinement: int = declare_setting(41, "angles", "angles tried between the neighbours of the best one")
    largest_wave: float = declare_setting(
        4.0,
        "usual sizes",
        "largest eccentricity or kinematic error that is found: a bias and a large arc together form a "
        "parabola, which imitates a wall",
    )
    column_ridge: float = declare_setting(
        1e-10, "of a column's square", "ridge for columns that a hardly moving joint does not separate"
    )
    largest_wall_misfit: float = declare_setting(
        0.7, "of the summed residual torque", "a wall must leave as much at most: it must stand out"
    )
    torsion_law_points: int = declare_setting(401, "points", "points of the torsion law's inverse")


ENCODER_REGRESSION = EncoderRegressionSettings()
