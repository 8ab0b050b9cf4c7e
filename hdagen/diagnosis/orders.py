"""Which ripple the motors show: the order at which the torque that nothing explains goes with the motor's angle.

Cogging and commutation repeat a whole number of times a turn of the motor. Their order cannot be found by small steps
from another, so it is read off: before the search, none of the effects meant and all of them tolerated (small amounts
of them would hide it), and again of what a leader leaves, which may have hidden it. The smoothed unexplained torque of
each part of a window is compared with the mean of the sine and the cosine over the rows of that part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.determined import is_determined
from hdagen.diagnosis.candidates import Dictionary
from hdagen.diagnosis.design import knots
from hdagen.diagnosis.fitting import Fitted
from hdagen.diagnosis.shooting import Shooting
from hdagen.diagnosis.starts import Suggested
from hdagen.plant import Array

EFFECT = "torque_ripple"
ORDERS = np.arange(1, 97)
CLEAR = 12.0  # gain of the best order over the usual one, in standard errors squared, from which it is taken
KEPT = 3  # orders that are tried


def with_orders(nothing: Fitted, suggested: Suggested) -> Suggested:
    """``suggested`` with the orders that the log shows first; ``nothing``: no effect meant, where that stands."""
    arm, shapes = nothing.design.shooting.arm, dict(suggested.shapes)
    for j in range(1, arm.n + 1):
        name = f"ripple_order_{j}"
        if name in arm.parameters.described:
            usual = arm.parameters.described[name].starts
            shapes[name] = tuple(dict.fromkeys((*_orders(nothing, j), *usual)))[: KEPT + 1]
    return replace(suggested, shapes=shapes)


def heard(lead: Fitted, words: Dictionary) -> Dictionary:
    """``words`` with a ripple of each joint's clearest order in what ``lead`` leaves, where they have none of it."""
    for k in [k for k, atom in enumerate(words.atoms) if atom.effect == EFFECT and atom.first]:
        atom = words.atoms[k]
        known = [value for a in words.atoms if a.name == atom.name for value in a.shapes.values()]
        clear = [] if atom.name in lead.names else _orders(lead, atom.joint)[:1]
        for order in clear:
            if order not in known:
                words = words.another(k, {f"ripple_order_{atom.joint}": order})
    return words


def _orders(fit: Fitted, j: int) -> tuple[float, ...]:
    """The clearest orders of joint j, the clearest first; none where none stands out."""
    shooting = fit.design.shooting
    torque = fit.design.linear().inner(max(fit.score.at.s, 1e-3), fit.posterior[0])[1]
    steps = knots(shooting)
    own = torque[:, (j - 1) * steps : j * steps].reshape(-1)
    orders, waves = _waves(shooting, j)
    if not len(orders) or not is_determined(waves[0]):
        return ()
    gains = np.array([_gain(own, wave) for wave in waves])
    best = np.argsort(-gains)[:KEPT]
    return tuple(float(orders[k]) for k in best if gains[k] > CLEAR * np.median(gains))


def _waves(shooting: Shooting, j: int) -> tuple[Array, Array]:
    """The orders of which the motor runs through a cycle, and the mean cosine and sine of each over the rows of each
    part of each window (orders, parts, 2)."""
    record, arm = shooting.record, shooting.arm
    ratio = arm.parameters[f"ratio_{j}"]
    name = f"motor_position_{j}"
    theta = record.log[name] if name in record.log else ratio * record.log[f"joint_position_{j}"]
    parts, steps, edges = [], knots(shooting), record.edges[record.kept]
    seen = np.concatenate([theta[first:end] for first, end in edges])
    orders = ORDERS[ORDERS * np.ptp(seen) >= 2 * np.pi]  # less of a cycle is a trend
    for first, end in edges:
        edge = np.linspace(first, end, steps + 1).round().astype(int) - first
        turned = np.exp(1j * orders[:, None] * theta[first:end])
        parts.append(np.add.reduceat(turned, edge[:-1], axis=1) / np.diff(edge))
    mean = np.concatenate(parts, axis=1)
    return orders, np.stack([mean.real, mean.imag], 2)


def _gain(torque: Array, wave: Array) -> float:
    """By how much a cosine and a sine lessen the square of the torque, in its variance."""
    left = torque - torque.mean()
    columns = wave - wave.mean(0)
    coefficients = np.linalg.lstsq(columns, left, rcond=1e-9)[0]
    return float(
        (left @ left - ((left - columns @ coefficients) ** 2).sum()) / max(float(left @ left) / len(left), 1e-300)
    )
