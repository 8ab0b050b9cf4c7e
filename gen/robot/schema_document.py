"""The page docs/reference/robot_toml.md, made from the table of keys in `gen.robot.schema`.

`python -m gen.robot.schema_document` prints it.
"""

from __future__ import annotations

from collections.abc import Iterable

from gen.presets import find_presets
from gen.robot.gear_catalogue import CATALOGUE
from gen.robot.schema import ANY, MAX_JOINTS, TITLES, Key, ValueKind, describe_form, keys_of
from gen.robot.trust import SOURCES

INTRODUCTION = """# robot.toml

`python -m gen.robot.schema_document` prints this page from the table in `gen/robot/schema.py`.
[bring_your_robot.md](../guides/bring_your_robot.md) shows how to write a file.

Values are in SI units, angles in rad. The `[[joint]]` tables stand base first, at most {joints}, and count from 1.
`[joint.drive]`, `[joint.limits]` and `[joint.sensor]` belong to the `[[joint]]` above them. Units of a prismatic joint
stand in parentheses.

Each joint of the short form moves in the plane, with its link along x. In the long form joints stand in space:
`[[joint]] in space` shows their keys, and `[tip]` the place of the tip. One file uses one form.

A number marked ± may be written `{{value = 1.6, tolerance = 0.1}}` or `{{value = 1.6, source = "CAD"}}`. A plain number
has the tolerance of the file, or 0 if the mark is (±). A source stands for a tolerance, a relative standard deviation:

{sources}

The tolerance is a share of the number itself. In space that of a centre of mass is a share of its distance from the
joint's frame, and that of a product of inertia Iᵢⱼ a share of √(Iᵢᵢ Iⱼⱼ). CAD often has a 0 there that no machine has.

All problems of a file are reported together: unknown keys, missing keys, wrong types and values out of range. A file
that is not TOML in UTF-8, or is larger than 1 MB, is refused as a whole.

Presets: {presets}.

Gears in the catalogue: {gears}. For any other gear, copy the numbers of its data sheet to `[joint.drive]`: `ratio`,
`K1`, `K2`, `K3`, `T1`, `T2`, `hysteresis_loss` (ψ) and, if it is known, `starting_torque`. The four springs follow from
them as from the catalogue's.
"""


def write_document() -> str:
    """Write docs/reference/robot_toml.md, the table of keys as Markdown.

    Returns:
        The text.

    """
    parts = [
        INTRODUCTION.format(
            joints=MAX_JOINTS,
            presets=_quote_names(find_presets()),
            gears=_quote_names(CATALOGUE),
            sources=_write_sources(),
        )
    ]
    for table, title in TITLES.items():
        heading = f"`{title}`" if table else title
        parts.append(f"\n## {heading}\n")
        parts.append(
            "| key | written as | unit | range | required | default | meaning |\n|---|---|---|---|---|---|---|"
        )
        parts += [_document_row(key) for key in keys_of(table).values()]
    return "\n".join(parts) + "\n"


def _write_sources() -> str:
    """The tolerance of each source, as a table in Markdown."""
    rows = (f"| `{one.name}` | {one.tolerance:g} | {one.reason} |" for one in SOURCES)
    return "\n".join(("| source | tolerance | reason |", "|---|---|---|", *rows))


def _quote_names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _document_row(key: Key) -> str:
    cells = (
        f"`{key.name}`",
        _written_form(key),
        _unit_text(key),
        _possible_values(key),
        key.need.value,
        _default_text(key),
        key.meaning,
    )
    return f"| {' | '.join(cells)} |"


def _written_form(key: Key) -> str:
    """How the value is written, with a mark where it may have a tolerance of its own."""
    if key.kind is ValueKind.VECTOR:
        return describe_form(key)
    marked = {ValueKind.PARAMETER: "number", ValueKind.PARAMETERS: describe_form(key)}.get(key.kind)
    if marked is None:
        return key.kind.value
    if key.exact:
        return f"{marked} (±)"
    return f"{marked} ±"


def _unit_text(key: Key) -> str:
    if key.prismatic_unit:
        return f"{key.unit} ({key.prismatic_unit})"
    return key.unit


def _possible_values(key: Key) -> str:
    """The choices, or the range."""
    if key.choices:
        return " or ".join(f"`{choice}`" for choice in key.choices)
    if key.range == ANY:
        return ""
    bounds = f"{key.range.low:g} … {key.range.high:g}"
    if key.range.excludes_low:
        return f"above {bounds}"
    return bounds


def _default_text(key: Key) -> str:
    if key.default_text or key.default is None:
        return key.default_text
    if isinstance(key.default, tuple):
        return f"[{', '.join(f'{entry:g}' for entry in key.default)}]"
    return f"{key.default}".lower()


if __name__ == "__main__":
    print(write_document(), end="")
