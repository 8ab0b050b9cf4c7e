"""The table of effects between the two markers in README.md; `python -m gen.builder.effects_table` prints it."""

from __future__ import annotations

import inspect
import sys

from gen.effects import ALL, NOMINAL
from gen.effects.effect import Effect, Parameter

EFFECTS_TABLE_HEAD = "| effect | acts at | its term | amplitudes; other parameters | source |\n|---|---|---|---|---|\n"
JOINT_PHRASES = {"each": "", "first": "; first joint", "last": "; last joint", "arm": "; whole arm"}


def make_effects_table() -> str:
    """List every effect in Markdown: those of every model, then those that a robot file or --effects adds.

    Returns:
        The two tables.

    """
    added = tuple(effect for effect in ALL if effect not in NOMINAL)
    parts = ["In every model:\n\n", EFFECTS_TABLE_HEAD, *map(_effect_row, NOMINAL)]
    parts += [
        "\nAdded where a robot file states them (`[[effect]]`) or a build asks for them (`--effects`):\n\n",
        EFFECTS_TABLE_HEAD,
    ]
    return "".join([*parts, *map(_effect_row, added)])


def _effect_row(effect: Effect) -> str:
    module = sys.modules[effect.equation.__module__]
    legend = (module.__doc__ or "").partition("Legend: ")[2].strip()
    equation = (inspect.getdoc(effect.equation) or "").removesuffix(".")
    where = effect.port.value + JOINT_PHRASES[effect.joints]
    if not effect.suits_rigid_drive:
        where += "; flexible drives"
    if not effect.suits_prismatic_joint:
        where += "; revolute joints"
    term = f"{equation}. {legend}"
    cells = (f"`{effect.name}`", where, term, _describe_parameters(effect), effect.citation)
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |\n"


def _describe_parameters(effect: Effect) -> str:
    """The effect's amplitudes, then its other parameters."""
    shown = {parameter.name: _own_parameter(parameter) for parameter in effect.parameters}
    amplitudes = ", ".join(shown.get(name) or _file_parameter(effect, name) for name in effect.amplitudes)
    others = ", ".join(text for name, text in shown.items() if name not in effect.amplitudes)
    return "; ".join(part for part in (amplitudes, others) if part)


def _file_parameter(effect: Effect, name: str) -> str:
    """An amplitude that is a key of the robot file."""
    size = effect.usual_shares.get(name)
    if size:
        return f"`{name}` (robot.toml, typically off by {100 * size:g} %)"
    return f"`{name}` (robot.toml)"


def _own_parameter(parameter: Parameter) -> str:
    """A parameter of an effect, with the difference from nominal that is usually met."""
    if parameter.typical is None:
        return f"`{parameter.name}` ({parameter.unit})"
    typical = f"{parameter.typical:g}"
    if parameter.nominal and parameter.typical:
        typical = f"{parameter.nominal:g} ± {typical}"
    if parameter.scale and parameter.typical:
        typical = f"{typical} × `{parameter.scale}`"
    return f"`{parameter.name}` ({parameter.unit}, typically {typical})"


if __name__ == "__main__":
    print(make_effects_table(), end="")
