"""A caller's values as arrays of real, finite numbers; a `PlantError` says in a sentence why a value is none."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.arm.build_loader import PlantError

Array = NDArray[np.float64]


def is_number(value: Any) -> bool:
    """Tell whether a value is one real, finite number.

    Args:
        value: Anything.

    Returns:
        Whether it is a Python or numpy integer or float that is neither NaN nor infinite.

    """
    return isinstance(value, (int, float, np.integer, np.floating)) and bool(np.isfinite(value))


def as_finite_array(value: ArrayLike, what: str) -> Array:
    """Turn a value into an array of finite numbers.

    Args:
        value: Numbers of any shape.
        what: The value's name in an error.

    Returns:
        The numbers as float64 in C's order, without a copy where they are that already.

    Raises:
        PlantError: The value is not numeric, is complex, or holds NaN or infinity.

    """
    try:
        if np.iscomplexobj(value):
            raise TypeError("they are complex")
        array = np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise PlantError(f"{what} is not an array of real numbers ({error}).") from None
    if not np.isfinite(array).all():
        raise PlantError(f"{what} holds NaN or infinity; give finite numbers.")
    return np.require(array, requirements="C")


def as_rows(value: ArrayLike, length: int, what: str) -> Array:
    """Turn a value into one row or several rows of finite numbers.

    Args:
        value: Numbers, (length) or (T, length).
        length: Entries of a row.
        what: The value's name in an error.

    Returns:
        The numbers as float64, (length) or (T, length).

    Raises:
        PlantError: The value has another shape, or is not made of finite numbers.

    """
    array = np.atleast_1d(as_finite_array(value, what))
    if array.ndim > 2 or array.shape[-1] != length:
        raise PlantError(f"{what} must have {length} entries, not the shape {array.shape}.")
    return array


def as_vector(value: ArrayLike, length: int, what: str) -> Array:
    """Turn a value into one row of finite numbers.

    Args:
        value: Numbers, (length).
        length: Entries of the row.
        what: The value's name in an error.

    Returns:
        The numbers as float64, (length).

    Raises:
        PlantError: The value has another shape, or is not made of finite numbers.

    """
    array = np.atleast_1d(as_finite_array(value, what))
    if array.shape != (length,):
        raise PlantError(f"{what} must have {length} entries, not the shape {array.shape}.")
    return array
