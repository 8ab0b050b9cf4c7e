"""Rotation vectors: a turn as its axis times its angle, the matrix of it, and how both change.

Legend: e rotation vector (3), θ = |e|; E = exp [e]×, with [e]× a = e × a; D(e) left Jacobian: Ė = [D(e) ė]× E.

All of it is smooth where θ < 2π; `find_rotation_vector` gives the shorter way round, so that it jumps at θ = π.
Source: Solà, Deray, Atchuthan, A micro Lie theory for state estimation in robotics (2018), (132), (133), (143)–(146).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

SX = ca.SX
SMALLEST_SQUARE = 1e-14  # added to θ², so that no quotient is 0/0; it moves the results by less than 1e-14


def make_cross_matrix(a: Any) -> Any:
    """Write a cross product as a matrix.

    Args:
        a: A vector (3).

    Returns:
        [a]× (3 × 3).

    """
    rows = ((0, -a[2], a[1]), (a[2], 0, -a[0]), (-a[1], a[0], 0))
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


def make_rotation_matrix(e: Any) -> Any:
    """Write the matrix of a turn.

    Args:
        e: Rotation vector (3), rad.

    Returns:
        exp [e]× (3 × 3).

    """
    _, first, second, _ = _find_series(e)
    turned = make_cross_matrix(e)
    return SX.eye(3) + first * turned + second * (turned @ turned)


def find_rotation_vector(R: Any) -> Any:
    """Find the rotation vector of a matrix, at most π long; at a half turn itself it is 0.

    Args:
        R: Rotation matrix (3 × 3).

    Returns:
        e (3), rad, with exp [e]× = R.

    """
    axis = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    sine, cosine = ca.sqrt(ca.dot(axis, axis) + SMALLEST_SQUARE**2), (ca.trace(R) - 1) / 2
    return axis * (ca.atan2(sine, cosine) / sine)


def find_left_jacobian(e: Any) -> Any:
    """Write what makes an angular velocity of the rate of a rotation vector.

    Args:
        e: Rotation vector (3), rad.

    Returns:
        D(e) (3 × 3): the angular velocity is D(e) ė.

    """
    _, _, second, third = _find_series(e)
    turned = make_cross_matrix(e)
    return SX.eye(3) + second * turned + third * (turned @ turned)


def invert_left_jacobian(e: Any) -> Any:
    """Write what makes the rate of a rotation vector of an angular velocity.

    Args:
        e: Rotation vector (3), rad.

    Returns:
        D(e)⁻¹ (3 × 3).

    """
    square, _, _, _ = _find_series(e)
    half = ca.sqrt(square) / 2
    turned = make_cross_matrix(e)
    return SX.eye(3) - turned / 2 + (1 - half * ca.cos(half) / ca.sin(half)) / square * (turned @ turned)


def find_angular_acceleration(e: Any, rate: Any, acceleration: Any) -> Any:
    """Write the angular acceleration of a turn whose rotation vector moves.

    Args:
        e: Rotation vector (3), rad.
        rate: ė (3).
        acceleration: ë (3).

    Returns:
        d/dt (D(e) ė) (3), rad/s².

    """
    at, along = SX.sym("e", 3), SX.sym("rate", 3)
    change = ca.jtimes(find_left_jacobian(at) @ along, at, along)
    return find_left_jacobian(e) @ acceleration + ca.substitute(change, ca.vertcat(at, along), ca.vertcat(e, rate))


def _find_series(e: Any) -> tuple[Any, Any, Any, Any]:
    """θ², sin θ/θ, (1 − cos θ)/θ² and (θ − sin θ)/θ³, without a loss of digits where these are multiplied by e."""
    square = ca.dot(e, e) + SMALLEST_SQUARE
    angle = ca.sqrt(square)
    first, half = ca.sin(angle) / angle, ca.sin(angle / 2) / angle
    return square, first, 2 * half * half, (1 - first) / square
