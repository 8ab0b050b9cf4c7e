"""The whole search for effects: all of them screened, the leading ones raced, and springs in rigid joints."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import partial

from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.inference.local_fit import restore_columns
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.search.fit_ranking import sort_by_evidence
from hdagen.diagnosis.search.hypothesis_search import SearchResult, search_hypotheses
from hdagen.diagnosis.search.null_model import NullModel
from hdagen.diagnosis.search.rigid_or_flexible import compare_with_springs
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import StageListener


def search_effects(
    models: Models,
    data: PreparedData,
    null: NullModel,
    on_stage: StageListener,
    may_have_springs: bool = True,
    named: Collection[str] = (),
) -> SearchResult:
    """Search the effects that explain a record, and springs in joints that the robot file calls rigid.

    Args:
        models: of the robot.
        data: with the record.
        null: the fitted null model, with all candidates.
        on_stage: receives each stage as it begins.
        may_have_springs: whether springs are searched in joints that the robot file calls rigid.
        named: effects that a search named which took the robot file as right, name@joint.

    Returns:
        The fits, and the screening. The search for springs is left out where it fails. Where the time is up, the best
        fits until then, at least that of the null model.

    """
    attempts, budget, words = Attempts(), null.shooting.budget, null.candidates
    if budget.is_left_out("fits of single effects", (atom.name for atom in words.members)):
        return SearchResult(words, (restore_columns(null.fit, words),), (null.fit.score,))
    found = search_hypotheses(null.shooting, words, on_stage, named)
    if budget.is_up:
        found = replace(found, fits=tuple(sort_by_evidence([*found.fits, null.fit])))
    if may_have_springs:
        search = partial(compare_with_springs, models.robot, models.full, data.record, data.window, found, on_stage)
        found = attempts.attempt("a spring in what the robot file calls rigid", search, found)
    simulators = {id(one): one for fit in found.fits if (one := fit.sensitivities.shooting)}.values()
    return replace(found, failures=(*attempts.failures, *describe_failed_simulations(simulators)))


def describe_failed_simulations(simulators: Iterable[MultipleShooting]) -> list[str]:
    """Describe how many simulations of a search failed.

    Args:
        simulators: of the search.

    Returns:
        One sentence, or none where every simulation succeeded.

    """
    every = list(simulators)
    run, failed = sum(one.rollout_count for one in every), sum(one.failure_count for one in every)
    if not failed:
        return []
    return [
        f"In {failed} of {run} simulations of the fit the model flew apart or gave no number: such a motion "
        "counts as wrong as can be, and the search went on without it."
    ]
