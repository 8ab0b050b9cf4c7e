"""From robot file and log to diagnosis.json: triage, search, decision, and the gap on data that the fit never saw."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from hdagen import verdict
from hdagen.diagnosis.achievable import corrected
from hdagen.diagnosis.attempts import Attempts
from hdagen.diagnosis.beside import beside, sure
from hdagen.diagnosis.controlled import controlled
from hdagen.diagnosis.decide import Decision, decide
from hdagen.diagnosis.findings import findings, hypothetical
from hdagen.diagnosis.first_look import first_look
from hdagen.diagnosis.foreign import foreign
from hdagen.diagnosis.gap import bounds, least
from hdagen.diagnosis.held_out import name_rows
from hdagen.diagnosis.ladder import ladder, left_by
from hdagen.diagnosis.lasting import lasting
from hdagen.diagnosis.missing import Sight, look
from hdagen.diagnosis.portion import SHARE, Portion, parted
from hdagen.diagnosis.prediction import weigh_predictions
from hdagen.diagnosis.record import Record, record
from hdagen.diagnosis.search import Search, search
from hdagen.diagnosis.series import with_springs
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.small_effects import drop_small_effects
from hdagen.diagnosis.standing import borne_out, doubted, known, leaves_little, outsized, stands
from hdagen.diagnosis.tolerated import tolerated
from hdagen.diagnosis.whereabouts import where
from hdagen.identity import identity
from hdagen.log import Log, LogError
from hdagen.plant import Arm, PlantError, load
from hdagen.repair import prepared
from hdagen.replay import Replay, check, replay
from hdagen.together import together

WINDOW = 0.05  # s: short enough that a wrong parameter bends the motion little
FEWEST = 25  # rows of a window
Meanwhile = tuple[Replay, Replay, Portion]  # the robot file's replay, the flexible correction's, what is compared
Told = tuple[Decision, dict[str, Any], Arm, Replay]  # what is said, diagnosis.json of it, the model and its replay
BLOCKS = f"blocks all over each log, {100 * SHARE:g} % of it"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What the search found, and the replays of the held-out data before and after."""

    search: Search
    decision: Decision
    content: dict[str, Any]
    before: Replay
    after: Replay
    held_out: Portion
    sight: Sight  # ``held_out`` through the models of both replays
    left_out: tuple[str, ...]  # a sentence for every stage and simulation that failed


def diagnose(robot: str | Path, logs: Sequence[Log], hold_out: Sequence[Log], say: Callable[[str], None]) -> Diagnosis:
    """Diagnose logs of one machine together; the gap is measured on the logs ``hold_out``, else on blocks that the
    fit does not see, a fifth of each log. Raises LogError where a log cannot carry a diagnosis, PlantError where the
    model cannot be had."""
    from threadpoolctl import threadpool_limits  # changes the environment when it is imported

    with threadpool_limits(1):  # small matrices by the hundred, beside threads of our own; and the same bits everywhere
        return _diagnose(robot, logs, hold_out, say)


def _diagnose(robot: str | Path, logs: Sequence[Log], hold_out: Sequence[Log], say: Callable[[str], None]) -> Diagnosis:
    say("model")
    plain, arm = together(lambda build: load(robot, *build), [("portable", ()), ("native", ("all",))])
    for log in (*logs, *hold_out):
        check(plain, log)
    logs, hold_out, fresh, of_data = prepared(plain, logs, hold_out)
    shown, held_out = parted(logs, hold_out, fresh)
    window = max(WINDOW, FEWEST * shown.log.period)
    seen = record(arm, shown, window)

    def counted(arm: Arm, said: verdict.Verdict | None = None) -> Replay:
        return _counted(replay(arm, held_out.log, with_=said), seen)

    without = partial(_without_effects, plain, shown, held_out, counted)
    attempts = Attempts()
    found, (before, flexible, held_out) = _searched(robot, arm, seen, window, without, say, attempts)
    say("prediction over long windows")
    decision = _own(_decided(found, shown, seen, attempts), logs)
    say("replay of held-out motion")
    alone = sure(arm, seen)

    def told(decided: Decision) -> Told:
        for one in dict.fromkeys((beside(decided, alone), decided)):  # what was read off is withdrawn first
            content = findings(found, one)
            changed, after = stands(plain, _model(arm, one, content), content, before, held_out, flexible, counted)
            if content["verdict"] == list(one.verdict):
                break
        return one, content, changed, after

    def instead(strange: Decision) -> Decision | None:  # known effects alone, where the held-out motion bears that out
        if not (without_it := known(strange)).verdict:
            return None
        _, content, _, alone_left = told(without_it)
        tried = borne_out(strange, before, alone_left, flexible, held_out)
        return None if tried.unknown or outsized(content) else tried

    if decision.unknown:
        if not (better := instead(decision)):
            say("what works all the time")
            work = partial(lasting, decision, found, arm, shown, window, alone)
            lasts = attempts.attempt("what works all the time", work, None)
            better = instead(lasts) if lasts else None
        decision = _own(better or decision, logs)
    decision, content, changed, after = told(decision)
    decision, doubt = doubted(decision, content["verdict"], before, after, held_out, counted)
    decision, small = drop_small_effects(decision, lambda one: told(one)[1]["gap"])
    if doubt or small:
        decision, content, changed, after = told(decision)
    content |= {"doubted": doubt, "alone": [one.content for one in alone], "small": small}
    say("what is tolerated, and what else it may be")
    content |= _rivals(decision, content, (before, after, held_out, counted), attempts)
    say("where and when")
    sight = look(changed, content, held_out.log, before, after)
    places = partial(where, sight, content, held_out.rows)
    content["where"] = attempts.attempt("where and when", places, content["where"])
    content["control"] = _control(plain, changed, verdict.read(content), held_out.log)
    content["robot"] = {"name": plain.robot["name"], "identity": identity(plain.robot), "sha256": _digest(robot)}
    content["data"] = _data(logs, hold_out, before, held_out, attempts.failures) | of_data
    return Diagnosis(found, decision, content, before, after, held_out, sight, tuple(attempts.failures))


def _without_effects(
    plain: Arm, shown: Portion, held_out: Portion, counted: Callable[[Arm], Replay], base: verdict.Verdict
) -> Meanwhile:
    """The robot file's replay, the best that base parameters and a flexible correction leave, and what is compared."""
    refitted = verdict.applied(plain, base)[0]
    before, alone = counted(plain), counted(refitted)
    held = held_out.without(before.guessed, before.starts)  # a guess would tell of itself
    return before, least([before, alone, corrected(refitted, shown, held_out, alone)], held), held


def _rivals(
    decision: Decision,
    content: dict[str, Any],
    rest: tuple[Replay, Replay, Portion, Callable[[Arm], Replay]],
    attempts: Attempts,
) -> dict[str, Any]:
    """`tolerated`, `ladder`, `causes`, `gap` and `sure` of diagnosis.json; ``rest``: what the first two take beside the
    decision."""
    nothing: list[dict[str, Any]] = []
    said = verdict.read(content)
    little = attempts.attempt("what is tolerated", lambda: tolerated(decision.best, said, *rest), nothing)
    rungs = attempts.attempt("the ladder", lambda: ladder(decision, content["verdict"], *rest), nothing)
    causes = [cause | {"gap_after": left_by(cause, rungs)} for cause in content["causes"]]
    left = content["gap"] | bounds(content["gap"], rungs, little)
    certain = content["sure"] and leaves_little(left["after"], [left["flexible"], *(one["gap"] for one in rungs)])
    return {"tolerated": little, "ladder": rungs, "causes": causes, "gap": left, "sure": certain}


def _searched(
    robot: str | Path,
    arm: Arm,
    seen: Record,
    window: float,
    work: Callable[[verdict.Verdict], Meanwhile],
    say: Callable[[str], None],
    attempts: Attempts,
) -> tuple[Search, Meanwhile]:
    """What is found in ``seen``, and what ``work`` makes meanwhile, as a search leaves half a core idle: it needs the
    base parameters of a model without effects alone. That there are springs is one of the ``attempts``."""
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


def _model(arm: Arm, decision: Decision, content: dict[str, Any]) -> Arm:
    """The model that a verdict is replayed on, which has every effect, as one with the verdict's alone is to be
    compiled: ``arm``, whose rigid drives are rigid, or where that lacks what is said, the one with springs."""
    said = verdict.read(content)
    known = arm.parameters.described
    lacks = any(name not in known for name in (*said.parameters, *said.base))
    return decision.best.design.shooting.arm if lacks else arm


def _decided(found: Search, shown: Portion, seen: Record, attempts: Attempts) -> Decision:
    """What a search says, its sets weighed by how they predict what is ``shown``, where that can be had."""
    weigh = partial(weigh_predictions, found, shown, lambda arm: _counted(replay(arm, shown.log), seen))
    return decide(found, attempts.attempt("prediction over long windows", weigh, {}))


def _own(decision: Decision, logs: Sequence[Log]) -> Decision:
    """The decision. Raises LogError where what it says is that the robot file is another machine's."""
    if not decision.unknown and (refused := foreign(decision.best)):
        raise LogError([f"{logs[0].source}: {refused}"])
    return decision


def _control(plain: Arm, changed: Arm, said: verdict.Verdict, log: Log) -> dict[str, Any] | None:
    """What the verdict changes for a controller, or why that cannot be said; None where no effect is named."""
    if not said.effects:
        return None
    try:
        return controlled(plain, verdict.applied(changed, said)[0], log).content
    except PlantError as error:
        return {"refused": str(error)}


def _counted(found: Replay, seen: Record) -> Replay:
    """Errors counted in the noise of the held-out or of the fitted motion, whichever shows more."""
    fitted = dict(zip(seen.names, seen.noise, strict=True))
    return replace(found, noise={name: max(noise, fitted.get(name, 0.0)) for name, noise in found.noise.items()})


def _data(
    logs: Sequence[Log], hold_out: Sequence[Log], before: Replay, held: Portion, failures: Sequence[str]
) -> dict[str, Any]:
    notes = [note for log in logs for note in log.notes]
    if before.guessed:
        count = len(before.guessed)
        notes.append(f"{count} window(s) of a replay begin in motion, without a velocity: the gap leaves them out.")
    return {
        "log": ", ".join(log.source for log in logs),
        "rate": 1 / logs[0].period,
        "duration": sum(float(log.time[-1] - log.time[0]) for log in logs),
        "held_out": ", ".join(log.source for log in hold_out) or BLOCKS,
        "hold_out": name_rows(held, hold_out or logs),
        "notes": list(dict.fromkeys([*notes, *failures])),
    }


def _digest(robot: str | Path) -> str | None:
    path = Path(robot)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
