"""Vectors, rotations and inertias in space, whose entries are numbers or CasADi expressions.

A number 0 takes the terms that it multiplies away, and 1 leaves them as they are. So what a chain does not have costs
no operation: a chain in the plane leaves of all this the operations of the plane.

Legend: s, c sine and cosine of a turn about z; an inertia has the entries xx, yy, zz, xy, xz, yz.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Vector = tuple[Any, Any, Any]
Matrix = tuple[tuple[float, float, float], ...]  # rows of numbers
Inertia = tuple[Any, Any, Any, Any, Any, Any]

NO_VECTOR: Vector = (0, 0, 0)
NO_INERTIA: Inertia = (0, 0, 0, 0, 0, 0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
TENSOR_ENTRIES = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # where the matrix of an inertia has the six entries


def _is_number(value: Any, number: float) -> bool:
    return isinstance(value, int | float) and value == number


def multiply_terms(a: Any, b: Any) -> Any:
    """Multiply, unless a factor is the number 0, 1 or −1.

    Args:
        a: A factor.
        b: A factor.

    Returns:
        The product.

    """
    if _is_number(a, 0) or _is_number(b, 0):
        return 0
    for one, other in ((a, b), (b, a)):
        if _is_number(one, 1):
            return other
        if _is_number(one, -1):
            return -other
    return a * b


def add_terms(*terms: Any) -> Any:
    """Add from left to right, without the number 0.

    Args:
        terms: The terms.

    Returns:
        The sum.

    """
    total: Any = 0
    for term in terms:
        if not _is_number(term, 0):
            total = term if _is_number(total, 0) else total + term
    return total


def subtract_terms(a: Any, b: Any) -> Any:
    """Subtract, unless one of both is the number 0.

    Args:
        a: The minuend.
        b: The subtrahend.

    Returns:
        a − b.

    """
    if _is_number(b, 0):
        return a
    if _is_number(a, 0):
        return -b
    return a - b


# -- vectors ----------------------------------------------------------------------------------------------------------


def add_vectors(a: Vector, b: Vector) -> Vector:
    """Add two vectors.

    Args:
        a: A vector.
        b: A vector.

    Returns:
        a + b.

    """
    return (add_terms(a[0], b[0]), add_terms(a[1], b[1]), add_terms(a[2], b[2]))


def subtract_vectors(a: Vector, b: Vector) -> Vector:
    """Subtract two vectors.

    Args:
        a: A vector.
        b: A vector.

    Returns:
        a − b.

    """
    return (subtract_terms(a[0], b[0]), subtract_terms(a[1], b[1]), subtract_terms(a[2], b[2]))


def scale_vector(factor: Any, a: Vector) -> Vector:
    """Multiply a vector by a number.

    Args:
        factor: The number.
        a: The vector.

    Returns:
        The product.

    """
    return (multiply_terms(factor, a[0]), multiply_terms(factor, a[1]), multiply_terms(factor, a[2]))


def cross_vectors(a: Vector, b: Vector) -> Vector:
    """Find the cross product.

    Args:
        a: A vector.
        b: A vector.

    Returns:
        a × b.

    """

    def entry(i: int, k: int) -> Any:
        return subtract_terms(multiply_terms(a[i], b[k]), multiply_terms(a[k], b[i]))

    return (entry(1, 2), entry(2, 0), entry(0, 1))


def multiply_matrix(rows: Sequence[Sequence[Any]], a: Sequence[Any]) -> Vector:
    """Multiply a matrix and a vector.

    Args:
        rows: The matrix (3 × 3).
        a: The vector.

    Returns:
        The product.

    """
    x, y, z = (add_terms(*(multiply_terms(entry, part) for entry, part in zip(row, a, strict=True))) for row in rows)
    return (x, y, z)


def multiply_matrices(a: Matrix, b: Matrix) -> Matrix:
    """Multiply two matrices of numbers; entries that rounding keeps from 0 and ±1 become these.

    Args:
        a: A matrix (3 × 3).
        b: A matrix (3 × 3).

    Returns:
        a b.

    """
    columns = tuple(zip(*b, strict=True))
    return tuple(
        tuple(_round_to_unit(sum(x * y for x, y in zip(row, column, strict=True))) for column in columns)  # type: ignore[misc]
        for row in a
    )


def _round_to_unit(value: float) -> float:
    """0, 1 or −1 where the value is one of them but for its last bits."""
    near = float(round(value))
    return near if abs(value - near) < 4e-16 else value


def transpose_matrix(rows: Matrix) -> Matrix:
    """Transpose a matrix of numbers.

    Args:
        rows: The matrix (3 × 3).

    Returns:
        Its transpose; of a rotation the inverse.

    """
    return tuple(zip(*rows, strict=True))


def rotate_about_z(s: Any, c: Any, a: Vector) -> Vector:
    """Find the components in the fixed frame of a vector given in a frame that has turned about z.

    Args:
        s: Sine of the angle.
        c: Cosine of the angle.
        a: The vector in the turned frame.

    Returns:
        The vector in the fixed frame.

    """
    x = subtract_terms(multiply_terms(c, a[0]), multiply_terms(s, a[1]))
    return (x, add_terms(multiply_terms(s, a[0]), multiply_terms(c, a[1])), a[2])


def rotate_back_about_z(s: Any, c: Any, a: Vector) -> Vector:
    """Find the components in a frame that has turned about z of a vector given in the fixed frame.

    Args:
        s: Sine of the angle.
        c: Cosine of the angle.
        a: The vector in the fixed frame.

    Returns:
        The vector in the turned frame.

    """
    x = add_terms(multiply_terms(c, a[0]), multiply_terms(s, a[1]))
    return (x, subtract_terms(multiply_terms(c, a[1]), multiply_terms(s, a[0])), a[2])


# -- inertias ---------------------------------------------------------------------------------------------------------


def multiply_inertia(inertia: Inertia, a: Vector) -> Vector:
    """Multiply an inertia and a vector.

    Args:
        inertia: The inertia, kg m².
        a: The vector.

    Returns:
        The product.

    """
    return multiply_matrix([[inertia[k] for k in row] for row in TENSOR_ENTRIES], a)


def rotate_inertia(rows: Matrix, inertia: Inertia) -> Inertia:
    """Find an inertia in another frame.

    Args:
        rows: The rotation (3 × 3), numbers: components in the new frame of a vector given in the old one.
        inertia: The inertia in the old frame, kg m².

    Returns:
        The inertia in the new frame, kg m².

    """
    if rows == IDENTITY:
        return inertia
    half = [multiply_inertia(inertia, row) for row in rows]

    def entry(i: int, k: int) -> Any:
        return add_terms(*(multiply_terms(rows[k][m], half[i][m]) for m in range(3)))

    return (entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2))


def rotate_inertia_about_z(s: Any, c: Any, inertia: Inertia) -> Inertia:
    """Find the entries in the fixed frame of an inertia given in a frame that has turned about z.

    Args:
        s: Sine of the angle.
        c: Cosine of the angle.
        inertia: The inertia in the turned frame, kg m².

    Returns:
        The inertia in the fixed frame, kg m².

    """
    xx, yy, zz, xy, xz, yz = inertia
    twice, gap = multiply_terms(2, xy), subtract_terms(yy, xx)
    moved = multiply_terms(s, subtract_terms(multiply_terms(s, gap), multiply_terms(c, twice)))
    mixed = multiply_terms(s, add_terms(multiply_terms(c, gap), multiply_terms(s, twice)))
    xz, yz, _ = rotate_about_z(s, c, (xz, yz, 0))
    return (add_terms(xx, moved), subtract_terms(yy, moved), zz, subtract_terms(xy, mixed), xz, yz)


def shift_body(mass: Any, moment: Vector, inertia: Inertia, r: Vector) -> tuple[Vector, Inertia]:
    """Refer first moment and inertia of a body to another point.

    Args:
        mass: Mass, kg.
        moment: First moment about the old point, kg m.
        inertia: Inertia about the old point, kg m².
        r: The old point as seen from the new one, m.

    Returns:
        First moment and inertia about the new point.

    """
    along = [
        multiply_terms(r[k], add_terms(multiply_terms(2, moment[k]), multiply_terms(r[k], mass))) for k in range(3)
    ]
    x, y, z = (add_terms(moment[k], multiply_terms(r[k], mass)) for k in range(3))
    new: Vector = (x, y, z)

    def mixed(i: int, k: int) -> Any:
        return add_terms(multiply_terms(moment[i], r[k]), multiply_terms(r[i], new[k]))

    xx, yy, zz, xy, xz, yz = inertia
    return new, (
        add_terms(xx, along[1], along[2]),
        add_terms(yy, along[0], along[2]),
        add_terms(zz, along[0], along[1]),
        subtract_terms(xy, mixed(0, 1)),
        subtract_terms(xz, mixed(0, 2)),
        subtract_terms(yz, mixed(1, 2)),
    )
