"""The table of effects between the two markers in README.md; `python -m gen.effects_table` prints it."""

from __future__ import annotations

import inspect
import sys

from gen.effect import Effect
from gen.effects import ALL, NOMINAL

HEAD = "| effect | acts at | its term | amplitudes; other parameters | source |\n|---|---|---|---|---|\n"
JOINTS = {"each": "", "first": "; first joint", "last": "; last joint", "arm": "; whole arm"}


def table() -> str:
    """Every effect there is, in Markdown: those of every model, then those that a robot file or --effects adds."""
    added = tuple(effect for effect in ALL if effect not in NOMINAL)
    parts = ["In every model:\n\n", HEAD, *map(_row, NOMINAL)]
    parts += ["\nAdded where a robot file states them (`[[effect]]`) or a build asks for them (`--effects`):\n\n", HEAD]
    return "".join([*parts, *map(_row, added)])


def _row(effect: Effect) -> str:
    module = sys.modules[effect.equation.__module__]
    legend = (module.__doc__ or "").partition("Legend: ")[2].strip()
    equation = (inspect.getdoc(effect.equation) or "").removesuffix(".")
    where = effect.port.value + JOINTS[effect.joints] + ("" if effect.rigid else "; flexible drives")
    where += "" if effect.prismatic else "; revolute joints"
    term = f"{equation}. {legend}"
    cells = (f"`{effect.name}`", where, term, _parameters(effect), effect.citation)
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |\n"


def _parameters(effect: Effect) -> str:
    own = {parameter.name: parameter for parameter in effect.parameters}

    def shown(name: str) -> str:
        if name not in own:
            size = effect.sizes.get(name)
            return f"`{name}` (robot.toml" + (f", typically off by {100 * size:g} %)" if size else ")")
        p = own[name]
        off = f"{p.nominal:g} ± " if p.nominal and p.typical else ""
        scale = f" × `{p.scale}`" if p.scale and p.typical else ""
        typical = "" if p.typical is None else f", typically {off}{p.typical:g}{scale}"
        return f"`{name}` ({p.unit}{typical})"

    amplitudes = ", ".join(map(shown, effect.amplitudes))
    others = ", ".join(shown(name) for name in own if name not in effect.amplitudes)
    return f"{amplitudes}; {others}" if others else amplitudes


if __name__ == "__main__":
    print(table(), end="")
