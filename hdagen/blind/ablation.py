"""Each rule of the decision switched off in turn, on the stored searches of sealed checks: what it is worth.

    hdagen blind --kind single --cases 40 --keep-searches --out checked
    python -m hdagen.blind.ablation checked --out docs/ablation.json [--jobs 2]
    python -m hdagen.blind.ablation docs/ablation.json

No set of effects is fitted again. A rule that is off may ask for a second search that the diagnosis had not needed;
then the first one stands. Each case is a task, kept in the folder `ablation` of its check, so an interrupted call goes
on by the same command. Cases that the file has already are not decided again. Labels are read after the cases are
decided.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hdagen.arm.build_loader import PlantError
from hdagen.blind.ablation_table import AS_IT_IS, render_ablation
from hdagen.blind.ablation_task import DECISIONS_FILE, is_other_decision, make_ablation_task
from hdagen.blind.realities.population import read_population
from hdagen.blind.scores import score_case
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Outcome, Status
from hdagen.diagnosis.search.stored_searches import SEARCHES_FILE
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json
from hdagen.support.version import __version__

LARGEST_REPORT_BYTES = 50_000_000
RESULT_FOLDER = "ablation"  # in the folder of a check
_LABEL_KEYS = ("optional", "numbers", "sizes", "background", "kind")


class AblationError(Exception):
    """A check cannot be decided again; the message is a sentence."""


@dataclass(frozen=True)
class AblatedCheck:
    """The cases of a check, decided with each rule off.

    Attributes:
        cases: each case with its ``name``, its ``population``, its ``kind``, whether it has a ``truth``, and by rule
            its ``outcomes``, each with whether the decision ``differs`` at all.
        problems: a sentence for each case that could not be decided.
        was_interrupted: whether an interrupt left some undecided.

    """

    cases: Sequence[Mapping[str, Any]]
    problems: Sequence[str]
    was_interrupted: bool


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


def ablate_check(folder: Path, known: Sequence[str], asked: ClusterRequest, say: Callable[[str], None]) -> AblatedCheck:
    """Decide the cases of a check with each rule off, and score them.

    Args:
        folder: of the check, which kept its searches.
        known: names of the cases that are not decided again.
        asked: where cases are decided.
        say: hears how far the work is.

    Returns:
        The cases that are not known.

    Raises:
        AblationError: the check kept no searches.
        InputFileError: a file cannot be read.
        PlantError: another call works on this check, or no further case can be decided; what is finished is kept.
        OSError: a result cannot be written.

    """
    places = sorted(path.parent.parent for path in (folder / "cases").glob(f"*/out/{SEARCHES_FILE}"))
    if not places:
        raise AblationError(f"{folder}: keeps no searches; check again with `hdagen blind --keep-searches`.")
    report = read_json(folder / "blind.json", LARGEST_REPORT_BYTES, "finish the check with `hdagen blind`")
    names = {place.name: f"{report['seed']}/{place.name}" for place in places}
    (folder / RESULT_FOLDER).mkdir(exist_ok=True)
    store = ResultStore(folder / RESULT_FOLDER)
    every = [make_ablation_task(place) for place in places]
    tasks = [one for one in every if names[one.name] not in known or store.find_finished(one)]  # rows of the table
    with store.hold_lock(), open_cluster(asked, say) as runner:
        outcomes, interrupted = run_campaign(tasks, store, runner, say)
    cases = [
        {"name": names[name], "version": __version__, **_score_decisions(report, name, store)}
        for name, outcome in outcomes.items()
        if outcome.status is Status.DONE and names[name] not in known
    ]
    return AblatedCheck(cases, _list_problems(outcomes), interrupted)


def _list_problems(outcomes: Mapping[str, Outcome]) -> list[str]:
    ended = [one for one in outcomes.values() if one.status in (Status.REFUSED, Status.FAILED)]
    return [" ".join(one.messages) for one in ended]


def _score_decisions(report: Mapping[str, Any], name: str, store: ResultStore) -> dict[str, Any]:
    """A decided case with its outcomes; its label is read only now. Raises InputFileError."""
    decided = read_json(store.folder / name / DECISIONS_FILE, LARGEST_REPORT_BYTES, "remove its folder")
    row = next(row for row in report["rows"] if row["name"] == name)
    population = read_population(report)
    outcomes = {
        rule: {**score_outcome(row, said), "differs": is_other_decision(said, decided[AS_IT_IS])}
        for rule, said in decided.items()
    }
    return {
        "population": population.name,
        "family": population.family,
        "kind": row["kind"],
        "truth": list(row["truth"]),
        "outcomes": outcomes,
    }


def main() -> int:
    """Decide the cases of checks with --out, or print the table of a file."""
    p = argparse.ArgumentParser(prog="python -m hdagen.blind.ablation", description=(__doc__ or "").split("\n")[0])
    p.add_argument("sources", nargs="+", type=Path, help="folders of checks; without --out one file of cases")
    p.add_argument("--out", type=Path, help="the file of cases, to which those of the checks are added")
    p.add_argument("--jobs", type=int, default=1, metavar="J", help="cases at the same time (default: 1)")
    options = p.parse_args()
    try:
        kept, problems, interrupted = _ablate_checks(options)
    except (AblationError, InputFileError, PlantError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    for words in problems:
        print(words, file=sys.stderr)
    sys.stdout.write(render_ablation(kept))
    if interrupted:
        return 130
    return 2 if problems else 0


def _ablate_checks(options: argparse.Namespace) -> tuple[dict[str, Any], list[str], bool]:
    """The content of the file of cases, to which those of the checks are added; sentences; whether it was interrupted.

    Raises AblationError, InputFileError, PlantError, OSError."""
    kept: dict[str, Any] = {"cases": []}
    problems: list[str] = []
    file = options.out or options.sources[0]
    if options.out is None or file.exists():
        kept = read_json(file, LARGEST_REPORT_BYTES, "`python -m hdagen.blind.ablation --out` writes such a file")
    for folder in options.sources if options.out else ():
        known, asked = [one["name"] for one in kept["cases"]], ClusterRequest(jobs=options.jobs)
        found = ablate_check(folder, known, asked, lambda words: print(words, file=sys.stderr, flush=True))
        problems += found.problems
        if found.cases:
            kept["cases"] += found.cases
            write_atomically(file, (json.dumps(kept, indent=1) + "\n").encode())
        if found.was_interrupted:
            return kept, problems, True
    return kept, problems, False


if __name__ == "__main__":
    sys.exit(main())
