"""How many windows of a log are fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.windows import WindowedRecord


def select(rows: int, windows: int, hidden: slice = slice(0)) -> np.ndarray:
    """The selected ones of some windows that follow each other."""
    visible = np.ones(rows * windows, bool)
    visible[hidden] = False
    starts = rows * np.arange(windows)
    record: Any = SimpleNamespace(visible_rows=visible, starts=starts, ends=starts + rows)
    return np.asarray(cast(Any, WindowedRecord.selected_windows).func(record))


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (25, DATA.most_selected_windows),
        (60, DATA.selected_rows // 60),
        (100, DATA.fewest_selected_windows),
    ],
)
def test_longer_windows_are_fewer(rows: int, expected: int) -> None:
    chosen = select(rows, 300)
    assert len(chosen) == expected
    assert chosen[0] == 0 and chosen[-1] == 299
    assert np.ptp(np.diff(chosen)) <= 1  # spread evenly


def test_of_a_short_log_all_windows_are_fitted_whose_rows_are_visible() -> None:
    assert select(100, 20, slice(450, 650)).tolist() == [k for k in range(20) if k not in (4, 5, 6)]
