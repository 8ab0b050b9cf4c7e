"""Every key of the predictive controller's controller.toml in one table: the checks and the documents are made of
it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

INFINITY = float("inf")


@dataclass(frozen=True)
class ConfigurationKey:
    """A key: ``kind`` "number", "whole", "axes" (one number for all axes of the target, or one each), "joints" (the
    same for joints), "turns" (the same for turns about x, y, z), "numbers" (a list), "point" (two, in space three), or
    "text" with ``choices``. ``default`` None: from the robot file, or none, as ``meaning`` says; ``needed``: it has no
    default. Numbers lie within ``low`` and ``high``, above ``low`` where ``open``; ``of_pose``: of the orientation of a
    tip in space alone."""

    table: str
    name: str
    kind: str
    default: Any
    unit: str
    low: float
    high: float
    meaning: str
    open: bool = False
    needed: bool = False
    of_pose: bool = False
    choices: tuple[str, ...] = ()

    @property
    def path(self) -> str:
        """Table and name, as messages say them."""
        return f"{self.table}.{self.name}"

    @property
    def stated_default(self) -> str:
        """The default as the documents state it."""
        if self.needed:
            return "needed"
        if self.default is None:
            return ""
        return f"`{self.default}`".replace("'", '"')


CONFIGURATION_KEYS = (
    ConfigurationKey("mpc", "nodes", "whole", 20, "1", 2, 400, "nodes of the horizon"),
    ConfigurationKey("mpc", "node", "number", 0.01, "s", 0, 0.2, "how long a node lasts", open=True),
    ConfigurationKey(
        "mpc",
        "grid",
        "numbers",
        None,
        "s",
        0,
        0.2,
        "how long each node lasts, in place of node; one number a node",
        open=True,
    ),
    ConfigurationKey(
        "mpc", "period", "number", 1e-3, "s", 1e-4, 0.05, "time from tick to tick, at most the shortest node"
    ),
    ConfigurationKey("mpc", "space", "text", "tip", "", 0, 0, "where the admittance acts", choices=("tip", "joint")),
    ConfigurationKey(
        "mpc",
        "solver",
        "text",
        "riccati",
        "",
        0,
        0,
        "which solver is asked first",
        choices=("riccati", "osqp", "interior"),
    ),
    ConfigurationKey("mpc", "tolerance", "number", 1e-4, "1", 0, 1e-2, "OSQP's, absolute and relative", open=True),
    ConfigurationKey("mpc", "iterations", "whole", 4000, "1", 1, 1_000_000, "OSQP's cap"),
    ConfigurationKey("mpc", "delay", "whole", 0, "ticks", 0, 8, "from a sample to its use beyond what its stamp says"),
    ConfigurationKey(
        "mpc", "steps", "whole", 1, "1", 1, 100, "of sequential quadratic programming a tick; 1: real-time iteration"
    ),
    ConfigurationKey("admittance", "mass", "axes", 2.0, "kg", 0, 1e6, "wanted mass (joint space: kg m²)", open=True),
    ConfigurationKey("admittance", "damping", "axes", 45.0, "N s/m", 0, 1e6, "wanted damping (N m s/rad)"),
    ConfigurationKey("admittance", "stiffness", "axes", 500.0, "N/m", 0, 1e6, "wanted stiffness (N m/rad)"),
    ConfigurationKey(
        "admittance",
        "rotation_mass",
        "turns",
        0.1,
        "kg m²",
        0,
        1e6,
        "wanted inertia of a tip in space about x, y, z",
        of_pose=True,
        open=True,
    ),
    ConfigurationKey(
        "admittance",
        "rotation_damping",
        "turns",
        2.0,
        "N m s/rad",
        0,
        1e6,
        "wanted damping of a tip in space about x, y, z",
        of_pose=True,
    ),
    ConfigurationKey(
        "admittance",
        "rotation_stiffness",
        "turns",
        20.0,
        "N m/rad",
        0,
        1e6,
        "wanted stiffness of a tip in space about x, y, z",
        of_pose=True,
    ),
    ConfigurationKey(
        "admittance", "force", "text", "sensor", "", 0, 0, "what drives it", choices=("sensor", "estimate")
    ),
    ConfigurationKey(
        "admittance",
        "force_decay",
        "number",
        0.0,
        "1/s",
        0,
        1e3,
        "rate at which the tip force fades over the horizon; 0: held",
    ),
    ConfigurationKey("weights", "position", "number", 1e6, "1/m²", 0, 1e12, "distance from the target (1/rad²)"),
    ConfigurationKey("weights", "velocity", "number", 100.0, "s²/m²", 0, 1e12, "difference of velocity (s²/rad²)"),
    ConfigurationKey(
        "weights",
        "orientation",
        "number",
        None,
        "1/rad²",
        0,
        1e12,
        "turn of a tip in space from the target's orientation; default: 1e5, of fewer than six joints 1",
        of_pose=True,
    ),
    ConfigurationKey(
        "weights",
        "turning",
        "number",
        None,
        "s²/rad²",
        0,
        1e12,
        "difference of angular velocity; default: 10, of fewer than six joints 1e-4",
        of_pose=True,
    ),
    ConfigurationKey(
        "weights", "posture", "number", 0.1, "s²/rad²", 0, 1e12, "joint speeds: what the target leaves free"
    ),
    ConfigurationKey(
        "weights",
        "torque",
        "number",
        0.06,
        "1",
        0,
        1e12,
        "motor torque less what holds the arm, as a share of the motor's largest",
    ),
    ConfigurationKey("weights", "torque_rate", "number", 6.0, "1", 0, 1e12, "change of that share from node to node"),
    ConfigurationKey(
        "weights", "terminal", "number", 10.0, "1", 0, 1e6, "factor on position and velocity at the last node"
    ),
    ConfigurationKey(
        "limits",
        "motor_torque",
        "joints",
        None,
        "N m",
        0,
        1e6,
        "at the motor; default: max_current × torque_constant",
        open=True,
    ),
    ConfigurationKey(
        "limits",
        "motor_current",
        "joints",
        None,
        "A",
        0,
        1e6,
        "default: max_current; the smaller of both limits holds",
        open=True,
    ),
    ConfigurationKey(
        "limits",
        "torque_rate",
        "joints",
        None,
        "N m/s",
        0,
        1e9,
        "default: limits.motor_torque_rate of the robot file",
        open=True,
    ),
    ConfigurationKey(
        "limits", "motor_speed", "joints", None, "rad/s", 0, 1e6, "default: limits.speed × ratio", open=True
    ),
    ConfigurationKey(
        "limits", "joint_low", "joints", None, "rad", -1e6, 1e6, "default: limits.position of the robot file"
    ),
    ConfigurationKey(
        "limits", "joint_high", "joints", None, "rad", -1e6, 1e6, "default: limits.position of the robot file"
    ),
    ConfigurationKey(
        "limits",
        "joint_torque",
        "joints",
        None,
        "N m",
        0,
        1e6,
        "at the flexspline; default: limits.torque (catalogue: repeated peak)",
        open=True,
    ),
    ConfigurationKey("limits", "tip_speed", "number", 0.25, "m/s", 0, 100, "length of the tip's velocity", open=True),
    ConfigurationKey(
        "limits",
        "sudden",
        "number",
        0.0,
        "m/s",
        0,
        10,
        "tip speed kept free for forces that come suddenly; `hdagen mpc table` says how much 30 N needs",
    ),
    ConfigurationKey(
        "limits",
        "margin",
        "number",
        0.03,
        "1",
        0,
        0.4,
        "share of soft limits kept free for what the model does not know",
    ),
    ConfigurationKey(
        "limits", "linear", "number", 30.0, "1", 0, 1e6, "exact penalty on a violation, per share of the limit"
    ),
    ConfigurationKey("limits", "square", "number", 100.0, "1", 0, 1e9, "its quadratic part"),
    ConfigurationKey("wall", "normal", "point", None, "1", -1, 1, "unit vector out of the free side", needed=True),
    ConfigurationKey(
        "wall", "offset", "number", None, "m", -100, 100, "the tip is kept where normal · tip ≤ offset", needed=True
    ),
    ConfigurationKey("wall", "stiffness", "number", None, "N/m", 0, 1e9, "of a real surface, with force", open=True),
    ConfigurationKey(
        "wall",
        "force",
        "number",
        None,
        "N",
        0,
        1e6,
        "contact force allowed: the tip may enter by force / stiffness",
        open=True,
    ),
    ConfigurationKey("wall", "margin", "number", 5e-4, "m", 0, 0.1, "distance kept for what the model does not know"),
    ConfigurationKey(
        "estimator",
        "acting",
        "text",
        "sent",
        "",
        0,
        0,
        "the torque that acted before a sample: the one sent, or motor_torque as the current sensor measures it",
        choices=("sent", "measured"),
    ),
    ConfigurationKey(
        "estimator", "torque", "joints", 0.0005, "N m/√Hz", 0, 1e6, "white torque at the motors", open=True
    ),
    ConfigurationKey(
        "estimator", "disturbance", "joints", 0.03, "N m/√s", 0, 1e6, "walk of the disturbance at the motors", open=True
    ),
    ConfigurationKey("estimator", "load", "joints", 0.0003, "N m/√Hz", 0, 1e6, "white torque at the joints", open=True),
    ConfigurationKey("estimator", "force", "number", 50.0, "N/√s", 0, 1e6, "walk of the tip force", open=True),
    ConfigurationKey("estimator", "sensor", "number", 0.2, "N", 0, 1e6, "deviation of the force sensor", open=True),
    ConfigurationKey(
        "estimator",
        "moment",
        "number",
        5.0,
        "N m/√s",
        0,
        1e6,
        "walk of the moment on a tip in space",
        open=True,
        of_pose=True,
    ),
    ConfigurationKey(
        "estimator",
        "moment_sensor",
        "number",
        0.02,
        "N m",
        0,
        1e6,
        "deviation of the moment sensor",
        open=True,
        of_pose=True,
    ),
    ConfigurationKey(
        "estimator", "observer", "number", 100.0, "rad/s", 0, 1e4, "bandwidth of the momentum observer", open=True
    ),
    ConfigurationKey(
        "estimator",
        "collision",
        "number",
        6.0,
        "N",
        0,
        1e6,
        "sudden change of the observed force that is called a collision",
        open=True,
    ),
    ConfigurationKey(
        "estimator",
        "friction_width",
        "joints",
        None,
        "rad/s",
        0,
        1e4,
        "of friction's smooth sign in the prediction; default: what dry friction changes the motor's speed by "
        "in a node",
        open=True,
    ),
    ConfigurationKey(
        "fallback",
        "bandwidth",
        "number",
        20.0,
        "rad/s",
        0,
        1e3,
        "of the impedance on the ladder, critically damped",
        open=True,
    ),
    ConfigurationKey(
        "fallback", "safe", "text", "damping", "", 0, 0, "after a fault", choices=("zero", "damping", "hold")
    ),
    ConfigurationKey(
        "fallback",
        "force_limit",
        "number",
        None,
        "N",
        0,
        1e6,
        "the guard's limit of the static tip force; default: none",
        open=True,
    ),
)
CONFIGURATION_TABLES = ("mpc", "admittance", "weights", "limits", "wall", "estimator", "fallback")


def keys_of_table(table: str) -> dict[str, ConfigurationKey]:
    """List the keys of a table.

    Args:
        table: Name of the table.

    Returns:
        The keys by name.

    """
    return {key.name: key for key in CONFIGURATION_KEYS if key.table == table}


def format_key_table() -> str:
    """Write the table of all keys as Markdown.

    Returns:
        The table.

    """
    rows = ["| key | unit | default | range | meaning |", "|---|---|---|---|---|"]
    for key in CONFIGURATION_KEYS:
        span = " or ".join(f"`{c}`" for c in key.choices) or f"{key.low:g} to {key.high:g}"
        rows.append(f"| `{key.path}` | {key.unit} | {key.stated_default} | {span} | {key.meaning} |")
    return "\n".join(rows) + "\n"
