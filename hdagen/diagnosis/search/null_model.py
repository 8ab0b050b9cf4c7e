"""The null model: no effect is active. Every hypothesis starts there, and it shows how large nuisance effects are."""

from __future__ import annotations

from hdagen.diagnosis.inference.candidate_priors import SHARES, Dictionary
from hdagen.diagnosis.inference.local_fit import Fitted, advanced, begun, sharing
from hdagen.diagnosis.inference.multiple_shooting import Shooting
from hdagen.diagnosis.inference.sensitivities import Point, design
from hdagen.diagnosis.initialization.candidate_list import dictionary
from hdagen.diagnosis.initialization.initial_guess import suggested
from hdagen.diagnosis.search.ripple_order import with_orders

LOOKS = 2  # steps of the fit


def first_look(shooting: Shooting) -> tuple[Dictionary, Fitted]:
    """Fit the null model, and prepare the candidates by it.

    Args:
        shooting: the record and its model.

    Returns:
        All candidates with their initial guess, the orders of ripples, and the spike width (a small misfit of the null
        model leaves no room for large effects); and the fitted null model.

    """
    hints = suggested(shooting.arm, shooting.record)
    fit = nothing(shooting, dictionary(shooting.arm, hints, shooting.record.uncommanded))
    return dictionary(shooting.arm, with_orders(fit, hints), shooting.record.uncommanded).sharing(
        fit.design.words.share
    ), fit


def nothing(shooting: Shooting, words: Dictionary) -> Fitted:
    """Fit the null model by a few steps, with its most probable spike width.

    Args:
        shooting: the record and its model.
        words: all candidates.

    Returns:
        The fit.

    """
    fit = begun(design(shooting, words.focused(()), first(shooting, words)), words, (), 1.0)
    for _ in range(LOOKS):
        fit = advanced(fit, words)
    return likeliest(fit)


def likeliest(fit: Fitted) -> Fitted:
    """Return a fit with the spike width that is most probable for it.

    Args:
        fit: the fit.

    """
    return max((sharing(fit, share) for share in SHARES), key=lambda one: one.score.at.evidence)


def first(shooting: Shooting, words: Dictionary) -> Point:
    """Return the point where every hypothesis starts: the robot file's numbers with the initial guess, limited to
    nuisance sizes, and with walls and ripples where the log suggests them.

    Args:
        shooting: the record and its model.
        words: all candidates.

    """
    p = shooting.arm.p.copy()
    for atom in words.atoms:
        if atom.first:
            atom.shape(shooting.arm, p)
    for c in words.columns:
        if c.seen:
            p[c.index] = c.tolerated
    p = shooting.arm.parameters.within(p)
    return Point(p, shooting.begun(p))
