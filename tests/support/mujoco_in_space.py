"""A robot.toml with joints in space as a MuJoCo model: rotors as bodies, springs as tendons, a base on hinges."""

from __future__ import annotations

import tomllib
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
KINDS = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}


def cross_matrix(a: Floats) -> Floats:
    """The matrix K with K b = a × b."""
    return np.cross(a, np.eye(3)).T


def turn_about(axis: Floats, angle: float) -> Floats:
    """The rotation (3 × 3) about a unit vector."""
    K = cross_matrix(axis)
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)


class SpatialMuJoCo:
    """The links of a robot with every [[effect]] that MuJoCo can hold; the rotors of drives with springs are bodies.

    Its coordinates in the order of our x: motors with springs, then joints; the base's turns apart.
    """

    def __init__(self, text: str, step: float = 5e-4) -> None:
        table = tomllib.loads(text)
        self.joints, self.n = table["joint"], len(table["joint"])
        stated = {(effect["name"], effect["joint"]): effect for effect in table.get("effect", [])}
        spec = mujoco.MjSpec()
        spec.option.integrator, spec.option.timestep = mujoco.mjtIntegrator.mjINT_RK4, step
        spec.option.gravity = table["gravity"]
        self._tilt(spec, stated.get(("gravity_tilt", 0)), np.array(table["gravity"]))
        body = self._add_base(spec.worldbody, stated.get(("base_compliance", 1)))
        for j, joint in enumerate(self.joints, 1):
            drive, carrier = joint["drive"], body
            body = body.add_body(name=f"link_{j}", pos=joint["origin"], quat=joint["rotation"])
            armature = 0.0 if not drive.get("rigid") else drive["ratio"] ** 2 * drive["motor_inertia"]
            damping = 0.0 if not drive.get("rigid") else drive["ratio"] ** 2 * drive["viscous_friction"]
            body.add_joint(
                name=f"joint_{j}", type=KINDS[joint["type"]], axis=joint["axis"], armature=armature, damping=damping
            )
            weight = {"mass": joint["mass"], "ipos": joint["center_of_mass"], "fullinertia": joint["inertia"]}
            body.mass, body.ipos, body.fullinertia = weight["mass"], weight["ipos"], weight["fullinertia"]
            body.explicitinertial = True
            if not drive.get("rigid"):
                coupling = stated.get(("rotor_coupling", j), {"coupling": 0.0})["coupling"]
                self._add_rotor(spec, carrier if coupling else spec.worldbody, j, coupling)
        self._add_payload(body, table, stated.get(("payload", self.n)))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        flexible = [j for j, joint in enumerate(self.joints, 1) if not joint["drive"].get("rigid")]
        names = [*(f"motor_{j}" for j in flexible), *(f"joint_{j}" for j in range(1, self.n + 1))]
        self.order = np.array([self.model.joint(name).dofadr[0] for name in names])
        self.motors = np.array([self.order[names.index(f"{'motor' if j in flexible else 'joint'}_{j}")]
                                for j in range(1, self.n + 1)])  # fmt: skip
        self.gears = np.array([1.0 if j in flexible else self.joints[j - 1]["drive"]["ratio"]
                               for j in range(1, self.n + 1)])  # fmt: skip

    def _tilt(self, spec: Any, effect: Any, gravity: Floats) -> None:
        """Turn gravity as the base turns the other way: roll about x, then pitch about y; gravity points along −z."""
        if effect is not None:
            x, y = np.eye(3)[0], np.eye(3)[1]
            base = turn_about(x, effect["tilt_roll"]) @ turn_about(y, effect["tilt_pitch"])
            spec.option.gravity = base.T @ gravity

    def _add_base(self, world: Any, effect: Any) -> Any:
        """Three hinges about x, y, z with the base's own inertia as their armature."""
        self.base_joints: list[str] = []
        if effect is None:
            return world
        C, omega = effect["base_compliance"], effect["base_frequency"]
        base = world.add_body(name="base")
        base.mass, base.inertia, base.explicitinertial = 1e-12, [1e-12] * 3, True
        for k, axis in enumerate("xyz"):
            self.base_joints.append(f"base_{axis}")
            base.add_joint(
                name=f"base_{axis}", type=KINDS["revolute"], axis=[float(k == i) for i in range(3)], stiffness=1 / C,
                damping=2 * effect["base_damping"] / (C * omega), armature=1 / (C * omega**2),
            )  # fmt: skip
        return base

    def _add_rotor(self, spec: Any, carrier: Any, j: int, coupling: float) -> None:
        """A rotor on the link before joint j, whose inertia across its axis that link then lacks."""
        joint, d = self.joints[j - 1], self.joints[j - 1]["drive"]
        slope = -1.0 if coupling < 0 else 1.0
        rotor = carrier.add_body(name=f"rotor_{j}", pos=joint["origin"], quat=joint["rotation"])
        rotor.mass, rotor.inertia, rotor.explicitinertial = 1e-12, [d["motor_inertia"]] * 3, True
        axis = [slope * part for part in joint["axis"]]
        rotor.add_joint(name=f"motor_{j}", type=KINDS["revolute"], axis=axis, damping=d["viscous_friction"])
        stiffness = 1.0 / (1.0 / d["flexspline_stiffness"] + 1.0 / (d["ratio"] ** 2 * d["wave_generator_stiffness"]))
        spring = spec.add_tendon(name=f"spring_{j}", damping=d["torsional_damping"], stiffness=stiffness)
        spring.springlength = [0.0, 0.0]
        spring.wrap_joint(f"motor_{j}", 1 / d["ratio"])
        spring.wrap_joint(f"joint_{j}", -1.0)
        if carrier.name.startswith("link_"):
            w, *v = joint["rotation"]
            K = cross_matrix(np.array(v))
            R = np.eye(3) + 2 * w * K + 2 * K @ K
            along = R @ np.array(joint["axis"])
            across = d["motor_inertia"] * (np.eye(3) - np.outer(along, along))
            xx, yy, zz, xy, xz, yz = carrier.fullinertia
            less = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - across
            carrier.fullinertia = [less[i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]

    def _add_payload(self, body: Any, table: Any, effect: Any) -> None:
        tip = body.add_body(name="tip", pos=table["tip"]["origin"], quat=table["tip"]["rotation"])
        tip.mass, tip.inertia, tip.explicitinertial = 1e-12, [1e-12] * 3, True
        if effect is not None:
            tip.mass = effect["payload_mass"]
            tip.ipos = [effect[f"payload_{axis}"] for axis in "xyz"]

    def place(self, x: Floats, u: Floats, turns: Floats | None = None, rates: Floats | None = None) -> None:
        """State and inputs: torques at the motors, then force and moment on the tip; and the base's turns."""
        d, half = self.data, self.order.size
        d.qpos[self.order], d.qvel[self.order] = x[:half], x[half : 2 * half]
        for k, name in enumerate(self.base_joints):
            address = self.model.joint(name).dofadr[0]
            d.qpos[address], d.qvel[address] = (0.0 if part is None else part[k] for part in (turns, rates))
        d.qfrc_applied[:] = 0.0
        d.qfrc_applied[self.motors] = u[: self.n] * self.gears
        mujoco.mj_fwdPosition(self.model, d)
        tip = self.model.body("tip").id
        mujoco.mj_applyFT(self.model, d, u[self.n : self.n + 3], u[self.n + 3 :], d.xpos[tip], tip, d.qfrc_applied)

    def accelerations(self) -> tuple[Floats, Floats]:
        """Of motors and joints, and of the base's turns."""
        mujoco.mj_forward(self.model, self.data)
        base = [self.data.qacc[self.model.joint(name).dofadr[0]] for name in self.base_joints]
        return self.data.qacc[self.order].copy(), np.array(base)
