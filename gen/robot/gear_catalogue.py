"""Gears of the maker's catalogue, and the laws of the drive that follow from its numbers.

Legend: T1, T2 torques that part the three straight lines, of stiffness K1, K2, K3, which the catalogue draws for torque
over torsion; ψ hysteresis loss; τ_fs starting torque at the wave generator; N ratio. A gear stands here only with all
of these read in a source; a peak torque that no source showed is None.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt


@dataclass(frozen=True)
class Gear:
    """A gear as the catalogue prints it; torques at the joint unless said otherwise."""

    ratio: float
    T1: float  # N m
    T2: float  # N m
    K1: float  # N m/rad, from 0 to T1
    K2: float  # N m/rad, from T1 to T2
    K3: float  # N m/rad, above T2
    hysteresis_loss: float  # ψ, rad
    starting_torque: float  # τ_fs, N m at the wave generator
    source: str
    repeated_peak_torque: float | None = None  # N m
    momentary_peak_torque: float | None = None  # N m


CATALOGUE: dict[str, Gear] = {
    "CSG-17-100": Gear(
        ratio=100.0,
        T1=3.9,
        T2=12.0,
        K1=1.0e4,
        K2=1.4e4,
        K3=1.6e4,
        hysteresis_loss=2.9e-4,  # 1 arcmin
        starting_torque=0.037,
        # Its rating table could not be read, so the peak torques are open; its table 6 has the teeth jump at 200 N m.
        source="Harmonic Drive LLC, CSF & CSG Series, Cup Type Component Sets, Housed Units: tables 41, 42 (T1, T2); "
        "K1 to K3, hysteresis loss and starting torque: the catalogue numbers behind the paper's Table I",
    ),
}


# The springs' values in robot.toml, in the order of `drive_laws`.
SPRING_KEYS = ("flexspline_stiffness", "flexspline_stiffening", "wave_generator_stiffness", "wave_generator_stiffening")
DATA_SHEET_KEYS = ("T1", "T2", "K1", "K2", "K3")  # the keys of a data sheet in robot.toml
LEAST_STIFFENING = 1e-6  # c_f, 1/(N m): as good as none


def largest_stiffness_ratio(T1: float, T2: float) -> float:
    """Find the ratio K2 / K1 from which on the flexspline's law would have no stiffness at no torque.

    Args:
        T1: Torque at which K1 ends, N m.
        T2: Torque at which K2 ends, N m.

    Returns:
        The ratio.

    """
    low, middle = (T1 / 2) ** 2, ((T1 + T2) / 2) ** 2
    return middle / low


def drive_laws(gear: Gear) -> tuple[float, float, float, float]:
    """Find the laws of the springs from catalogue numbers alone.

    The flexspline's stiffness K_f0 (1 + (c_f τ)²), (9) corrected, passes through K1 and K2 at the mid-torques T1/2 and
    (T1 + T2)/2 of their regions, (28) corrected; the wave generator has (29) and (31).

    Args:
        gear: The gear.

    Returns:
        K_f0, N m/rad, and c_f, 1/(N m), of the flexspline; K_w0, N m/rad, and c_w, 1/(N m), of the wave generator.

    """
    low, middle = (gear.T1 / 2) ** 2, ((gear.T1 + gear.T2) / 2) ** 2
    slope = (gear.K2 - gear.K1) / (middle - low)
    K_f0 = gear.K1 - slope * low
    c_f = max(sqrt(slope / K_f0), LEAST_STIFFENING)
    K_w0 = 2 * gear.starting_torque / (gear.ratio * gear.hysteresis_loss)
    c_w = 2 / (gear.hysteresis_loss * gear.ratio * K_w0)
    return K_f0, c_f, K_w0, c_w
