"""The part of a manifest that says of every effect how it shows itself, whether or not the build has it."""

from __future__ import annotations

from typing import Any

from gen.effects import ALL
from gen.effects.appearance import ConfusionGroup
from gen.effects.effect import Effect


def describe_catalogue() -> dict[str, Any]:
    """Describe how every effect shows itself, and the groups of effects that look alike.

    Returns:
        ``effects`` along the signal chain, and ``confusion_groups``, the narrowest first; as JSON can hold them.

    """
    groups = [{"name": group.name.lower(), "experiment": group.value} for group in ConfusionGroup]
    return {"effects": [_describe_traits(effect) for effect in ALL], "confusion_groups": groups}


def _describe_traits(effect: Effect) -> dict[str, Any]:
    series_spring = None
    if effect.series_spring is not None:
        series_spring = vars(effect.series_spring)
    return {
        "name": effect.name,
        "place": effect.port.place,
        "amplitudes": effect.amplitudes,
        "experiment": vars(effect.experiment),
        "confusion_groups": [group.name.lower() for group in effect.confusion_groups],
        "plot": vars(effect.plot),
        "residual": effect.residual,
        "is_friction": effect.is_friction,
        "presupposes": effect.presupposes,
        "twins": effect.twins,
        "accumulating_state": next((state.name for state in effect.states if state.is_accumulating), None),
        "walls": [vars(wall) for wall in effect.walls],
        "series_spring": series_spring,
    }
