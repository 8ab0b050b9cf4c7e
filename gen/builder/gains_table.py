"""The table of gains of docs/guides/control.md, between its markers; `python -m gen.builder.gains_table` prints it."""

from __future__ import annotations

from dataclasses import replace

from gen.effects import NOMINAL
from gen.effects.effect import Parameter
from gen.model.arm_model import Model
from gen.model.compliance_laws import make_laws
from gen.model.control_loop import COMMON_GAINS
from gen.model.right_hand_side import assemble_graphs
from gen.model.tip_laws_in_space import DIRECTIONS, list_space_gains
from gen.robot.load_robot import load

GAINS_TABLE_HEAD = "| gain | laws | unit | default | possible | what it is |\n|---|---|---|---|---|---|\n"


def make_gains_table() -> str:
    """List every gain of every law in Markdown: those of all laws first, then each law's own, axes together.

    The gains of the laws of a tip in space come last, as they are for six joints without limits.

    Returns:
        The table.

    """
    model = Model(load("paper"), NOMINAL)
    laws = make_laws(model, assemble_graphs(model).c)
    found = [(law.name, gain) for law in laws for gain in law.gains]
    joint = replace(model.robot.joints[0], limits=replace(model.robot.joints[0].limits, position=None))
    found += [(law.name, gain) for gain in list_space_gains([joint] * 6) for law in laws if "cartesian" in law.name]
    rows: dict[tuple[str, Parameter], list[str]] = {}
    for law, gain in found:
        values = Parameter("", gain.unit, gain.nominal, gain.low, gain.high, gain.meaning)
        users = rows.setdefault((_name_axes(gain), values), [])
        if law not in users:
            users.append(law)
    return GAINS_TABLE_HEAD + "".join(_gain_row(name, gain, users, len(laws)) for (name, gain), users in rows.items())


def _name_axes(gain: Parameter) -> str:
    """The names of a gain along all axes."""
    kind, _, axis = gain.name.rpartition("_")
    if axis in DIRECTIONS[:3]:
        return f"`{kind}_x`, `{kind}_y`, in space `{kind}_z`"
    if axis in DIRECTIONS:
        return f"in space `{kind}_rx`, `{kind}_ry`, `{kind}_rz`"
    if axis.isdigit():
        return f"`{kind}_1`, `{kind}_2`, …"
    if gain in COMMON_GAINS:
        return f"`{gain.name}`"
    return f"in space `{gain.name}`"


def _gain_row(name: str, gain: Parameter, users: list[str], count: int) -> str:
    who = ", ".join(f"`{user}`" for user in users)
    if len(users) == count:
        who = "all"
    return f"| {name} | {who} | {gain.unit} | {gain.nominal:g} | {gain.low:g} to {gain.high:g} | {gain.meaning} |\n"


if __name__ == "__main__":
    print(make_gains_table(), end="")
