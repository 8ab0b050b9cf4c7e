"""The virtual prototype and how it is driven: arms, controllers, sensors, motions, and runs that figures share.

Its numbers stand in the preset `paper_prototype`, each with its source. This file states how it is driven: the paper
names neither the inner loop of its controllers nor the size of most pushes.
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

from hdagen.adoption.robot_file import RobotFile
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm, load
from hdagen.arm.preset_files import find_preset_files
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference, circle
from hdagen.log.measured_log import Log
from hdagen.simulation.simulated_sensors import Sensors
from hdagen.simulation.simulator import Push, Simulation, run

PROTOTYPE = "paper_prototype"
TABLE_1 = "paper_table1"
THREE_JOINTS = "paper_three_joints"
LEAN_PROTOTYPE = "paper_prototype, lean"
CARTESIAN_LAWS = {"impedance": "impedance_cartesian", "admittance": "admittance_cartesian"}
PERIOD = 1e-3  # s, of controller and CAN
# Inner loops for encoders of 42 and of 4096 counts a turn; `Controller` has those of the latter.
HALL_INNER_LOOP = {"bandwidth": 25.0, "observer_bandwidth": 20.0, "velocity_cutoff": 20.0}  # rad/s, rad/s, Hz
FINE_INNER_LOOP = {"bandwidth": 50.0, "observer_bandwidth": 100.0, "velocity_cutoff": 80.0}
FINE_ENCODER_RESOLUTION = 2 * np.pi / 4096  # rad, of a motor encoder in place of the paper's Hall sensors
ENCODER_JITTER, LARGEST_ENCODER_NOISE = (
    0.5,
    2.5e-3,
)  # noise of an encoder's angle: counts rms, and at most rad rms; assumed, as the preset
DISC_RESOLUTION = 2 * np.pi / 2**18  # rad, of the optical disc
SAFE_DAMPING = 2e-3  # N m s/rad at the motors: after a fault they stop within J/d = 46 ms
LARGEST_MOTOR_JUMP = (
    2.0  # rad of a motor in a tick: five times its largest speed, and more than a count of a Hall sensor
)
CIRCLE_RADIUS, CIRCLE_CENTER, TURN_SECONDS = (
    0.05,
    (0.2, 0.0),
    5.0,
)  # m, III.C; m and s are assumed: the middle of the workspace, 63 mm/s
PUSH_FORCE = 10.0  # N, assumed; the paper names none. Larger ones take soft settings out of reach
CIRCLE_PUSHES = (Push(3.0, 4.0, (PUSH_FORCE, 0.0)), Push(6.0, 7.0, (0.0, PUSH_FORCE)))  # times: III.C
PUSH_BANDS = ((3.0, 4.0, f"{PUSH_FORCE:g} N in x"), (6.0, 7.0, f"{PUSH_FORCE:g} N in y"))
TORSION_PARAMETERS = ("kinematic_square", "kinematic_cube", "kinematic_fourth", "kinematic_fifth")
STRUCTURE_FAULTS: dict[str, dict[str, float]] = {  # of the printed parts, V; the paper gives no size: assumed
    "play of 1 arcmin in the printed parts": {"backlash_angle_1": 2.9e-4, "backlash_angle_2": 2.9e-4},
    "links that bend at 24 Hz": {"link_share_1": 0.2, "link_share_2": 0.2},
    "mounting that yields": {"base_compliance_1": 2e-5},
}
TORSION_JOINT_1 = (6.57e-5, 0.0018, 0.0032, -0.0017, 2.68e-4, -1.27e-4)  # rad, IV.A, of joint 1 over turns
TORSION_JOINT_2 = (1.72e-4, 9.47e-4, -0.0017, 3.47e-4, 7.94e-4, -3.67e-4)  # of joint 2

T = TypeVar("T")


@dataclass
class Bench:
    """Arms that are built once, and runs that several figures share; ``profile`` of the builds, ``threads`` for sweeps,
    ``folders`` of the builds by robot."""

    profile: str = "native"
    threads: int = 2
    folders: dict[str, Path] = field(default_factory=dict)
    _shared_results: dict[Any, Any] = field(default_factory=dict)

    def arm(self, robot: str = PROTOTYPE, changes: Mapping[str, float] | None = None) -> Arm:
        """Load an arm, which nothing else shares.

        Args:
            robot: preset or robot file.
            changes: parameters that differ from the robot's, SI, by name.

        Returns:
            The arm.

        """
        arm = Arm(self.folders[robot]) if robot in self.folders else load(robot, self.profile)
        self.folders[robot] = arm.folder
        arm.parameters.update(changes or {})
        return arm

    def lean_arm(self) -> Arm:
        """Load the prototype without the effects that are switched off in it: the same numbers in less time."""
        if LEAN_PROTOTYPE not in self.folders:
            whole = self.arm()
            file = RobotFile(find_preset_files()[PROTOTYPE].read_bytes(), whole)
            file.drop_zero_effects()
            with TemporaryDirectory() as place:
                path = Path(place) / "lean.toml"
                path.write_bytes(file.to_bytes())
                self.folders[LEAN_PROTOTYPE] = load(path, self.profile, out=whole.folder.parent).folder
        return self.arm(LEAN_PROTOTYPE)

    def robot_file(self, changes: Mapping[str, float], robot: str = PROTOTYPE, sensors: Sensors | None = None) -> bytes:
        """Write a preset's file with other parameters and sensors, for `hdagen replay`.

        Args:
            changes: parameters that differ from the preset's, SI, by name.
            robot: the preset.
            sensors: encoders of the logs; None for those of the preset.

        Returns:
            Content of the robot file.

        """

        def make() -> bytes:
            arm = self.arm(robot, changes)
            file = RobotFile(find_preset_files()[robot].read_bytes(), arm)
            for name, value in changes.items():
                file.set_number(file.locate_parameter(name), value)
            file.update_dependent_numbers(arm)
            return file.to_bytes()

        text = self.compute_once(("robot file", robot, tuple(sorted(changes.items()))), make)
        return _with_sensors(text, sensors or Sensors())

    def compute_once(self, key: Any, make: Callable[[], T]) -> T:
        """Compute a value at its first use and keep it.

        Args:
            key: identifies the value; hashable.
            make: computes the value.

        Returns:
            The value of the first call with this key.

        """
        if key not in self._shared_results:
            self._shared_results[key] = make()
        found: T = self._shared_results[key]
        return found


def _with_sensors(text: bytes, sensors: Sensors) -> bytes:
    """A robot file whose joints all have these encoders."""
    for side, resolution, noise in (
        (b"motor", sensors.motor_resolution, sensors.motor_noise),
        (b"joint", sensors.joint_resolution, sensors.joint_noise),
    ):
        for quantity, values in ((b"resolution", resolution), (b"noise", noise)):
            if values is not None:
                line = rb"(%s_encoder_%s = )[^ #\n]*" % (side, quantity)
                text = re.sub(line, rb"\g<1>%.17g" % values[0], text)
    return text


def without_kinematic_torsion(arm: Arm) -> dict[str, float]:
    """Switch the kinematic torsion of a model off.

    Args:
        arm: the model.

    Returns:
        Changes of its parameters, for `Bench.arm`.

    """
    return {name: 0.0 for name in arm.parameters if name.startswith(("kinematic_", "ratio_error_"))}


def torsion_changes(j: int, coefficients: Sequence[float]) -> dict[str, float]:
    """Give a joint the torsion Σ a_k s^k of (13), with the minus sign of (14).

    Args:
        j: the joint, from 1.
        coefficients: a_0 to a_5, rad, over turns s. a_0 becomes a zero of the joint's encoder, the linear part a ratio.

    Returns:
        Changes of parameters, for `Bench.arm`.

    """
    changes = {f"{name}_{j}": -float(a) for name, a in zip(TORSION_PARAMETERS, coefficients[2:], strict=True)}
    changes[f"ratio_error_{j}"] = -float(sum(coefficients[1:])) / (2 * np.pi)
    changes[f"encoder_bias_{j}"] = -float(coefficients[0])
    return changes


def make_guard(n: int = 2, period: float = PERIOD) -> Guard:
    """Make the guard of all runs.

    Args:
        n: number of joints.
        period: of a tick, s.

    Returns:
        The guard.

    """
    return Guard(Safe.DAMPING, period, safe_damping=(SAFE_DAMPING,) * n, motor_jump=(LARGEST_MOTOR_JUMP,) * n)


def make_controller(known: Arm, law: str, gains: Mapping[str, float] | None = None, fine: bool = False) -> Controller:
    """Make a controller.

    Args:
        known: the arm that the controller believes.
        law: "impedance" or "admittance", or any law of `Controller`.
        gains: gains that differ from the inner loop's and the law's own.
        fine: the inner loop for encoders of 4096 counts in place of that for Hall sensors.

    Returns:
        The controller, with the guard of all runs.

    """
    return Controller(known, CARTESIAN_LAWS.get(law, law), make_guard(known.n), {**inner_loop(fine), **(gains or {})})


def inner_loop(fine: bool) -> dict[str, float]:
    """Look up the inner loop of a controller.

    Args:
        fine: for encoders of 4096 counts in place of Hall sensors.

    Returns:
        Its gains.

    """
    if fine:
        return FINE_INNER_LOOP
    return HALL_INNER_LOOP


def cartesian_gains(mass: float, damping: float, stiffness: float) -> dict[str, float]:
    """Make gains of a Cartesian law, the same in both axes.

    Args:
        mass: M, kg.
        damping: B, N s/m.
        stiffness: K, N/m.

    Returns:
        Gains by name.

    """
    values = {"mass": mass, "damping": damping, "stiffness": stiffness}
    return {f"{name}_{axis}": value for name, value in values.items() for axis in "xy"}


def paper_circle(seconds: float = 10.0, radius: float = CIRCLE_RADIUS) -> Reference:
    """Make the circle of III.C.

    Args:
        seconds: length of the motion, s.
        radius: of the circle, m.

    Returns:
        The reference of the tip.

    """
    return circle(radius, CIRCLE_CENTER, TURN_SECONDS, seconds, PERIOD)


def fine_sensors(n: int = 2) -> Sensors:
    """Make sensors with 4096 counts a turn at the motors in place of Hall sensors.

    Args:
        n: number of joints.

    Returns:
        The sensors; discs are those of the preset.

    """
    return Sensors(
        motor_resolution=(FINE_ENCODER_RESOLUTION,) * n, motor_noise=(ENCODER_JITTER * FINE_ENCODER_RESOLUTION,) * n
    )


def encoders_of(fine: bool, n: int = 2) -> Sensors | None:
    """Choose the sensors of a run.

    Args:
        fine: 4096 counts a turn at the motors in place of Hall sensors.
        n: number of joints.

    Returns:
        The fine sensors, or None for those of the preset.

    """
    if fine:
        return fine_sensors(n)
    return None


def make_encoders(counts: int, bits: int) -> Sensors:
    """Make the encoders of two joints.

    Args:
        counts: a turn of each motor.
        bits: each disc has 2^bits counts a turn.

    Returns:
        The sensors.

    """
    motor, joint = 2 * np.pi / counts, 2 * np.pi / 2**bits
    noise = min(ENCODER_JITTER * motor, LARGEST_ENCODER_NOISE), ENCODER_JITTER * joint
    return Sensors((motor,) * 2, (joint,) * 2, motor_noise=(noise[0],) * 2, joint_noise=(noise[1],) * 2)


@dataclass(frozen=True)
class DrivenRun:
    """A run of an arm under given currents: its log, and the truth at the log's rows: state (T, nx), joint torque
    (T, n, N m), tip (T, 2, m)."""

    log: Log
    state: Array
    joint_torque: Array
    tip: Array


def drive_arm(
    arm: Arm, current: Array, push: Array, q: ArrayLike, sensors: Sensors | None = None, seed: int = 0
) -> DrivenRun:
    """Drive an arm by given currents from rest, with set-valued dry friction.

    Args:
        arm: the true arm.
        current: commanded currents (T, n), A.
        push: force on the tip (T, 2), N.
        q: joint positions at rest (n,), rad.
        sensors: encoders; None for those of the robot.
        seed: of the sensors' noise.

    Returns:
        The run; its log holds the readings of all sensors, those of joint torque too.

    """
    from hdagen.simulation.simulated_sensors import resolve_sensor_errors

    scheme, random, n = resolve_sensor_errors(arm, sensors or Sensors()), np.random.default_rng(seed), arm.n
    mean, acting = arm.apply_input_stage(current, PERIOD, np.zeros(n))
    state = arm.rollout(arm.rest(q), np.hstack([mean, push]), PERIOD, exact=True)[:-1]
    truth = arm.outputs(state, np.hstack([acting, push]))
    raw = np.hstack([truth["motor_position"], truth["joint_position"]])
    seen = scheme.count_angles(raw + scheme.draw_encoder_noise(len(raw), seed))
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
    return DrivenRun(log, state, truth["joint_torque"], truth["tip"])


def simulate_pushed(
    bench: Bench,
    law: str,
    gains: Mapping[str, float],
    reference: Reference,
    pushes: Sequence[Push] = CIRCLE_PUSHES,
    fine: bool = False,
    changes: Mapping[str, float] | None = None,
    seed: int = 1,
    start: ArrayLike | None = None,
) -> Simulation:
    """Simulate the pushed prototype under a law; the controller knows the prototype without ``changes``.

    Args:
        bench: arms and shared runs.
        law: "impedance" or "admittance".
        gains: of the law.
        reference: of the tip.
        pushes: forces on the tip.
        fine: encoders of 4096 counts and their inner loop in place of Hall sensors.
        changes: parameters of the true arm that differ from the prototype's, SI.
        seed: of the sensors' noise.
        start: joint positions near which the arm starts on the reference (n,), rad; None for 0.6 rad each.

    Returns:
        The simulation.

    """
    known, plant = bench.compute_once("known", bench.arm), bench.arm(changes=changes)
    regulator = make_controller(known, law, gains, fine)
    return run(plant, regulator, reference, pushes, encoders_of(fine, plant.n), seed, start)
