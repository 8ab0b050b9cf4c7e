"""`hdagen doctor`: whether this computer has everything that hdagen needs, and the cure where it has not."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hdagen.arm.installation_check import InstallationFinding

DOCTOR_EXAMPLE = """example:
  hdagen doctor

looks at Python, the C compiler, the folder of the builds and every package, one line each.
exit codes: 0 everything needed is there, 1 something needed is missing"""
DONE, INCOMPLETE = 0, 1


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "doctor",
        help="check Python, compiler, folders and packages",
        description="Checks whether this computer has everything that hdagen needs, and says what to do where not.",
        epilog=DOCTOR_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--json", action="store_true", help="print the findings as JSON")


def run(options: argparse.Namespace) -> int:
    """Check the installation, print a line for each thing.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code: 1 where something that is needed is missing.

    """
    from hdagen.arm.installation_check import check_installation

    findings = []
    for finding in check_installation():
        findings.append(finding)
        if not options.json:
            print(f"{_grade_finding(finding):8} {finding.subject}: {finding.found}", flush=True)
    if options.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=1))
    if any(finding.is_needed and not finding.is_good for finding in findings):
        return INCOMPLETE
    return DONE


def _grade_finding(finding: InstallationFinding) -> str:
    if finding.is_good:
        return "ok"
    if finding.is_needed:
        return "missing"
    return "optional"
