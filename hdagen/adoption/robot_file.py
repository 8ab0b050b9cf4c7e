"""A robot.toml whose numbers are changed in place: comments, order, spelling and line ends stay as they are.

The build's manifest says which keys the robot has and which effect a parameter belongs to; no key is typed here but
those that hang on each other: a catalogue gear, a lumped inertia, and defaults that follow another key.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, InlineTable, Table

from hdagen.arm.arm_parameters import VECTOR_ENTRIES
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm

_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_DATA_SHEET_KEYS = ("K1", "K2", "K3", "T1", "T2", "starting_torque")  # of a data sheet, in place of `catalogue`
_GEAR_KEYS = (  # what either stands for
    "ratio",
    "flexspline_stiffness",
    "flexspline_stiffening",
    "wave_generator_stiffness",
    "wave_generator_stiffening",
    "law_torque",
    "hysteresis_loss",
)
SPRING_KEYS = (*_GEAR_KEYS[1:6], "torsional_damping")  # what a drive with springs has and a rigid one has not
_LEADING_KEYS = {"law_torque": "flexspline_stiffening", "friction_smoothing": "ratio"}  # defaults made from another key
LUMPED_KEYS = ("mass", "center_of_mass", "inertia")  # of a link; a lumped inertia is made of all three


@dataclass(frozen=True)
class NumberPlace:
    """Where a number stands: ``table`` is top, joint, drive, or the name of an effect; joint 0 is the whole arm;
    ``entry`` is its place in a list of numbers."""

    table: str
    joint: int
    key: str
    entry: int | None = None

    def __str__(self) -> str:
        if self.entry is not None:
            return f"{NumberPlace(self.table, self.joint, self.key)}[{self.entry}]"
        if self.table == "top":
            return self.key
        if self.table == "joint":
            return f"joint[{self.joint}].{self.key}"
        if self.table == "drive":
            return f"joint[{self.joint}].drive.{self.key}"
        return f"{self.table}@{self.joint}.{self.key}"


class RobotFile:
    """The file ``raw`` of the robot that ``arm`` is a model of. Raises PlantError where it cannot be read."""

    def __init__(self, raw: bytes, arm: Arm) -> None:
        self._robot, self._quantities = arm.robot, {q["name"]: q for q in arm.manifest["parameters"]}
        self._bom, self._lines = b"", "\n"
        if raw.startswith(_BYTE_ORDER_MARK):
            self._bom = _BYTE_ORDER_MARK
        text = raw.removeprefix(_BYTE_ORDER_MARK).decode("utf-8")
        if "\r\n" in text:
            self._lines = "\r\n"
        text = text.replace("\r\n", "\n")
        if not text.endswith("\n"):
            text += "\n"
        try:
            self._document = tomlkit.parse(text)
        except TOMLKitError as error:
            raise PlantError(f"{arm.robot['name']}: the robot file cannot be changed in place ({error}).") from None

    def to_bytes(self) -> bytes:
        """Write the file as it is now.

        Returns:
            The bytes of the file.

        """
        return self._bom + tomlkit.dumps(self._document).replace("\n", self._lines).encode("utf-8")

    def locate_parameter(self, name: str, effect: str | None = None) -> NumberPlace:
        """Find the place of a parameter in the file, or the place that it would have.

        Args:
            name: Name of the parameter in the model.
            effect: The effect that owns the parameter if no table holds it yet.

        Returns:
            The place.

        Raises:
            PlantError: The parameter belongs to no key and no effect.

        """
        joint, key = self._quantities[name]["joint"], name
        if joint:
            key = name.removesuffix(f"_{joint}")
        vector, _, entry = key.rpartition("_")
        if vector == "gravity" and not joint:
            return NumberPlace("top", 0, vector, VECTOR_ENTRIES[vector].index(entry))
        if joint and key in self._robot["joints"][joint - 1]["drive"]:
            return NumberPlace("drive", joint, key)
        if joint and key in self._robot["joints"][joint - 1]:
            return NumberPlace("joint", joint, key)
        if joint and entry in VECTOR_ENTRIES.get(vector, ()):
            return NumberPlace("joint", joint, vector, VECTOR_ENTRIES[vector].index(entry))
        stated = (e["name"] for e in self._robot["effects"] if e["joint"] == joint and key in e["parameters"])
        owner = next(stated, None) or self._quantities[name].get("effect") or effect
        if owner is None:
            raise PlantError(f"{name} belongs to no key and no effect of the robot file; diagnose again.")
        return NumberPlace(owner, joint, key)

    def states_number(self, place: NumberPlace) -> bool:
        """Tell whether the file as it was read states a number, in writing or by a default.

        Args:
            place: Place of the number.

        Returns:
            Whether it does; not where the number stands in a table that is to be added.

        """
        stated = ((effect["name"], effect["joint"]) for effect in self._robot["effects"])
        return place.table in ("top", "joint", "drive") or (place.table, place.joint) in stated

    def set_number(self, place: NumberPlace, value: float, unit: str = "", share: float = 0.0) -> None:
        """Change or add a number.

        Args:
            place: Place of the number.
            value: The number.
            unit: Its unit, a comment of an added number.
            share: Its relative standard deviation, which an added number of an effect states as its tolerance if it
                is above the file's tolerance.

        """
        if place.entry is not None:
            table = self._find_joint_table(place.joint) if place.joint else self._document
            numbers: Any = table[place.key]
            _set_in_table(numbers["value"] if isinstance(numbers, Mapping) else numbers, place.entry, value)
        elif place.table == "top":
            self._set_top_key(place.key, value, unit)
        elif place.table in ("joint", "drive"):
            self._set_joint_key(place, value, unit)
        else:
            table, tolerance = self._find_effect_table(place), 0.0
            if table is None:
                table = self._add_effect_table(place)
            if share > self._robot["tolerance"]:
                tolerance = min(share, 10.0)
            _set_in_table(table, place.key, value, unit, tolerance)

    def drop_zero_effects(self) -> None:
        """Take out the effects whose amplitudes are all 0: what is left computes the same, with less."""
        acting = {
            (q["effect"], q["joint"])
            for q in self._quantities.values()
            if q["role"] == "amplitude" and q["nominal"] != 0.0
        }
        effects: Any = self._document.get("effect", [])
        for k in reversed(range(len(effects))):
            if (effects[k]["name"], effects[k]["joint"]) not in acting:
                del effects[k]

    def update_dependent_numbers(self, wanted: Arm) -> None:
        """Update the numbers that depend on changed ones: lumped inertias, and defaults that follow a changed key.

        Args:
            wanted: The arm with the parameters that the file shall have.

        """
        for joint, stated in enumerate(self._robot["joints"], 1):
            table, drive = self._find_joint_table(joint), self._find_joint_table(joint)["drive"]
            changed = {
                name
                for name, q in self._quantities.items()
                if q["joint"] == joint and wanted.parameters[name] != q["nominal"]
            }
            if "inertia_about_joint" in table and changed & {f"{key}_{joint}" for key in LUMPED_KEYS}:
                mass, center, inertia = (wanted.parameters[f"{key}_{joint}"] for key in LUMPED_KEYS)
                _set_in_table(table, "inertia_about_joint", inertia + mass * center**2)
            if f"coulomb_friction_{joint}" in changed and "K1" in drive and "starting_torque" not in drive:
                _set_in_table(drive, "starting_torque", self._quantities[f"coulomb_friction_{joint}"]["nominal"], "N m")
            for key, leader in _LEADING_KEYS.items():
                if f"{leader}_{joint}" in changed and key not in drive and stated["drive"][key] is not None:
                    _set_in_table(drive, key, wanted.parameters[f"{key}_{joint}"])

    def _set_top_key(self, key: str, value: float, unit: str) -> None:
        """A key of the file's own; a new one stands behind its gravity, before the comments of the first table."""
        if key in self._document:
            _set_in_table(self._document, key, value)
        else:
            item = tomlkit.item(value)
            item.comment(unit)
            self._document._insert_after("gravity", key, item)  # it would go behind those comments by itself

    def _set_joint_key(self, place: NumberPlace, value: float, unit: str) -> None:
        table = self._find_joint_table(place.joint)
        if place.table == "joint":
            if place.key != "inertia" or "inertia_about_joint" not in table:  # the lumped one is settled at the end
                _set_in_table(table, place.key, value, unit)
            return
        if place.key in _GEAR_KEYS and table["drive"].keys() & {"catalogue", *_DATA_SHEET_KEYS}:
            self._replace_gear_by_springs(place.joint)
        _set_in_table(table["drive"], place.key, value, unit)

    def _replace_gear_by_springs(self, joint: int) -> None:
        """The springs themselves in place of `catalogue` or of a data sheet: a gear that differs is no longer that."""
        table = self._find_joint_table(joint)
        drive, stated = table["drive"], self._robot["joints"][joint - 1]
        gear = {key: drive.pop(key) for key in ("catalogue", *_DATA_SHEET_KEYS) if key in drive}
        if isinstance(drive, Table):
            began = ", ".join(f"{key} = {value}" for key, value in gear.items())
            if "catalogue" in gear:
                began = f"{gear['catalogue']} of the catalogue"
            drive.add(tomlkit.comment(f"began as {began}"))
        for key in _GEAR_KEYS:
            if key not in drive and stated["drive"][key] is not None:
                value = stated["drive"][key]
                if isinstance(value, Mapping):
                    value = value["nominal"]
                _set_in_table(drive, key, value)
        if stated["limits"]["torque"] is not None:
            limits: Any = tomlkit.inline_table()
            if isinstance(table, Table):
                limits = tomlkit.table()
            table.setdefault("limits", limits).setdefault("torque", stated["limits"]["torque"])

    def _find_joint_table(self, joint: int) -> Any:
        return self._document["joint"][joint - 1]

    def _find_effect_table(self, place: NumberPlace) -> Any:
        """The [[effect]] table of a place, None where the file has none."""
        for table in self._document.get("effect", ()):
            if table["name"] == place.table and table["joint"] == place.joint:
                return table
        return None

    def _add_effect_table(self, place: NumberPlace) -> Any:
        """A new [[effect]] table at the end of the file, or a new entry where the effects are written in a list."""
        if "effect" not in self._document:
            self._document.add(tomlkit.nl())
            self._document.append("effect", tomlkit.aot())
        effects: Any = self._document["effect"]
        table: Any = tomlkit.inline_table()
        if isinstance(effects, AoT):
            table = tomlkit.table()
        table["name"], table["joint"] = place.table, place.joint
        effects.append(table)
        return effects[-1]


def _set_in_table(
    table: MutableMapping[Any, Any], key: Any, value: float, unit: str = "", tolerance: float = 0.0
) -> None:
    """Set a number in its own form; a new one with its unit as a comment, and its tolerance if it has one."""
    present = isinstance(key, int) or key in table
    if present and isinstance(table[key], Mapping):
        table[key]["value"] = value
    elif present:
        table[key] = value
    else:
        item: Any = tomlkit.item(value)
        if tolerance:
            item = tomlkit.inline_table()
            item["value"], item["tolerance"] = value, float(f"{tolerance:.3g}")
        if unit and unit != "1" and not isinstance(table, InlineTable):
            item.comment(unit)
        table[key] = item
