"""The chain in space against Pinocchio, MuJoCo and SymPy, none of which shares a line with gen, and its folding."""

from __future__ import annotations

import sysconfig
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest
import robots
import space_robots
import sympy as sp
from compiled import Floats
from graphs import assembled

from gen.builder.build_files import count_operations
from gen.model.robot_chain import make_chain
from gen.model.symmetric_matrices import solve_symmetric
from gen.robot.load_robot import from_table
from gen.robot.model_parameters import list_parameters
from hdagen.model_import.chain_reduction import ChainRequest
from hdagen.model_import.robot_writing import import_model

KINDS = ("R", "P", "RR", "PR", "RP", "RRR", "PRP", "RRPR", "RRRRR", "RPRRRR", "RRRRRR", "RRRRRRR", "PRRRPRR")
CHAINS = [space_robots.chain(kinds, seed, aligned) for seed, kinds in enumerate(KINDS) for aligned in (False, True)]
LONG = [space_robots.chain("R" * 12, 3), space_robots.chain("RRPRRRPRRRRR", 4)]
MIXED = space_robots.mixed_chains(20)
STATES = 50  # of each chain: 1,300 in all
CAMPAIGN_STATES = 10_000
BOUND = 1e-10  # relative to the size of each state's result

World = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


# -- the three sides ------------------------------------------------------------------------------------------------


@cache
def graph(text: str) -> ca.Function:
    """The chain of gen: (q, v, a, wrench, torque) -> everything that is compared, for the file's numbers."""
    robot = from_table(tomllib.loads(text), "robot.toml", Path("robot.toml"))
    chain, n = make_chain(robot), len(robot.joints)
    p: dict[str, Any] = {value.name: value.nominal for value in list_parameters(robot)}
    q, v, a = (ca.SX.sym(name, n) for name in "qva")
    wrench, torque = ca.SX.sym("wrench", 6), ca.SX.sym("torque", n)
    gravity, J = chain.gravity(p), chain.tip_jacobian(q, p)
    rotors = np.diag([joint.drive.motor_inertia.nominal for joint in robot.joints])
    M, bias = chain.mass_matrix(q, p), chain.bias_torque(q, v, p)
    load = torque - chain.newton_euler(q, v, [0] * n, p, gravity, ca.vertsplit(wrench))
    moments = chain.mass_moments(q, p)
    found = {
        "mass_matrix": M,
        "bias": bias,
        "gravity": chain.gravity_torque(q, p),
        "torque": chain.newton_euler(q, v, ca.vertsplit(a), p, gravity, ca.vertsplit(wrench)),
        "jacobian": J,
        "drift": ca.jtimes(J @ v, q, v),
        "jacobian_rate": ca.jtimes(J, q, v),
        "tip": chain.tip_position(q, p),
        "rotation": chain.tip_rotation(q),
        "acceleration": solve_symmetric(M + rotors, load),
        "kinetic": v.T @ M @ v / 2,
        "potential": -sum(moments[j, k] * gravity[k] for j in range(n) for k in range(3)),
    }
    return ca.Function("chain", [q, v, a, wrench, torque], list(found.values()), list("qvawt"), list(found))


class Pinocchio:
    """The same robot in Pinocchio, joint by joint; rotors as armature."""

    def __init__(self, text: str) -> None:
        table = tomllib.loads(text)
        self.model = pin.Model()
        self.model.gravity.linear = np.array(table["gravity"])
        parent = 0
        for j, joint in enumerate(table["joint"], 1):
            sort = {"revolute": pin.JointModelRevoluteUnaligned, "prismatic": pin.JointModelPrismaticUnaligned}
            kind = sort[joint["type"]](np.array(joint["axis"]))
            parent = self.model.addJoint(parent, kind, place(joint), f"joint_{j}")
            xx, yy, zz, xy, xz, yz = joint["inertia"]
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            body = pin.Inertia(joint["mass"], np.array(joint["center_of_mass"]), tensor)
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        self.tip = self.model.addFrame(pin.Frame("tip", parent, 0, place(table["tip"]), pin.FrameType.OP_FRAME))
        self.rotors = np.diag([joint["drive"]["motor_inertia"] for joint in table["joint"]])
        self.data = self.model.createData()

    @classmethod
    def of_urdf(cls, path: Path, joints: list[str], tip: str) -> Pinocchio:
        """The same of a URDF by Pinocchio's own parser, right angles exact, every other joint held at 0."""
        self = cls.__new__(cls)
        text = path.read_text().replace("1.57079632679", repr(np.pi / 2)).replace("3.14159265359", repr(np.pi))
        whole = pin.buildModelFromXML(text)
        others = [whole.getJointId(name) for name in whole.names[1:] if name not in joints]
        self.model = pin.buildReducedModel(whole, others, pin.neutral(whole))
        self.tip, self.rotors = self.model.getFrameId(tip), np.zeros((len(joints), len(joints)))
        self.data = self.model.createData()
        return self

    def all(self, q: Floats, v: Floats, a: Floats, wrench: Floats, torque: Floats) -> dict[str, Any]:
        """Everything that is compared."""
        m, d = self.model, self.data
        out: dict[str, Any] = {"bias": pin.nonLinearEffects(m, d, q, v).copy()}
        out["gravity"] = pin.computeGeneralizedGravity(m, d, q).copy()
        M = pin.crba(m, d, q)
        out["mass_matrix"] = M = np.triu(M) + np.triu(M, 1).T
        out["kinetic"], out["potential"] = pin.computeKineticEnergy(m, d, q, v), pin.computePotentialEnergy(m, d, q)
        pin.computeJointJacobiansTimeVariation(m, d, q, v)
        pin.forwardKinematics(m, d, q, v, np.zeros_like(v))
        pin.updateFramePlacements(m, d)
        out["jacobian_rate"] = pin.getFrameJacobianTimeVariation(m, d, self.tip, World).reshape(6, -1).copy()
        drift = pin.getFrameClassicalAcceleration(m, d, self.tip, World)
        out["drift"] = np.concatenate([drift.linear, drift.angular])
        out["tip"], out["rotation"] = d.oMf[self.tip].translation.copy(), d.oMf[self.tip].rotation.copy()
        out["jacobian"] = J = pin.computeFrameJacobian(m, d, q, self.tip, World).reshape(6, -1).copy()
        out["torque"] = pin.rnea(m, d, q, v, a).copy() - J.T @ wrench
        out["acceleration"] = np.linalg.solve(M + self.rotors, torque + J.T @ wrench - out["bias"])
        return out


def place(table: dict[str, Any]) -> pin.SE3:
    """The frame of a joint or the tip."""
    w, x, y, z = table["rotation"]
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(), np.array(table["origin"]))


class MuJoCo:
    """The same robot in MuJoCo, body by body; rotors as armature."""

    def __init__(self, text: str) -> None:
        table = tomllib.loads(text)
        spec = mujoco.MjSpec()
        spec.option.gravity = table["gravity"]
        spec.compiler.degree = False
        body = spec.worldbody
        for j, joint in enumerate(table["joint"], 1):
            body = body.add_body(name=f"link_{j}", pos=joint["origin"], quat=joint["rotation"])
            kind = {"revolute": mujoco.mjtJoint.mjJNT_HINGE, "prismatic": mujoco.mjtJoint.mjJNT_SLIDE}[joint["type"]]
            body.add_joint(type=kind, axis=joint["axis"], armature=joint["drive"]["motor_inertia"])
            body.mass, body.ipos, body.fullinertia = joint["mass"], joint["center_of_mass"], joint["inertia"]
            body.explicitinertial = True
        body.add_site(name="tip", pos=table["tip"]["origin"], quat=table["tip"]["rotation"])
        self.model = spec.compile()
        self.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        self.data = mujoco.MjData(self.model)
        self.rotors = np.diag([joint["drive"]["motor_inertia"] for joint in table["joint"]])

    def all(self, q: Floats, v: Floats, a: Floats, wrench: Floats, torque: Floats) -> dict[str, Any]:
        """Everything that is compared; MuJoCo's energy counts the rotors too."""
        m, d, n = self.model, self.data, q.size
        d.qpos[:], d.qvel[:], d.qfrc_applied[:] = q, v, torque
        mujoco.mj_fwdPosition(m, d)
        full, J = np.empty((n, n)), np.empty((6, n))
        mujoco.mj_fullM(m, d, full)
        site = m.site("tip").id
        mujoco.mj_jacSite(m, d, J[:3], J[3:], site)
        mujoco.mj_applyFT(m, d, wrench[:3], wrench[3:], d.site_xpos[site], n, d.qfrc_applied)
        mujoco.mj_forward(m, d)
        return {
            "mass_matrix": full - self.rotors,
            "bias": d.qfrc_bias.copy(),
            "jacobian": J,
            "tip": d.site_xpos[site].copy(),
            "rotation": d.site_xmat[site].reshape(3, 3).copy(),
            "acceleration": d.qacc.copy(),
            "kinetic": d.energy[1] - v @ self.rotors @ v / 2,
            "potential": d.energy[0],
        }


def states(n: int, rows: int, seed: int = 7) -> tuple[Floats, ...]:
    """Random positions, velocities, accelerations, wrenches and torques."""
    rng = np.random.default_rng(seed)
    sizes = ((np.pi, n), (4.0, n), (20.0, n), (30.0, 6), (20.0, n))
    return tuple(rng.uniform(-size, size, (rows, many)) for size, many in sizes)


def compare(text: str, reference: Pinocchio | MuJoCo, rows: int) -> None:
    """Every row of every result agrees to BOUND of its size, or of the largest row's where it is nearly 0."""
    drawn = states(len(tomllib.loads(text)["joint"]), rows)
    f = graph(text)
    ours = dict(zip(f.name_out(), f.map(rows).call([ca.DM(part.T) for part in drawn]), strict=True))
    theirs = [reference.all(*row) for row in zip(*drawn, strict=True)]
    for name in theirs[0]:
        expected = np.array([np.ravel(np.asarray(row[name]).T) for row in theirs])
        shape = (f.size1_out(name), f.size2_out(name))
        found = np.array(ours[name]).reshape(shape[0], rows, shape[1]).transpose(1, 2, 0).reshape(rows, -1)
        size = np.linalg.norm(expected, axis=1)
        error = np.linalg.norm(found - expected, axis=1) / np.maximum(size, 1e-3 * max(size.max(), 1e-3))
        assert error.max() <= BOUND, f"{name}: {error.max():.3g} relative in row {error.argmax()}"


@pytest.mark.parametrize("text", CHAINS, ids=lambda text: text.split('"')[1])
def test_everything_agrees_with_pinocchio(text: str) -> None:
    compare(text, Pinocchio(text), STATES)


@pytest.mark.parametrize("text", CHAINS, ids=lambda text: text.split('"')[1])
def test_everything_agrees_with_mujoco(text: str) -> None:
    compare(text, MuJoCo(text), STATES)


URDFS = {  # links of the chain's end in real models: five of 6 and 7 joints, and one of 5
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "wrist_3_link"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link7"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "wrist_3_link"),
    "z1": ("z1_description/urdf/z1.urdf", "link06"),
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_link"),
}


def find_urdf(robot: str) -> Path:
    """A URDF of the package example-robot-data; skips where it is not installed."""
    folder = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
    if not folder.is_dir():
        pytest.skip("example-robot-data is not installed: pip install 'hdagen[robots]'")
    return folder / URDFS[robot][0]


@pytest.mark.parametrize("robot", URDFS)
@pytest.mark.parametrize("rows", [STATES, pytest.param(CAMPAIGN_STATES, marks=pytest.mark.campaign)])
def test_an_imported_urdf_is_what_pinocchio_reads(robot: str, rows: int) -> None:
    path = find_urdf(robot)
    text = import_model(str(path), ChainRequest(tip=URDFS[robot][1])).text
    joints = [joint["name"] for joint in tomllib.loads(text)["joint"]]
    assert len(joints) == {"panda": 7, "ur5": 6, "xarm7": 7, "ur10": 6, "z1": 6, "so101": 5}[robot]
    compare(text, Pinocchio.of_urdf(path, joints, URDFS[robot][1]), rows)


@pytest.mark.campaign
@pytest.mark.parametrize("text", MIXED + LONG, ids=lambda text: text.split('"')[1])
def test_ten_thousand_states_agree(text: str) -> None:
    for reference in (Pinocchio(text), MuJoCo(text)):
        compare(text, reference, CAMPAIGN_STATES)


# -- a second derivation, and the plane -----------------------------------------------------------------------------


@pytest.mark.parametrize("kinds", ["RR", "RP", "PRR"])
def test_sympys_lagrangian_agrees(kinds: str) -> None:
    """Positions of the centres of mass and rotations, differentiated by SymPy: M, and Coriolis with gravity."""
    text = space_robots.chain(kinds, 21, aligned=True)
    table, n = tomllib.loads(text), len(kinds)
    q, v = sp.symbols(f"q:{n}"), sp.symbols(f"v:{n}")
    kinetic, height, R, o = sp.S.Zero, sp.S.Zero, sp.eye(3), sp.zeros(3, 1)
    for joint, angle in zip(table["joint"], q, strict=True):
        o, R = o + R * sp.Matrix(joint["origin"]), R * sp.Matrix(place(joint).rotation.round(15))
        axis = sp.Matrix(joint["axis"])
        if joint["type"] == "prismatic":
            o = o + R * axis * angle
        else:
            K = sp.Matrix(3, 3, lambda i, k, a=axis: a.cross(sp.Matrix(np.eye(3)[:, k]))[i])
            R = R * (sp.eye(3) + sp.sin(angle) * K + (1 - sp.cos(angle)) * K * K)
        center = o + R * sp.Matrix(joint["center_of_mass"])
        speed = center.jacobian(q) * sp.Matrix(v)
        rate = sum((R.diff(one) * by for one, by in zip(q, v, strict=True)), sp.zeros(3))
        turning = R.T * rate
        spin = sp.Matrix([turning[2, 1], turning[0, 2], turning[1, 0]])
        xx, yy, zz, xy, xz, yz = joint["inertia"]
        inertia = sp.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        kinetic += joint["mass"] * speed.dot(speed) / 2 + spin.dot(inertia * spin) / 2
        height -= joint["mass"] * sp.Matrix(table["gravity"]).dot(center)
    M = sp.hessian(kinetic, v)
    momentum = M * sp.Matrix(v)
    bias = momentum.jacobian(q) * sp.Matrix(v) - sp.Matrix([sp.diff(kinetic - height, one) for one in q])
    numbers = sp.lambdify([q, v], [M, bias, kinetic, height], modules="numpy", cse=True)
    f = graph(text)
    for row in zip(*states(n, 10), strict=True):
        ours = dict(zip(f.name_out(), f(*row), strict=True))
        theirs = dict(zip(("mass_matrix", "bias", "kinetic", "potential"), numbers(row[0], row[1]), strict=True))
        for name, expected in theirs.items():
            expected = np.asarray(expected, float).reshape(ours[name].shape)  # noqa: PLW2901
            assert np.array(ours[name]) == pytest.approx(expected, rel=1e-10, abs=1e-10 * np.abs(expected).max())


PLANE_OPERATIONS = {  # of the preset `paper`, as they were before the chain left the plane
    "rhs": 233,
    "rhs_exact": 233,
    "holding": 158,
    "rhs_jacobian": 959,
    "points": 15,
    "tip_jacobian": 60,
    "mass_matrix": 21,
    "coriolis_matrix": 18,
    "gravity_torque": 31,
    "inverse_dynamics": 93,
    "energy": 309,
    "outputs": 231,
    "force_map": 48,
    "position_tick": 396,
    "impedance_cartesian_tick": 528,
}


def test_the_plane_costs_no_operation_more() -> None:
    found = {f.name: count_operations(f.graph) for f in assembled("paper").functions}
    assert {name: most for name, most in PLANE_OPERATIONS.items() if found[name] > most} == {}


def test_a_chain_in_space_that_lies_in_the_plane_is_the_one_of_the_short_form() -> None:
    """The same arm in both forms: M, bias, gravity, tip and torques under a force are equal."""
    text = robots.chain("RPR", 6)
    table = tomllib.loads(text)
    lines, end = [f'name = "flat"\ngravity = {[*table["gravity"], 0.0]}'], 0.0
    for joint in table["joint"]:
        slides, own = joint["type"] == "prismatic", joint["inertia"]
        axis = [1.0, 0.0, 0.0] if slides else [0.0, 0.0, 1.0]
        lines += ["[[joint]]", f'type = "{joint["type"]}"', f"origin = [{end}, 0.0, 0.0]", f"axis = {axis}"]
        lines += [f"mass = {joint['mass']}", f"center_of_mass = [{joint['center_of_mass']}, 0.0, 0.0]"]
        lines += [f"inertia = [{own}, {own}, {own}, 0.0, 0.0, 0.0]", "[joint.drive]"]
        lines += [f"{key} = {str(value).lower()}" for key, value in joint["drive"].items()]
        end = joint["length"]
    flat = "\n".join([*lines, "[tip]", f"origin = [{end}, 0.0, 0.0]"])
    q, v, a, wrench, torque = states(3, 20)
    wrench[:, 2:] = 0.0
    short = from_table(table, "robot.toml", Path("robot.toml"))
    chain, p = make_chain(short), {value.name: value.nominal for value in list_parameters(short)}
    for row in zip(q, v, a, wrench, torque, strict=True):
        deep = dict(zip(graph(flat).name_out(), graph(flat)(*row), strict=True))
        symbols = [ca.SX(part) for part in row[:3]]
        expected = {
            "mass_matrix": chain.mass_matrix(symbols[0], p),
            "bias": chain.bias_torque(symbols[0], symbols[1], p),
            "torque": chain.newton_euler(
                symbols[0], symbols[1], ca.vertsplit(symbols[2]), p, chain.gravity(p), row[3][:2]
            ),
        }
        for name, value in expected.items():
            assert np.array(deep[name]) == pytest.approx(np.array(ca.DM(ca.evalf(value))), rel=1e-12, abs=1e-11)
