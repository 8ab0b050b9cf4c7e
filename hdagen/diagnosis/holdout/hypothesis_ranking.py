"""A ranking of the leading hypotheses by the gap that each leaves on held-out motion, with an interval.

A probability says how well a hypothesis explains the fitted motion; the ranking says how well it generalizes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from hdagen.adoption import verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import bootstrap_gaps
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.posterior import Decision, Hypothesis
from hdagen.diagnosis.decision.verdict_content import build_hypothetical_verdict
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.prediction.window_replay import Replay
from hdagen.support.parallel import map_in_threads


def rank_hypotheses(
    decision: Decision,
    said: Sequence[str],
    before: Replay,
    after: Replay,
    held: LogPortion,
    seen: Callable[[Arm], Replay],
) -> list[dict[str, Any]]:
    """Rank the leading hypotheses by their gap on held-out motion.

    The ranking has the robot file, the verdict, no effect with refitted base parameters, and the most probable
    hypotheses that were fitted, each with its own parameters.

    Args:
        decision: with the hypotheses.
        said: the effects of the verdict, effect@joint.
        before: the replay of the robot file's model.
        after: the replay with the verdict.
        held: the held-out rows (T,) of the log.
        seen: replays the held-out log on a model.

    Returns:
        Entries with ``model`` (robot file, hypothesis, verdict), ``effects``, ``probability``, ``gap`` in multiples of
        the noise and its ``interval``, the largest gap first.

    Raises:
        PlantError: a model cannot be simulated.

    """
    stated = tuple(said)
    fitted = [h for h in decision.hypotheses if h.fit and h.names != stated]
    tried = [h for h in fitted if not h.names] + [h for h in fitted if h.names][: HOLDOUT_CHECK.most_ranked_hypotheses]

    def replayed(one: Hypothesis) -> Replay:
        assert one.fit
        return seen(
            verdict.apply_verdict(one.fit.sensitivities.shooting.arm, build_hypothetical_verdict(one.fit, one.names))[0]
        )

    probability = None
    if stated == decision.verdict:
        probability = decision.probability
    rungs: list[tuple[str, Sequence[str], float | None]] = [
        ("robot file", (), None),
        *(("hypothesis", h.names, h.probability) for h in tried),
        ("verdict", stated, probability),
    ]
    left = bootstrap_gaps(before, [before, *map_in_threads(replayed, tried), after], held)
    found = [
        {"model": model, "effects": list(names), "probability": p, "gap": value, "interval": interval}
        for (model, names, p), (value, interval) in zip(rungs, left, strict=True)
    ]
    return sorted(found, key=lambda one: -float(one["gap"]))


def find_gap_after(cause: Mapping[str, Any], rungs: Sequence[Mapping[str, Any]]) -> float | None:
    """Find the smallest gap of all hypotheses that have a cause.

    Args:
        cause: an entry of `causes` of diagnosis.json.
        rungs: `ranking` of diagnosis.json.

    Returns:
        That gap in multiples of the noise; None where no hypothesis with the cause was replayed.

    """
    name = f"{cause['effect']}@{cause['joint']}"
    return min((float(rung["gap"]) for rung in rungs if name in rung["effects"]), default=None)
