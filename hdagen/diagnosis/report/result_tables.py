"""Two tables of a diagnosis for notebooks and scripts: the ranked hypotheses with their doubts, and the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hdagen.pages.number_table import TableCell
from hdagen.pages.result_table import ResultTable

NO_EFFECT = "no effect"
BASE_PARAMETER = "base parameter"


def build_hypothesis_table(content: Mapping[str, Any]) -> ResultTable:
    """Build the table of hypotheses, the most probable first, with a column for each doubt.

    Args:
        content: Content of diagnosis.json.

    Returns:
        One row for each hypothesis. ``gap`` (in multiples of the noise) and its 95 % interval are known of the leading
        hypotheses alone. The doubts: whether the hypothesis names something ``unknown``; whether held-out motion did
        not ``confirm`` it; the effects that it is ``confounded_with``; its effects that are ``not_needed``, as the gap
        is as small without them; its effects that this motion would ``not_show``; parameters ``at_end`` of their range.

    """
    probability = "probability"
    if not content["method"]["calibrated"]:
        probability = "probability (not calibrated)"
    rows = [_describe_hypothesis(k, one, content) for k, one in enumerate(content["hypotheses"], 1)]
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    return ResultTable(f"Hypotheses by {probability}", columns)


def build_parameter_table(content: Mapping[str, Any]) -> ResultTable:
    """Build the table of the parameters as re-estimated with the verdict: those of its effects, then base parameters.

    Args:
        content: Content of diagnosis.json.

    Returns:
        One row for each parameter with its name in the model, its effect, value, standard deviation (None: unknown),
        unit, and the end of its range that it stands at, if any.

    """
    rows: list[tuple[str, str, Mapping[str, Any]]] = []
    for entry in content["verdict"]:
        suffix = f"_{entry.partition('@')[2]}".removesuffix("_0")
        rows += [(f"{name}{suffix}", entry, one) for name, one in _find_parameters(content, entry).items()]
    rows += [(name, BASE_PARAMETER, one) for name, one in content["parameters"].items()]
    columns: dict[str, Sequence[TableCell]] = {
        "parameter": [name for name, _, _ in rows],
        "effect": [effect for _, effect, _ in rows],
        "value": [one["value"] for _, _, one in rows],
        "std": [one["std"] for _, _, one in rows],
        "unit": [one["unit"] for _, _, one in rows],
        "at_end": [one["end"] or "" for _, _, one in rows],
    }
    return ResultTable("Parameters with the verdict", columns)


def _describe_hypothesis(rank: int, hypothesis: Mapping[str, Any], content: Mapping[str, Any]) -> dict[str, TableCell]:
    """One row of the table of hypotheses."""
    effects: list[str] = hypothesis["effects"]
    gap, (low, high) = _find_gap(effects, content["ranking"])
    doubts, contradicted = content["doubts"] or {}, content["contradicted"] or {}
    refuted = [one["verdict"] for one in (doubts, contradicted) if one]
    return {
        "rank": rank,
        "hypothesis": " + ".join(effects) or NO_EFFECT,
        "probability": hypothesis["probability"],
        "verdict": set(effects) == set(content["verdict"]),
        "gap": gap,
        "gap_low": low,
        "gap_high": high,
        "unknown": any(name.startswith("unknown@") for name in effects),
        "unconfirmed": any(set(effects) == set(one) for one in refuted),
        "confounded_with": _join_names(_list_confounded(effects, content)),
        "not_needed": _join_names(name for name in effects if name in _list_small(content)),
        "not_shown": _join_names(name for name in effects if name in content["undetectable"]),
        "at_end": _join_names(_list_parameters_at_end(effects, content)),
    }


def _find_gap(
    effects: Sequence[str], ranking: Sequence[Mapping[str, Any]]
) -> tuple[float | None, tuple[float | None, float | None]]:
    """The gap of a hypothesis on held-out motion and its interval; None where it was not replayed."""
    for one in ranking:
        if one["model"] != "robot file" and set(one["effects"]) == set(effects):
            low, high = one["interval"] or (None, None)
            return one["gap"], (low, high)
    return None, (None, None)


def _list_confounded(effects: Sequence[str], content: Mapping[str, Any]) -> list[str]:
    """The effects that the log cannot tell from those of a hypothesis."""
    causes = (cause for cause in content["causes"] if f"{cause['effect']}@{cause['joint']}" in effects)
    others = [other for cause in causes for other in cause["confounded_with"]]
    return [name for name in dict.fromkeys(others) if name not in effects]


def _list_small(content: Mapping[str, Any]) -> list[str]:
    """The effects without which the gap is as small."""
    return [f"{one['effect']}@{one['joint']}" for one in content["small"]]


def _list_parameters_at_end(effects: Sequence[str], content: Mapping[str, Any]) -> list[str]:
    """The parameters of some effects that stand at an end of their range."""
    found: list[str] = []
    for entry in effects:
        found += [name for name, one in _find_parameters(content, entry).items() if one["end"]]
    return found


def _find_parameters(content: Mapping[str, Any], entry: str) -> Mapping[str, Any]:
    """The parameters of an effect, name@joint, as diagnosis.json has them."""
    effect, _, joint = entry.partition("@")
    for cause in content["causes"]:
        if (cause["effect"], str(cause["joint"])) == (effect, joint):
            parameters: Mapping[str, Any] = cause["parameters"]
            return parameters
    return {}


def _join_names(names: Iterable[str]) -> str:
    return ", ".join(names)
