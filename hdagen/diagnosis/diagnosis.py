"""A finished diagnosis as its caller has it: the verdict, the gap, and the two files that it is saved as."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.diagnosis.report import report_page
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.report.diagnosis_summary import DiagnosisSummary
from hdagen.diagnosis.report.repeat_commands import DiagnosedFiles
from hdagen.diagnosis.search.stored_searches import SEARCHES_FILE, write_searches
from hdagen.support.atomic_write import write_atomically


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(DiagnosisSummary):
    """A finished diagnosis of logs of one machine.

    Attributes:
        result: everything that the stages found.
        robot: the preset or robot.toml that was diagnosed.
        logs: the paths of the logs.
        holdout: the paths of the hold-out logs.

    """

    result: DiagnosisResult
    robot: str | Path
    logs: tuple[str, ...]
    holdout: tuple[str, ...]

    @property
    def content(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return self.result.content

    @property
    def failures(self) -> tuple[str, ...]:
        """A sentence for every optional stage that was left out, and for simulations that failed."""
        return self.result.failures

    def save(self, folder: str | Path, columns: str | Path | None = None) -> None:
        """Write diagnosis.json and report.html.

        Args:
            folder: where both files are written; it is made where it does not exist.
            columns: path of the columns.toml that the logs were read with, for the commands on the page.

        Raises:
            OSError: the folder cannot be written into.

        """
        out = Path(folder)
        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.content, indent=1, allow_nan=False) + "\n"
        write_atomically(out / "diagnosis.json", text.encode())
        files = DiagnosedFiles(self.robot, self.logs, self.holdout, folder, columns)
        report_page.write_report(self.result, out / "report.html", files)

    def save_searches(self, folder: str | Path) -> None:
        """Write the searches, from which the same logs can be decided again without any fit.

        Args:
            folder: where the file is written; it exists.

        Raises:
            OSError: the folder cannot be written into.

        """
        write_searches(self.result.searches, Path(folder) / SEARCHES_FILE)
