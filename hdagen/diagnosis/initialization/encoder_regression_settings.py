"""The regression of encoder readings, without any simulation."""

from __future__ import annotations

from dataclasses import dataclass

from hdagen.support.setting_declaration import setting


@dataclass(frozen=True)
class EncoderRegressionSettings:
    """The regression of encoder readings, without any simulation."""

    least_load_share: float = setting(0.1, "of the rms torque", "a joint's torque has a certain sign from here")
    regression_reweightings: int = setting(6, "reweightings", "reweightings of the rows: bound of the loop")
    wall_tail_ends: tuple[float, float] = setting(
        (0.002, 0.3), "of the rows", "ends of a geometric grid of shares of rows beyond a wall"
    )
    wall_tail_count: int = setting(60, "walls", "points of that grid: one wall is tried for each")
    wall_refinement: int = setting(41, "angles", "angles tried between the neighbours of the best one")
    largest_wave: float = setting(
        4.0,
        "usual sizes",
        "largest eccentricity or kinematic error that is found: a bias and a large arc together form a "
        "parabola, which imitates a wall",
    )
    column_ridge: float = setting(
        1e-10, "of a column's square", "ridge for columns that a hardly moving joint does not separate"
    )
    largest_wall_misfit: float = setting(
        0.7, "of the summed residual torque", "a wall must leave as much at most: it must stand out"
    )
    torsion_law_points: int = setting(401, "points", "points of the torsion law's inverse")


ENCODER_REGRESSION = EncoderRegressionSettings()
