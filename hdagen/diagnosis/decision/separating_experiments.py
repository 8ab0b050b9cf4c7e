"""Experiments that separate effects which look alike in a log."""

from __future__ import annotations

from collections.abc import Iterable

from hdagen.arm.effect_catalogue import EffectCatalogue

SAME_EFFECT_EXPERIMENT = (
    "move one joint while the others are held still, each in turn: what belongs to a joint stays with it."
)


def suggest_experiments(effects: EffectCatalogue, name: str, confounded: Iterable[str]) -> str:
    """Suggest the experiments that separate an effect from those it is confounded with.

    Args:
        effects: how each effect shows itself.
        name: the effect, effect@joint.
        confounded: the other effects, effect@joint.

    Returns:
        Sentences in which each experiment stands once; "" where ``confounded`` is empty.

    """
    effect, _, joint = name.partition("@")
    against: dict[str, list[str]] = {}
    others: list[str] = []
    for other in confounded:
        if (experiment := _find_experiment(effects, effect, joint, *other.partition("@")[::2])) is None:
            others.append(other)
        else:
            against.setdefault(experiment, []).append(other)
    if others:
        shown = [effect, *dict.fromkeys(other.partition("@")[0] for other in others)]
        against["; ".join(_describe_experiment(effects, one) for one in shown) + "."] = others
    return " ".join(f"Against {', '.join(others)}: {experiment}" for experiment, others in against.items())


def _find_experiment(effects: EffectCatalogue, effect: str, joint: str, other: str, other_joint: str) -> str | None:
    """The experiment that separates two effects which look alike; None where no group has both."""
    if effect == other and joint != other_joint:
        return SAME_EFFECT_EXPERIMENT
    return effects.find_group_experiment(effect, other)


def _describe_experiment(effects: EffectCatalogue, effect: str) -> str:
    """The experiment that shows an effect, with its reason."""
    experiment = effects[effect].experiment
    return f"{experiment.action} ({effect.replace('_', ' ')} {experiment.observation})"
