"""The table of gains of docs/guides/control.md, between its markers; `python -m gen.builder.gains_table` prints it."""

from __future__ import annotations

from gen.effects import NOMINAL
from gen.effects.effect import Parameter
from gen.model.arm_model import Model
from gen.model.compliance_laws import make_laws
from gen.model.control_loop import COMMON_GAINS
from gen.model.right_hand_side import assemble_graphs
from gen.robot.load_robot import load

GAINS_TABLE_HEAD = "| gain | laws | unit | default | possible | what it is |\n|---|---|---|---|---|---|\n"


def make_gains_table() -> str:
    """List every gain of every law in Markdown: those of all laws first, then each law's own, axes together.

    Returns:
        The table.

    """
    model = Model(load("paper"), NOMINAL)
    laws = make_laws(model, assemble_graphs(model).c)
    rows: dict[tuple[str, Parameter], list[str]] = {}
    for law in laws:
        for gain in law.gains:
            values = Parameter("", gain.unit, gain.nominal, gain.low, gain.high, gain.meaning)
            users = rows.setdefault((_name_axes(gain), values), [])
            if law.name not in users:
                users.append(law.name)
    return GAINS_TABLE_HEAD + "".join(_gain_row(name, gain, users, len(laws)) for (name, gain), users in rows.items())


def _name_axes(gain: Parameter) -> str:
    """The names of a gain along all axes."""
    if gain in COMMON_GAINS:
        return f"`{gain.name}`"
    kind, _, axis = gain.name.rpartition("_")
    if axis in ("x", "y"):
        return f"`{kind}_x`, `{kind}_y`"
    return f"`{kind}_1`, `{kind}_2`, …"


def _gain_row(name: str, gain: Parameter, users: list[str], count: int) -> str:
    who = ", ".join(f"`{user}`" for user in users)
    if len(users) == count:
        who = "all"
    return f"| {name} | {who} | {gain.unit} | {gain.nominal:g} | {gain.low:g} to {gain.high:g} | {gain.meaning} |\n"


if __name__ == "__main__":
    print(make_gains_table(), end="")
