"""The table of effects between the two markers in README.md; `python -m gen.effects_table` prints it."""

from __future__ import annotations

import inspect
import sys

from gen.effect import Effect
from gen.effects import ALL, NOMINAL

HEAD = "| effect | acts at | its term | amplitudes; other parameters | source |\n|---|---|---|---|---|\n"
JOINTS = {"each": "", "last": "; last joint", "arm": "; whole arm"}


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
    term = f"{equation}. {legend}"
    cells = (f"`{effect.name}`", where, term, _parameters(effect), effect.citation)
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |\n"


def _parameters(effect: Effect) -> str:
    own = {parameter.name: parameter for parameter in effect.parameters}

    def shown(name: str) -> str:
        if name not in own:
            return f"`{name}` (robot.toml)"
        p = own[name]
        typical = "" if p.typical is None else f", typically {p.typical:g}"
        return f"`{name}` ({p.unit}{typical})"

    amplitudes = ", ".join(map(shown, effect.amplitudes))
    others = ", ".join(shown(name) for name in own if name not in effect.amplitudes)
    return f"{amplitudes}; {others}" if others else amplitudes


if __name__ == "__main__":
    print(table(), end="")
