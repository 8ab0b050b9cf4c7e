"""The table of gains between the two markers in docs/control.md; `python -m gen.gains_table` prints it."""

from __future__ import annotations

from gen.compliance import COMMON, laws
from gen.effect import Parameter
from gen.effects import NOMINAL
from gen.functions import assemble
from gen.model import Model
from gen.robot import load

HEAD = "| gain | laws | unit | default | possible | what it is |\n|---|---|---|---|---|---|\n"


def table() -> str:
    """Every gain of every law, in Markdown: those of all laws first, then each law's own, axes together."""
    model = Model(load("paper"), NOMINAL)
    made = laws(model, assemble(model).c)
    rows: dict[tuple[str, Parameter], list[str]] = {}
    for law in made:
        for gain in law.gains:
            kind, _, axis = gain.name.rpartition("_")
            own = gain not in COMMON
            space = "cartesian" if axis in ("x", "y") else "joint"
            shown = f"`{kind}_x`, `{kind}_y`" if space == "cartesian" else f"`{kind}_1`, `{kind}_2`, …"
            name = shown if own else f"`{gain.name}`"
            values = Parameter("", gain.unit, gain.nominal, gain.low, gain.high, gain.meaning)
            users = rows.setdefault((name, values), [])
            users += [] if law.name in users else [law.name]
    return HEAD + "".join(_row(name, gain, users, len(made)) for (name, gain), users in rows.items())


def _row(name: str, gain: Parameter, users: list[str], count: int) -> str:
    who = "all" if len(users) == count else ", ".join(f"`{user}`" for user in users)
    return f"| {name} | {who} | {gain.unit} | {gain.nominal:g} | {gain.low:g} to {gain.high:g} | {gain.meaning} |\n"


if __name__ == "__main__":
    print(table(), end="")
