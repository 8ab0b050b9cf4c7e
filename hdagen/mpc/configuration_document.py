"""docs/reference/controller_toml.md, printed from the table of keys.

`python -m hdagen.mpc.configuration_document` prints it.
"""

from __future__ import annotations

from hdagen.mpc.configuration_schema import format_key_table

INTRODUCTION = """# controller.toml

The configuration of the [predictive controller](../guides/mpc.md): `[table]`s with the keys below, and one
`[[wall]]` for each wall.
All problems of a file are reported together, one sentence each, before anything is built:

- unknown keys and contradictions;
- counts that do not fit the arm, and ranges that are empty together with those of the robot file;
- a limit of the current without a torque constant;
- walls that leave no room, or no room within reach;
- a cost that is not definite;
- a horizon that needs more than 32 MiB.

`hdagen mpc keys` prints the table, and `python -m hdagen.mpc.configuration_document` this page.

"""


def write_document() -> str:
    """Write docs/reference/controller_toml.md, the table of keys as Markdown.

    Returns:
        The text.

    """
    return INTRODUCTION + format_key_table()


if __name__ == "__main__":
    print(write_document(), end="")
