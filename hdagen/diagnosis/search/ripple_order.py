"""The order of a motor's ripple: how often the unexplained torque repeats in a turn of the motor.

Cogging and commutation repeat a whole number of times in a turn. Small steps do not lead from one order to another, so
the order is read from the log. The first time no effect is active and all of them are nuisances, as small amounts of an
effect would hide the ripple; the second time it is read from the residual of a leader, which may have hidden it. The
smoothed unexplained torque of each part of a window is compared with the mean sine and cosine over the rows of that
part.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.data_quality.rank_check import is_determined
from hdagen.diagnosis.inference.candidate_priors import CandidateSet
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import count_torque_steps
from hdagen.diagnosis.initialization.initial_guess import InitialGuess
from hdagen.diagnosis.search.null_model_settings import NULL_MODEL

RIPPLE_ORDERS = np.arange(1, NULL_MODEL.largest_ripple_order + 1)


def suggest_ripple_orders(nothing: Fit, suggested: InitialGuess) -> InitialGuess:
    """Put the orders that the log shows before the usual ones.

    Args:
        nothing: the fitted null model.
        suggested: the initial guess to extend.

    Returns:
        The initial guess with these orders.

    """
    arm, shapes = nothing.sensitivities.shooting.arm, dict(suggested.shapes)
    for name, q in arm.parameters.described.items():
        if q.is_motor_order:
            clear = _clearest_orders(nothing, q.joint)
            shapes[name] = tuple(dict.fromkeys((*clear, *q.starts)))[: NULL_MODEL.most_ripple_orders + 1]
    return replace(suggested, shapes=shapes)


def add_ripple_orders(lead: Fit, words: CandidateSet) -> CandidateSet:
    """Add a ripple of each joint's clearest order in the leader's residual, unless the candidates have it.

    Args:
        lead: the leading fit.
        words: all candidates.

    Returns:
        The larger set.

    """
    described = lead.sensitivities.shooting.arm.parameters.described
    for k, atom in enumerate(words.members):
        order_name = next((name for name in atom.shapes if described[name].is_motor_order), None)
        if order_name is None or not atom.has_default_shapes or atom.name in lead.names:
            continue
        known = [a.shapes[order_name] for a in words.members if a.name == atom.name]
        for order in _clearest_orders(lead, atom.joint)[:1]:
            if order not in known:
                words = words.with_shapes_added(k, {**atom.shapes, order_name: order})
    return words


def _clearest_orders(fit: Fit, j: int) -> tuple[float, ...]:
    """List the clearest orders of joint j, the clearest first; none where none stands out."""
    shooting = fit.sensitivities.shooting
    torque = fit.sensitivities.linear_model().solve_inner(max(fit.score.posterior.s, 1e-3), fit.posterior[0])[1]
    steps = count_torque_steps(shooting)
    own = torque[:, (j - 1) * steps : j * steps].reshape(-1)
    orders, waves = _mean_waves(shooting, j)
    if not len(orders) or not is_determined(waves[0]):
        return ()
    gains = np.array([_wave_gain(own, wave) for wave in waves])
    best = np.argsort(-gains)[: NULL_MODEL.most_ripple_orders]
    return tuple(float(orders[k]) for k in best if gains[k] > NULL_MODEL.clear_order_gain * np.median(gains))


def _mean_waves(shooting: MultipleShooting, j: int) -> tuple[Array, Array]:
    """List the orders that run through a full cycle, with the mean cosine and sine of each over the rows of each part
    of each window (orders, parts, 2)."""
    record, arm = shooting.record, shooting.arm
    ratio = arm.parameters[f"ratio_{j}"]
    name = f"motor_position_{j}"
    theta = record.log[name] if name in record.log else ratio * record.log[f"joint_position_{j}"]
    parts, steps, edges = [], count_torque_steps(shooting), record.window_edges[record.selected_windows]
    angles = np.concatenate([theta[first:end] for first, end in edges])
    orders = RIPPLE_ORDERS[RIPPLE_ORDERS * np.ptp(angles) >= 2 * np.pi]  # less than one cycle is a trend
    for first, end in edges:
        edge = np.linspace(first, end, steps + 1).round().astype(int) - first
        turned = np.exp(1j * orders[:, None] * theta[first:end])
        parts.append(np.add.reduceat(turned, edge[:-1], axis=1) / np.diff(edge))
    mean = np.concatenate(parts, axis=1)
    return orders, np.stack([mean.real, mean.imag], 2)


def _wave_gain(torque: Array, wave: Array) -> float:
    """Return the reduction of the torque's squares by a cosine and a sine, in units of its variance."""
    left = torque - torque.mean()
    columns = wave - wave.mean(0)
    coefficients = np.linalg.lstsq(columns, left, rcond=1e-9)[0]
    return float(
        (left @ left - ((left - columns @ coefficients) ** 2).sum()) / max(float(left @ left) / len(left), 1e-300)
    )
