"""The check of a verdict on held-out motion, which the fit did not see.

A fit sees short windows, each with its own initial state. An effect that acts at few places, or slowly, hardly shows
there, and a little of many effects within tolerance stands in for it. Elsewhere, and over longer windows, it does not.
So the verdict is checked joint by joint on motion that was kept from the fit.

A known effect is confirmed where the verdict closes a third of its joint's error. The short windows may leave so much
torque unexplained that something unknown is more probable than any known effect. Then a known effect is confirmed all
the same, as long as the base parameters alone do not close as much; its probability depends on the error that is left.
No known effect takes the place of something unknown if it would have to be larger than any such effect is. Where no
known effect is confirmed, the verdict names something unknown alone, at the joint with the largest error left.

Remainders beside named effects do not compete with these: `hdagen.diagnosis.holdout.unexplained_remainder`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.held_out_gap import measure_channel_errors
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.decision_settings import DECISION
from hdagen.diagnosis.decision.posterior import SMALLEST_POSITIVE, Decision, Hypothesis, conclude_verdict
from hdagen.diagnosis.decision.verdict_content import StatedEffects
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.small_effects import Fits, drop_effects
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.prediction.window_replay import Replay

LEAST_UNKNOWN_ODDS = DECISION.sure_below / (
    1.0 - DECISION.sure_below
)  # of something unknown where short windows say so: what is named is then not sure


@dataclass(frozen=True, eq=False)
class ConfirmedVerdict:
    """The part of a verdict that held-out motion confirms.

    Attributes:
        effects: the effects that it confirms, effect@joint; `unknown@joint` among them.
        base_parameters: as re-estimated, in the form of `parameters` of diagnosis.json.
        is_withdrawn: whether it confirms no effect and no base parameter.
        gap: `gap` of diagnosis.json on the last motion.
        arm: the model with the verdict's effects, or the robot file's model where they are withdrawn.
        after: the replay of the last motion after the verdict.

    """

    effects: tuple[str, ...]
    base_parameters: Mapping[str, Any]
    is_withdrawn: bool
    gap: Mapping[str, Any]
    arm: Arm
    after: Replay


def withdraw_harmful(
    plain: Arm,
    named: Arm,
    stated: StatedEffects,
    motions: Sequence[HoldoutMotion],
    fitted: Mapping[str, Any],
    alone: Mapping[str, Any] = MappingProxyType({}),
) -> ConfirmedVerdict:
    """Withdraw the parts of a verdict that do not close the gap on held-out motion.

    Base parameters that spoil a verdict are withdrawn first, then the verdict. Something unknown stays, as it predicts
    no motion. Beside it, base parameters that were refitted with effects which are not named may be wrong, and those
    that were refitted alone may close the gap. A verdict that changes nothing closes nothing: the model with every
    effect at no size starts its windows in other estimates of the state, which may lie nearer by chance.

    Args:
        plain: the robot file's model.
        named: the model with the verdict's effects.
        stated: the verdict's effects.
        motions: the verdict must predict each of them better than the robot file does.
        fitted: the base parameters as they are refitted with the effects, as `parameters` of diagnosis.json.
        alone: the same as they are refitted with no effect.

    Returns:
        The verdict that stays, with the gap on the last motion.

    Raises:
        PlantError: a model cannot be simulated.

    """
    last = motions[-1]
    for base in _list_base_parameters(stated, fitted, alone):
        stated_verdict = stated.build_verdict(base)
        if not (base or stated_verdict.effects):
            continue
        arm = verdict.apply_verdict(named, stated_verdict)[0]
        replays = [motion.simulate(arm) for motion in motions]
        gaps = [motion.measure_gap(after) for motion, after in zip(motions, replays, strict=True)]
        bent = bool(stated_verdict.unexplained_joints and base)
        if all(gap["before"] >= HOLDOUT_CHECK.least_explainable_gap and _closes_gap(gap, bent) for gap in gaps):
            return ConfirmedVerdict(stated.names, base, False, gaps[-1], named, replays[-1])
    gap, kept = last.measure_gap(last.before), tuple[str, ...]()
    if gap["before"] >= HOLDOUT_CHECK.least_explainable_gap:
        kept = tuple(f"unknown@{joint}" for joint in stated_verdict.unexplained_joints)
    return ConfirmedVerdict(kept, {}, True, gap, plain, last.before)


def _list_base_parameters(
    stated: StatedEffects, fitted: Mapping[str, Any], alone: Mapping[str, Any]
) -> list[Mapping[str, Any]]:
    """The base parameters to try with a verdict, in turn; the robot file's own come last."""
    if any(name.startswith("unknown@") for name in stated.names):
        return [fitted, alone, {}]
    return [fitted, {}]


def _closes_gap(told: dict[str, Any], bent: bool) -> bool:
    """Whether a gap is smaller after, as `gap` has it.

    Beside something unknown, base parameters are ``bent`` to the motion of the log: there the whole interval must lie
    above next to nothing.
    """
    surely = told["interval"][0] > 1.0 - HOLDOUT_CHECK.unclosed_share if bent and told["interval"] else True
    return bool(told["after"] < told["before"] and surely)


def leaves_little(after: float, others: Sequence[float]) -> bool:
    """Say whether a verdict leaves so little of the gap that it can be sure.

    Args:
        after: gap with the verdict, in multiples of the noise.
        others: gap with each other set of effects, and with a flexible correction, in multiples of the noise.

    Returns:
        False where many times the noise is left and something else leaves far less, or very many times the noise.

    """
    return after <= DATA.significant_noise_multiple or (
        after <= HOLDOUT_CHECK.largest_sure_gap
        and min(others, default=after) > HOLDOUT_CHECK.most_remaining_share * after
    )


def doubt_on_holdout(
    decision: Decision, fitted: Fits, said: Sequence[str], motion: HoldoutMotion, after: Replay
) -> tuple[Decision, dict[str, Any] | None]:
    """Doubt the effects of a verdict that held-out motion does not confirm.

    Args:
        decision: to be checked; one that names something unknown stays as it is.
        fitted: the fits of a search, by their sets of effects.
        said: the effects that close the gap, name@joint.
        motion: held-out motion.
        after: its replay with these effects.

    Returns:
        The decision with the confirmed effects, if these were fitted by themselves, or with something unknown where
        none is confirmed. And `doubt_on_holdout` of diagnosis.json, the verdict before and the share of a joint's error
        that is left; None if nothing is doubted.

    Raises:
        PlantError: the model cannot be simulated.

    """
    if decision.is_unknown:
        return decision, None
    whole = motion.simulate(build_fitted_arm(decision))
    named = {int(name.partition("@")[2]) for name in said}
    left = measure_remaining_shares(motion.before, after, whole, motion.portion, named)
    joint, share = max(left.items(), key=lambda one: one[1], default=(0, 0.0))
    if share <= HOLDOUT_CHECK.most_remaining_share:
        return decision, None
    standing = tuple(name for name in said if _least_left(name, left) <= HOLDOUT_CHECK.most_remaining_share)
    doubts = {"verdict": list(decision.verdict), "joint": joint, "left": share}
    if not standing:
        return _set_unknown_odds(
            decision, (share / HOLDOUT_CHECK.most_remaining_share) ** HOLDOUT_CHECK.unknown_odds_power, joint
        ), doubts
    if standing == decision.verdict:
        return decision, None
    fewer = drop_effects(decision, fitted, *(name for name in decision.verdict if name not in standing))
    return (fewer, doubts) if fewer else (decision, None)


def _least_left(name: str, left: Mapping[int, float]) -> float:
    """The share of the error that is left at the joint of an effect, name@joint; of the whole arm the least share."""
    joint = int(name.partition("@")[2])
    return left.get(joint, 1.0) if joint else min(left.values(), default=1.0)


def remove_unknown(decision: Decision) -> Decision:
    """Conclude the verdict as if nothing unknown were present.

    Args:
        decision: with or without something unknown.

    Returns:
        The decision among known effects.

    """
    return _set_unknown_odds(decision, 0.0, 1)


def is_at_bound(effects: Sequence[str], causes: Sequence[Mapping[str, Any]]) -> bool:
    """Say whether an effect of a verdict has a size at an end of its range, larger or smaller than any known one.

    Args:
        effects: the effects of the verdict, effect@joint.
        causes: as diagnosis.json has them.

    Returns:
        True if one has.

    """
    own = (cause for cause in causes if f"{cause['effect']}@{cause['joint']}" in effects)
    sizes = (q for cause in own for q in cause["parameters"].values() if q["std"] is not None)  # a shape has none
    return any(q["end"] for q in sizes)


def reweigh_unknown(decision: Decision, said: Sequence[str], motion: HoldoutMotion, alone: Replay) -> Decision:
    """Reweigh a verdict of something unknown against known effects, on held-out motion.

    The odds of something unknown fall with the error that the known effects leave, at the joint with the largest share
    left. They fall again where a flexible correction leaves more. Where it leaves less, an unknown structure is there:
    short windows have searched for it, so the odds rise for effects of long windows only. Suppose each of these effects
    closes a third of its joint's error and the base parameters alone do not. Then something unknown is no more probable
    than they are, and the less so the less they leave. Such a verdict is never sure.

    Args:
        decision: whose verdict is something unknown.
        said: the known effects, name@joint.
        motion: held-out motion.
        alone: its replay with these effects.

    Returns:
        The decision at other odds; its verdict may be the known effects.

    """
    before, held = motion.before, motion.portion
    left, others, base = (
        measure_remaining_errors(before, one, held) for one in (alone, motion.flexible, motion.refitted_base)
    )
    at, share = max(left.items(), key=lambda one: one[1], default=(0, 1.0))
    beside = share / min(max(others.get(at, 0.0), SMALLEST_POSITIVE), HOLDOUT_CHECK.most_remaining_share)
    odds = decision.uncalibrated_probability / max(1.0 - decision.uncalibrated_probability, SMALLEST_POSITIVE)
    for ratio in (
        min(share / HOLDOUT_CHECK.most_remaining_share, 1.0),
        beside if decision.is_long_horizon else min(beside, 1.0),
    ):
        odds *= ratio**HOLDOUT_CHECK.unknown_odds_power
    of_base = {j: left[j] / max(min(base.get(j, 1.0), 1.0), SMALLEST_POSITIVE) for j in left}
    shares = [_least_left(name, of_base) for name in said]
    if shares and max(shares) <= HOLDOUT_CHECK.most_remaining_share:
        sets = [h for h in decision.hypotheses if not h.is_unknown]
        named = sum(h.probability for h in sets if h.names) / sum(h.probability for h in sets)
        odds = min(odds, named * max(shares) / HOLDOUT_CHECK.most_remaining_share)
    odds = max(odds, LEAST_UNKNOWN_ODDS)
    (joint,) = {int(name.partition("@")[2]) for name in decision.verdict if name.startswith("unknown@")}
    return _set_unknown_odds(decision, odds, joint)


def _set_unknown_odds(decision: Decision, odds: float, joint: int) -> Decision:
    """The decision at other ``odds`` of something unknown, at a ``joint``."""
    unknown = odds / (1.0 + odds)
    named = [h for h in decision.hypotheses if not h.is_unknown]
    total = sum(h.probability for h in named)
    shared = [replace(h, probability=(1.0 - unknown) * h.probability / total) for h in named]
    unexplained = [Hypothesis((f"unknown@{joint}",), unknown, None)] if unknown else []
    return replace(conclude_verdict([*shared, *unexplained], decision.best), undetectable=decision.undetectable)


def build_fitted_arm(decision: Decision) -> Arm:
    """Build the model of the best fit, with its effects within tolerance.

    Args:
        decision: with the fit.

    Returns:
        The model.

    """
    at = decision.best.sensitivities
    return at.shooting.arm.with_parameters(at.point.p)


def measure_remaining_shares(
    before: Replay, after: Replay, whole: Replay, held: LogPortion, named: Collection[int]
) -> dict[int, float]:
    """Measure the share of each joint's error that a verdict leaves, with or without effects within tolerance.

    It is the lesser of the shares with ``after`` and ``whole``; at a named joint of which ``after`` closes next to
    nothing, it is that of ``after``.

    Args:
        before: the replay of the robot file's model.
        after: the replay with the verdict.
        whole: the replay with the best fit, and so with its effects within tolerance.
        held: the held-out rows (T,) of the log.
        named: joints of the verdict's effects.

    Returns:
        By joint the share (1), 0 where the error that is left does not count.

    """
    shares, tolerating = (measure_remaining_errors(before, one, held) for one in (after, whole))
    unclosed = {j for j in named if shares.get(j, 0.0) > HOLDOUT_CHECK.unclosed_share}
    return {j: share if j in unclosed else min(share, tolerating[j]) for j, share in shares.items()}


def measure_remaining_errors(before: Replay, after: Replay, held: LogPortion) -> dict[int, float]:
    """Measure the share of each joint's error that is left.

    Args:
        before: the replay of the robot file's model.
        after: another replay of the same log.
        held: the held-out rows (T,) of the log.

    Returns:
        By joint the smallest share (1) of its encoders, and of its torque sensor if that erred.

    """
    shares: dict[int, float] = {}
    for name, channel in measure_channel_errors(before, after, held).items():
        quantity, _, j = name.rpartition("_")
        if channel["before"] > (0.0 if quantity.endswith("position") else DATA.significant_noise_multiple):
            share = channel["after"] / channel["before"] if channel["after"] > DATA.significant_noise_multiple else 0.0
            shares[int(j)] = min(share, shares.get(int(j), share))
    return shares
