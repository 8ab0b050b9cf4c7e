"""What a caller gives, as arrays of real, finite numbers, or a sentence on what is wrong with it (PlantError)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdagen.opening import PlantError

Array = NDArray[np.float64]


def is_number(value: Any) -> bool:
    """Whether the value is one real, finite number."""
    return isinstance(value, (int, float, np.integer, np.floating)) and bool(np.isfinite(value))


def finite(value: ArrayLike, what: str) -> Array:
    """``value`` as an array in C's order; ``what`` names it in the error."""
    try:
        if np.iscomplexobj(value):
            raise TypeError("they are complex")
        array = np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise PlantError(f"{what} is not an array of real numbers ({error}).") from None
    if not np.isfinite(array).all():
        raise PlantError(f"{what} holds NaN or infinity; give finite numbers.")
    return np.require(array, requirements="C")


def of_rows(value: ArrayLike, length: int, what: str) -> Array:
    """One row (length) or several (T, length)."""
    array = np.atleast_1d(finite(value, what))
    if array.ndim > 2 or array.shape[-1] != length:
        raise PlantError(f"{what} must have {length} entries, not the shape {array.shape}.")
    return array


def vector(value: ArrayLike, length: int, what: str) -> Array:
    """One row (length)."""
    array = np.atleast_1d(finite(value, what))
    if array.shape != (length,):
        raise PlantError(f"{what} must have {length} entries, not the shape {array.shape}.")
    return array
