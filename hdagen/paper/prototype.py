"""The virtual prototype and how it is driven: arms, controllers, sensors, motions, and runs that figures share.

Its numbers stand in the preset `paper_prototype`, each with its source. What is stated here is how it is used: the
paper names neither the inner loop of its controllers nor the size of most pushes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from hdagen.control import Controller, Guard, Safe
from hdagen.log import Log
from hdagen.plant import Arm, Array, load
from hdagen.reference import Reference, circle
from hdagen.robot_file import RobotFile
from hdagen.simulation import Push, Sensors, Simulation, run

ROBOT = "paper_prototype"
TABLE_1 = "paper_table1"
THREE = "paper_three_joints"
LEAN = "paper_prototype, lean"
LAWS = {"impedance": "impedance_cartesian", "admittance": "admittance_cartesian"}
PERIOD = 1e-3  # s, of controller and CAN
# Inner loops that 42 counts a turn carry: half of what encoders of 4096 counts do (`Controller`'s own: 50, 100, 80 Hz).
INNER = {"bandwidth": 25.0, "observer_bandwidth": 20.0, "velocity_cutoff": 20.0}  # rad/s, rad/s, Hz
FINE_INNER = {"bandwidth": 50.0, "observer_bandwidth": 100.0, "velocity_cutoff": 80.0}
ENCODER = 2 * np.pi / 4096  # rad, of a motor encoder beside the paper's Hall sensors
JITTER, SWITCHING = (
    0.5,
    2.5e-3,
)  # counts rms of an encoder's angle; rad rms at the motor at most: assumed, as the preset
DISC = 2 * np.pi / 2**18  # rad, of the optical disc
SAFE_DAMPING = 2e-3  # N m s/rad at the motors: after a fault they stop within J/d = 46 ms
JUMP = 2.0  # rad of a motor in a tick: five times its largest speed, and more than a count of a Hall sensor
RADIUS, CENTER, TURN = 0.05, (0.2, 0.0), 5.0  # m, III.C; m and s are assumed: the middle of the workspace, 63 mm/s
PUSH = 10.0  # N, assumed; the paper names none. Larger ones take soft settings out of reach
PUSHES = (Push(3.0, 4.0, (PUSH, 0.0)), Push(6.0, 7.0, (0.0, PUSH)))  # times: III.C
BANDS = ((3.0, 4.0, f"{PUSH:g} N in x"), (6.0, 7.0, f"{PUSH:g} N in y"))
TORSION = ("kinematic_square", "kinematic_cube", "kinematic_fourth", "kinematic_fifth")
STRUCTURE: dict[str, dict[str, float]] = {  # of the printed parts, V; the paper gives no size: assumed
    "play of 1 arcmin in the printed parts": {"backlash_angle_1": 2.9e-4, "backlash_angle_2": 2.9e-4},
    "links that bend at 24 Hz": {"link_share_1": 0.2, "link_share_2": 0.2},
    "mounting that yields": {"base_compliance_1": 2e-5},
}
A = (6.57e-5, 0.0018, 0.0032, -0.0017, 2.68e-4, -1.27e-4)  # rad, IV.A, of joint 1 over turns
B = (1.72e-4, 9.47e-4, -0.0017, 3.47e-4, 7.94e-4, -3.67e-4)  # of joint 2

T = TypeVar("T")


@dataclass
class Bench:
    """Arms that are built once, and runs that more than one figure shows; ``threads`` for sweeps, ``folders`` the
    builds by robot."""

    profile: str = "native"
    threads: int = 2
    folders: dict[str, Path] = field(default_factory=dict)
    _shared: dict[Any, Any] = field(default_factory=dict)

    def arm(self, robot: str = ROBOT, changes: Mapping[str, float] | None = None) -> Arm:
        """An arm of its own, with parameters changed by name."""
        arm = Arm(self.folders[robot]) if robot in self.folders else load(robot, self.profile)
        self.folders[robot] = arm.folder
        arm.parameters.update(changes or {})
        return arm

    def lean(self) -> Arm:
        """The prototype built without the effects that are switched off in it: the same numbers, sooner."""
        if LEAN not in self.folders:
            whole = self.arm()
            file = _preset(ROBOT, whole)
            file.drop_idle()
            with TemporaryDirectory() as place:
                path = Path(place) / "lean.toml"
                path.write_bytes(file.text())
                self.folders[LEAN] = load(path, self.profile, out=whole.folder.parent).folder
        return self.arm(LEAN)

    def robot_file(self, changes: Mapping[str, float], robot: str = ROBOT, sensors: Sensors | None = None) -> bytes:
        """The preset's file with parameters and sensors changed, as `hdagen replay` takes it; sensors as the preset
        has them where ``sensors`` says nothing."""

        def make() -> bytes:
            arm = self.arm(robot, changes)
            file = _preset(robot, arm)
            for name, value in changes.items():
                file.put(file.place(name), value)
            file.settle(arm)
            return file.text()

        text = self.once(("robot file", robot, tuple(sorted(changes.items()))), make)
        return _with_sensors(text, sensors or Sensors())

    def once(self, key: Any, make: Callable[[], T]) -> T:
        """What ``make`` gives, made at its first use."""
        if key not in self._shared:
            self._shared[key] = make()
        found: T = self._shared[key]
        return found


def _preset(robot: str, arm: Arm) -> RobotFile:
    return RobotFile((Path(__file__).parents[2] / "gen" / "presets" / f"{robot}.toml").read_bytes(), arm)


def _with_sensors(text: bytes, sensors: Sensors) -> bytes:
    """A robot file whose joints all have these encoders."""
    for side, resolution, noise in (
        (b"motor", sensors.motor_resolution, sensors.motor_noise),
        (b"joint", sensors.joint_resolution, sensors.joint_noise),
    ):
        for what, values in ((b"resolution", resolution), (b"noise", noise)):
            if values is not None:
                line = rb"(%s_encoder_%s = )[^ #\n]*" % (side, what)
                text = re.sub(line, rb"\g<1>%.17g" % values[0], text)
    return text


def uncompensated(arm: Arm) -> dict[str, float]:
    """The changes that make a model know nothing of kinematic torsion."""
    return {name: 0.0 for name in arm.parameters if name.startswith(("kinematic_", "ratio_error_"))}


def torsion_of(j: int, coefficients: Sequence[float]) -> dict[str, float]:
    """The changes that give joint j the torsion Σ a_k s^k, s in turns: a_0 is a zero of the joint's encoder, the linear
    part a ratio; with the minus sign of (14)."""
    changes = {f"{name}_{j}": -float(a) for name, a in zip(TORSION, coefficients[2:], strict=True)}
    changes[f"ratio_error_{j}"] = -float(sum(coefficients[1:])) / (2 * np.pi)
    changes[f"encoder_bias_{j}"] = -float(coefficients[0])
    return changes


def guard(n: int = 2, period: float = PERIOD) -> Guard:
    """The guard of all runs."""
    return Guard(Safe.DAMPING, period, safe_damping=(SAFE_DAMPING,) * n, motor_jump=(JUMP,) * n)


def controller(known: Arm, law: str, gains: Mapping[str, float] | None = None, fine: bool = False) -> Controller:
    """A law of ``known``, the arm as the controller believes it, with the inner loop of Hall sensors, or ``fine``."""
    inner = FINE_INNER if fine else INNER
    return Controller(known, LAWS.get(law, law), guard(known.n), {**inner, **(gains or {})})


def cartesian(mass: float, damping: float, stiffness: float) -> dict[str, float]:
    """Gains of a Cartesian law, the same in both axes."""
    values = {"mass": mass, "damping": damping, "stiffness": stiffness}
    return {f"{name}_{axis}": value for name, value in values.items() for axis in "xy"}


def turns(seconds: float = 10.0, radius: float = RADIUS) -> Reference:
    """The circle of III.C."""
    return circle(radius, CENTER, TURN, seconds, PERIOD)


def fine_sensors(n: int = 2) -> Sensors:
    """4096 counts a turn at the motors in place of Hall sensors."""
    return Sensors(motor_resolution=(ENCODER,) * n, motor_noise=(JITTER * ENCODER,) * n)


def encoders(counts: int, bits: int) -> Sensors:
    """``counts`` a turn at both motors, discs of 2^``bits``."""
    motor, joint = 2 * np.pi / counts, 2 * np.pi / 2**bits
    noise = min(JITTER * motor, SWITCHING), JITTER * joint
    return Sensors((motor,) * 2, (joint,) * 2, motor_noise=(noise[0],) * 2, joint_noise=(noise[1],) * 2)


@dataclass(frozen=True)
class Driven:
    """An arm under given currents: log, and the truth at its rows: state (T, nx), joint torque (T, n), tip (T, 2)."""

    log: Log
    state: Array
    joint_torque: Array
    tip: Array


def driven(
    arm: Arm, current: Array, push: Array, q: ArrayLike, sensors: Sensors | None = None, seed: int = 0
) -> Driven:
    """``current`` (T, n, A) commanded and ``push`` (T, 2, N) on the tip, from rest at joint positions ``q``; dry
    friction set-valued. The log holds what sensors read, the joint torque sensors too."""
    from hdagen.sensors import errors

    scheme, random, n = errors(arm, sensors or Sensors()), np.random.default_rng(seed), arm.n
    mean, acting = arm.acting(current, PERIOD, np.zeros(n))
    state = arm.rollout(arm.rest(q), np.hstack([mean, push]), PERIOD, exact=True)[:-1]
    truth = arm.outputs(state, np.hstack([acting, push]))
    raw = np.hstack([truth["motor_position"], truth["joint_position"]])
    seen = scheme.read(raw + scheme.encoder_noise(len(raw), seed))
    torque_noise = np.array([joint["sensor"]["torque_noise"] for joint in arm.robot["joints"]])
    measured = acting + random.normal(size=acting.shape) * scheme.current_noise
    sensed = truth["joint_torque"] + random.normal(size=acting.shape) * torque_noise
    felt = push + random.normal(size=push.shape) * scheme.force_noise
    columns: dict[str, Array] = {}
    for j in range(n):
        columns |= {
            f"motor_current_command_{j + 1}": current[:, j], f"motor_current_{j + 1}": measured[:, j],
            f"motor_position_{j + 1}": seen[:, j], f"joint_position_{j + 1}": seen[:, n + j],
            f"joint_torque_{j + 1}": sensed[:, j],
        }  # fmt: skip
    columns |= {"tip_force_x": felt[:, 0], "tip_force_y": felt[:, 1]}
    time = np.arange(len(current)) * PERIOD
    columns = {name: np.ascontiguousarray(values) for name, values in columns.items()}
    log = Log(time, columns, n, f"simulated: {arm.robot['name']}, currents given, seed {seed}")
    return Driven(log, state, truth["joint_torque"], truth["tip"])


def pushed(
    bench: Bench,
    law: str,
    gains: Mapping[str, float],
    reference: Reference,
    pushes: Sequence[Push] = PUSHES,
    fine: bool = False,
    changes: Mapping[str, float] | None = None,
    seed: int = 1,
    start: ArrayLike | None = None,
) -> Simulation:
    """The prototype under a law, pushed; the controller knows the prototype, but not ``changes`` of it."""
    known, plant = bench.once("known", bench.arm), bench.arm(changes=changes)
    sensors = fine_sensors(plant.n) if fine else None
    return run(plant, controller(known, law, gains, fine), reference, pushes, sensors, seed, start)
