"""Whether what is said stands on motion that the fit did not see.

A fit sees short windows that each begin anew. What acts at few places, or works slowly, hardly shows there, and a
little of much that is tolerated stands in for it; elsewhere, and over longer windows, it does not. So the verdict is
looked at on motion that was kept from the fit, joint by joint.

What is there: a known effect stands where the verdict closes a third of what its joint errs by. Where the short windows
leave so much torque unexplained that something unknown is more probable than any known effect, it stands there all the
same, as long as the base parameters alone do not close as much; how probable it is says how much is left. Nothing that
is known takes the place of something unknown if it would have to be larger than any such effect is. Where no known
effect stands, something unknown is said alone, at the joint of which most is left.

What remains beside named effects is no rival of theirs: `hdagen.diagnosis.remainder`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.decide import LEAST, SURE, Decision, Hypothesis, decided
from hdagen.diagnosis.gap import ABOVE, by_channel
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.small_effects import Fits, without
from hdagen.diagnosis.unseen_motion import UnseenMotion
from hdagen.plant import Arm
from hdagen.replay import Replay

MOST = 2 / 3  # of what every encoder of a joint errs by, that may be left: what leaves more explains something else
NOTHING = 0.9  # of the same, or of a gap, from which on a verdict closes next to nothing
NOISE = 1.2  # gap on held-out motion, in multiples of the noise, below which there is nothing to explain
FAR = 100.0  # of the same, from which on what is left is no small matter, whatever else leaves
STEEPLY = 4.0  # power of what is left in the odds
LEAST_ODDS = SURE / (1.0 - SURE)  # of something unknown where short windows say so: what is named is then not sure


def stands(
    plain: Arm,
    named: Arm,
    content: dict[str, Any],
    motions: Sequence[UnseenMotion],
    alone: Mapping[str, Any] = MappingProxyType({}),
) -> tuple[Arm, Replay]:
    """What of a verdict closes the gap on motion that no fit saw.

    Base parameters that spoil a verdict are withdrawn first, then the verdict; but that something unknown is at work
    says of no motion. Where it is, base parameters that were refitted with effects that are not named may be bent, and
    those that were refitted alone close the gap.

    Args:
        plain: the robot file's model.
        named: the model with the verdict's effects.
        content: of diagnosis.json, which is told what stands, and the gap on the last of the motions.
        motions: each must be told better with the verdict.
        alone: the base parameters as they are refitted with no effect, in the form of ``content``.

    Returns:
        The model that stands, and its replay of the last motion.

    Raises:
        PlantError: a model cannot be simulated.

    """
    fitted: dict[str, Any] = content["parameters"]
    last = motions[-1]
    bases = [fitted, dict(alone), {}] if verdict.read(content).unknown else [fitted, {}]
    for base in bases:
        content["parameters"] = base
        said = verdict.read(content)
        arm = verdict.applied(named, said)[0]
        replays = [motion.simulate(arm) for motion in motions]
        gaps = [motion.measure_gap(after) for motion, after in zip(motions, replays, strict=True)]
        content["gap"] = gaps[-1]
        if all(gap["before"] >= NOISE and _closes(gap, bool(said.unknown and base)) for gap in gaps):
            return named, replays[-1]
    kept = [f"unknown@{joint}" for joint in said.unknown] if content["gap"]["before"] >= NOISE else []
    content |= {"verdict": kept, "sure": False, "where": []}
    content["gap"] = last.measure_gap(last.before)
    return plain, last.before


def _closes(told: dict[str, Any], bent: bool) -> bool:
    """Whether a gap is smaller after, as `gap` has it: by more than next to nothing with all of its interval, where
    base parameters stand beside something unknown, which has ``bent`` them to the motion of the log."""
    surely = told["interval"][0] > 1.0 - NOTHING if bent and told["interval"] else True
    return bool(told["after"] < told["before"] and surely)


def leaves_little(after: float, others: Sequence[float]) -> bool:
    """Whether what a verdict leaves of a gap is so little that it can be sure.

    Args:
        after: gap with the verdict, in multiples of the noise.
        others: what each other set of effects leaves, and a flexible correction, in the same.

    Returns:
        False where many times the noise is left and something else leaves far less, or very many times the noise.

    """
    return after <= ABOVE or (after <= FAR and min(others, default=after) > MOST * after)


def doubted(
    decision: Decision, fitted: Fits, said: Sequence[str], motion: UnseenMotion, after: Replay
) -> tuple[Decision, dict[str, Any] | None]:
    """A decision without what does not stand on motion that the fit did not see.

    Args:
        decision: what would be said; one that something unknown is at work stays as it is.
        fitted: the fits of a search, by their sets of effects.
        said: what of it closes the gap, name@joint.
        motion: that the fit did not see.
        after: its replay with what is said.

    Returns:
        The decision, with the effects that stand where these were fitted by themselves, or with something unknown said
        where none stands; and `doubted` of diagnosis.json: what would have been said, and what share of a joint's
        errors is left; None if nothing is doubted.

    Raises:
        PlantError: the model cannot be simulated.

    """
    if decision.unknown:
        return decision, None
    whole = motion.simulate(use_whole(decision))
    named = {int(name.partition("@")[2]) for name in said}
    left = leave_shares(motion.before, after, whole, motion.portion, named)
    joint, share = max(left.items(), key=lambda one: one[1], default=(0, 0.0))
    if share <= MOST:
        return decision, None
    standing = tuple(name for name in said if _least_left(name, left) <= MOST)
    told = {"verdict": list(decision.verdict), "joint": joint, "left": share}
    if not standing:
        return _at_odds(decision, (share / MOST) ** STEEPLY, joint), told
    if standing == decision.verdict:
        return decision, None
    fewer = without(decision, fitted, *(name for name in decision.verdict if name not in standing))
    return (fewer, told) if fewer else (decision, None)


def _least_left(name: str, left: Mapping[int, float]) -> float:
    """The share that is left at the joint of an effect, name@joint; of one of the whole arm that of any joint."""
    joint = int(name.partition("@")[2])
    return left.get(joint, 1.0) if joint else min(left.values(), default=1.0)


def known(decision: Decision) -> Decision:
    """What would be said if there were nothing that no effect explains."""
    return _at_odds(decision, 0.0, 1)


def outsized(content: dict[str, Any]) -> bool:
    """Whether a verdict, as diagnosis.json has it, has an effect whose size is at an end of what it may be: it would be
    more, or less, than any that is known."""
    causes = (one for one in content["causes"] if f"{one['effect']}@{one['joint']}" in content["verdict"])
    sizes = (q for cause in causes for q in cause["parameters"].values() if q["std"] is not None)  # a shape has none
    return any(q["end"] for q in sizes)


def borne_out(decision: Decision, said: Sequence[str], motion: UnseenMotion, alone: Replay) -> Decision:
    """A decision that something unknown is at work, in view of motion that the fit did not see.

    As the odds of something unknown rise there with what a verdict leaves, so they fall with what known effects leave
    of the joint that has the largest share left, and again where a flexible correction leaves more. Where one leaves
    less there is a structure: short windows have looked for it, and of what long ones tell the odds rise. Where each of
    these effects closes a third of what its joint errs by, and the base parameters by themselves do not, something
    unknown is no more probable than they are, and the less so the less they leave. What short windows do not tell is
    never sure.

    Args:
        decision: that something unknown is at work.
        said: the known effects, name@joint.
        motion: that the fit did not see.
        alone: its replay with these effects.

    Returns:
        The decision at other odds; what it says may be the known effects.

    """
    before, held = motion.before, motion.portion
    left, others, base = (leave_errors(before, one, held) for one in (alone, motion.flexible, motion.base))
    at, share = max(left.items(), key=lambda one: one[1], default=(0, 1.0))
    beside = share / min(max(others.get(at, 0.0), LEAST), MOST)
    odds = decision.stated / max(1.0 - decision.stated, LEAST)
    for ratio in (min(share / MOST, 1.0), beside if decision.lasting else min(beside, 1.0)):
        odds *= ratio**STEEPLY
    of_base = {j: left[j] / max(min(base.get(j, 1.0), 1.0), LEAST) for j in left}
    shares = [_least_left(name, of_base) for name in said]
    if shares and max(shares) <= MOST:
        sets = [h for h in decision.hypotheses if not h.unknown]
        named = sum(h.probability for h in sets if h.names) / sum(h.probability for h in sets)
        odds = min(odds, named * max(shares) / MOST)
    odds = max(odds, LEAST_ODDS)
    (joint,) = {int(name.partition("@")[2]) for name in decision.verdict if name.startswith("unknown@")}
    return _at_odds(decision, odds, joint)


def _at_odds(decision: Decision, odds: float, joint: int) -> Decision:
    """The decision at other ``odds`` that something unknown is at work, at a ``joint``."""
    unknown = odds / (1.0 + odds)
    named = [h for h in decision.hypotheses if not h.unknown]
    total = sum(h.probability for h in named)
    shared = [replace(h, probability=(1.0 - unknown) * h.probability / total) for h in named]
    strange = [Hypothesis((f"unknown@{joint}",), unknown, None)] if unknown else []
    return replace(decided([*shared, *strange], decision.best), unseen=decision.unseen)


def use_whole(decision: Decision) -> Arm:
    """The model where the best fit stands, with what it tolerates."""
    at = decision.best.design
    return at.shooting.arm.at(at.point.p)


def leave_shares(
    before: Replay, after: Replay, whole: Replay, held: Portion, named: Collection[int]
) -> dict[int, float]:
    """The share of the errors ``before`` that is left at each joint, 0 where nothing is left that counts: what
    ``after`` or ``whole`` leaves, the less, but ``after`` where it closes next to nothing of a joint that is
    ``named``."""
    said, tolerating = (leave_errors(before, one, held) for one in (after, whole))
    alone = {j for j in named if said.get(j, 0.0) > NOTHING}
    return {j: share if j in alone else min(share, tolerating[j]) for j, share in said.items()}


def leave_errors(before: Replay, after: Replay, held: Portion) -> dict[int, float]:
    """The share that is left of the errors of each joint: of its encoders', and of its torque sensor's if that erred,
    the smallest."""
    shares: dict[int, float] = {}
    for name, channel in by_channel(before, after, held).items():
        quantity, _, j = name.rpartition("_")
        if channel["before"] > (0.0 if quantity.endswith("position") else ABOVE):
            share = channel["after"] / channel["before"] if channel["after"] > ABOVE else 0.0
            shares[int(j)] = min(share, shares.get(int(j), share))
    return shares
