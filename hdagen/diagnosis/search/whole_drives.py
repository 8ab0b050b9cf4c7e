"""Whole drives: the frictions of every joint and the motors' inertias that a robot file leaves out, fitted together.

A URDF states no inertia of a rotor and often no friction, so all joints lack theirs at once. A search that adds one
effect after the other stops early there: each alone leaves most of the misfit, and a misfit that large counts as torque
that nothing explains. The regression of the torque knows about where all of them are.
"""

from __future__ import annotations

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.inference.alternative_starts import refit_from_start
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.sensitivities import Sensitivities
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import InitialGuess, guess_from_log
from hdagen.diagnosis.initialization.torque_regression import TorqueRegression
from hdagen.diagnosis.search.hypothesis_race import take_further_steps
from hdagen.diagnosis.search.ordinary_frictions import list_ordinary_frictions
from hdagen.diagnosis.search.regressed_starts import fit_regressed_set
from hdagen.diagnosis.search.search_settings import SEARCH
from hdagen.diagnosis.search.wrong_numbers import drop_unneeded


def fit_whole_drives(regression: TorqueRegression, at: Sensitivities, candidates: CandidateSet, near: float) -> Fit:
    """Fit all drives' frictions and absent inertias at once, and drop the members that are not worth their price.

    Args:
        regression: the regression of the record, with the same candidates.
        at: sensitivities about the robot file's numbers.
        candidates: all candidates; some are absent inertias.
        near: unexplained torque about which the fit looks for its own, as the null model has it.

    Returns:
        The fit.

    """
    drives = tuple(sorted((*list_ordinary_frictions(candidates), *list_absent_inertias(candidates))))
    whole = _restart_fit(fit_regressed_set(regression, at, candidates, drives, near), at, candidates)
    return drop_unneeded(whole, candidates, drives)


def are_rotors_missing(arm: Arm, record: WindowedRecord) -> bool:
    """Tell whether the robot file leaves out rotors that the log shows: whether their inertias, with the frictions of
    all joints, explain more of the residual torque than any other effect does.

    Args:
        arm: the compiled model.
        record: the log in windows.

    Returns:
        Whether they do; False where the file states every rotor.

    """
    if not list_absent_inertias(build_candidates(arm, InitialGuess({}, {}, {}), with_numbers=True)):
        return False  # before the log is read
    hints = guess_from_log(arm, record)
    candidates = build_candidates(arm, hints, record.joints_without_command, with_numbers=True)
    rotors, frictions = list_absent_inertias(candidates), list_ordinary_frictions(candidates)
    if (regression := TorqueRegression.from_record(arm, record, candidates)) is None:
        return False
    effects = [k for k, one in enumerate(candidates.members) if not one.is_number and k not in frictions]
    possible = [k for k in effects if candidates.is_compatible(arm, k, frictions)]
    others = [tuple(frictions), *(tuple(sorted((*frictions, k))) for k in possible)]
    with_rotors = regression.fit_set(tuple(sorted((*frictions, *rotors))))
    return with_rotors.criterion < min(regression.fit_set(one).criterion for one in others)


def _restart_fit(fit: Fit, at: Sensitivities, candidates: CandidateSet) -> Fit:
    """Fit a set again, from the robot file's numbers for all that is not in it, for as long as that explains more."""
    for _ in range(SEARCH.drive_restarts):
        begun = refit_from_start(at.point, fit, candidates, fit.effects)
        again = take_further_steps(begun, candidates)
        if again.evidence_here <= fit.evidence_here:
            break
        fit = again
    return fit


def list_absent_inertias(candidates: CandidateSet) -> list[int]:
    """List the motors' inertias that the robot file states as 0, as a URDF does.

    Args:
        candidates: all candidates.

    Returns:
        Places of these candidates; none where the robot file is taken as right.

    """
    rotors = (k for k, one in enumerate(candidates.members) if one.effect == "motor_inertia")
    return [k for k in rotors if candidates.is_absent_number(k)]
