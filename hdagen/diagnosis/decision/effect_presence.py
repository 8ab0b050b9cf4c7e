"""How large the effects of a fit are, which of them count as present, and how well their sizes are known."""

from __future__ import annotations

import numpy as np

from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.rollout import Rollout


def measure_effect_sizes(fit: Fit) -> dict[str, float]:
    """Measure the sizes of a fit's free effects.

    Sine and cosine of one effect count together. Of an effect that grows over time, the part that it reached within the
    log counts. The last step of the linear model is not taken yet: of the sizes before and after it the smaller counts.

    Args:
        fit: with its effects.

    Returns:
        By name the size, in usual sizes (1).

    """
    words, stood = fit.sensitivities.candidates, fit.sensitivities.candidates.to_theta(fit.sensitivities.point.p)
    whole = {k: min(words.measure_size(k, one) for one in (fit.posterior[0], stood)) for k in fit.effects}
    return {words.members[k].name: float(size) * _measure_accumulated_share(k, fit) for k, size in whole.items()}


def keep_present_effects(fit: Fit) -> tuple[str, ...]:
    """Keep the effects of a fit that are large enough to count as present.

    Args:
        fit: with its effects.

    Returns:
        Their names, name@joint, sorted.

    """
    sizes = relate_to_least_sizes(fit)
    return tuple(name for name in fit.names if sizes[name] >= 1.0)


def relate_to_least_sizes(fit: Fit) -> dict[str, float]:
    """Relate the sizes of a fit's free effects to the least that count as present.

    Args:
        fit: with its effects.

    Returns:
        By name the size, in multiples of the least size that counts (1).

    """
    words = fit.sensitivities.candidates
    least = {words.members[k].name: words.presence_threshold(k) for k in fit.effects}
    return {name: size / least[name] for name, size in measure_effect_sizes(fit).items()}


def measure_deviations(fit: Fit) -> dict[str, float]:
    """Measure how well a fit determines the sizes of its free effects.

    Args:
        fit: with its effects.

    Returns:
        By name the largest amplitude, in its standard deviations (1).

    """
    candidates, (mean, covariance) = fit.sensitivities.candidates, fit.posterior
    deviations = np.abs(mean) / np.sqrt(covariance.diagonal())
    own = {candidates.members[k].name: candidates.amplitude_columns((k,)) for k in fit.effects}
    return {name: float(deviations[columns].max(initial=0.0)) for name, columns in own.items()}


def _measure_accumulated_share(k: int, fit: Fit) -> float:
    """The largest share of candidate k that is reached where a window begins, at the fit's parameters.

    A large effect that grows slowly, or at high speed alone, shows as little as a small one that acts at once.
    """
    atom, shooting, point = fit.sensitivities.candidates.members[k], fit.sensitivities.shooting, fit.sensitivities.point
    if atom.traits.accumulating_state is None:
        return 1.0
    memory = shooting.predict_with_memory(Rollout(point.p, point.initial_states))[1]
    own = shooting.arm.state_names[-memory.shape[1] :]
    return float(np.abs(memory[:, own.index(f"{atom.traits.accumulating_state}_{atom.joint}")]).max())
