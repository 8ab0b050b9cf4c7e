"""Whether a hold-out contradicts the log: nothing that explains the log explains any of it.

A hold-out judges the verdict of a log, so it must come from the same machine. From another machine of the same type, it
would withdraw every effect, and all of its error would count as unknown. The log itself tells: the model that explains
it, and the best correction without structure made from it, close nearly nothing of any joint's error on the hold-out. A
single joint with a smaller error, or a remaining error near the noise, speaks for the same machine. So does a log that
the model does not explain: then both may hold the same unknown effect.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.held_out_gap import evaluate_gap
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.decision.posterior import Decision
from hdagen.diagnosis.holdout.holdout_check_settings import HOLDOUT_CHECK
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.diagnosis.holdout.verdict_withdrawal import build_fitted_arm, measure_remaining_errors
from hdagen.prediction.window_replay import Replay


def find_contradiction(
    plain: Arm, decision: Decision, shown: LogPortion, simulate: Callable[[Arm], Replay], motion: HoldoutMotion
) -> dict[str, Any] | None:
    """Compare the verdict of a log with a hold-out.

    Args:
        plain: the robot file's model.
        decision: the decision by the log alone.
        shown: the fitted motion of the log.
        simulate: replays it on an arm.
        motion: the hold-out.

    Returns:
        `contradicted` of diagnosis.json: ``verdict``, the verdict by the log alone; ``closed``, the share of the log's
        own gap that it closes; ``left``, the share of the hold-out's gap that remains. None where the hold-out may be
        of the same machine.

    Raises:
        PlantError: a model cannot be simulated.

    """
    if not _leaves_all(motion, motion.flexible):  # costs no simulation
        return None
    whole = build_fitted_arm(decision)
    after = motion.simulate(whole)
    other = motion.measure_gap(after)
    if not (
        _leaves_all(motion, after) and other["interval"] and other["interval"][1] <= 1.0 - HOLDOUT_CHECK.unclosed_share
    ):
        return None
    own = evaluate_gap(simulate(plain), simulate(whole), shown)
    if not (own["interval"] and own["interval"][0] >= 1.0 - HOLDOUT_CHECK.named_remainder_share):
        return None
    left = other["after"] / other["before"]
    return {"verdict": list(decision.verdict), "closed": own["shrink"], "left": left}


def _leaves_all(motion: HoldoutMotion, after: Replay) -> bool:
    """Tell whether a replay closes next to nothing of any joint's error."""
    return (
        min(measure_remaining_errors(motion.before, after, motion.portion).values(), default=0.0)
        >= HOLDOUT_CHECK.unclosed_share
    )
