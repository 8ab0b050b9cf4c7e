"""Families of realities side by side: what a probability is worth in one that the calibration has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hdagen.blind.calibrate import fit_calibration
from hdagen.blind.confidence_intervals import Figure
from hdagen.blind.labels import FAMILY_TITLES, format_figure
from hdagen.blind.score_summary import calibration_error, measure_calibration_error, select_single, summarize_rows
from hdagen.blind.scores import Row
from hdagen.diagnosis.decision.decision_settings import DECISION

FEWEST_CASES = 30  # of the other families together, that a calibration is fitted to
_SHOWN_FIGURES = ("effect_and_joint", "p_truth", "sure", "sure_and_wrong")


def render_family_table(rows: Mapping[str, Sequence[Row]]) -> str:
    """Render the figures of one effect, family by family.

    Args:
        rows: cases of each family; those of other kinds than one effect do not count.

    Returns:
        A Markdown table.

    """
    single = {family: select_single(every) for family, every in rows.items()}
    lines = [
        "| family | cases | effect and joint | p of truth | sure | sure and wrong | calibration error | "
        "leave-one-family-out |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for family, mine in single.items():
        if not mine:
            continue
        figures, others = (
            summarize_rows(mine),
            [row for name, every in single.items() if name != family for row in every],
        )
        cells = [
            FAMILY_TITLES[family],
            str(len(mine)),
            *(format_figure(name, figures[name]) for name in _SHOWN_FIGURES),
        ]
        cells.append(format_figure("calibration_error", calibration_error(mine)))
        cells.append(_format_transfer(transfer_calibration(others, mine)))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def transfer_calibration(others: Sequence[Row], mine: Sequence[Row]) -> Figure | None:
    """Calibrate on the cases of other families, and measure the calibration error on those of one.

    Args:
        others: cases of the other families, with one effect each.
        mine: cases of the family that is left out.

    Returns:
        The error; None where the others are too few, or all right or all wrong.

    """
    log_odds, right = _read_odds(others)
    if len(right) < FEWEST_CASES or right.all() or not right.any():
        return None
    temperature, lapse = fit_calibration(log_odds, right)
    own, hits = _read_odds(mine)
    believed = (1.0 - lapse) / (1.0 + np.exp(-own / temperature))
    return measure_calibration_error(believed.tolist(), hits.tolist())


def _read_odds(rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray]:
    """Log-odds of each verdict before calibration (cases,), and whether it is right (cases,)."""
    known = [row for row in rows if not row.failed]
    margin = DECISION.probability_margin
    p = np.clip([row.p_stated for row in known], margin, 1.0 - margin)
    return np.log(p / (1.0 - p)), np.array([row.is_right for row in known], bool)


def _format_transfer(error: Figure | None) -> str:
    if error is None:
        return "too few others"
    return format_figure("calibration_error", error)
