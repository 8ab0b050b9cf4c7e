"""Whether the step that a robot file states carries the model: smooth friction at rest, and the fastest mode.

Legend: h step, s; A = ∂ẋ/∂x at rest; F the part of A that smooth friction makes; λ eigenvalue, 1/s.

At rest smooth friction has the slope level/width, so it stops a motor at the rate level/(J width), J the inertia that
the motor feels. RK4 is stable for |h λ| up to 2.78 on the real axis and 2.83 on the imaginary one (Hairer, Wanner,
Solving Ordinary Differential Equations II (1996), IV.2). Beyond, friction drives the motor to and fro; its level bounds
that, so nothing blows up, and speeds and sensitivities are wrong in silence. Friction has to stay below 1, which leaves
parameters room to move, and modes below 2.78; a remark tells where they are beyond 0.5, from which RK4's error shows.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from gen.c_code.headers import MOST_STEP_PARTS, slide_velocities
from gen.model.arm_model import Model
from gen.model.right_hand_side import Graphs
from gen.robot.schema import keys_of
from gen.robot.smoothing_width import LARGEST_SMOOTH_FRICTION

LARGEST_STABLE_MODE = 2.78  # h |λ| of modes
LARGEST_ACCURATE_MODE = 0.5  # h |λ| of modes, worth a remark
STABILITY_GRID_POINTS = 256  # configurations, about
MOST_GRID_POINTS = 4**5  # of a whole grid
FRICTIONLESS_FACTOR = 1e12  # factor on the width of smooth friction that takes it out of A


@dataclass(frozen=True)
class Mode:
    """The fastest mode of the arm at rest over a grid of configurations: |λ|, 1/s, and the joint that moves most."""

    rate: float
    joint: int


@dataclass(frozen=True)
class StepExamination:
    """The rates that the step has to carry. Tuples have an entry a joint."""

    step: float  # s
    smallest_step: float  # s, into which the step may be divided where friction asks for it
    width: tuple[float, ...]  # rad/s at the motor, of smooth friction
    friction: tuple[float, ...]  # 1/s, a bound of the rate that the joint's smooth friction has a part in
    friction_rate: float  # 1/s, the fastest decay that smooth friction makes
    unloaded: Mode
    loaded: Mode  # at the joints' torque limits; `unloaded` where none is stated
    unstable_from: tuple[tuple[int, float], ...]  # joints and torques, N m or N; empty: nowhere up to law_torque

    def refusals(self, label: str) -> list[str]:
        """Write a sentence for everything that the step does not carry.

        Args:
            label: The robot file's name.

        Returns:
            The sentences; none where the step carries the model.

        """
        problems = []
        whole = self.smallest_step * self.friction_rate / LARGEST_SMOOTH_FRICTION
        for j, (width, rate) in enumerate(zip(self.width, self.friction, strict=True), 1):
            share = self.smallest_step * rate / LARGEST_SMOOTH_FRICTION
            if whole > 1 and share > 1:
                problems.append(
                    f"{label}, joint[{j}].drive.friction_smoothing: found {width:.4g} rad/s, over which friction stops"
                    f" the motor {share:.3g} times faster than a step of {self.smallest_step:.3g} s can follow, so that"
                    f" speeds are wrong in silence, possible is {_round_to_three_digits(width * share, math.ceil)} or"
                    f" more; write that, or step = {_round_to_three_digits(self.step / whole, math.floor)} or less."
                )
        size = self.step * self.loaded.rate
        if size > LARGEST_STABLE_MODE:
            problems.append(
                f"{label}, step: found {self.step:.4g} s, in which the fastest mode ({self.loaded.rate:.4g} 1/s, at"
                f" joint {self.loaded.joint}, {self._load_phrase}) moves on by {size:.3g} rad, possible is"
                f" {LARGEST_STABLE_MODE}, beyond which RK4 is unstable; write step ="
                f" {_round_to_three_digits(LARGEST_STABLE_MODE / self.loaded.rate, math.floor)} or less, or correct"
                " springs, inertias or limits.torque."
            )
        return problems

    def find_remedy(self) -> tuple[float, tuple[float, ...]]:
        """Find a step and widths of smooth friction that carry the model.

        Where friction asks for a wider smoothing than a robot file may state, the step becomes smaller, too.

        Returns:
            The step, s, and the widths, rad/s; unchanged where they carry the model already.

        """
        step = self.step
        if self.step * self.loaded.rate > LARGEST_STABLE_MODE:
            step = float(_round_to_three_digits(LARGEST_STABLE_MODE / self.loaded.rate, math.floor))
        smallest = self.smallest_step * step / self.step
        if smallest * self.friction_rate <= LARGEST_SMOOTH_FRICTION:
            return step, self.width
        shares = [max(smallest * rate / LARGEST_SMOOTH_FRICTION, 1.0) for rate in self.friction]
        widest = keys_of("joint.drive")["friction_smoothing"].range.high
        lack = max(width * share / widest for width, share in zip(self.width, shares, strict=True))
        if lack > 1:
            step = float(_round_to_three_digits(step / lack, math.floor))
            shares = [max(share / lack, 1.0) for share in shares]
        widths = zip(self.width, shares, strict=True)
        return step, tuple(min(self._widen_smoothing(width, share), widest) for width, share in widths)

    @staticmethod
    def _widen_smoothing(width: float, share: float) -> float:
        """A width, rad/s, ``share`` times as large and rounded up; as it is where share is 1."""
        if share > 1:
            return float(_round_to_three_digits(width * share, math.ceil))
        return width

    def describe_step(self) -> list[str]:
        """Describe the friction and the modes that the step carries, and how well it does.

        Returns:
            The lines.

        """
        lines = []
        for j, (width, rate) in enumerate(zip(self.width, self.friction, strict=True), 1):
            carried = (
                f"{self.smallest_step * rate:.3g} of a step of {self.smallest_step:.3g} s, possible is"
                f" {LARGEST_SMOOTH_FRICTION:g}"
            )
            lines.append(
                f"friction at joint {j} smoothed over {width:.4g} rad/s: {carried} (RK4 is stable to"
                f" {LARGEST_STABLE_MODE})"
            )
        modes = {"without load": self.unloaded, self._load_phrase: self.loaded}
        for when, mode in modes.items():
            size = self.step * mode.rate
            known = f"{mode.rate:.4g} 1/s ({mode.rate / (2 * math.pi):.3g} Hz) at joint {mode.joint}"
            remark = ""
            if LARGEST_ACCURATE_MODE < size <= LARGEST_STABLE_MODE:
                remark = f"; beyond {LARGEST_ACCURATE_MODE} RK4's error shows: mind the accuracy"
            lines.append(
                f"fastest mode {when}: {known}, {size:.3g} rad a step, possible is {LARGEST_STABLE_MODE}{remark}"
            )
        if self.unstable_from and self.step * self.loaded.rate <= LARGEST_STABLE_MODE:
            where = ", ".join(f"{torque:.3g} at joint {j}" for j, torque in self.unstable_from)
            lines.append(f"unstable from joint torques of {where} on, where the springs are too stiff for the step")
        return lines

    @property
    def _load_phrase(self) -> str:
        if self.loaded == self.unloaded:
            return "without load"
        return "at the torque limits"


def examine_step(graphs: Graphs) -> StepExamination:
    """Examine whether the step of the robot file carries the model.

    Args:
        graphs: The model's graphs.

    Returns:
        The rates that the step has to carry.

    Raises:
        ValueError: The parameters give no numbers.

    """
    model, linear = graphs.model, _Linearization(graphs)
    joints, step = model.robot.joints, model.robot.step
    limit, law = np.zeros(model.n), np.zeros(model.n)
    for j in model.flexible:
        limit[j - 1] = joints[j - 1].limits.torque or 0.0
        law[j - 1] = joints[j - 1].drive.law_torque.nominal  # type: ignore[union-attr]
    unloaded, _ = linear.fastest_mode(np.zeros(model.n))
    loaded, _ = linear.fastest_mode(limit)
    friction, rate = _bound_friction_rates(linear)
    smallest = step
    if model.needs_stiff_step:
        smallest = step / MOST_STEP_PARTS
    return StepExamination(
        step,
        smallest,
        tuple(joint.drive.friction_smoothing.nominal for joint in joints),
        friction,
        rate,
        unloaded,
        loaded,
        _find_unstable_torques(linear, law),
    )


class _Linearization:
    """A at rest on a grid of configurations, for given joint torques; p nominal."""

    def __init__(self, graphs: Graphs) -> None:
        self.model = model = graphs.model
        functions = {f.name: f.graph for f in graphs.functions}
        nominal = np.array([q.nominal for q in model.quantities])
        smoothing = np.array([q.name.startswith("friction_smoothing_") for q in model.quantities])
        self.torsion = functions["torsion"]
        x, u, c = functions["rhs_jacobian"].sx_in()
        by_x = functions["rhs_jacobian"](x, u, c)[0]  # without the rest, a part of the operations
        self.jacobian = ca.Function("by_x", [x, u, c], [by_x])
        self.found: dict[Any, np.ndarray] = {}
        self.smooth = functions["prepare"](nominal)
        self.frictionless = functions["prepare"](np.where(smoothing, nominal * FRICTIONLESS_FACTOR, nominal))
        stiff = {
            f"{state.name}_{j}" for _, state, j in model.effect_states if state.is_stiff
        }  # these have the L-stable step
        self.names = [slot.name for slot in model.x_slots]
        self.kept = [k for k, name in enumerate(self.names) if name not in stiff]
        self.ratio = np.array([joint.drive.ratio.nominal for joint in model.robot.joints])
        self.q = _configuration_grid(model)

    def state_matrices(self, torque: np.ndarray, c: Any, q: np.ndarray) -> np.ndarray:
        """A (points × m × m) at configurations ``q`` (points × n) with joint torques (n), no stiff memories in it."""
        torsion = np.array(self.torsion(torque, c)).ravel()
        key = (torsion.tobytes(), q.tobytes(), c is self.smooth)  # of rigid drives no torque moves anything
        if key in self.found:
            return self.found[key]
        x = np.zeros((len(self.names), len(q)))
        for j in self.model.joints:
            x[self.names.index(f"joint_position_{j}")] = q[:, j - 1]
            if j in self.model.flexible:
                x[self.names.index(f"motor_position_{j}")] = self.ratio[j - 1] * (q[:, j - 1] + torsion[j - 1])
        u = ca.DM.zeros(len(self.model.u_slots), len(q))
        by_x = np.array(self.jacobian.map(len(q))(x, u, ca.repmat(c, 1, len(q))))
        if not np.isfinite(by_x).all():
            raise ValueError(
                "found parameters with which the equations of motion give no numbers; look for one far off"
            )
        whole = by_x.reshape((len(self.names), len(self.names), len(q)), order="F").transpose(2, 0, 1)
        self.found[key] = whole[:, self.kept][:, :, self.kept]
        return self.found[key]

    def fastest_mode(self, torque: np.ndarray, q: np.ndarray | None = None) -> tuple[Mode, np.ndarray]:
        """The fastest mode without smooth friction, and the configuration (1 × n) where it is."""
        if q is None:
            q = self.q
        values, vectors = np.linalg.eig(self.state_matrices(torque, self.frictionless, q))
        point, which = np.unravel_index(np.argmax(np.abs(values)), values.shape)
        part = dict(zip((self.names[k] for k in self.kept), np.abs(vectors[point, :, which]), strict=True))
        moved = [  # motor speeds, in which joints of both kinds compare
            max(part[f"joint_velocity_{j}"] * self.ratio[j - 1], part.get(f"motor_velocity_{j}", 0.0))
            for j in self.model.joints
        ]
        return Mode(float(np.abs(values[point, which])), int(np.argmax(moved)) + 1), q[point : point + 1]


def _find_unstable_torques(linear: _Linearization, law: np.ndarray) -> tuple[tuple[int, float], ...]:
    """Joint torques from which the step is unstable, all loaded to the same share of ``law``, N m or N (n)."""
    step = linear.model.robot.step
    at_law, where = linear.fastest_mode(law)
    if step * at_law.rate <= LARGEST_STABLE_MODE:
        return ()
    inside, outside = 0.0, 1.0
    for _ in range(20):
        share = 0.5 * (inside + outside)
        if step * linear.fastest_mode(share * law, where)[0].rate > LARGEST_STABLE_MODE:
            outside = share
        else:
            inside = share
    return tuple((j, float(inside * law[j - 1])) for j in linear.model.flexible)


def _bound_friction_rates(linear: _Linearization) -> tuple[tuple[float, ...], float]:
    """For each joint a bound of the rate that its smooth friction has a part in, and the fastest rate, 1/s.

    The bound is the joint's column of |F| in motor speeds, summed. No eigenvalue lies beyond the largest sum and a
    column goes as 1/width, so widths that bring every sum to 1/h carry it. A flexible drive's column has the one
    entry level/(J_m width); rigid drives feel each other through the links.
    """
    model = linear.model
    rest = np.zeros(model.n)
    difference = linear.state_matrices(rest, linear.smooth, linear.q) - linear.state_matrices(
        rest, linear.frictionless, linear.q
    )
    names = [linear.names[k] for k in linear.kept]
    slide = [names.index(name) for name in slide_velocities(model)]
    F = difference[:, slide][:, :, slide]
    scale = np.where([j in model.rigid for j in model.joints], linear.ratio, 1.0)
    sums = np.abs(F * scale[:, None] / scale).sum(axis=1).max(axis=0)
    return tuple(float(value) for value in sums), float(np.abs(np.linalg.eigvals(F)).max())


def _configuration_grid(model: Model) -> np.ndarray:
    """Configurations (points × n): full turns of every revolute joint but the first, on which A hardly depends, with
    straight and folded arm; the stated range of every prismatic joint, ±1 m where none is stated. Of a long arm
    the first and a fixed random choice of the others."""
    count = 2 * max(2, int(STABILITY_GRID_POINTS ** (1 / max(model.n - 1, 1)) / 2))
    axes: list[np.ndarray] = []
    for joint in model.robot.joints:
        if joint.kind == "prismatic":
            axes.append(np.linspace(*(joint.limits.position or (-1.0, 1.0)), 5))
        elif axes:
            axes.append(np.arange(count) * (2 * np.pi / count))
        else:
            axes.append(np.zeros(1))
    if math.prod(map(len, axes)) <= MOST_GRID_POINTS:
        return np.array(list(itertools.product(*axes)))
    rng = np.random.default_rng(0)
    drawn = np.column_stack([rng.choice(axis, STABILITY_GRID_POINTS) for axis in axes])
    return np.vstack([[axis[0] for axis in axes], drawn])


def _round_to_three_digits(value: float, toward: Any) -> str:
    """Three digits, rounded up (math.ceil) or down (math.floor)."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{toward(value / unit) * unit:.3g}"
