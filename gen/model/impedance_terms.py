"""Terms that the compliance laws share: wanted mass, damping and stiffness, the tip's inertia, a force held for a tick.

Legend: M, B, K wanted mass, damping and stiffness; Λ = (J M_q⁻¹ Jᵀ)⁻¹ the tip's inertia; h period.
Source: Khatib, IEEE J. Robot. Autom. 3 (1987) 43 for Λ.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from gen.effects.effect import Parameter
from gen.model.control_loop import ControlLoop
from gen.model.symmetric_matrices import solve_symmetric

SX = ca.SX
SQUARINGS, TAYLOR = 50, 6  # of `held_force`: h B/M up to 1e14, the most that the gains' bounds allow, becomes 0.1


def find_tip_inertia(loop: ControlLoop, M_q: Any, J: Any) -> Any:
    """Write the inertia of the tip, kept finite in singular postures by the law's gains.

    Args:
        loop: The symbols of the law, with the gain ``singularity``, in space ``singularity_rotation`` too.
        M_q: Mass matrix of the links (n × n).
        J: Jacobian of the tip (2 × n, or 6 × n in space).

    Returns:
        Λ = (J M_q⁻¹ Jᵀ + S)⁻¹ (2 × 2, or 6 × 6), S diagonal, of these gains.

    """
    count = J.shape[0]
    lost = loop.g["singularity"] * SX.eye(count)
    if count > 3:
        lost = ca.diag(ca.vertcat(*(loop.g[name] for name in 3 * ["singularity"] + 3 * ["singularity_rotation"])))
    A = J @ solve_symmetric(M_q, J.T) + lost
    return solve_symmetric(A, SX.eye(count))


def held_force(M: Any, B: Any, K: Any, h: Any, x: Any, v: Any, F: Any) -> tuple[Any, Any]:
    """Move M ẍ + B ẋ + K x = F on by one period with F held: (26) discretised exactly.

    exp(A h) is found by scaling and squaring, but as Y = exp − 1: Y ← 2 Y + Y² keeps every digit of entries that are
    small against 1, however many squarings follow. So one number of squarings serves the whole range of the gains.

    Args:
        M: Mass, kg or kg m².
        B: Damping, N s/m or N m s/rad.
        K: Stiffness, N/m or N m/rad.
        h: Period, s.
        x: Position, m or rad.
        v: Velocity.
        F: Force or torque.

    Returns:
        Position and velocity after the period.

    Source:
        Van Loan, IEEE Trans. Autom. Control 23 (1978) 395; Moler, Van Loan, SIAM Review 45 (2003) 3, method 3.

    """
    A = SX(3, 3)
    A[0, 1], A[1, 0], A[1, 1], A[1, 2] = h, -h * K / M, -h * B / M, h / M
    scaled = A / 2.0**SQUARINGS
    Y = scaled
    for k in range(TAYLOR, 1, -1):
        Y = scaled + scaled @ Y / k
    for _ in range(SQUARINGS):
        Y = 2 * Y + Y @ Y
    return x + Y[0, 0] * x + Y[0, 1] * v + Y[0, 2] * F, v + Y[1, 0] * x + Y[1, 1] * v + Y[1, 2] * F


def list_impedance_gains(
    axes: tuple[str, ...], units: tuple[str, str, str], nominal: tuple[float, float, float]
) -> tuple[Parameter, ...]:
    """List the gains of the wanted mass, damping and stiffness along each axis.

    Args:
        axes: Names of the axes or the joints.
        units: Units of mass, damping and stiffness.
        nominal: Their usual values.

    Returns:
        The gains, those of the mass first.

    """
    kinds = (
        ("mass", "wanted inertia", 1e-9),
        ("damping", "wanted damping", 0.0),
        ("stiffness", "wanted stiffness", 0.0),
    )
    return tuple(
        Parameter(f"{name}_{axis}", unit, value, low, 1e6, meaning)
        for (name, meaning, low), unit, value in zip(kinds, units, nominal, strict=True)
        for axis in axes
    )
