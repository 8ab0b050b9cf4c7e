"""The explanation of a verdict: alternatives, remainders, single moments, where and when the gap lies, control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from hdagen.adoption.verdict import Verdict, apply_verdict
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.checked_verdict import CheckedVerdict
from hdagen.diagnosis.data.held_out_gap import compute_gap_bounds
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.prepared_data import PreparedData
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.holdout.hypothesis_ranking import rank_hypotheses
from hdagen.diagnosis.holdout.nuisance_effects import rank_nuisance_effects
from hdagen.diagnosis.holdout.single_moments import find_single_moments
from hdagen.diagnosis.holdout.unexplained_remainder import is_as_good_as_it_gets, measure_remainders, name_remainders
from hdagen.diagnosis.holdout.verdict_withdrawal import leaves_little
from hdagen.diagnosis.residuals.controller_impact import compare_controllers
from hdagen.diagnosis.residuals.localization import localize_gap
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque, see_residual_torque
from hdagen.diagnosis.stages.optional_stages import Attempts
from hdagen.diagnosis.stages.stage import Stage, StageListener
from hdagen.diagnosis.stages.time_budget import TimeBudget
from hdagen.log.measured_log import Log

Entries = Sequence[Mapping[str, Any]]  # of a list in diagnosis.json


@dataclass(frozen=True, eq=False)
class Alternatives:
    """Other explanations of the held-out motion.

    Attributes:
        nuisance_effects: of diagnosis.json: effects within tolerance that would close a part of the gap.
        ranking: of diagnosis.json: the leading hypotheses by the gap that each leaves.
        gap: of diagnosis.json, with its bounds by all that was fitted.
        is_sure: whether no alternative makes the verdict unsure.

    """

    nuisance_effects: Entries
    ranking: Entries
    gap: Mapping[str, Any]
    is_sure: bool


@dataclass(frozen=True, eq=False)
class FinalVerdict:
    """The verdict in the end, with what makes it unsure.

    Attributes:
        effects: the verdict in the end, effect@joint, with the remainders as `unknown@joint`.
        is_sure: whether the verdict is sure.
        alternatives: other explanations of the held-out motion.
        remainders: `remains` of diagnosis.json: the share of each joint's error that is left.
        is_as_good_as_it_gets: whether no fit closes a notable share of the gap.
        moments: of diagnosis.json: events that happen once.

    """

    effects: tuple[str, ...]
    is_sure: bool
    alternatives: Alternatives
    remainders: Entries
    is_as_good_as_it_gets: bool
    moments: Entries


@dataclass(frozen=True, eq=False)
class Explanation:
    """The explanation of a verdict.

    Attributes:
        final: the verdict in the end.
        residual_torque: the held-out motion through the models before and after the verdict.
        where: of diagnosis.json: where and when the gap lies; None where that could not be found.
        control: of diagnosis.json: controllers before and after the verdict; None where no effect is named.
        failures: a sentence for each stage that failed.
        not_tried: of diagnosis.json: parts that were left out because the time was up.

    """

    final: FinalVerdict
    residual_torque: ResidualTorque
    where: Entries | None
    control: Mapping[str, Any] | None
    failures: tuple[str, ...]
    not_tried: Entries


def explain_verdict(
    models: Models, data: PreparedData, checked: CheckedVerdict, budget: TimeBudget, on_stage: StageListener
) -> Explanation:
    """Explain a verdict: what else it may be, what remains, and where and when the gap lies.

    Args:
        models: of the robot.
        data: of the diagnosis.
        checked: the verdict after its check on held-out motion.
        budget: the time of the diagnosis.
        on_stage: receives each stage as it begins.

    Returns:
        The explanation. A stage that fails is left out.

    Raises:
        PlantError: the model with the verdict cannot be simulated.

    """
    attempts, statement, motion = Attempts(budget), checked.settled.statement, checked.motion
    confirmed, log = statement.confirmed, motion.portion.log
    on_stage(Stage.ALTERNATIVES)
    final = conclude_diagnosis(data, checked, attempts)
    on_stage(Stage.LOCATION)
    stated_verdict = replace(statement.stated, names=final.effects).build_verdict(confirmed.base_parameters)
    sight = see_residual_torque(confirmed.arm, stated_verdict, log, motion.before, confirmed.after)
    where = attempts.attempt("where and when", partial(localize_gap, sight, final.effects, motion.portion.rows), None)
    return Explanation(
        final=final,
        residual_torque=sight,
        where=where,
        control=_compare_control(models.nominal, confirmed.arm, stated_verdict, log),
        failures=tuple(attempts.failures),
        not_tried=budget.describe_untried(),
    )


def conclude_diagnosis(data: PreparedData, checked: CheckedVerdict, attempts: Attempts) -> FinalVerdict:
    """Conclude the verdict from its check on held-out motion: with remainders, and unsure where alternatives say so.

    Args:
        data: of the diagnosis.
        checked: the verdict after its check on held-out motion.
        attempts: runs the rankings; one that fails is left out.

    Returns:
        The verdict in the end.

    """
    confirmed = checked.settled.statement.confirmed
    alternatives = rank_alternatives(checked, attempts)
    remainders = measure_remainders(alternatives.gap["by_channel"])
    named = any(not name.startswith("unknown@") for name in confirmed.effects)
    good = not named and is_as_good_as_it_gets(alternatives.gap)
    effects = () if good else tuple(name_remainders(confirmed.effects, remainders))
    moments = _find_moments(checked, data.judged_logs)
    is_sure = alternatives.is_sure and bool(effects or not moments) and not attempts.budget.not_tried
    return FinalVerdict(effects, is_sure, alternatives, remainders, good, moments)


def rank_alternatives(checked: CheckedVerdict, attempts: Attempts) -> Alternatives:
    """Rank the nuisance effects and the leading hypotheses by the gap that each leaves.

    Args:
        checked: the verdict after its check on held-out motion.
        attempts: runs both rankings; one that fails is left out.

    Returns:
        The alternatives.

    """
    statement, motion, nothing = checked.settled.statement, checked.motion, list[dict[str, Any]]()
    decision, confirmed = statement.decision, statement.confirmed
    replays = motion.before, confirmed.after, motion.portion, motion.simulate
    stated_verdict = replace(statement.stated, names=confirmed.effects).build_verdict(confirmed.base_parameters)
    rank_nuisances = partial(rank_nuisance_effects, decision.best, stated_verdict, *replays)
    nuisances = attempts.attempt_in_time("the nuisance effects", rank_nuisances, nothing)
    rank = partial(rank_hypotheses, decision, confirmed.effects, *replays)
    ranking = attempts.attempt_in_time("the ranking", rank, nothing)
    gap = {**confirmed.gap, **compute_gap_bounds(confirmed.gap, ranking, nuisances)}
    others = [gap["flexible"], *(one["gap"] for one in ranking)]
    sure = decision.is_sure and not confirmed.is_withdrawn
    return Alternatives(nuisances, ranking, gap, sure and leaves_little(gap["after"], others))


def _find_moments(checked: CheckedVerdict, logs: Sequence[Log]) -> Entries:
    """The events that happen once in the replayed ``logs``; none where the hold-out contradicts the log."""
    if checked.contradiction:
        return []
    before, after = checked.motion.before, checked.settled.statement.confirmed.after
    every = LogPortion.all_rows(checked.motion.portion.log).without_windows(before.guessed_starts, before.starts)
    return find_single_moments(before, after, every, logs)


def _compare_control(plain: Arm, changed: Arm, said: Verdict, log: Log) -> Mapping[str, Any] | None:
    """Compare controllers under the verdict, or say why that is impossible; None where no effect is named."""
    if not said.effects:
        return None
    try:
        return compare_controllers(plain, apply_verdict(changed, said)[0], log).content
    except PlantError as error:
        return {"refused": str(error)}
