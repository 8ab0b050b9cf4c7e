"""The arm against MuJoCo and Pinocchio, both fed from the same robot.toml and nothing else.

Neither shares a line with gen: MuJoCo reads MJCF that is written here, Pinocchio gets joints and bodies one by one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import robots
from compiled import Compiled, Floats

STATES = 10_000
BOUND = 1e-9  # relative, of each state's result as a vector
CHAINS = {kinds: robots.chain(kinds, seed) for seed, kinds in enumerate(("R", "RR", "RPR", "RRRRRR"), 1)}

FLEXIBLE = {
    kinds: robots.chain(kinds, 7, robots.LINEAR)
    + "".join(robots.effect("rotor_coupling", j, coupling=1.0) for j in range(2, len(kinds) + 1))
    for kinds in ("RR", "RPR")
}


def tag(element: str, /, *inner: str, **attributes: Any) -> str:
    """An XML element; tuples are written with spaces."""
    values = {
        key: " ".join(map(repr, value)) if isinstance(value, tuple) else value for key, value in attributes.items()
    }
    written = "".join(f' {key}="{value}"' for key, value in values.items())
    return f"<{element}{written}>{''.join(inner)}</{element}>"


def mjcf(text: str, step: float = 0.0005) -> str:
    """The robot in MuJoCo's words: rigid drives as armature, flexible ones as rotors of their own, joined by a spring.

    A rotor that `rotor_coupling` names rides on the link before its joint and turns with (1) or against (-1) it;
    0 puts it on the base.
    """
    table = tomllib.loads(text)
    joints = table["joint"]
    riding = {e["joint"]: e["coupling"] for e in table.get("effect", []) if e["name"] == "rotor_coupling"}
    inner, base, springs = tag("site", name="tip", pos=(joints[-1]["length"], 0, 0)), "", ""
    for j in range(len(joints), 0, -1):
        joint, d = joints[j - 1], joints[j - 1]["drive"]
        N, at = d["ratio"], (joints[j - 2]["length"] if j > 1 else 0.0, 0, 0)
        slides, rigid = joint.get("type") == "prismatic", d.get("rigid", False)
        rotor = {"armature": N * N * d["motor_inertia"], "damping": N * N * d["viscous_friction"]} if rigid else {}
        kind = {"type": "slide", "axis": (1, 0, 0)} if slides else {"type": "hinge", "axis": (0, 0, 1)}
        moves = tag("joint", name=f"joint_{j}", **kind, **rotor)
        weight = tag(
            "inertial", pos=(joint["center_of_mass"], 0, 0), mass=joint["mass"], diaginertia=3 * (joint["inertia"],)
        )
        inner = tag("body", moves, weight, inner, name=f"link_{j}", pos=at)
        if rigid:
            continue
        turns = {"axis": (0, 0, -1 if riding.get(j, 0) < 0 else 1), "damping": d["viscous_friction"]}
        spins = tag("inertial", pos=(0, 0, 0), mass=1e-12, diaginertia=3 * (d["motor_inertia"],))
        motor = tag("body", spins, tag("joint", name=f"motor_{j}", type="hinge", **turns), pos=at)
        inner, base = (inner + motor, base) if riding.get(j) else (inner, base + motor)
        stiffness = 1.0 / (1.0 / d["flexspline_stiffness"] + 1.0 / (N * N * d["wave_generator_stiffness"]))
        ends = tag("joint", joint=f"motor_{j}", coef=1 / N) + tag("joint", joint=f"joint_{j}", coef=-1)
        springs += tag("fixed", ends, stiffness=stiffness, damping=d["torsional_damping"], springlength=0)
    option = tag("option", gravity=(*table["gravity"], 0), integrator="RK4", timestep=step)
    return tag("mujoco", tag("compiler", angle="radian"), option, tag("worldbody", inner, base), tag("tendon", springs))


class MuJoCo:
    """The robot in MuJoCo, joints and motors in the order of our x."""

    def __init__(self, text: str, step: float = 0.0005) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(text, step))
        self.data = mujoco.MjData(self.model)
        table = tomllib.loads(text)
        self.n = len(table["joint"])
        self.ratios = np.array([joint["drive"]["ratio"] for joint in table["joint"]])
        names = [f"joint_{j}" for j in range(1, self.n + 1)]
        self.rigid = all(joint["drive"].get("rigid", False) for joint in table["joint"])
        if not self.rigid:
            names = [f"motor_{j}" for j in range(1, self.n + 1)] + names
        self.order = np.array([self.model.joint(name).dofadr[0] for name in names])

    def place(self, x: Floats, u: Floats, force: Floats) -> None:
        """State and forces: u at the motors, ``force`` on the tip; velocities and forces are then known to MuJoCo."""
        half = x.size // 2
        d = self.data
        d.qpos[self.order], d.qvel[self.order] = x[:half], x[half:]
        d.qfrc_applied[:] = 0.0
        d.qfrc_applied[self.order[: self.n]] = u * (self.ratios if self.rigid else 1.0)
        mujoco.mj_fwdPosition(self.model, d)
        self.push(force)

    def push(self, force: Floats) -> None:
        """Add the force on the tip to what is applied, at the present posture."""
        tip = self.data.site("tip").xpos
        last = self.model.body(f"link_{self.n}").id
        full = np.array([*force, 0.0])
        mujoco.mj_applyFT(self.model, self.data, full, np.zeros(3), tip, last, self.data.qfrc_applied)

    def rate(self, x: Floats, u: Floats, force: Floats) -> Floats:
        """Rate of x."""
        self.place(x, u, force)
        mujoco.mj_forward(self.model, self.data)
        return np.concatenate([x[x.size // 2 :], self.data.qacc[self.order]])


class Pinocchio:
    """The links in Pinocchio, rotors of rigid drives as armature."""

    def __init__(self, text: str) -> None:
        table = tomllib.loads(text)
        self.model = pin.Model()
        self.model.gravity.linear = np.array([*table["gravity"], 0.0])
        parent, reach = 0, 0.0
        armature, self.damping, self.ratios = [], [], []
        for j, joint in enumerate(table["joint"], 1):
            kind = pin.JointModelPX() if joint.get("type") == "prismatic" else pin.JointModelRZ()
            parent = self.model.addJoint(parent, kind, pin.SE3(np.eye(3), np.array([reach, 0.0, 0.0])), f"joint_{j}")
            com = np.array([joint["center_of_mass"], 0.0, 0.0])
            inertia = pin.Inertia(joint["mass"], com, joint["inertia"] * np.eye(3))
            self.model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
            d, reach = joint["drive"], joint["length"]
            armature.append(d["ratio"] ** 2 * d["motor_inertia"])
            self.damping.append(d["ratio"] ** 2 * d["viscous_friction"])
            self.ratios.append(d["ratio"])
        place = pin.SE3(np.eye(3), np.array([reach, 0.0, 0.0]))
        self.tip = self.model.addFrame(pin.Frame("tip", parent, 0, place, pin.FrameType.OP_FRAME))
        self.rotors = np.array(armature)
        self.data = self.model.createData()

    def all(self, q: Floats, v: Floats, a: Floats) -> dict[str, Floats]:
        """Everything that is compared, of the links alone but for ``mass_matrix``, which has the rotors."""
        m, d = self.model, self.data
        out: dict[str, Any] = {"torque": pin.rnea(m, d, q, v, a).copy()}
        out["bias"] = pin.nonLinearEffects(m, d, q, v).copy()
        out["gravity"] = pin.computeGeneralizedGravity(m, d, q).copy()
        M = pin.crba(m, d, q)
        out["mass_matrix"] = np.triu(M) + np.triu(M, 1).T + np.diag(self.rotors)
        pin.forwardKinematics(m, d, q, v, np.zeros_like(v))
        pin.updateFramePlacements(m, d)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        out["jacobian"] = pin.computeFrameJacobian(m, d, q, self.tip, world).reshape(6, -1)[:2]
        out["tip"] = d.oMf[self.tip].translation[:2].copy()
        out["tip_velocity"] = pin.getFrameVelocity(m, d, self.tip, world).linear[:2].copy()
        out["drift"] = pin.getFrameClassicalAcceleration(m, d, self.tip, world).linear[:2].copy()
        return out


def close(ours: Floats, theirs: Any, bound: float = BOUND, floor: float = 1e-9) -> None:
    """Each row agrees to ``bound`` of its own size (``floor`` of the largest row's where it is nearly 0)."""
    theirs = np.asarray(theirs).reshape(ours.shape)
    size = np.linalg.norm(theirs, axis=1)
    error = np.linalg.norm(ours - theirs, axis=1) / np.maximum(size, floor * size.max())
    worst = int(error.argmax())
    assert error[worst] <= bound, (
        f"row {worst}: {error[worst]:.3g} relative, ours {ours[worst]}, theirs {theirs[worst]}"
    )


def moves(n: int, rows: int = STATES) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Random positions, velocities, accelerations, motor torques, tip forces."""
    rng = np.random.default_rng(20)
    return (
        rng.uniform(-3.0, 3.0, (rows, n)),
        rng.uniform(-5.0, 5.0, (rows, n)),
        rng.uniform(-20.0, 20.0, (rows, n)),
        rng.uniform(-0.5, 0.5, (rows, n)),
        rng.uniform(-50.0, 50.0, (rows, 2)),
    )


Builder = Callable[..., Compiled]


@pytest.mark.parametrize("kinds", CHAINS)
def test_forward_dynamics_agree_with_mujoco(build: Builder, kinds: str) -> None:
    """Accelerations of rigid chains under motor torque, viscous friction, gravity and a tip force."""
    arm, reference = build(CHAINS[kinds]), MuJoCo(CHAINS[kinds])
    q, v, _, u, f = moves(len(kinds))
    x = np.hstack([q, v])
    ours = arm("rhs", x, np.hstack([u, f]), arm.prepare())[0]
    close(ours, [reference.rate(*row) for row in zip(x, u, f, strict=True)])


@pytest.mark.parametrize("kinds", CHAINS)
def test_every_part_agrees_with_pinocchio(build: Builder, kinds: str) -> None:
    """Mass matrix with rotors, bias, gravity, inverse dynamics, tip Jacobian, its drift, and the tip."""
    arm, reference, n = build(CHAINS[kinds]), Pinocchio(CHAINS[kinds]), len(kinds)
    q, v, a, u, f = moves(n)
    c = arm.prepare()
    rows = [reference.all(*row) for row in zip(q, v, a, strict=True)]
    theirs = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    close(arm("mass_matrix", q, c)[0], theirs["mass_matrix"])
    gravity = arm("gravity_torque", q, c)[0]
    close(gravity, theirs["gravity"])
    C = arm("coriolis_matrix", q, v, c)[0].reshape(-1, n, n).transpose(0, 2, 1)
    close(np.einsum("kij,kj->ki", C, v) + gravity, theirs["bias"])
    J, tip_velocity, drift = arm("tip_jacobian", q, v, c)
    close(J, theirs["jacobian"].transpose(0, 2, 1))
    close(tip_velocity, theirs["tip_velocity"])
    close(drift, theirs["drift"])
    close(arm("points", q, c)[0].reshape(-1, n + 1, 2)[:, n], theirs["tip"])
    pushed = theirs["torque"] - np.einsum("kij,ki->kj", theirs["jacobian"], f)
    close(arm("inverse_dynamics", q, v, a, f, c)[0], pushed)
    load = (
        u * reference.ratios - v * reference.damping + np.einsum("kij,ki->kj", theirs["jacobian"], f) - theirs["bias"]
    )
    accelerations = np.linalg.solve(theirs["mass_matrix"], load[..., None])[..., 0]
    close(arm("rhs", np.hstack([q, v]), np.hstack([u, f]), c)[0][:, n:], accelerations)


@pytest.mark.parametrize("kinds", FLEXIBLE)
@pytest.mark.parametrize("coupling", [0.0, 1.0, -1.0])
def test_flexible_drives_agree_with_mujoco(build: Builder, kinds: str, coupling: float) -> None:
    """Rotors, springs, dampers as bodies and tendons; rotors on the base, or on the link before, turning either way."""
    n = len(kinds)
    arm, reference = build(FLEXIBLE[kinds]), MuJoCo(FLEXIBLE[kinds].replace("coupling = 1.0", f"coupling = {coupling}"))
    q, v, twist, u, f = moves(n, STATES if kinds == "RR" else STATES // 10)
    N = reference.ratios
    x = np.hstack([N * (q + twist * 1e-4), q, N * (v + 0.02 * twist), v])
    c = arm.prepare(**{f"coupling_{j}": coupling for j in range(2, n + 1)})
    close(arm("rhs", x, np.hstack([u, f]), c)[0], [reference.rate(*row) for row in zip(x, u, f, strict=True)])


@pytest.mark.parametrize("text", [CHAINS["RR"], FLEXIBLE["RR"]], ids=["rigid", "flexible"])
def test_trajectory_agrees_with_mujocos_runge_kutta(build: Builder, text: str) -> None:
    """1 s in steps of 0.5 ms, torques held over 10 ms: the same method on the same equations gives the same numbers."""
    arm, reference = build(text), MuJoCo(text)
    t = np.arange(0.0, 1.0, 0.01)
    u = 0.3 * np.column_stack([np.sin(6.0 * t), np.cos(9.0 * t)])
    x0 = np.zeros(len(arm.states))
    ours = arm.rollout(x0, np.hstack([u, np.zeros((t.size, 2))]), arm.prepare(), 0.01, 0.0005)
    reference.place(x0, u[0], np.zeros(2))
    theirs = [x0]
    for row in u:
        reference.data.qfrc_applied[reference.order[:2]] = row * (reference.ratios if reference.rigid else 1.0)
        for _ in range(20):
            mujoco.mj_step(reference.model, reference.data)
        theirs.append(np.concatenate([reference.data.qpos[reference.order], reference.data.qvel[reference.order]]))
    scale = np.abs(ours).max(axis=0)
    assert scale.min() > 0.1, "an arm that hardly moves compares nothing"
    assert (np.abs(ours - np.array(theirs)) / scale).max() < 1e-9


def test_motor_torque_of_inverse_dynamics_is_what_forward_dynamics_need(build: Builder) -> None:
    """Rigid chain: the motor torque for an acceleration, put into the right-hand side, gives that acceleration."""
    arm = build(CHAINS["RPR"])
    q, v, a, _, f = moves(3)
    c = arm.prepare()
    torque = arm("inverse_dynamics", q, v, a, f, c)[1]
    close(arm("rhs", np.hstack([q, v]), np.hstack([torque, f]), c)[0][:, 3:], a)
