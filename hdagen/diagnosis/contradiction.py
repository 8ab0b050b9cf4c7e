"""Whether a hold-out contradicts the log: nothing that tells the log tells anything of it.

A hold-out judges what a log says, and so must be of the same machine. Where it is not, as that of another robot of the
same type, no effect stands on it, and all of its error would be said to be unknown. What tells is the log itself: the
model that explains it, and the best that a correction without structure makes of it, close nearly nothing of what any
joint errs by on the hold-out. A single joint that is told better, or what is left there being near the noise, speaks
for the same machine. So does a log that the model does not explain: then there may be something unknown in both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hdagen.diagnosis.decide import Decision
from hdagen.diagnosis.gap import gap
from hdagen.diagnosis.portion import Portion
from hdagen.diagnosis.remainder import SHARE
from hdagen.diagnosis.standing import NOTHING, leave_errors, use_whole
from hdagen.diagnosis.unseen_motion import UnseenMotion
from hdagen.plant import Arm
from hdagen.replay import Replay


def find_contradiction(
    plain: Arm, decision: Decision, shown: Portion, simulate: Callable[[Arm], Replay], motion: UnseenMotion
) -> dict[str, Any] | None:
    """Hold what explains a log against a hold-out.

    Args:
        plain: the robot file's model.
        decision: what the log says by itself.
        shown: the log's motion that the fit saw.
        simulate: replays it on an arm.
        motion: the hold-out.

    Returns:
        `contradicted` of diagnosis.json: ``verdict``, what would be said, ``closed``, what share of the log's own gap
        that closes, and ``left`` of the hold-out's; None where the hold-out may be of the same machine.

    Raises:
        PlantError: a model cannot be simulated.

    """
    if not _leaves_all(motion, motion.flexible):  # costs no simulation
        return None
    whole = use_whole(decision)
    after = motion.simulate(whole)
    other = motion.measure_gap(after)
    if not (_leaves_all(motion, after) and other["interval"] and other["interval"][1] <= 1.0 - NOTHING):
        return None
    own = gap(simulate(plain), simulate(whole), shown)
    if not (own["interval"] and own["interval"][0] >= 1.0 - SHARE):
        return None
    left = other["after"] / other["before"]
    return {"verdict": list(decision.verdict), "closed": own["shrink"], "left": left}


def _leaves_all(motion: UnseenMotion, after: Replay) -> bool:
    """Whether a replay closes next to nothing of what any joint errs by."""
    return min(leave_errors(motion.before, after, motion.portion).values(), default=0.0) >= NOTHING
