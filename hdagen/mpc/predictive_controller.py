"""The predictive controller, tick by tick: `MPC(arm, configuration).tick(now, path, …)`.

A tick always leaves a whole, legal torque; faults come back as a status, never as an exception. Not a safety-rated
function: use it behind a certified stop (docs/project/safety.md, docs/guides/mpc.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hdagen.arm.arrays import Array
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe, pack_limits
from hdagen.control.guarded_controller import Controller
from hdagen.control.pose_kinematics import add_turns
from hdagen.control.reference_motion import Reference
from hdagen.mpc.compiled_settings import (
    LIMIT_FAMILIES,
    find_inertias,
    find_torque_limits,
    list_report_parts,
    pack_settings,
)
from hdagen.mpc.configuration import Configuration, expand_values, list_admittance_gains
from hdagen.mpc.target_coordinates import follows_pose
from hdagen.mpc.wall import Wall

RUNGS = ("on the plan", "on the last plan, shifted", "held by an impedance", "on the ramp to the safe torque")


@dataclass(frozen=True)
class TickReport:
    """The report of a tick. ``active``, ``violated`` and ``predicted_violation`` by family of limits: rows of the plan
    at or beyond their bound, the present violation and the plan's largest, SI (negative or 0: none)."""

    rung: str
    failures: int
    solved: int
    factored: int
    interior: int
    residual: float
    active: Mapping[str, int]
    violated: Mapping[str, float]
    predicted_violation: Mapping[str, float]
    tip_force: Array  # N, that drives the target
    observed_force: Array  # N, by the momentum observer
    disturbance: Array  # N m at the motors
    innovation: float
    collision: bool
    target_displacement: Array
    state_estimate: Array
    planned_torque: Array  # (nodes, n) N m
    predicted_states: Array  # (nodes, states) SI


@dataclass(frozen=True)
class NonlinearProblem:
    """A tick's nonlinear problem as `python -m gen truth` takes it."""

    data: dict[str, Any]


class BoundFunction(Protocol):
    """A compiled function bound to its buffers."""

    def run(self) -> None:
        """Call it."""


@dataclass(frozen=True)
class _WrappedTick:
    run: Callable[[], None]


class MPC(Controller):
    """The predictive controller of an arm that was built with its structure, `load(robot, mpc=configuration)`.

    ``path`` (nodes + 1, 2 axes): commanded positions and velocities at the tick and at the end of every node; it may
    be filled in place. Of a tip in space they are x, y, z and the rotation vector of the orientation, then the
    velocity and the angular velocity. Raises PlantError where the configuration is refused.
    """

    law = "mpc"

    def __init__(self, arm: Arm, configuration: Configuration | None = None, guard: Guard | None = None) -> None:
        c = configuration or Configuration()
        described: dict[str, Any] = arm.manifest.get("mpc") or {}
        wanted = c.structure
        built = described and f"nodes={described['nodes']},walls={described['walls']},space={described['space']}"
        if built != wanted:
            found = "without a predictive controller"
            if built:
                found = f"with {built}"
            raise PlantError(
                f"the arm is built {found} and the configuration needs {wanted}; load it with load(robot, "
                "mpc=configuration)."
            )
        self.arm, self.configuration, self.described = arm, c, {"reference": (), "gains": ()}
        module, n, self.nodes = arm.module, arm.n, described["nodes"]
        self.axes, self.gains, self.reference_names = described["axes"], dict[str, float](), ("joint_path",)
        if described["space"] == "tip":
            self.gains, self.reference_names = list_admittance_gains(arm.robot, c), ("tip_path",)
        self._allocate_buffers(n, module)
        self.path = self._reference.reshape(self.nodes + 1, 2 * self.axes)
        self.reference = self._reference
        self._bind_functions(module)
        self._given = guard
        self.configure_with(c)

    def _allocate_buffers(self, n: int, module: Any) -> None:
        self._context = np.zeros(module.length("mpc_tick", "controller"), np.uint8)
        self._now = np.zeros(1)
        self.measurement = np.zeros(module.length("mpc_tick", "measurement"))
        self._reference = np.zeros(module.length("mpc_tick", "path"))
        self.torque: Array = np.zeros(n)
        self._status: NDArray[np.int32] = np.zeros(1, np.int32)
        self._report = np.zeros(module.length("mpc_report", "report"))
        ends = np.cumsum([0, *(length for _, length in list_report_parts(self.arm))]).tolist()
        self._parts = {name: slice(*ends[k : k + 2]) for k, (name, _) in enumerate(list_report_parts(self.arm))}
        self._name_channels()

    def _bind_functions(self, module: Any) -> None:
        buffers = (self._context, self._now, self.measurement)
        self._plain = module.bind("mpc_tick", *buffers, self._reference, self.torque, self._status)
        self._tick: BoundFunction = self._plain
        self._prepare = module.bind("mpc_prepare", self._context)
        self._recover = module.bind("mpc_recover", *buffers, self._status)
        self._watchdog = module.bind("mpc_watchdog", self._context, self._now, self.torque, self._status)
        self._say = module.bind("mpc_report", self._context, self._report)
        self._read = "mpc_read"

    def _choose_guard(self, c: Configuration) -> Guard:
        """The guard that was given, or one made of the robot file, with the configuration's period and limits."""
        guard = self._given
        if guard is None:
            _, inertia = find_inertias(self.arm)
            damping = tuple((20 * inertia).tolist())  # motors stop in 1/20 s
            guard = Guard(Safe[str(c["fallback.safe"]).upper()], safe_damping=damping)
            if guard.safe is Safe.HOLD:
                guard = replace(guard, safe_stiffness=tuple(10 * d for d in damping))
        limits: dict[str, Any] = {}
        if (torque := find_torque_limits(self.arm, c)) is not None:
            limits["torque_limit"] = torque
        if c["limits.torque_rate"] is not None:
            limits["torque_rate"] = tuple(expand_values(c["limits.torque_rate"], self.arm.n))
        if c["fallback.force_limit"] is not None:
            limits["force_limit"] = c["fallback.force_limit"]
        return replace(guard, period=c["mpc.period"], **limits)

    def configure_with(self, configuration: Configuration) -> None:
        """Replace the configuration, with the arm's present parameters.

        Args:
            configuration: A configuration of the same structure.

        Raises:
            PlantError: The configuration is refused, and nothing has changed.

        """
        if configuration.structure != self.configuration.structure:
            raise PlantError(f"the configuration needs {configuration.structure}, the controller has "
                             f"{self.configuration.structure}; make a new controller.")  # fmt: skip
        if problems := configuration.find_incompatibilities(self.arm.robot):
            raise PlantError("\n".join(problems))
        guard = self._choose_guard(configuration)
        limits = pack_limits(self.arm, guard, problems)
        if problems:
            raise PlantError("\n".join(problems))
        whole = np.array([guard.safe.value, guard.stale_stamp_ticks, guard.stale_bits_ticks], np.int32)
        settings = pack_settings(self.arm, configuration)
        call = (self._context, self.arm.p.copy(), settings, whole, limits, self._status)
        configure = self.arm.module.bind("mpc_configure", *call)
        configure.run()
        if self._status[0]:
            raise PlantError(f"mpc: {self.sentence(int(self._status[0]))}")
        self._configure, self.configuration, self.guard = configure, configuration, guard

    def move_limits(self, walls: Sequence[Wall] | None = None, **limits: Any) -> None:
        """Move soft limits while the controller runs.

        Args:
            walls: The new walls, as many as were compiled; None: as they are.
            **limits: New values of ``tip_speed``, ``motor_speed``, ``joint_low``, ``joint_high`` or ``joint_torque``.

        Raises:
            PlantError: A limit is refused, and nothing has changed.

        """
        if walls is None:
            walls = self.configuration.walls
        moved = {f"limits__{name}": value for name, value in limits.items()}
        c = self.configuration.with_changes(tuple(walls), **moved)
        if c.structure != self.configuration.structure:
            raise PlantError(f"the controller has {len(self.configuration.walls)} walls; give as many.")
        if problems := c.find_incompatibilities(self.arm.robot):
            raise PlantError("\n".join(problems))
        settings = pack_settings(self.arm, c)
        self.arm.module.bind("mpc_limit", self._context, settings, self._status).run()
        if self._status[0]:
            raise PlantError(f"mpc: {self.sentence(int(self._status[0]))}")
        self.configuration = c

    def prepare(self) -> None:
        """Do the part of the next tick that needs no measurement; to be called when the torque is sent."""
        self._prepare.run()

    def step(self) -> None:
        """Do the tick on the buffers as they are."""
        self._plain.run()

    def wrap_tick(self, runs: Callable[[], None] | None) -> None:
        """Wrap the tick, to observe it from outside.

        Args:
            runs: The function that `tick` shall call, and that calls `step`; None: the tick alone again.

        """
        self._tick = self._plain
        if runs is not None:
            self._tick = _WrappedTick(runs)

    def rows(self, reference: Reference) -> Array:
        """Sample a reference at every tick and at the end of every node; past its end it goes on straight.

        Args:
            reference: The motion to follow.

        Returns:
            The path of every tick, (T, (nodes + 1) · 2 axes).

        """
        times = np.concatenate([[0.0], np.cumsum(self.configuration.grid)])
        count = len(reference.position)
        at = reference.time[:, None] + times[None]
        last = (count - 1) * reference.period
        below = np.minimum((at / reference.period + 1e-9).astype(int), count - 1)
        rest = (at - below * reference.period)[..., None]
        moved = rest * reference.velocity[below] + np.where(
            at[..., None] <= last, rest**2 / 2 * reference.acceleration[below], 0.0
        )
        position = reference.position[below] + moved
        if follows_pose(self.arm.robot, reference.space):
            position[..., 3:] = add_turns(moved[..., 3:], reference.position[below][..., 3:])
        velocity = reference.velocity[below] + np.where(
            at[..., None] <= last, rest * reference.acceleration[below], 0.0
        )
        return np.ascontiguousarray(np.concatenate([position, velocity], -1).reshape(count, -1))

    def report(self) -> TickReport:
        """Read the report of the last tick, before `prepare` is called.

        Returns:
            The report.

        """
        self._say.run()
        said = self._report.copy()
        r = {name: said[part] for name, part in self._parts.items()}
        whole = {name: int(r[name][0]) for name in ("failures", "solved", "factored", "interior")}
        by = {
            what: dict(zip(LIMIT_FAMILIES, r[what].tolist(), strict=True))
            for what in ("active_of", "violated_by", "foreseen_by")
        }
        active = {name: int(value) for name, value in by["active_of"].items()}
        return TickReport(
            RUNGS[int(r["rung"][0])], **whole, residual=float(r["residual"][0]), active=active,
            violated=by["violated_by"], predicted_violation=by["foreseen_by"], tip_force=r["tip_force"],
            observed_force=r["observed_force"], disturbance=r["disturbance"], innovation=float(r["innovation"][0]),
            collision=bool(r["collision"][0]), target_displacement=r["yielded"], state_estimate=r["x"],
            planned_torque=r["plan"].reshape(self.nodes, -1), predicted_states=r["predicted"].reshape(self.nodes, -1),
        )  # fmt: skip

    def quadratic_problem(self) -> tuple[Array, Array]:
        """Read the quadratic problem of the last tick.

        Returns:
            Problem and solution, as `mpc_solve` takes them.

        """
        module = self.arm.module
        found = [np.zeros(module.length("mpc_problem", name)) for name in ("problem", "solution")]
        module.bind("mpc_problem", self._context, *found).run()
        return found[0], found[1]

    def format_header(self) -> str:
        """Write the settings and the guard's configuration as C.

        Returns:
            C text, as example_mpc.c includes it.

        """
        problems: list[str] = []
        limits = pack_limits(self.arm, self.guard, problems)
        whole = [self.guard.safe.value, self.guard.stale_stamp_ticks, self.guard.stale_bits_ticks]

        def listed(name: str, values: Sequence[float]) -> str:
            return f"static const double {name}[] = {{{', '.join(repr(float(v)) for v in values)}}};\n"

        values = listed("mpc_settings", pack_settings(self.arm, self.configuration).tolist())
        values += listed("mpc_guard_real", limits.tolist()) + listed("mpc_guard_whole", whole)
        joints = range(1, self.arm.n + 1)
        values += listed("mpc_ratio", [self.arm.parameters[f"ratio_{j}"] for j in joints])
        return values + listed(
            "mpc_torque_constant", [self.arm.parameters.get(f"torque_constant_{j}", 1.0) for j in joints]
        )

    def nonlinear_problem(self) -> NonlinearProblem:
        """Read the whole nonlinear problem of the last tick.

        Returns:
            The problem as `python -m gen truth` takes it.

        """
        m, n, nodes = self.arm.manifest["mpc"], self.arm.n, self.nodes
        nx, ny, rows, shared = len(m["state"]), m["outputs"], len(m["rows"]), m["shared"]
        sizes = {
            "x": nx, "T": nodes * n, "before": n, "hold": n, "shared": shared, "force": self.arm.nu - n,
            "goal": nodes * ny,
            "weights": 2 * ny, "torque_weight": n, "rate_weight": n, "limits": 2 * rows, "linear": rows,
            "square": rows, "fading": nodes, "seen": nodes * (ny + m["orientation"]),
        }  # fmt: skip
        found = np.zeros(self.arm.module.length("mpc_whole", "whole"))
        self.arm.module.bind("mpc_whole", self._context, found).run()
        parts = np.split(found, np.cumsum(list(sizes.values()))[:-1])
        data = {name: part.tolist() for name, part in zip(sizes, parts, strict=True)}
        limits = np.array(data.pop("limits")).reshape(rows, 2)
        data |= {"low": limits[:, 0].tolist(), "high": limits[:, 1].tolist()}
        data["goal"] = np.array(data["goal"]).reshape(nodes, ny).tolist()
        seen = np.array(data.pop("seen")).reshape(nodes, -1)
        data["orientation"] = seen[:, ny:].tolist()
        data["weights"] = np.array(data["weights"]).reshape(2, ny).tolist()
        data |= {
            "grid": list(self.configuration.grid),
            "period": [self.configuration["mpc.period"]],
            "simple": m["simple"],
        }
        return NonlinearProblem(data)

    def sentence(self, status: int) -> str:
        """Explain a status.

        Args:
            status: The number that `tick` returned.

        Returns:
            One sentence.

        """
        own = {int(code): text for code, text in self.arm.manifest["mpc"]["statuses"]}
        return own.get(status) or super().sentence(status)
