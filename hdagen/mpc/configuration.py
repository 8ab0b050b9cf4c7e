"""controller.toml of the predictive controller, read and checked: every problem at once, one sentence each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.mpc.configuration_schema import CONFIGURATION_KEYS, CONFIGURATION_TABLES, keys_of_table
from hdagen.mpc.configuration_value import convert_value
from hdagen.mpc.target_coordinates import count_positions, count_tip_coordinates, follows_pose
from hdagen.mpc.wall import WALL_ROUNDING, Wall, find_least_distance, leave_no_room
from hdagen.support.input_file import InputFileError, read_toml
from hdagen.support.messages import show_path, show_value, suggest_name

NO_LIMIT = 1e6

MOST_CONFIGURATION_BYTES = 100_000  # bytes of a controller.toml
MOST_WALLS = 8


@dataclass(frozen=True)
class Configuration:
    """The content of a controller.toml: ``values`` by "table.key" without the defaults, and the walls."""

    values: Mapping[str, Any] = field(default_factory=dict)
    walls: tuple[Wall, ...] = ()

    def __getitem__(self, path: str) -> Any:
        """The value of "table.key"; its default where none was given."""
        if path in self.values:
            return self.values[path]
        return next(key.default for key in CONFIGURATION_KEYS if key.path == path)

    @property
    def grid(self) -> tuple[float, ...]:
        """How long each node lasts, s."""
        if self["mpc.grid"] is not None:
            return tuple(self["mpc.grid"])
        return (self["mpc.node"],) * int(self["mpc.nodes"])

    @property
    def structure(self) -> str:
        """The structure that is compiled into the controller, as `python -m gen build --mpc` takes it."""
        return f"nodes={len(self.grid)},walls={len(self.walls)},space={self['mpc.space']}"

    def with_changes(self, walls: tuple[Wall, ...] | None = None, **values: Any) -> Configuration:
        """Copy the configuration with some values replaced.

        Args:
            walls: The new walls; None: as they are.
            **values: New values by key, with "__" for the dot (``limits__tip_speed=0.2``).

        Returns:
            The changed configuration.

        Raises:
            PlantError: A value is unknown or not possible; the message has every problem.

        """
        named = {name.replace("__", "."): value for name, value in values.items()}
        wanted = {**self.values, **named}
        tables: dict[str, Any] = {}
        for path, value in wanted.items():
            table, _, name = path.partition(".")
            entries = tables.setdefault(table, {})
            entries[name] = value
            if isinstance(value, tuple):
                entries[name] = list(value)
        if walls is None:
            walls = self.walls
        tables["wall"] = [{**asdict(wall), "normal": list(wall.normal)} for wall in walls]
        return check_configuration(tables, "configuration")

    def find_incompatibilities(self, robot: Mapping[str, Any]) -> list[str]:
        """Find the reasons why the configuration does not fit a robot.

        Args:
            robot: Description of the robot, as the manifest of a build holds it.

        Returns:
            One sentence for each problem.

        """
        return find_incompatibilities(robot, self)


def read_configuration(path: str | Path) -> Configuration:
    """Read a controller.toml.

    Args:
        path: The file.

    Returns:
        The configuration.

    Raises:
        PlantError: The file cannot be read, or says something that is not possible; the message has every problem.

    """
    try:
        content = read_toml(Path(path), MOST_CONFIGURATION_BYTES, "see docs/reference/controller_toml.md")
    except InputFileError as error:
        raise PlantError(error) from None
    return check_configuration(content, show_path(path))


def check_configuration(content: Mapping[str, Any], where: str) -> Configuration:
    """Check the tables of a configuration.

    Args:
        content: Tables by name, as TOML gives them.
        where: The source, for messages.

    Returns:
        The configuration.

    Raises:
        PlantError: A table, a key or a value is not possible; the message has every problem.

    """
    problems: list[str] = []
    values: dict[str, Any] = {}
    for table, entries in content.items():
        if table not in CONFIGURATION_TABLES:
            possible = f"{', '.join(CONFIGURATION_TABLES)}{suggest_name(table, CONFIGURATION_TABLES)}"
            problems.append(f"{where}: unknown table {table[:40]!r}; possible are {possible}.")
        elif table != "wall":
            _read_table(where, table, entries, values, problems)
    walls = _read_walls(where, content.get("wall", []), problems)
    if not problems:
        _find_contradictions(where, Configuration(values, walls), problems)
    if problems:
        raise PlantError("\n".join(problems))
    return Configuration(values, walls)


def _read_table(where: str, table: str, entries: Any, values: dict[str, Any], problems: list[str]) -> None:
    known = keys_of_table(table)
    if not isinstance(entries, Mapping):
        problems.append(f"{where}: {table} is a table of keys; write [{table}].")
        return
    for name, value in entries.items():
        if name not in known:
            possible = f"{', '.join(known)}{suggest_name(name, known)}"
            problems.append(f"{where}, {table}: unknown key {name[:40]!r}; possible are {possible}.")
        elif value is not None:
            found, why = convert_value(known[name], value)
            if why:
                problems.append(f"{where}, {table}.{name}: found {show_value(value)}, possible is {why}.")
            else:
                values[f"{table}.{name}"] = found


def _read_walls(where: str, tables: Any, problems: list[str]) -> tuple[Wall, ...]:
    if not isinstance(tables, list) or not all(isinstance(table, Mapping) for table in tables):
        problems.append(f"{where}: walls are tables in a list; write [[wall]], one a wall.")
        return ()
    if len(tables) > MOST_WALLS:
        problems.append(f"{where}: found {len(tables)} walls, possible are {MOST_WALLS}; join some.")
        return ()
    walls = []
    for k, table in enumerate(tables, 1):
        found: dict[str, Any] = {}
        before = len(problems)
        _read_table(f"{where}, wall {k}", "wall", table, found, problems)
        given = {path.removeprefix("wall."): value for path, value in found.items()}
        problems += [f"{where}, wall {k}: {n} is missing; state it." for n in ("normal", "offset") if n not in table]
        if len(problems) > before:
            continue
        wall = Wall(**given)
        length = math.hypot(*wall.normal)
        if abs(length - 1) > 1e-6:
            problems.append(f"{where}, wall {k}: normal has length {length:.4g}, possible is 1; divide by its length.")
        if (wall.stiffness is None) != (wall.force is None):
            problems.append(f"{where}, wall {k}: stiffness and force belong together; state both or neither.")
        normal = wall.normal
        if length > 0:
            normal = tuple(entry / length for entry in wall.normal)
        walls.append(Wall(normal, wall.offset, wall.stiffness, wall.force, wall.margin))
    return tuple(walls)


def _find_contradictions(where: str, c: Configuration, problems: list[str]) -> None:
    """Problems that no single key shows."""
    grid = c.grid
    if c["mpc.grid"] is not None and "mpc.nodes" in c.values and len(grid) != c["mpc.nodes"]:
        problems.append(
            f"{where}: mpc.grid has {len(grid)} nodes and mpc.nodes says {c['mpc.nodes']}; state one of them."
        )
    if not 2 <= len(grid) <= 400:
        problems.append(f"{where}: mpc.grid has {len(grid)} nodes, possible are 2 to 400.")
    if min(grid) < c["mpc.period"] * (1 - 1e-9):
        problems.append(
            f"{where}: a node lasts {min(grid):g} s and the period {c['mpc.period']:g} s; make every node at "
            f"least as long."
        )
    if c["limits.sudden"] >= c["limits.tip_speed"]:
        problems.append(
            f"{where}: limits.sudden leaves nothing of limits.tip_speed, {c['limits.tip_speed']:g} m/s; lower it."
        )
    if c["weights.position"] + c["weights.velocity"] <= 0:
        problems.append(
            f"{where}: weights.position and weights.velocity are both 0, so nothing is followed; raise one."
        )
    if c["weights.torque"] + c["weights.torque_rate"] <= 0:
        problems.append(
            f"{where}: weights.torque and weights.torque_rate are both 0, so the cost is not definite; raise one."
        )
    if c["limits.linear"] + c["limits.square"] <= 0:
        problems.append(f"{where}: limits.linear and limits.square are both 0, so soft limits do not count; raise one.")
    if len({len(wall.normal) for wall in c.walls}) > 1:
        problems.append(f"{where}: walls have normals of two and of three numbers; give all those of the arm's tip.")
    elif leave_no_room(c.walls):
        problems.append(f"{where}: the walls leave nothing between them; move one.")
    if c["mpc.grid"] is not None and "mpc.node" in c.values:
        problems.append(f"{where}: mpc.grid says how long each node lasts, and mpc.node too; state one of them.")
    low, high = c["limits.joint_low"], c["limits.joint_high"]
    if low is not None and high is not None:
        joints = max(np.size(low), np.size(high))
        problems += [
            f"{where}: limits.joint_low lies above limits.joint_high at joint {j}; correct them."
            for j, (a, b) in enumerate(zip(expand_values(low, joints), expand_values(high, joints), strict=False), 1)
            if a >= b
        ]


def expand_values(value: Any, count: int) -> list[float]:
    """Give each joint or axis its number.

    Args:
        value: One number for all, or a tuple with one for each.
        count: Count of joints or axes.

    Returns:
        The numbers; a tuple keeps its own length.

    """
    if isinstance(value, tuple):
        return [float(v) for v in value]
    return [float(value)] * count


def resolve_limits(robot: Mapping[str, Any], c: Configuration) -> dict[str, list[float]]:
    """Take the soft limits of the joints from the configuration, else from the robot file.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        c: The configuration.

    Returns:
        ``joint_low`` and ``joint_high`` (rad or m), ``motor_speed`` (rad/s), ``joint_torque`` (N m or N), by joint;
        UNLIMITED where neither states a limit.

    """
    joints = robot["joints"]
    out: dict[str, list[float]] = {name: [] for name in ("joint_low", "joint_high", "motor_speed", "joint_torque")}
    for joint in joints:
        stated = joint["limits"]
        low, high = stated["position"] or (-NO_LIMIT, NO_LIMIT)
        speed, torque = NO_LIMIT, NO_LIMIT
        if stated["speed"] is not None:
            speed = stated["speed"] * abs(joint["drive"]["ratio"]["nominal"])
        if stated["torque"] is not None:
            torque = stated["torque"]
        for values, value in zip(out.values(), (low, high, speed, torque), strict=True):
            values.append(value)
    given = {name: c[f"limits.{name}"] for name in out}
    return out | {name: expand_values(value, len(joints)) for name, value in given.items() if value is not None}


def list_admittance_gains(robot: Mapping[str, Any], c: Configuration) -> dict[str, float]:
    """List the admittance by the names that a Cartesian law has for its gains.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        c: The configuration.

    Returns:
        ``mass_x`` to ``stiffness_y``, in space to ``stiffness_rz``, SI.

    """
    out, count = dict[str, float](), count_tip_coordinates(robot)
    for name in ("mass", "damping", "stiffness"):
        values = expand_values(c[f"admittance.{name}"], count)
        out |= {f"{name}_{axis}": value for axis, value in zip("xyz", values, strict=False)}
        if follows_pose(robot, "tip"):
            turns = expand_values(c[f"admittance.rotation_{name}"], 3)
            out |= {f"{name}_r{axis}": value for axis, value in zip("xyz", turns, strict=False)}
    return out


def find_incompatibilities(robot: Mapping[str, Any], c: Configuration) -> list[str]:
    """Find the reasons why a configuration does not fit a robot.

    Args:
        robot: Description of the robot, as the manifest of a build holds it.
        c: The configuration.

    Returns:
        One sentence for each problem.

    """
    found = list(_find_wrong_counts(robot, c))
    if found:
        return found
    limits = resolve_limits(robot, c)
    found += [
        f"limits.joint_low is {low:g} and limits.joint_high {high:g} rad at joint {j}, the robot file's where the "
        f"configuration gives none, and nothing lies between them; correct them."
        for j, (low, high) in enumerate(zip(limits["joint_low"], limits["joint_high"], strict=True), 1)
        if low >= high
    ]
    if c["limits.motor_current"] is not None:
        lacking = [j for j, joint in enumerate(robot["joints"], 1) if joint["drive"]["torque_constant"] is None]
        if lacking:
            found.append(
                f"limits.motor_current needs a torque_constant in the robot file, which joint {lacking[0]} has not; "
                "give limits.motor_torque."
            )
    if all(joint["kind"] == "revolute" for joint in robot["joints"]):
        reach = _find_reach(robot)
        away = find_least_distance(c.walls)
        if away is not None and away > reach + WALL_ROUNDING:
            found.append(
                f"the walls leave only what is {away:.4g} m and more from the base, and the arm is {reach:.4g} m long; "
                "move one."
            )
    return found


def _find_reach(robot: Mapping[str, Any]) -> float:
    """The farthest that a tip of revolute joints comes from the base, m, or more."""
    if "tip" in robot:
        parts = [*robot["joints"], robot["tip"]]
        return sum(math.hypot(*part["origin"]) for part in parts)
    return float(sum(joint["length"]["nominal"] for joint in robot["joints"]))


def _find_wrong_counts(robot: Mapping[str, Any], c: Configuration) -> Iterator[str]:
    """Problems with the length of lists."""
    counts = {"axes": count_positions(robot, c["mpc.space"]), "joints": len(robot["joints"]), "turns": 3}
    where, coordinates = ("in space" if "tip" in robot else "in the plane"), count_tip_coordinates(robot)
    for k, wall in enumerate(c.walls, 1):
        if len(wall.normal) != coordinates:
            yield (
                f"wall {k}: normal has {len(wall.normal)} numbers and {robot['name']} moves {where}; give "
                f"{coordinates}."
            )
    for key in CONFIGURATION_KEYS:
        if key.of_pose and key.path in c.values and not follows_pose(robot, c["mpc.space"]):
            yield f"{key.path} is of the orientation of a tip in space, which this target has not; leave it out."
    for key in CONFIGURATION_KEYS:
        if key.kind not in counts:
            continue
        value, count = c[key.path], counts[key.kind]
        if isinstance(value, tuple) and len(value) != count:
            yield f"{key.path} has {len(value)} numbers and there are {count} {key.kind}; give one, or {count}."
