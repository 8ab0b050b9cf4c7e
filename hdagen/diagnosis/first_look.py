"""The first look at a log, with no effect meant: where every hypothesis begins, and what of everything there may be."""

from __future__ import annotations

from hdagen.diagnosis.candidates import SHARES, Dictionary, dictionary
from hdagen.diagnosis.design import Point, design
from hdagen.diagnosis.fitting import Fitted, advanced, begun, sharing
from hdagen.diagnosis.orders import with_orders
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.starts import suggested

LOOKS = 2  # steps of it


def first_look(shooting: Shooting) -> tuple[Dictionary, Fitted]:
    """All candidates with what the log suggests, the orders of ripples, and the share to which all are tolerated, as
    where none leaves little, what is not there cannot be large; and what none leaves, by which that was told."""
    hints = suggested(shooting.arm, shooting.record)
    fit = nothing(shooting, dictionary(shooting.arm, hints, shooting.record.uncommanded))
    return dictionary(shooting.arm, with_orders(fit, hints), shooting.record.uncommanded).sharing(
        fit.design.words.share
    ), fit


def nothing(shooting: Shooting, words: Dictionary) -> Fitted:
    """No effect meant, after a few steps, with the share under which that is most probable."""
    fit = begun(design(shooting, words.focused(()), first(shooting, words)), words, (), 1.0)
    for _ in range(LOOKS):
        fit = advanced(fit, words)
    return likeliest(fit)


def likeliest(fit: Fitted) -> Fitted:
    """A hypothesis with all that it does not mean tolerated to the share under which that is most probable."""
    return max((sharing(fit, share) for share in SHARES), key=lambda one: one.score.at.evidence)


def first(shooting: Shooting, words: Dictionary) -> Point:
    """Where every hypothesis begins: the robot file's own numbers, with what was read off the log as far as it is
    tolerated, walls and ripples where the log suggests them."""
    p = shooting.arm.p.copy()
    for atom in words.atoms:
        if atom.first:
            atom.shape(shooting.arm, p)
    for c in words.columns:
        if c.seen:
            p[c.index] = c.tolerated
    p = shooting.arm.parameters.within(p)
    return Point(p, shooting.begun(p))
