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
from hdagen.adoption.robot_identity import compute_robot_identity
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm, load
from hdagen.data_quality.log_preparation import prepare_logs
from hdagen.diagnosis.data.gap import compute_gap_bounds
from hdagen.diagnosis.data.held_out_rows import name_rows
from hdagen.diagnosis.data.split import HOLDOUT_SHARE, LogPortion, split_logs
from hdagen.diagnosis.data.windows import WindowedRecord, cut_windows
from hdagen.diagnosis.decision.direct_evidence import find_direct_evidence
from hdagen.diagnosis.decision.posterior import Decision, score_hypotheses
from hdagen.diagnosis.decision.verdict_content import build_hypothetical_verdict
from hdagen.diagnosis.decision.wrong_robot import refuse_wrong_robot
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.holdout.contradicting_holdout import find_contradiction
from hdagen.diagnosis.holdout.holdout_check import HoldoutJudge, Statement, choose_decision
from hdagen.diagnosis.holdout.hypothesis_ranking import find_gap_after, rank_hypotheses
from hdagen.diagnosis.holdout.long_window_prediction import weigh_predictions
from hdagen.diagnosis.holdout.nuisance_effects import rank_nuisance_effects
from hdagen.diagnosis.holdout.single_moments import find_single_moments
from hdagen.diagnosis.holdout.unexplained_remainder import is_as_good_as_it_gets, measure_remainders, name_remainders
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion, measure_holdout
from hdagen.diagnosis.holdout.verdict_withdrawal import leaves_little
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.long_horizon import search_long_horizon
from hdagen.diagnosis.optional_stages import Attempts
from hdagen.diagnosis.report.diagnosis_result import DiagnosisResult
from hdagen.diagnosis.report.sentences import say_contradiction
from hdagen.diagnosis.residuals.controller_impact import compare_controllers
from hdagen.diagnosis.residuals.localization import localize_gap
from hdagen.diagnosis.residuals.residual_torque import see_residual_torque
from hdagen.diagnosis.search.hypothesis_search import SearchResult, search_effects
from hdagen.diagnosis.search.null_model import fit_null_model
from hdagen.diagnosis.search.rigid_or_flexible import compare_with_springs
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay, check_log_fits_arm, replay
from hdagen.support.parallel import map_in_threads

WINDOW_LENGTH = 0.05  # s: short enough that a wrong parameter bends the motion little
FEWEST_WINDOW_ROWS = 25  # rows of a window
HALF_TEXT = "every other second, the rest having decided what stands,"
BLOCKS_TEXT = f"blocks all over each log, {100 * HOLDOUT_SHARE:g} % of it"


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
        return _run_stages(robot, logs, hold_out, say)


def _run_stages(
    robot: str | Path, logs: Sequence[Log], hold_out: Sequence[Log], say: Callable[[str], None]
) -> Diagnosis:
    say("model")
    plain, arm = map_in_threads(lambda build: load(robot, *build), [("portable", ()), ("native", ("all",))])
    for log in (*logs, *hold_out):
        check_log_fits_arm(plain, log)
    logs, hold_out, fresh, of_data = prepare_logs(plain, logs, hold_out)
    shown, held_out = split_logs(logs, hold_out, fresh)
    window = max(WINDOW_LENGTH, FEWEST_WINDOW_ROWS * shown.log.period)
    seen = cut_windows(arm, shown, window)

    attempts = Attempts()
    measure = partial(measure_holdout, plain, shown=shown, portion=held_out, simulate=_make_simulation(held_out, seen))
    found, unseen = _run_search(robot, arm, seen, window, measure, say, attempts)
    judged, motion = unseen.split_in_halves() if hold_out else (unseen, unseen)
    judge = HoldoutJudge(plain, arm, found, find_direct_evidence(arm, seen), judged)
    say("prediction over long windows")
    decision = _check_robot(_make_decision(found, shown, seen, attempts), logs)
    hold_against = partial(find_contradiction, plain, decision, shown, _make_simulation(shown, seen), unseen)
    contradicted = attempts.attempt("whether the hold-out is of this machine", hold_against, None) if hold_out else None

    def search_long_windows(strange: Decision) -> Decision | None:
        say("what works all the time")
        work = partial(search_long_horizon, strange, found, arm, shown, window, judge.direct_evidence)
        return attempts.attempt("what works all the time", work, None)

    say("replay of held-out motion")
    if contradicted:
        told = judge.withhold_verdict(decision, motion, contradicted)
    else:
        told = judge.settle_decision(_check_robot(choose_decision(decision, judge, search_long_windows), logs), motion)
    content = told.content
    say("what is tolerated, and what else it may be")
    content |= _describe_alternatives(told, motion, attempts)
    content |= _describe_remainder(content)
    content |= _describe_moments(told, motion, hold_out or logs)
    say("where and when")
    sight = see_residual_torque(told.arm, content, motion.portion.log, motion.before, told.after)
    places = partial(localize_gap, sight, content, motion.portion.rows)
    content["where"] = attempts.attempt("where and when", places, content["where"])
    content["control"] = _describe_control(plain, told.arm, verdict.read_verdict(content), motion.portion.log)
    content["robot"] = {
        "name": plain.robot["name"],
        "identity": compute_robot_identity(plain.robot),
        "sha256": _hash_robot_file(robot),
    }
    content["data"] = _describe_data(logs, hold_out, motion, attempts.failures) | of_data
    if contradicted:
        content["data"]["warnings"].append(say_contradiction(contradicted))
    result = DiagnosisResult(found, told.decision, content, motion, told.after, sight, tuple(attempts.failures))
    return Diagnosis(result, robot, tuple(log.source for log in logs), tuple(log.source for log in hold_out))


def _make_simulation(portion: LogPortion, seen: WindowedRecord) -> Callable[[Arm], Replay]:
    """Replays the logs of a portion on an arm."""
    return lambda arm: _count_in_fit_noise(replay(arm, portion.log), seen)


def _describe_alternatives(told: Statement, motion: HoldoutMotion, attempts: Attempts) -> dict[str, Any]:
    """`rank_nuisance_effects`, `rank_hypotheses`, `causes`, `gap` and `find_direct_evidence` of diagnosis.json."""
    nothing: list[dict[str, Any]] = []
    decision, content, rest = told.decision, told.content, (motion.before, told.after, motion.portion, motion.simulate)
    said = verdict.read_verdict(content)
    little = attempts.attempt("what is tolerated", lambda: rank_nuisance_effects(decision.best, said, *rest), nothing)
    rungs = attempts.attempt("the ladder", lambda: rank_hypotheses(decision, content["verdict"], *rest), nothing)
    causes = [cause | {"gap_after": find_gap_after(cause, rungs)} for cause in content["causes"]]
    left = content["gap"] | compute_gap_bounds(content["gap"], rungs, little)
    certain = content["sure"] and leaves_little(left["after"], [left["flexible"], *(one["gap"] for one in rungs)])
    return {"tolerated": little, "ladder": rungs, "causes": causes, "gap": left, "sure": certain}


def _describe_remainder(content: dict[str, Any]) -> dict[str, Any]:
    """Return `remains`, `as_good_as_it_gets` and `verdict` of diagnosis.json, with the remaining errors."""
    remains, named = measure_remainders(content["gap"]["by_channel"]), verdict.read_verdict(content).effects
    good = not named and is_as_good_as_it_gets(content["gap"])
    said = [] if good else name_remainders(content["verdict"], remains)
    return {"remains": remains, "as_good_as_it_gets": good, "verdict": said}


def _describe_moments(told: Statement, motion: HoldoutMotion, logs: Sequence[Log]) -> dict[str, Any]:
    """Return `moments` and `find_direct_evidence` of diagnosis.json, with the events that happen once in the replayed
    logs."""
    content, before = told.content, motion.before
    every = LogPortion.all_rows(motion.portion.log).without_windows(before.guessed_starts, before.starts)
    moments = [] if content["contradicted"] else find_single_moments(before, told.after, every, logs)
    return {"moments": moments, "sure": content["sure"] and bool(content["verdict"] or not moments)}


def _run_search(
    robot: str | Path,
    arm: Arm,
    seen: WindowedRecord,
    window: float,
    work: Callable[[verdict.Verdict], HoldoutMotion],
    say: Callable[[str], None],
    attempts: Attempts,
) -> tuple[SearchResult, HoldoutMotion]:
    """Search the record, and run ``work`` beside the search, which leaves half a core idle. ``work`` needs the base
    parameters of the model without effects alone. The search for springs is one of the ``attempts``."""
    say("what the log suggests")
    shooting = MultipleShooting(arm, seen)
    words, none = fit_null_model(shooting)
    with ThreadPoolExecutor(1) as aside:
        meanwhile = aside.submit(work, build_hypothetical_verdict(none, ()))
        del none
        found = search_effects(shooting, words, say)
        stage = "a spring in what the robot file calls rigid"
        found = attempts.attempt(stage, lambda: compare_with_springs(robot, arm, seen, window, found, say), found)
        attempts.report_failed_simulations(
            {id(one): one for fit in found.fits if (one := fit.sensitivities.shooting)}.values()
        )
        return found, meanwhile.result()


def _make_decision(found: SearchResult, shown: LogPortion, seen: WindowedRecord, attempts: Attempts) -> Decision:
    """Decide by the search, with its sets weighed by their prediction of ``shown`` where that can be simulated."""
    weigh = partial(weigh_predictions, found, shown, _make_simulation(shown, seen))
    return score_hypotheses(found, attempts.attempt("prediction over long windows", weigh, {}))


def _check_robot(decision: Decision, logs: Sequence[Log]) -> Decision:
    """Return the decision. Raise LogError where it says that the robot file is another machine's."""
    if not decision.is_unknown and (refused := refuse_wrong_robot(decision.best)):
        raise LogError([f"{logs[0].source}: {refused}"])
    return decision


def _describe_control(plain: Arm, changed: Arm, said: verdict.Verdict, log: Log) -> dict[str, Any] | None:
    """Compare controllers under the verdict, or say why that is impossible; None where no effect is named."""
    if not said.effects:
        return None
    try:
        return compare_controllers(plain, verdict.apply_verdict(changed, said)[0], log).content
    except PlantError as error:
        return {"refused": str(error)}


def _count_in_fit_noise(found: Replay, seen: WindowedRecord) -> Replay:
    """Count errors in the noise of the held-out or of the fitted motion, whichever is larger."""
    fitted = dict(zip(seen.names, seen.noise, strict=True))
    return replace(found, noise={name: max(noise, fitted.get(name, 0.0)) for name, noise in found.noise.items()})


def _describe_data(
    logs: Sequence[Log], hold_out: Sequence[Log], motion: HoldoutMotion, failures: Sequence[str]
) -> dict[str, Any]:
    notes = [note for log in logs for note in log.notes]
    if count := len(motion.before.guessed_starts):
        notes.append(f"{count} window(s) of a replay begin in motion, without a velocity: the gap leaves them out.")
    return {
        "log": ", ".join(log.source for log in logs),
        "rate": 1 / logs[0].period,
        "duration": sum(float(log.time[-1] - log.time[0]) for log in logs),
        "held_out": f"{HALF_TEXT} of {', '.join(log.source for log in hold_out)}" if hold_out else BLOCKS_TEXT,
        "hold_out": name_rows(motion.portion, hold_out or logs),
        "notes": list(dict.fromkeys([*notes, *failures])),
    }


def _hash_robot_file(robot: str | Path) -> str | None:
    path = Path(robot)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
