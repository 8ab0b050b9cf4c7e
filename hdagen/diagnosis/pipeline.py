"""From robot file and log to diagnosis.json: triage, search, decision, and the gap on data that the fit never saw."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hdagen.adoption import verdict
from hdagen.adoption.robot_identity import identity
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.data_quality.log_preparation import prepared
from hdagen.diagnosis.data.gap import bounds
from hdagen.diagnosis.data.held_out_rows import name_rows
from hdagen.diagnosis.data.split import SHARE, Portion, part
from hdagen.diagnosis.data.windows import Record, record
from hdagen.diagnosis.decision.direct_evidence import sure
from hdagen.diagnosis.decision.posterior import Decision, decide
from hdagen.diagnosis.decision.verdict_content import hypothetical
from hdagen.diagnosis.decision.wrong_robot import foreign
from hdagen.diagnosis.holdout.contradicting_holdout import find_contradiction
from hdagen.diagnosis.holdout.holdout_check import Judge, Statement, choose
from hdagen.diagnosis.holdout.hypothesis_ranking import ladder, left_by
from hdagen.diagnosis.holdout.long_window_prediction import weigh_predictions
from hdagen.diagnosis.holdout.nuisance_effects import tolerated
from hdagen.diagnosis.holdout.single_moments import find_moments
from hdagen.diagnosis.holdout.unexplained_remainder import is_as_good_as_it_gets, measure_remainders, name_remainders
from hdagen.diagnosis.holdout.unseen_motion import UnseenMotion, measure_unseen
from hdagen.diagnosis.holdout.verdict_withdrawal import leaves_little
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.long_horizon import lasting
from hdagen.diagnosis.optional_stages import Attempts
from hdagen.diagnosis.report.diagnosis_result import Diagnosis
from hdagen.diagnosis.report.sentences import say_contradiction
from hdagen.diagnosis.residuals.controller_impact import controlled
from hdagen.diagnosis.residuals.localization import where
from hdagen.diagnosis.residuals.residual_torque import look
from hdagen.diagnosis.search.hypothesis_search import Search, search
from hdagen.diagnosis.search.null_model import first_look
from hdagen.diagnosis.search.rigid_or_flexible import with_springs
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay, check, replay
from hdagen.support.parallel import together

WINDOW = 0.05  # s: short enough that a wrong parameter bends the motion little
FEWEST = 25  # rows of a window
HALF = "every other second, the rest having decided what stands,"
BLOCKS = f"blocks all over each log, {100 * SHARE:g} % of it"


def diagnose(robot: str | Path, logs: Sequence[Log], hold_out: Sequence[Log], say: Callable[[str], None]) -> Diagnosis:
    """Diagnose logs of one machine together.

    Args:
        robot: a preset or a robot.toml.
        logs: logs of the machine.
        hold_out: other motions of the machine. Every other second of them decides which effects stand, and the gap is
            measured on the rest. Without them both happen on blocks that the fit does not use, a fifth of each log.
        say: receives each stage as it begins.

    Returns:
        The verdict, and the content of diagnosis.json.

    Raises:
        LogError: a log cannot carry a diagnosis.
        PlantError: the model cannot be loaded.

    """
    from threadpoolctl import threadpool_limits  # changes the environment when it is imported

    with threadpool_limits(1):  # small matrices by the hundred, beside threads of our own; and the same bits everywhere
        return _diagnose(robot, logs, hold_out, say)


def _diagnose(robot: str | Path, logs: Sequence[Log], hold_out: Sequence[Log], say: Callable[[str], None]) -> Diagnosis:
    say("model")
    plain, arm = together(lambda build: load(robot, *build), [("portable", ()), ("native", ("all",))])
    for log in (*logs, *hold_out):
        check(plain, log)
    logs, hold_out, fresh, of_data = prepared(plain, logs, hold_out)
    shown, held_out = part(logs, hold_out, fresh)
    window = max(WINDOW, FEWEST * shown.log.period)
    seen = record(arm, shown, window)

    attempts = Attempts()
    measure = partial(measure_unseen, plain, shown=shown, portion=held_out, simulate=_simulate(held_out, seen))
    found, unseen = _searched(robot, arm, seen, window, measure, say, attempts)
    judged, motion = unseen.halve() if hold_out else (unseen, unseen)
    judge = Judge(plain, arm, found, sure(arm, seen), judged)
    say("prediction over long windows")
    decision = _own(_decided(found, shown, seen, attempts), logs)
    hold_against = partial(find_contradiction, plain, decision, shown, _simulate(shown, seen), unseen)
    contradicted = attempts.attempt("whether the hold-out is of this machine", hold_against, None) if hold_out else None

    def search_long_windows(strange: Decision) -> Decision | None:
        say("what works all the time")
        work = partial(lasting, strange, found, arm, shown, window, judge.direct)
        return attempts.attempt("what works all the time", work, None)

    say("replay of held-out motion")
    if contradicted:
        told = judge.withhold(decision, motion, contradicted)
    else:
        told = judge.settle(_own(choose(decision, judge, search_long_windows), logs), motion)
    content = told.content
    say("what is tolerated, and what else it may be")
    content |= _rivals(told, motion, attempts)
    content |= _remainder(content)
    content |= _moments(told, motion, hold_out or logs)
    say("where and when")
    sight = look(told.arm, content, motion.portion.log, motion.before, told.after)
    places = partial(where, sight, content, motion.portion.rows)
    content["where"] = attempts.attempt("where and when", places, content["where"])
    content["control"] = _control(plain, told.arm, verdict.read(content), motion.portion.log)
    content["robot"] = {"name": plain.robot["name"], "identity": identity(plain.robot), "sha256": _digest(robot)}
    content["data"] = _data(logs, hold_out, motion, attempts.failures) | of_data
    if contradicted:
        content["data"]["warnings"].append(say_contradiction(contradicted))
    return Diagnosis(found, told.decision, content, motion, told.after, sight, tuple(attempts.failures))


def _simulate(portion: Portion, seen: Record) -> Callable[[Arm], Replay]:
    """Replays the logs of a portion on an arm."""
    return lambda arm: _counted(replay(arm, portion.log), seen)


def _rivals(told: Statement, motion: UnseenMotion, attempts: Attempts) -> dict[str, Any]:
    """`tolerated`, `ladder`, `causes`, `gap` and `sure` of diagnosis.json."""
    nothing: list[dict[str, Any]] = []
    decision, content, rest = told.decision, told.content, (motion.before, told.after, motion.portion, motion.simulate)
    said = verdict.read(content)
    little = attempts.attempt("what is tolerated", lambda: tolerated(decision.best, said, *rest), nothing)
    rungs = attempts.attempt("the ladder", lambda: ladder(decision, content["verdict"], *rest), nothing)
    causes = [cause | {"gap_after": left_by(cause, rungs)} for cause in content["causes"]]
    left = content["gap"] | bounds(content["gap"], rungs, little)
    certain = content["sure"] and leaves_little(left["after"], [left["flexible"], *(one["gap"] for one in rungs)])
    return {"tolerated": little, "ladder": rungs, "causes": causes, "gap": left, "sure": certain}


def _remainder(content: dict[str, Any]) -> dict[str, Any]:
    """Return `remains`, `as_good_as_it_gets` and `verdict` of diagnosis.json, with the remaining errors."""
    remains, named = measure_remainders(content["gap"]["by_channel"]), verdict.read(content).effects
    good = not named and is_as_good_as_it_gets(content["gap"])
    said = [] if good else name_remainders(content["verdict"], remains)
    return {"remains": remains, "as_good_as_it_gets": good, "verdict": said}


def _moments(told: Statement, motion: UnseenMotion, logs: Sequence[Log]) -> dict[str, Any]:
    """Return `moments` and `sure` of diagnosis.json, with the events that happen once in the replayed logs."""
    content, before = told.content, motion.before
    every = Portion.whole(motion.portion.log).without(before.guessed, before.starts)
    moments = [] if content["contradicted"] else find_moments(before, told.after, every, logs)
    return {"moments": moments, "sure": content["sure"] and bool(content["verdict"] or not moments)}


def _searched(
    robot: str | Path,
    arm: Arm,
    seen: Record,
    window: float,
    work: Callable[[verdict.Verdict], UnseenMotion],
    say: Callable[[str], None],
    attempts: Attempts,
) -> tuple[Search, UnseenMotion]:
    """Search the record, and run ``work`` beside the search, which leaves half a core idle. ``work`` needs the base
    parameters of the model without effects alone. The search for springs is one of the ``attempts``."""
    say("what the log suggests")
    shooting = Shooting(arm, seen)
    words, none = first_look(shooting)
    with ThreadPoolExecutor(1) as aside:
        meanwhile = aside.submit(work, hypothetical(none, ()))
        del none
        found = search(shooting, words, say)
        stage = "a spring in what the robot file calls rigid"
        found = attempts.attempt(stage, lambda: with_springs(robot, arm, seen, window, found, say), found)
        attempts.count({id(one): one for fit in found.fitted if (one := fit.design.shooting)}.values())
        return found, meanwhile.result()


def _decided(found: Search, shown: Portion, seen: Record, attempts: Attempts) -> Decision:
    """Decide by the search, with its sets weighed by their prediction of ``shown`` where that can be simulated."""
    weigh = partial(weigh_predictions, found, shown, _simulate(shown, seen))
    return decide(found, attempts.attempt("prediction over long windows", weigh, {}))


def _own(decision: Decision, logs: Sequence[Log]) -> Decision:
    """Return the decision. Raise LogError where it says that the robot file is another machine's."""
    if not decision.unknown and (refused := foreign(decision.best)):
        raise LogError([f"{logs[0].source}: {refused}"])
    return decision


def _control(plain: Arm, changed: Arm, said: verdict.Verdict, log: Log) -> dict[str, Any] | None:
    """Compare controllers under the verdict, or say why that is impossible; None where no effect is named."""
    if not said.effects:
        return None
    try:
        return controlled(plain, verdict.applied(changed, said)[0], log).content
    except PlantError as error:
        return {"refused": str(error)}


def _counted(found: Replay, seen: Record) -> Replay:
    """Count errors in the noise of the held-out or of the fitted motion, whichever is larger."""
    fitted = dict(zip(seen.names, seen.noise, strict=True))
    return replace(found, noise={name: max(noise, fitted.get(name, 0.0)) for name, noise in found.noise.items()})


def _data(
    logs: Sequence[Log], hold_out: Sequence[Log], motion: UnseenMotion, failures: Sequence[str]
) -> dict[str, Any]:
    notes = [note for log in logs for note in log.notes]
    if count := len(motion.before.guessed):
        notes.append(f"{count} window(s) of a replay begin in motion, without a velocity: the gap leaves them out.")
    return {
        "log": ", ".join(log.source for log in logs),
        "rate": 1 / logs[0].period,
        "duration": sum(float(log.time[-1] - log.time[0]) for log in logs),
        "held_out": f"{HALF} of {', '.join(log.source for log in hold_out)}" if hold_out else BLOCKS,
        "hold_out": name_rows(motion.portion, hold_out or logs),
        "notes": list(dict.fromkeys([*notes, *failures])),
    }


def _digest(robot: str | Path) -> str | None:
    path = Path(robot)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
