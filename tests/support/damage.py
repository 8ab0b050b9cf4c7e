"""Ways in which a log of two joints is spoilt, each with what must become of it: mended, refused, or handed on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdagen.log.measured_log import Log

DEGREE = 180 / np.pi
INPUTS = ("motor_current_command", "motor_current")
POSITIONS = ("motor_position", "joint_position", "joint_position_reference")
Damage = Callable[[Log], Log]


def changed(log: Log, **columns: np.ndarray) -> Log:
    """The log with other columns in place of its own; those it does not have are left out."""
    own = {name: values for name, values in columns.items() if name in log.columns}
    return Log(log.time, log.columns | own, log.n_joints, log.source)


def kept(log: Log, rows: np.ndarray) -> Log:
    """Those rows of the log."""
    return Log(log.time[rows], {n: v[rows] for n, v in log.columns.items()}, log.n_joints, log.source)


def each(change: Callable[[np.ndarray], np.ndarray], *names: str) -> Damage:
    """``change`` of the columns ``names``."""
    return lambda log: changed(log, **{name: change(log[name]) for name in names if name in log})


def both(*bases: str) -> list[str]:
    """The columns of both joints."""
    return [f"{base}_{j}" for base in bases for j in (1, 2)]


def times(factor: float, *names: str) -> Damage:
    return each(lambda values: factor * values, *names)


def swapped(*bases: str) -> Damage:
    def swap(log: Log) -> Log:
        return changed(log, **{f"{b}_{j}": log[f"{b}_{3 - j}"] for b in bases for j in (1, 2) if f"{b}_1" in log})

    return swap


def later(rows: int, *names: str) -> Damage:
    return each(lambda values: values[np.clip(np.arange(len(values)) - rows, 0, len(values) - 1)], *names)


def cut(share: float, *names: str) -> Damage:
    """Cut off at a share of the largest size of the first."""

    def clip(log: Log) -> Log:
        bound = share * np.abs(log[names[0]]).max()
        return changed(log, **{name: np.clip(log[name], -bound, bound) for name in names})

    return clip


def dropped(share: float, timed: bool = True) -> Damage:
    """Rows lost at random; not ``timed``: the time column is numbered through after the loss."""

    def drop(log: Log) -> Log:
        rows = np.random.default_rng(3).random(len(log)) > share
        rows[[0, -1]] = True
        left = kept(log, rows)
        return left if timed else Log(log.time[: len(left)], left.columns, log.n_joints, log.source)

    return drop


def holes(name: str, first: int, count: int) -> Damage:
    """``count`` rows without a value from row ``first`` on."""

    def hole(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[first : first + count] = np.nan
        return values

    return each(hole, name)


def spiked(name: str, value: float, *rows: int) -> Damage:
    """``value`` in those rows."""

    def spike(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[list(rows)] = value
        return values

    return each(spike, name)


def sparse(name: str, share: float) -> Damage:
    """No value in a share of the rows, at random."""
    return each(lambda v: np.where(np.random.default_rng(5).random(len(v)) < share, np.nan, v), name)


def repeated(share: float) -> Damage:
    """A share of the rows, at random, holds what the row before does, but for the time."""

    def repeat(log: Log) -> Log:
        rows = np.arange(len(log))
        rows[np.random.default_rng(6).random(len(log)) < share] -= 1
        rows = np.maximum(rows, 0)
        return changed(log, **{name: values[rows] for name, values in log.columns.items()})

    return repeat


def frozen(name: str, first: float, share: float) -> Damage:
    """One reading for a share of the log, from ``first``, a share too, on."""

    def freeze(values: np.ndarray) -> np.ndarray:
        values, row = values.copy(), round(first * len(values))
        values[row : row + round(share * len(values))] = values[row]
        return values

    return each(freeze, name)


def set_anew(name: str, row: int, by: float) -> Damage:
    """``by`` more from that row on."""
    return each(lambda values: values + np.where(np.arange(len(values)) < row, 0.0, by), name)


def stuck(*names: str) -> Damage:
    return each(lambda values: np.full_like(values, values[0]), *names)


def wrapped(*names: str) -> Damage:
    return each(lambda values: values % (2 * np.pi), *names)


def without(log: Log, *bases: str) -> Log:
    """The log without these quantities, at every joint."""
    columns = {name: values for name, values in log.columns.items() if name.rpartition("_")[0] not in bases}
    return Log(log.time, columns, log.n_joints, log.source)


# what is wrong: (damage, the names of what is mended, exactly so that the log is as it was)
MENDED: dict[str, tuple[Damage, set[str]]] = {
    "motor in degrees": (times(DEGREE, "motor_position_1"), {"degrees"}),
    "joint in degrees": (times(DEGREE, "joint_position_2"), {"degrees"}),
    "both encoders in degrees": (times(DEGREE, "joint_position_1", "motor_position_1"), {"degrees"}),
    "all in degrees": (times(DEGREE, *both(*POSITIONS)), {"degrees"}),
    "currents in milliamperes": (times(1e3, *both(*INPUTS)), {"milliamperes"}),
    "one measured current in milliamperes": (times(1e3, "motor_current_2"), {"milliamperes"}),
    "one command in milliamperes": (times(1e3, "motor_current_command_2"), {"milliamperes"}),
    "a motor encoder wraps": (wrapped("motor_position_1"), {"wrapped"}),
    "both motor encoders wrap": (wrapped(*both("motor_position")), {"wrapped"}),
    "a motor encoder loses a turn": (set_anew("motor_position_1", 1200, -2 * np.pi), {"wrapped"}),
    "a command logged late": (later(5, *both("motor_current_command")), {"row_shift"}),
}
# what is wrong: (damage, the names of what is mended, the log being another one afterwards)
LESSENED: dict[str, tuple[Damage, set[str]]] = {
    "3 % of the rows lost": (dropped(0.03), {"dropped"}),
    "5 % of the rows lost": (dropped(0.05), {"dropped"}),
    "a short hole": (holes("motor_position_1", 1000, 8), {"missing", "dropped"}),
    "a long hole": (holes("motor_current_1", 1000, 100), {"missing", "dropped"}),
    "one huge measured current": (spiked("motor_current_1", 1e5, 1000), {"spike", "dropped"}),
    "two commands beyond the drive": (spiked("motor_current_command_2", -100.0, 700, 1500), {"spike", "dropped"}),
    "a reading that is wrong": (
        lambda log: set_anew("joint_position_1", 801, -0.3)(set_anew("joint_position_1", 800, 0.3)(log)),
        {"glitch", "dropped"},
    ),
    "3 % of the rows repeated": (repeated(0.03), {"stale", "dropped"}),
    "a motor encoder frozen": (frozen("motor_position_2", 0.3, 0.06), {"stale", "dropped"}),
    "a joint encoder frozen": (frozen("joint_position_1", 0.6, 0.05), {"stale", "dropped"}),
    "a measured current frozen": (frozen("motor_current_2", 0.5, 0.07), {"stale", "dropped"}),
    "3 % without a value": (sparse("joint_position_2", 0.03), {"missing", "dropped"}),
    "the command under the name of a measurement": (
        lambda log: changed(log, motor_current_1=log["motor_current_command_1"]),
        {"row_shift"},
    ),
}
# what is wrong: (damage, a word of the sentence with which it is refused)
REFUSED: dict[str, tuple[Damage, str]] = {
    "current reversed": (times(-1, "motor_current_1", "motor_current_command_1"), "reversed"),
    "measured current reversed": (times(-1, "motor_current_1"), "reversed"),
    "command reversed": (times(-1, "motor_current_command_2"), "reversed"),
    "joint encoder reversed": (times(-1, "joint_position_2"), "reversed"),
    "motor encoder reversed": (times(-1, "motor_position_1"), "reversed"),
    "both encoders reversed": (times(-1, *[f"{b}_1" for b in POSITIONS]), "reversed"),
    "joints swapped": (swapped(*INPUTS, *POSITIONS), "logged as the other's"),
    "motor encoders swapped": (swapped("motor_position"), "swapped"),
    "joint encoders swapped": (swapped("joint_position"), "swapped"),
    "currents swapped": (swapped(*INPUTS), "swapped"),
    "commands swapped": (swapped("motor_current_command"), "swapped"),
    "encoders swapped": (swapped("motor_position", "joint_position"), "swapped"),
    "30 % of the rows lost": (dropped(0.3), "too many"),
    "rows lost and numbered through": (dropped(0.03, timed=False), "rows were lost"),
    "shorter than a second": (lambda log: log.rows(500, 1200), "lasts 0.699 s"),
    "40 % without a value": (sparse("joint_position_2", 0.4), "too many"),
    "motor encoder stuck": (stuck("motor_position_1"), "stays at"),
    "joint encoder stuck": (stuck("joint_position_2"), "stays at"),
    "command stuck": (stuck("motor_current_command_1"), "stays at"),
    "measured current stuck": (stuck("motor_current_1"), "stays at"),
    "currents stuck": (stuck("motor_current_1", "motor_current_command_1"), "stays at"),
    "currents zero": (times(0, "motor_current_1", "motor_current_command_1"), "stays at"),
    "motor encoder out of range": (cut(0.7, "motor_position_1"), "range has ended|stays at"),
    "joint encoder out of range": (cut(0.7, "joint_position_2"), "range has ended"),
    "motor encoder frozen for long": (frozen("motor_position_1", 0.2, 0.25), "repeats the row before"),
    "joint encoder set anew": (set_anew("joint_position_2", 1500, 0.05), "set anew"),
    "nothing moves": (stuck(*both(*POSITIONS)), "no joint moves"),
}
