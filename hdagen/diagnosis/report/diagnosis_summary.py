"""A diagnosis in short: verdict, gap, and the two tables, of one that was just made or of one that was saved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hdagen.adoption.diagnosis_file import read_content
from hdagen.adoption.verdict import read_verdict
from hdagen.diagnosis.report.result_tables import build_hypothesis_table, build_parameter_table
from hdagen.diagnosis.report.sentences import write_verdict
from hdagen.pages.markup import build_element, escape_html
from hdagen.pages.quantity import format_number
from hdagen.pages.result_table import ResultTable

SHOWN_HYPOTHESES = 5  # hypotheses in the summary of a notebook
GAP_DIGITS = 3  # significant digits of a gap


class DiagnosisSummary:
    """The content of diagnosis.json as values and tables."""

    @property
    def content(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        raise NotImplementedError

    @property
    def verdict(self) -> tuple[str, ...]:
        """The effects that the model lacks, effect@joint; `unknown@joint` where no known effect explains the error."""
        return tuple(self.content["verdict"])

    @property
    def sure(self) -> bool:
        """Whether the verdict is sure: everything else together holds at most a tenth of the probability."""
        return bool(self.content["sure"])

    @property
    def gap(self) -> Mapping[str, Any]:
        """The gap on held-out motion before and after the verdict, in multiples of the noise."""
        gap: Mapping[str, Any] = self.content["gap"]
        return gap

    @property
    def sentence(self) -> str:
        """The verdict in words, with the gap and all remarks."""
        return write_verdict(self.content)

    def table(self) -> ResultTable:
        """Build the ranked table of hypotheses, with a column for each doubt.

        Returns:
            The table, the most probable hypothesis first.

        """
        return build_hypothesis_table(self.content)

    def parameters(self) -> ResultTable:
        """Build the table of the parameters of the verdict's effects and of base parameters.

        Returns:
            The table, with value, standard deviation and unit.

        """
        return build_parameter_table(self.content)

    def __repr__(self) -> str:
        named = ", ".join(self.verdict) or "no effect"
        doubt = ", not sure"
        if self.sure:
            doubt = ""
        return f"<diagnosis: {named}{doubt}; gap {self._format_gap()}>"

    def _repr_html_(self) -> str:
        """The first screen of the report, for notebooks: the verdict, the gap, and the leading hypotheses."""
        table = self.table()
        leading = {name: cells[:SHOWN_HYPOTHESES] for name, cells in table.columns.items() if any(cells)}
        heading = build_element("p", build_element("strong", escape_html(self.sentence)))
        gap = build_element("p", escape_html(f"Gap on held-out motion: {self._format_gap()}."))
        return build_element("div", heading, gap, replace(table, columns=leading)._repr_html_())

    def _format_gap(self) -> str:
        before, after = (format_number(float(self.gap[when]), GAP_DIGITS) for when in ("before", "after"))
        return f"{before} → {after} times the noise"


@dataclass(frozen=True, eq=False, repr=False)
class SavedDiagnosis(DiagnosisSummary):
    """A diagnosis as its diagnosis.json has it.

    Attributes:
        source: The file.
        stored: Its content.

    """

    source: Path
    stored: dict[str, Any]

    @property
    def content(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return self.stored


def read_diagnosis(path: str | Path) -> SavedDiagnosis:
    """Read a diagnosis that was saved.

    Args:
        path: A diagnosis.json, or the folder that holds it.

    Returns:
        The diagnosis.

    Raises:
        PlantError: The file cannot be read, is of another schema, or contradicts itself.

    """
    file = Path(path)
    if file.is_dir():
        file = file / "diagnosis.json"
    content = dict(read_content(file))
    read_verdict(file)  # refuses another schema and contradictions
    return SavedDiagnosis(file, content)
