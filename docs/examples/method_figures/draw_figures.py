"""Draw the figures of docs/method: one SVG for each page, from small made data or as a schematic.

    python docs/examples/method_figures/draw_figures.py [NAME ...]

writes docs/images/method/NAME.svg, all of them when no name is given. Nothing is simulated with a robot model. The only
measured numbers are those of docs/real.json (figure real_machines) and of calibration.json (figure scores).
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import matplotlib.pyplot as plt
from check_and_explanation import (
    draw_blind_check,
    draw_explanation,
    draw_holdout_check,
    draw_limits,
    draw_long_horizon,
    draw_real_machines,
)
from figure_style import ROOT, STYLE
from fits_and_scores import draw_direct_evidence, draw_likelihood, draw_null_model, draw_scores, draw_search
from matplotlib.figure import Figure
from pipeline_and_data import (
    draw_candidate_models,
    draw_data_quality,
    draw_holdout_blocks,
    draw_pipeline,
    draw_prediction,
)

IMAGES = ROOT / "docs" / "images" / "method"
FIGURES: dict[str, Callable[[], Figure]] = {
    "pipeline": draw_pipeline,
    "prediction": draw_prediction,
    "data_quality": draw_data_quality,
    "candidate_models": draw_candidate_models,
    "holdout_blocks": draw_holdout_blocks,
    "direct_evidence": draw_direct_evidence,
    "null_model": draw_null_model,
    "likelihood": draw_likelihood,
    "search": draw_search,
    "scores": draw_scores,
    "holdout_check": draw_holdout_check,
    "long_horizon": draw_long_horizon,
    "explanation": draw_explanation,
    "blind_check": draw_blind_check,
    "real_machines": draw_real_machines,
    "limits": draw_limits,
}


def main() -> None:
    """Write the figures that the command names, or all."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name in sys.argv[1:] or FIGURES:
            figure = FIGURES[name]()
            figure.savefig(IMAGES / f"{name}.svg", metadata={"Date": None})
            plt.close(figure)
            print(f"docs/images/method/{name}.svg")


if __name__ == "__main__":
    main()
