"""The page of effects and its figures, in docs/method and docs/images: `python -m gen.builder.effects_table docs`."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path

from gen.builder.effect_figures import draw_effect
from gen.effects import ALL, NOMINAL
from gen.effects.effect import Effect, Parameter
from gen.effects.file_numbers import FILE_NUMBERS, FileNumber

EFFECTS_INTRODUCTION = """# Effects

`python -m gen.builder.effects_table docs` prints this page from the equations in `gen/effects`, one file an effect.

An effect is one term at one port of a joint. It has parameters, and an amplitude whose 0 removes it exactly. θ is the
motor angle, q the joint angle, N the ratio, φ = θ/N − q the torsion, and τ the joint torque. [model.md](model.md)
shows the ports.

Each figure shows the term of the effect at its typical size on the preset `paper`. Where the robot file states the
amplitude, the figure has that value.

"""
STATED = "These effects are in every model. The robot file states their amplitudes.\n"
ADDED = """These effects are in a model if its robot file states them (`[[effect]]`), or if a build asks for them
(`--effects`). The diagnosis tries all of them.
"""
NUMBERS = """The diagnosis also tries whether one of these numbers is wrong by a factor. They have no term, as the
equations of motion hold them.
"""
NUMBERS_TABLE_HEAD = "| number | place | meaning | experiment |\n|---|---|---|---|\n"
EFFECTS_TABLE_HEAD = "| effect | acts at | meaning |\n|---|---|---|\n"
JOINT_PHRASES = {"each": "", "first": "; first joint", "last": "; last joint", "arm": "; whole arm"}


def write_effects_page(docs: Path) -> None:
    """Write the page and its figures.

    Args:
        docs: The folder of documents.

    """
    figures = docs / "images" / "effects"
    figures.mkdir(parents=True, exist_ok=True)
    for effect in ALL:
        (figures / f"{effect.name}.svg").write_text(draw_effect(effect), encoding="utf-8")
    (docs / "method" / "effects.md").write_text(make_effects_page(), encoding="utf-8")


def make_effects_page() -> str:
    """The page in Markdown: a list of all effects, then a section for each.

    Returns:
        The text of docs/method/effects.md.

    """
    added = tuple(effect for effect in ALL if effect not in NOMINAL)
    parts = [EFFECTS_INTRODUCTION, EFFECTS_TABLE_HEAD, *map(_effect_row, ALL)]
    for title, text, effects in (("In every model", STATED, NOMINAL), ("Added", ADDED, added)):
        parts += [f"\n## {title}\n\n{text}", *map(_effect_section, effects)]
    parts += [f"\n## Numbers of the robot file\n\n{NUMBERS}\n", NUMBERS_TABLE_HEAD, *map(_number_row, FILE_NUMBERS)]
    return "".join(parts)


def _number_row(number: FileNumber) -> str:
    shown = number.experiment
    return f"| `{number.name}` | {number.place} | {number.meaning} | {shown.action}: it {shown.observation} |\n"


def _effect_row(effect: Effect) -> str:
    return f"| [`{effect.name}`](#{effect.name}) | {effect.port.value} | {_table_cell(_effect_meaning(effect))} |\n"


def _effect_section(effect: Effect) -> str:
    equation = " ".join((inspect.getdoc(effect.equation) or "").split()).removesuffix(".")
    legend = _effect_document(effect).partition("Legend: ")[2].strip()
    rows = [("term", equation), ("symbols", legend), ("acts at", _describe_place(effect))]
    rows.append(("amplitudes; other parameters", _describe_parameters(effect)))
    if effect.space_form is not None:
        rows += _describe_space_form(effect.space_form)
    rows.append(("source", effect.citation))
    lines = "".join(f"| {name} | {_table_cell(text)} |\n" for name, text in rows)
    figure = f"![{effect.name}](../images/effects/{effect.name}.svg)\n"
    return f"\n### {effect.name}\n\n{_effect_meaning(effect)}\n\n{figure}\n| | |\n|---|---|\n{lines}"


def _describe_space_form(effect: Effect) -> list[tuple[str, str]]:
    """Rows on the form that an effect has in a chain that leaves the plane."""
    equation = " ".join((inspect.getdoc(effect.equation) or "").split()).removesuffix(".")
    return [("term in space", equation), ("amplitudes; other parameters in space", _describe_parameters(effect))]


def _effect_meaning(effect: Effect) -> str:
    return _effect_document(effect).partition("Legend: ")[0].strip()


def _effect_document(effect: Effect) -> str:
    return " ".join((sys.modules[effect.equation.__module__].__doc__ or "").split())


def _describe_place(effect: Effect) -> str:
    where = effect.port.value + JOINT_PHRASES[effect.joints]
    if not effect.suits_rigid_drive:
        where += "; flexible drives"
    if not effect.suits_prismatic_joint:
        where += "; revolute joints"
    return where


def _table_cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


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
    write_effects_page(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
