"""Every key of the predictive controller's controller.toml in one table: the checks and the documents are made of
it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

INF = float("inf")


@dataclass(frozen=True)
class Key:
    """A key: ``kind`` "number", "whole", "axes" (one number for all axes of the target, or one each), "joints" (the
    same for joints), "numbers" (a list), "point" (two), or "text" with ``choices``. ``default`` None: from the robot
    file, or none, as ``meaning`` says; ``needed``: it has no default. Numbers lie within ``low`` and ``high``, above
    ``low`` where ``open``."""

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


KEYS = (
    Key("mpc", "nodes", "whole", 20, "1", 2, 400, "nodes of the horizon"),
    Key("mpc", "node", "number", 0.01, "s", 0, 0.2, "how long a node lasts", open=True),
    Key(
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
    Key("mpc", "period", "number", 1e-3, "s", 1e-4, 0.05, "time from tick to tick, at most the shortest node"),
    Key("mpc", "space", "text", "tip", "", 0, 0, "where the admittance acts", choices=("tip", "joint")),
    Key(
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
    Key("mpc", "tolerance", "number", 1e-4, "1", 0, 1e-2, "OSQP's, absolute and relative", open=True),
    Key("mpc", "iterations", "whole", 4000, "1", 1, 1_000_000, "OSQP's cap"),
    Key("mpc", "delay", "whole", 0, "ticks", 0, 8, "from a sample to its use beyond what its stamp says"),
    Key("mpc", "steps", "whole", 1, "1", 1, 100, "of sequential quadratic programming a tick; 1: real-time iteration"),
    Key("admittance", "mass", "axes", 2.0, "kg", 0, 1e6, "wanted mass (joint space: kg m²)", open=True),
    Key("admittance", "damping", "axes", 45.0, "N s/m", 0, 1e6, "wanted damping (N m s/rad)"),
    Key("admittance", "stiffness", "axes", 500.0, "N/m", 0, 1e6, "wanted stiffness (N m/rad)"),
    Key("admittance", "force", "text", "sensor", "", 0, 0, "what drives it", choices=("sensor", "estimate")),
    Key(
        "admittance",
        "force_decay",
        "number",
        0.0,
        "1/s",
        0,
        1e3,
        "rate at which the tip force fades over the horizon; 0: held",
    ),
    Key("weights", "position", "number", 1e6, "1/m²", 0, 1e12, "distance from the target (1/rad²)"),
    Key("weights", "velocity", "number", 100.0, "s²/m²", 0, 1e12, "difference of velocity (s²/rad²)"),
    Key("weights", "posture", "number", 0.1, "s²/rad²", 0, 1e12, "joint speeds: what the target leaves free"),
    Key(
        "weights",
        "torque",
        "number",
        0.06,
        "1",
        0,
        1e12,
        "motor torque less what holds the arm, as a share of the motor's largest",
    ),
    Key("weights", "torque_rate", "number", 6.0, "1", 0, 1e12, "change of that share from node to node"),
    Key("weights", "terminal", "number", 10.0, "1", 0, 1e6, "factor on position and velocity at the last node"),
    Key(
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
    Key(
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
    Key(
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
    Key("limits", "motor_speed", "joints", None, "rad/s", 0, 1e6, "default: limits.speed × ratio", open=True),
    Key("limits", "joint_low", "joints", None, "rad", -1e6, 1e6, "default: limits.position of the robot file"),
    Key("limits", "joint_high", "joints", None, "rad", -1e6, 1e6, "default: limits.position of the robot file"),
    Key(
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
    Key("limits", "tip_speed", "number", 0.25, "m/s", 0, 100, "length of the tip's velocity", open=True),
    Key(
        "limits",
        "sudden",
        "number",
        0.0,
        "m/s",
        0,
        10,
        "tip speed kept free for forces that come suddenly; `hdagen mpc table` says how much 30 N needs",
    ),
    Key(
        "limits",
        "margin",
        "number",
        0.03,
        "1",
        0,
        0.4,
        "share of soft limits kept free for what the model does not know",
    ),
    Key("limits", "linear", "number", 30.0, "1", 0, 1e6, "exact penalty on a violation, per share of the limit"),
    Key("limits", "square", "number", 100.0, "1", 0, 1e9, "its quadratic part"),
    Key("wall", "normal", "point", None, "1", -1, 1, "unit vector out of the free side", needed=True),
    Key("wall", "offset", "number", None, "m", -100, 100, "the tip is kept where normal · tip ≤ offset", needed=True),
    Key("wall", "stiffness", "number", None, "N/m", 0, 1e9, "of a real surface, with force", open=True),
    Key(
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
    Key("wall", "margin", "number", 5e-4, "m", 0, 0.1, "distance kept for what the model does not know"),
    Key(
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
    Key("estimator", "torque", "joints", 0.0005, "N m/√Hz", 0, 1e6, "white torque at the motors", open=True),
    Key(
        "estimator", "disturbance", "joints", 0.03, "N m/√s", 0, 1e6, "walk of the disturbance at the motors", open=True
    ),
    Key("estimator", "load", "joints", 0.0003, "N m/√Hz", 0, 1e6, "white torque at the joints", open=True),
    Key("estimator", "force", "number", 50.0, "N/√s", 0, 1e6, "walk of the tip force", open=True),
    Key("estimator", "sensor", "number", 0.2, "N", 0, 1e6, "deviation of the force sensor", open=True),
    Key("estimator", "observer", "number", 100.0, "rad/s", 0, 1e4, "bandwidth of the momentum observer", open=True),
    Key(
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
    Key(
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
    Key(
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
    Key("fallback", "safe", "text", "damping", "", 0, 0, "after a fault", choices=("zero", "damping", "hold")),
    Key(
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
TABLES = ("mpc", "admittance", "weights", "limits", "wall", "estimator", "fallback")


def keys(table: str) -> dict[str, Key]:
    """List the keys of a table.

    Args:
        table: Name of the table.

    Returns:
        The keys by name.

    """
    return {key.name: key for key in KEYS if key.table == table}


def documented() -> str:
    """Write the table of all keys for docs/mpc.md.

    Returns:
        Markdown.

    """
    rows = ["| key | unit | default | range | meaning |", "|---|---|---|---|---|"]
    for key in KEYS:
        span = " or ".join(f"`{c}`" for c in key.choices) or f"{key.low:g} to {key.high:g}"
        rows.append(f"| `{key.path}` | {key.unit} | {key.stated_default} | {span} | {key.meaning} |")
    return "\n".join(rows) + "\n"
