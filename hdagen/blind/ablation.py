"""Each rule of the decision switched off in turn, on the stored searches of sealed checks: what it is worth.

    hdagen blind --kind single --cases 40 --keep-searches --out checked
    python -m hdagen.blind.ablation checked --out docs/ablation.json
    python -m hdagen.blind.ablation docs/ablation.json

No set of effects is fitted again. A rule that is off may ask for a second search that the diagnosis had not needed;
then the first one stands. Cases that the file has already are not decided again. Labels are read after a case is
decided.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.arm.joint_names import read_joint_names
from hdagen.blind.ablation_table import AS_IT_IS, render_ablation
from hdagen.blind.decision_rules import RULES
from hdagen.blind.realities.population import read_population
from hdagen.blind.scores import score_case
from hdagen.diagnosis.search.stored_searches import SEARCHES_FILE
from hdagen.diagnosis.stored_diagnosis import StoredDiagnosis, read_diagnosis
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.version import __version__

LARGEST_REPORT_BYTES = 50_000_000
DECIDED_KEYS = ("verdict", "sure", "hypotheses")
_LABEL_KEYS = ("optional", "numbers", "sizes", "background", "kind")


class AblationError(Exception):
    """A case cannot be decided again; the message is a sentence."""


def decide_without_rules(folder: Path) -> dict[str, Mapping[str, Any] | None]:
    """Decide a case as it is, and with each rule off.

    Args:
        folder: of the case, with its robot file, log, searches and diagnosis.

    Returns:
        By the rule's name what was decided, as `StoredDiagnosis.decide_again` has it; None where there is no decision.

    Raises:
        AblationError: the case is not decided as it was.
        InputFileError: a file of the case cannot be read.
        LogError: the log cannot be read.
        PlantError: the robot cannot be built.

    """
    robot, searches = folder / "robot.toml", folder / "out" / SEARCHES_FILE
    log = read(folder / "log.parquet", holes=True, names=read_joint_names(robot))
    stored = read_diagnosis(robot, [log], searches)
    found = {AS_IT_IS: _decide(stored)}
    said = read_json(folder / "out" / "diagnosis.json", LARGEST_REPORT_BYTES, "check again")
    before = found[AS_IT_IS]
    if before is None or any(before[key] != said[key] for key in DECIDED_KEYS):
        raise AblationError(f"{folder}: is not decided as in its diagnosis.json; check again with this version.")
    for rule in RULES:
        with rule.switch_off():
            found[rule.name] = _decide(stored)
    return found


def _decide(stored: StoredDiagnosis) -> Mapping[str, Any] | None:
    try:
        return stored.decide_again()
    except (LogError, PlantError):
        return None


def score_outcome(row: Mapping[str, Any], said: Mapping[str, Any] | None) -> dict[str, bool]:
    """Score what was decided against the truth.

    Args:
        row: of the case, as blind.json has it.
        said: what was decided; None where there is no decision.

    Returns:
        Whether the effect is ``right`` at its joint and nothing else is named, the ``joint`` is right, the verdict is
        ``sure``, anything is ``named``, and whether the decision ``lacks`` a second search.

    """
    label = {"verdict": row["truth"]} | {key: row[key] for key in _LABEL_KEYS}
    whole = None if said is None else {**said, "where": []}
    scored = score_case(row["name"], label, {"snr": row["snr"], "parameters": row["parameters"]}, {}, whole)
    return {
        "right": scored.is_right and not scored.failed,
        "joint": bool(scored.truth) and scored.is_joint_right,
        "sure": scored.sure,
        "named": bool(scored.verdict),
        "lacks": bool(said and said["lacks_search"]),
    }


def ablate_check(folder: Path, known: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Decide the cases of a check with each rule off, and score them.

    Args:
        folder: of the check, which kept its searches.
        known: names of the cases that are not decided again.

    Yields:
        Each case with its ``name``, its ``population``, its ``kind``, whether it has a ``truth``, and by rule its
        ``outcomes``, each with whether the decision ``differs`` at all.

    Raises:
        AblationError: the check kept no searches, or a case is not decided as it was.
        InputFileError: a file cannot be read.
        LogError: a log cannot be read.
        PlantError: a robot cannot be built.

    """
    places = sorted(path.parent.parent for path in (folder / "cases").glob(f"*/out/{SEARCHES_FILE}"))
    if not places:
        raise AblationError(f"{folder}: keeps no searches; check again with `hdagen blind --keep-searches`.")
    report = read_json(folder / "blind.json", LARGEST_REPORT_BYTES, "finish the check with `hdagen blind`")
    population = read_population(report)
    for place in places:
        name = f"{report['seed']}/{place.name}"
        if name in known:
            continue
        decided = decide_without_rules(place)
        row = next(row for row in report["rows"] if row["name"] == place.name)  # the label, only now
        yield {
            "name": name,
            "population": population.name,
            "family": population.family,
            "kind": row["kind"],
            "truth": list(row["truth"]),
            "version": __version__,
            "outcomes": {
                rule: {**score_outcome(row, said), "differs": _differs(said, decided[AS_IT_IS])}
                for rule, said in decided.items()
            },
        }


def _differs(said: Mapping[str, Any] | None, usual: Mapping[str, Any] | None) -> bool:
    """Whether a decision is another one, be it by a probability alone."""
    if said is None or usual is None:
        return said is not usual
    return any(said[key] != usual[key] for key in DECIDED_KEYS)


def main() -> int:
    """Decide the cases of checks with --out, or print the table of a file."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.ablation", description=(__doc__ or "").split("\n")[0])
    p.add_argument("sources", nargs="+", type=Path, help="folders of checks; without --out one file of cases")
    p.add_argument("--out", type=Path, help="the file of cases, to which those of the checks are added")
    options = p.parse_args()
    kept: dict[str, Any] = {"cases": []}
    file = options.out or options.sources[0]
    try:
        if options.out is None or file.exists():
            kept = read_json(file, LARGEST_REPORT_BYTES, "`python -m hdagen.blind.ablation --out` writes such a file")
        for folder in options.sources if options.out else ():
            for case in ablate_check(folder, [one["name"] for one in kept["cases"]]):
                kept["cases"].append(case)
                write_atomically(file, (json.dumps(kept, indent=1) + "\n").encode())
                print(case["name"], file=sys.stderr, flush=True)
    except (AblationError, InputFileError, LogError, PlantError) as error:
        print(error, file=sys.stderr)
        return 2
    sys.stdout.write(render_ablation(kept))
    return 0


if __name__ == "__main__":
    sys.exit(main())
