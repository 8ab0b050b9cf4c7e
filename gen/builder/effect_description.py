"""The part of a manifest that says of every effect how it shows itself, whether or not the build has it."""

from __future__ import annotations

from typing import Any

from gen.effects import ALL
from gen.effects.appearance import ConfusionGroup
from gen.effects.effect import Effect
from gen.effects.file_numbers import FILE_NUMBERS, FileNumber


def describe_catalogue(in_space: bool) -> dict[str, Any]:
    """Describe how every effect shows itself, and the groups of effects that look alike.

    Args:
        in_space: Whether the chain leaves the plane.

    Returns:
        ``effects`` along the signal chain, then the numbers of the robot file; and ``confusion_groups``, the narrowest
        first; as JSON can hold them.

    """
    effects = [_describe_traits(effect.choose_form(in_space)) for effect in ALL]
    effects += map(_describe_number, FILE_NUMBERS)
    groups = [{"name": group.name.lower(), "experiment": group.value} for group in ConfusionGroup]
    return {"effects": effects, "confusion_groups": groups}


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
        "alternatives": (),
    }


def _describe_number(number: FileNumber) -> dict[str, Any]:
    return {
        "name": number.name,
        "place": number.place,
        "amplitudes": (number.name,),
        "experiment": vars(number.experiment),
        "confusion_groups": [group.name.lower() for group in number.confusion_groups],
        "plot": vars(number.plot),
        "residual": number.residual,
        "is_friction": False,
        "presupposes": None,
        "twins": (),
        "accumulating_state": None,
        "walls": [],
        "series_spring": None,
        "alternatives": (*(other.name for other in FILE_NUMBERS), *number.alternatives),
    }
