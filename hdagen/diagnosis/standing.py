"""Whether what is said stands on motion that the fit did not see.

A fit sees short windows that each begin anew. What acts at few places, or works slowly, hardly shows there, and a
little of much that is tolerated stands in for it; elsewhere, and over longer windows, it does not. So the verdict is
looked at on the held-out motion, and the leading model with all that its fit has, what it names and what it tolerates:
where both leave most of what every encoder of a joint errs by, something is at work that no effect explains. And where
an effect is named of a joint and the verdict closes next to nothing there: that a little of much else does is not what
is said. The other way round: where known effects alone close most of it, what short windows leave is little; and where
no regression closes more, what is left has no structure that could be known. But one that would have to be larger than
any known effect is none.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.decide import LEAST, Decision, Hypothesis, decided
from hdagen.diagnosis.gap import by_channel, gap
from hdagen.diagnosis.portion import Portion
from hdagen.plant import Arm
from hdagen.replay import Replay

MOST = 2 / 3  # of what every encoder of a joint errs by, that may be left: what leaves more explains something else
NOTHING = 0.9  # of the same, or of a gap, from which on a verdict closes next to nothing
NOISE = 1.2  # gap on held-out motion, in multiples of the noise, below which there is nothing to explain
ABOVE = 10.0  # multiples of the noise, from which on what is left counts
FAR = 100.0  # of the same, from which on what is left is no small matter, whatever else leaves
STEEPLY = 4.0  # power of what is left in the odds


def stands(
    plain: Arm,
    named: Arm,
    content: dict[str, Any],
    before: Replay,
    held_out: Portion,
    flexible: Replay,
    counted: Callable[[Arm, verdict.Verdict], Replay],
) -> tuple[Arm, Replay]:
    """The model with what stands up to other motion, ``named`` with the verdict's effects or ``plain``, and its replay;
    ``content`` is told. Base parameters that spoil a verdict are withdrawn first, then the verdict; but that something
    unknown is at work says of no motion."""
    fitted: dict[str, Any] = content["parameters"]
    for base in (fitted, {}):
        content["parameters"] = base
        said = verdict.read(content)
        after = counted(named, said)
        content["gap"] = gap(before, after, held_out, flexible)
        if content["gap"]["before"] >= NOISE and _closes(content["gap"], bool(said.unknown and base)):
            return named, after
    kept = [f"unknown@{joint}" for joint in said.unknown] if content["gap"]["before"] >= NOISE else []
    content |= {"verdict": kept, "sure": False, "where": []}
    content["gap"] = gap(before, before, held_out, flexible)
    return plain, before


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
    decision: Decision,
    said: Sequence[str],
    before: Replay,
    after: Replay,
    held: Portion,
    seen: Callable[[Arm], Replay],
) -> tuple[Decision, dict[str, Any] | None]:
    """The decision, with something unknown said instead where what was ``said`` of it, name@joint, whose replay is
    ``after``, and all that its best fit has leave most of the gap of the replay ``before`` in what is ``held`` out;
    ``seen``: the replay of that on an arm. And `doubted` of diagnosis.json: what would have been said, and what share
    of a joint's errors is left. Raises PlantError."""
    if decision.unknown:
        return decision, None
    joint, share = worst(before, after, seen(_whole(decision)), held, {int(name.partition("@")[2]) for name in said})
    if share <= MOST:
        return decision, None
    other = _at_odds(decision, (share / MOST) ** STEEPLY, joint)
    return other, {"verdict": list(decision.verdict), "joint": joint, "left": share}


def known(decision: Decision) -> Decision:
    """What would be said if there were nothing that no effect explains."""
    return _at_odds(decision, 0.0, 1)


def outsized(content: dict[str, Any]) -> bool:
    """Whether a verdict, as diagnosis.json has it, has an effect whose size is at an end of what it may be: it would be
    more, or less, than any that is known."""
    causes = (one for one in content["causes"] if f"{one['effect']}@{one['joint']}" in content["verdict"])
    sizes = (q for cause in causes for q in cause["parameters"].values() if q["std"] is not None)  # a shape has none
    return any(q["end"] for q in sizes)


def borne_out(decision: Decision, before: Replay, alone: Replay, flexible: Replay, held: Portion) -> Decision:
    """The decision that something unknown is at work, its odds in view of what the `known` effects ``alone`` leave of
    the errors ``before`` in what is ``held`` out, of the joint that has the largest share left: as they rise there with
    what a verdict leaves, so they fall, and again where a ``flexible`` correction leaves more. Where one leaves less
    there is a structure: short windows have looked for it, and of what long ones tell the odds rise."""
    left, others = (_left(before, one, held) for one in (alone, flexible))
    at, share = max(left.items(), key=lambda one: one[1], default=(0, 1.0))
    beside = share / min(max(others.get(at, 0.0), LEAST), MOST)
    odds = decision.stated / max(1.0 - decision.stated, LEAST)
    for ratio in (min(share / MOST, 1.0), beside if decision.lasting else min(beside, 1.0)):
        odds *= ratio**STEEPLY
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


def _whole(decision: Decision) -> Arm:
    """The model where the best fit stands, with what it tolerates."""
    at = decision.best.design
    return at.shooting.arm.at(at.point.p)


def worst(before: Replay, after: Replay, whole: Replay, held: Portion, named: Collection[int]) -> tuple[int, float]:
    """The joint of whose errors ``before`` the largest share is left, and the share, 0 where nothing is left that
    counts: what ``after`` or ``whole`` leaves, the less, but ``after`` where it closes next to nothing of a joint that
    is ``named``."""
    said, tolerating = (_left(before, one, held) for one in (after, whole))
    alone = {j for j in named if said.get(j, 0.0) > NOTHING}
    shares = {j: share if j in alone else min(share, tolerating[j]) for j, share in said.items()}
    return max(shares.items(), key=lambda one: one[1], default=(0, 0.0))


def _left(before: Replay, after: Replay, held: Portion) -> dict[int, float]:
    """The share that is left of the errors of each joint: of its encoders', and of its torque sensor's if that erred,
    the smallest."""
    shares: dict[int, float] = {}
    for name, channel in by_channel(before, after, held).items():
        quantity, _, j = name.rpartition("_")
        if channel["before"] > (0.0 if quantity.endswith("position") else ABOVE):
            share = channel["after"] / channel["before"] if channel["after"] > ABOVE else 0.0
            shares[int(j)] = min(share, shares.get(int(j), share))
    return shares
