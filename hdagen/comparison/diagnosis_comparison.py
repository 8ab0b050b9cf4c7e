"""Two diagnoses side by side.

Two estimates agree if their difference is within its 95 % interval, both being Gaussian and independent. Two diagnoses
of the same log are not independent, which the comparison says.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from hdagen.adoption.diagnosis_file import is_finite
from hdagen.adoption.diagnosis_schema import upgrade_content
from hdagen.adoption.verdict import FACTOR, read_verdict
from hdagen.diagnosis.report.effect_words import join_effects
from hdagen.pages.number_table import TableCell
from hdagen.pages.result_table import ResultTable

INTERVAL_DEVIATIONS = 1.96  # standard deviations to each end of a 95 % interval
LEAST_LISTED_PROBABILITY = 0.01  # from which an effect that no verdict names is listed
BASE_PARAMETER = "base parameter"
NAMED_BY = {(True, True): "both", (True, False): "first", (False, True): "second", (False, False): "none"}


@dataclass(frozen=True)
class Estimate:
    """A parameter as one diagnosis has it: ``value``, and ``std`` where the diagnosis states a standard deviation."""

    value: float
    std: float | None

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval; None without a standard deviation."""
        if self.std is None:
            return None
        reach = INTERVAL_DEVIATIONS * self.std
        return self.value - reach, self.value + reach


@dataclass(frozen=True)
class ParameterPair:
    """A parameter by its name in the model, with the estimates of both diagnoses; None where one has none.

    Attributes:
        name: Its name in the model.
        effect: The effect that it belongs to, effect@joint, or "base parameter".
        unit: Its unit.
        first: The first estimate.
        second: The second estimate.

    """

    name: str
    effect: str
    unit: str
    first: Estimate | None
    second: Estimate | None

    @property
    def difference(self) -> float | None:
        """Second minus first; None where one is lacking."""
        if self.first is None or self.second is None:
            return None
        return self.second.value - self.first.value

    @property
    def deviations(self) -> float | None:
        """The difference in its own standard deviations; None where it is not known."""
        if self.first is None or self.second is None or self.first.std is None or self.second.std is None:
            return None
        difference, std = self.second.value - self.first.value, math.hypot(self.first.std, self.second.std)
        if std == 0.0:
            return 0.0 if difference == 0.0 else math.copysign(math.inf, difference)
        return difference / std

    @property
    def do_agree(self) -> bool | None:
        """Whether the difference is within its 95 % interval; None where that is not known."""
        if self.deviations is None:
            return None
        return abs(self.deviations) <= INTERVAL_DEVIATIONS


@dataclass(frozen=True)
class EffectPair:
    """An effect, effect@joint: whether each verdict names it, and its probability in each; None where it was not
    tried."""

    effect: str
    is_in_first: bool
    is_in_second: bool
    first_probability: float | None
    second_probability: float | None


@dataclass(frozen=True, eq=False)
class DiagnosisComparison:
    """Two diagnoses side by side.

    Attributes:
        labels: Where each comes from.
        contents: The content of each diagnosis.json.

    """

    labels: tuple[str, str]
    contents: tuple[Mapping[str, Any], Mapping[str, Any]]

    @property
    def effects(self) -> tuple[EffectPair, ...]:
        """The effects that a verdict names or a diagnosis finds possible, the named ones first."""
        first, second = (set(content["verdict"]) for content in self.contents)
        chances = [_read_probabilities(content) for content in self.contents]
        names = (
            {name for chance in chances for name, value in chance.items() if value >= LEAST_LISTED_PROBABILITY}
            | first
            | second
        )
        pairs = [EffectPair(n, n in first, n in second, chances[0].get(n), chances[1].get(n)) for n in names]
        return tuple(sorted(pairs, key=_rank_effect))

    @property
    def parameters(self) -> tuple[ParameterPair, ...]:
        """The parameters of the effects that a verdict names, then the base parameters."""
        found = [dict(_read_estimates(content, self._named_effects)) for content in self.contents]
        pairs = []
        for key in dict.fromkeys([*found[0], *found[1]]):
            (first, unit), (second, other) = (one.get(key, (None, "")) for one in found)
            pairs.append(ParameterPair(key[1], key[0], unit or other, first, second))
        return tuple(sorted(pairs, key=lambda pair: pair.effect == BASE_PARAMETER))

    @property
    def _named_effects(self) -> frozenset[str]:
        return frozenset(name for content in self.contents for name in content["verdict"])

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what limits the comparison."""
        said = []
        robots, logs, held = (
            [_read_part(content, *keys) for content in self.contents]
            for keys in (("robot", "identity"), ("data", "log"), ("data", "hold_out"))
        )
        if None in robots or robots[0] != robots[1]:
            said.append(
                "The robot files differ, or an older diagnosis does not say which it was: estimates can be compared, "
                "and changes from the file cannot."
            )
        if logs[0] is not None and logs[0] == logs[1]:
            said.append("Both are of the same log: their estimates err together, and their agreement confirms neither.")
        if held[0] != held[1]:
            said.append("The held-out rows differ, so the gaps are of different motions.")
        for which, content in zip(("first", "second"), self.contents, strict=True):
            if not content.get("sure"):
                said.append(f"The {which} diagnosis is not sure of its verdict.")
        return tuple(said)

    @property
    def joints(self) -> tuple[str | None, ...]:
        """Names of the joints; none where the diagnoses are of robots with different names."""
        first, second = (tuple(content.get("joints") or ()) for content in self.contents)
        return first if first == second else ()

    @property
    def sentence(self) -> str:
        """Verdicts and parameters compared in a sentence or two."""
        first, second = (list(content["verdict"]) for content in self.contents)
        both = [name for name in first if name in second]
        parts = []
        if both:
            parts.append(f"both name {join_effects(both, self.joints)}")
        for which, own, other in (("first", first, second), ("second", second, first)):
            alone = [name for name in own if name not in other]
            if alone:
                parts.append(f"only the {which} names {join_effects(alone, self.joints)}")
        text = "; ".join(parts) or "neither names an effect"
        known = [pair for pair in self.parameters if pair.do_agree is not None]
        if known:
            agreeing = sum(bool(pair.do_agree) for pair in known)
            text += f"; {agreeing} of {len(known)} parameters agree within their 95 % intervals"
        return f"{text[0].upper()}{text[1:]}."

    def table(self) -> ResultTable:
        """Build the table of gaps.

        Returns:
            A row for each figure of the gap on held-out motion, in multiples of the noise.

        """
        rows = {key: [_read_number(content, "gap", key) for content in self.contents] for key in GAP_FIGURES}
        columns: dict[str, list[TableCell]] = {"gap": [GAP_FIGURES[key] for key in rows]}
        columns |= {name: [row[k] for row in rows.values()] for k, name in enumerate(("first", "second"))}
        return ResultTable("Gap on held-out motion, in multiples of the noise", columns)

    def tabulate_effects(self) -> ResultTable:
        """Build the table of effects.

        Returns:
            A row for each effect that a verdict names or a diagnosis finds possible.

        """
        pairs = self.effects
        columns: dict[str, list[TableCell]] = {
            "effect": [pair.effect for pair in pairs],
            "named by": [NAMED_BY[pair.is_in_first, pair.is_in_second] for pair in pairs],
            "first": [pair.first_probability for pair in pairs],
            "second": [pair.second_probability for pair in pairs],
        }
        return ResultTable("Effects, with their probability in each diagnosis", columns)

    def tabulate_parameters(self) -> ResultTable:
        """Build the table of parameters.

        Returns:
            A row for each parameter with both estimates, their standard deviations, the difference in standard
            deviations, and whether they agree.

        """
        pairs = self.parameters
        columns: dict[str, list[TableCell]] = {
            "parameter": [pair.name for pair in pairs],
            "effect": [pair.effect for pair in pairs],
            "first": [_get_value(pair.first) for pair in pairs],
            "first ±": [_get_deviation(pair.first) for pair in pairs],
            "second": [_get_value(pair.second) for pair in pairs],
            "second ±": [_get_deviation(pair.second) for pair in pairs],
            "unit": [pair.unit for pair in pairs],
            "difference": [pair.difference for pair in pairs],
            "in deviations": [pair.deviations for pair in pairs],
            "agree": [pair.do_agree for pair in pairs],
        }
        return ResultTable("Parameters, with standard deviations", columns)

    def to_dict(self) -> dict[str, Any]:
        """Write the comparison as JSON takes it.

        Returns:
            Sentence, notes, both diagnoses in short, effects and parameters.

        """
        sides = [
            {
                "source": label,
                "robot": _read_part(content, "robot", "name"),
                "log": _read_part(content, "data", "log"),
                "verdict": list(content["verdict"]),
                "sure": bool(content.get("sure")),
                "gap": {key: _read_number(content, "gap", key) for key in GAP_FIGURES},
            }
            for label, content in zip(self.labels, self.contents, strict=True)
        ]
        return {
            "sentence": self.sentence,
            "notes": list(self.notes),
            "first": sides[0],
            "second": sides[1],
            "effects": [asdict(pair) for pair in self.effects],
            "parameters": [
                asdict(pair)
                | {"difference": pair.difference, "deviations": _drop_infinity(pair.deviations), "agree": pair.do_agree}
                for pair in self.parameters
            ],
        }

    def __str__(self) -> str:
        tables = (self.table(), self.tabulate_effects(), self.tabulate_parameters())
        return "\n\n".join([self.sentence, *(str(table) for table in tables if len(table)), *self.notes])

    def _repr_html_(self) -> str:
        """The three tables as HTML, for notebooks."""
        return "".join(t._repr_html_() for t in (self.table(), self.tabulate_effects(), self.tabulate_parameters()))


GAP_FIGURES = {
    "before": "with the robot file",
    "after": "with the verdict",
    "achievable": "least of all that was fitted",
    "shrink": "share that closed",
}


def compare_contents(
    first: Mapping[str, Any], second: Mapping[str, Any], labels: tuple[str, str] = ("first", "second")
) -> DiagnosisComparison:
    """Compare two diagnoses.

    Args:
        first: Content of a diagnosis.json.
        second: Content of another one.
        labels: Where each comes from.

    Returns:
        The comparison.

    Raises:
        PlantError: A content is of another schema, or contradicts itself.

    """
    contents = upgrade_content(first), upgrade_content(second)
    for content in contents:
        read_verdict(content)
    return DiagnosisComparison(labels, contents)


def _get_value(estimate: Estimate | None) -> float | None:
    return None if estimate is None else estimate.value


def _get_deviation(estimate: Estimate | None) -> float | None:
    return None if estimate is None else estimate.std


def _rank_effect(pair: EffectPair) -> tuple[int, float, str]:
    """The place of an effect: named by both, by one, by none; then by its larger probability."""
    named = -int(pair.is_in_first) - int(pair.is_in_second)
    return named, -max(pair.first_probability or 0.0, pair.second_probability or 0.0), pair.effect


def _read_probabilities(content: Mapping[str, Any]) -> dict[str, float]:
    """The probability of every effect that was tried."""
    causes = content.get("causes", [])
    chances = {f"{one['effect']}@{one['joint']}": _keep_number(one.get("probability")) for one in causes}
    for one in _read_list(content, "hypotheses"):  # something unknown is no cause, and has a hypothesis of its own
        names = one.get("effects") if isinstance(one, Mapping) else None
        if isinstance(names, list) and len(names) == 1 and str(names[0]).startswith("unknown@"):
            chances[str(names[0])] = _keep_number(one.get("probability"))
    return {name: value for name, value in chances.items() if value is not None}


def _read_estimates(
    content: Mapping[str, Any], named: frozenset[str]
) -> Iterator[tuple[tuple[str, str], tuple[Estimate, str]]]:
    """The estimates of the named effects and of the base parameters, by effect and name, with their units."""
    for cause in content.get("causes", []):
        effect = f"{cause['effect']}@{cause['joint']}"
        if effect in named and isinstance(cause.get("parameters"), Mapping):
            suffix = f"_{cause['joint']}".removesuffix("_0")
            for name, entry in cause["parameters"].items():
                if name == FACTOR:  # says the same as the number beside it
                    continue
                yield from _read_estimate(effect, f"{name}{suffix}", entry)
    for name, entry in content.get("parameters", {}).items():
        yield from _read_estimate(BASE_PARAMETER, name, entry)


def _read_estimate(effect: str, name: str, entry: Any) -> Iterator[tuple[tuple[str, str], tuple[Estimate, str]]]:
    """One estimate, if the entry has a value."""
    given = entry if isinstance(entry, Mapping) else {"value": entry}
    value, std = _keep_number(given.get("value")), _keep_number(given.get("std"))
    if value is not None:
        if std is not None and std < 0.0:
            std = None
        yield (effect, name), (Estimate(value, std), str(given.get("unit", "")))


def _read_part(content: Mapping[str, Any], *keys: str) -> Any:
    """What stands below some keys; None where nothing does."""
    part: Any = content
    for key in keys:
        part = part.get(key) if isinstance(part, Mapping) else None
    return part


def _read_list(content: Mapping[str, Any], key: str) -> list[Any]:
    part = content.get(key)
    return part if isinstance(part, list) else []


def _read_number(content: Mapping[str, Any], *keys: str) -> float | None:
    return _keep_number(_read_part(content, *keys))


def _keep_number(value: Any) -> float | None:
    """A finite number; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not is_finite(value):
        return None
    return float(value)


def _drop_infinity(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else value
