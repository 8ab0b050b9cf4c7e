"""`hdagen.compare`: two diagnoses side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hdagen.api.log_replay import DiagnosisSource
from hdagen.comparison.diagnosis_comparison import DiagnosisComparison, compare_contents
from hdagen.diagnosis.report.diagnosis_summary import DiagnosisSummary, read_diagnosis


def compare(first: DiagnosisSource, second: DiagnosisSource) -> DiagnosisComparison:
    """Compare two diagnoses: of two logs, of two machines, or before and after a change.

    Args:
        first: A diagnosis, a diagnosis.json or the folder that holds it, or its content.
        second: Another one.

    Returns:
        Verdicts, probabilities, gaps and parameters side by side, and which parameters agree.

    Raises:
        PlantError: A diagnosis cannot be read, is of another schema, or contradicts itself.

    """
    (one, label), (other, name) = (_read_source(source, k) for source, k in ((first, "first"), (second, "second")))
    return compare_contents(one, other, (label, name))


def _read_source(source: DiagnosisSource, label: str) -> tuple[Mapping[str, Any], str]:
    """The content of a diagnosis, and where it comes from."""
    if isinstance(source, DiagnosisSummary):
        return source.content, label
    if isinstance(source, str | Path):
        saved = read_diagnosis(source)
        return saved.content, str(saved.source)
    return source, label
