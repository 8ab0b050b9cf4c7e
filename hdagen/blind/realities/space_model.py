"""Arms in space as models of MuJoCo: joints with armatures, gears that give way after a motor, and stops.

Legend: a joint whose gear gives way is two joints of MuJoCo about one axis, the motor's and the gear's after it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import mujoco

from hdagen.blind.realities.model_arms import STEP, Table

HARDEST_IMPEDANCE = 0.9999  # MuJoCo's hardest impedance
_STOP_IMPEDANCE = 1e-3  # of a stop: MuJoCo adds about this share of the joint's inertia to what meets it
_FAR = 1e6  # rad or m, of the end of a range that is never met


def write_space_model(
    table: Table,
    friction: Sequence[float],
    damping: Sequence[float],
    payload: Mapping[str, float] | None = None,
    gears: Collection[int] = (),
) -> str:
    """Write an arm in space as MJCF.

    Args:
        table: the robot file, with the links to be simulated.
        friction: dry friction of each joint, N m or N.
        damping: of each joint, N m s/rad or N s/m.
        payload: its ``mass`` and its place ``x``, ``y``, ``z`` at the tip, m.
        gears: the joints, from 1, whose gear gives way. Rotor and friction of such a joint are the motor's.

    Returns:
        The model's text, with joints ``motor1``, ``gear1`` and so on.

    """
    dry = f'solreffriction="{2 * STEP!r} 1" solimpfriction="{HARDEST_IMPEDANCE} {HARDEST_IMPEDANCE} 0.001 0.5 2"'
    bodies = []
    for j, (joint, dry_friction, slope) in enumerate(zip(table["joint"], friction, damping, strict=True), 1):
        kind = {"revolute": "hinge", "prismatic": "slide"}[joint.get("type", "revolute")]
        along = f'type="{kind}" axis="{_join(joint.get("axis", (0, 0, 1)))}"'
        gear = f'<joint name="gear{j}" {along}/>' if j in gears else ""
        bodies.append(
            f'<body pos="{_join(joint.get("origin", (0, 0, 0)))}" quat="{_join(joint.get("rotation", (1, 0, 0, 0)))}">'
            f'<joint name="motor{j}" {along} damping="{slope!r}"'
            f' armature="{joint["drive"]["motor_inertia"]!r}" frictionloss="{dry_friction!r}" {dry}/>{gear}'
            f'<inertial pos="{_join(joint["center_of_mass"])}" mass="{joint["mass"]!r}"'
            f' fullinertia="{_join(joint["inertia"])}"/>'
        )
    tip = table.get("tip", {})
    if payload:
        mass, own = payload["mass"], 1e-6 * payload["mass"]
        place = _join([payload[axis] for axis in "xyz"])
        bodies.append(
            f'<body pos="{_join(tip.get("origin", (0, 0, 0)))}" quat="{_join(tip.get("rotation", (1, 0, 0, 0)))}">'
            f'<inertial pos="{place}" mass="{mass!r}" diaginertia="{own} {own} {own}"/>'
        )
    return f"""<mujoco><option timestep="{STEP!r}" integrator="RK4" solver="Newton" tolerance="1e-12"
      gravity="{_join(table["gravity"])}"/><worldbody>{"".join(bodies)}{"</body>" * len(bodies)}</worldbody></mujoco>"""


def _join(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def set_spring(model: Any, joint: str, stiffness: float, damping: float) -> None:
    """Give a joint of MuJoCo a spring that rests at 0.

    Args:
        model: the model; it is changed.
        joint: name of the joint.
        stiffness: N m/rad or N/m.
        damping: N m s/rad or N s/m.

    """
    k = model.joint(joint).id
    model.jnt_stiffness[k], model.qpos_spring[model.jnt_qposadr[k]] = stiffness, 0.0
    model.dof_damping[model.jnt_dofadr[k]] = damping


def set_stop(model: Any, joint: str, ends: tuple[float | None, float | None], stiffness: float, damping: float) -> None:
    """Stop a joint of MuJoCo at the ends of a range; a stop pushes and never pulls.

    Args:
        model: the model; it is changed.
        joint: name of the joint.
        ends: the lowest and the highest position, rad or m; None where nothing stops it.
        stiffness: of the stop, N m/rad or N/m.
        damping: of the stop while it is met, N m s/rad or N s/m.

    """
    k = model.joint(joint).id
    low, high = ends
    model.jnt_limited[k] = 1
    model.jnt_range[k] = (-_FAR if low is None else low, _FAR if high is None else high)
    weight = float(model.dof_invweight0[model.jnt_dofadr[k]]) * (1.0 - _STOP_IMPEDANCE)
    model.jnt_solref[k] = (-stiffness * weight, -damping * weight)  # MuJoCo reads them as accelerations
    model.jnt_solimp[k] = (_STOP_IMPEDANCE, _STOP_IMPEDANCE, 0.001, 0.5, 2.0)


def measure_gear(table: Table, joint: int) -> float:
    """Measure how easily the link of a joint turns against its rotor, at the arm's zero position.

    Args:
        table: the robot file; the joint has a rotor.
        joint: its number, from 1.

    Returns:
        Acceleration of the gear by its torque, 1/(kg m²) or 1/kg.

    """
    still = [0.0] * len(table["joint"])
    model = mujoco.MjModel.from_xml_string(write_space_model(table, still, still, gears=(joint,)))
    return float(model.dof_invweight0[model.jnt_dofadr[model.joint(f"gear{joint}").id]])


def measure_inertia(table: Table, joint: int) -> float:
    """Measure the inertia that a joint moves, at the arm's zero position.

    Args:
        table: the robot file.
        joint: its number, from 1.

    Returns:
        Inertia about the joint's axis, kg m², or mass of what slides, kg, with the joint's rotor.

    """
    still = [0.0] * len(table["joint"])
    model = mujoco.MjModel.from_xml_string(write_space_model(table, still, still))
    return float(model.dof_M0[joint - 1])
