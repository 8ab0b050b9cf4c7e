"""The diagnosis' simulations: many at once are what each alone would be, in the order in which they were given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import arms
import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, MEMORY, NOISE, SENSORS, simulated

from gen.effects import ALL
from hdagen.arm import delayed_sensors as late
from hdagen.arm.compiled_arm import MOST_MEMORY_DECAYS, Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.alternative_starts import refit_without
from hdagen.diagnosis.inference.fit_steps import advance_fit
from hdagen.diagnosis.inference.linearization import compute_sensitivities
from hdagen.diagnosis.inference.local_fit import start_fit as begin_fit
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout
from hdagen.diagnosis.inference.sensitivities import (
    OperatingPoint,
    compute_finite_differences,
    step_parameter,
    weigh_residual,
)
from hdagen.diagnosis.initialization.candidate_list import build_candidates
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.search.null_model import make_nominal_point
from hdagen.log.measured_log import Log
from hdagen.support.parallel import map_in_threads

Builder = Callable[..., Compiled]
EFFECTS = ("presliding_friction", "transmission_hysteresis", "sensor_delay", "current_loop_lag")
EVERY = tuple(effect.name for effect in ALL)  # what other tests build, too
MOVED = {"torsional_damping_1": 100.0, "viscous_friction_1": 1.1, "coulomb_friction_2": 0.9, "mass_2": 1.02}  # times
SET = {"sensor_delay_1": 1e-3, "current_lag_2": 1e-3, "hysteresis_torque_1": 2.0}


def shooting(
    build: Builder, profile: str, torques: bool = False, gaps: bool = False, hidden: tuple[int, int] = (0, 0)
) -> MultipleShooting:
    """``gaps``: rows are missing, and between two gaps too few are left for a window; rows that are ``hidden`` from the
    fit."""
    arm = Arm(build(FLEXIBLE, profile, EFFECTS).folder)
    log = simulated(arm)
    columns, rng = dict(log.columns), np.random.default_rng(3)
    if torques:
        columns |= {f"joint_torque_{j}": rng.normal(size=len(log)) for j in (1, 2)}
    kept = np.setdiff1d(np.arange(len(log)), [*range(300, 320), *range(330, 350)] if gaps else [])
    there = {name: np.ascontiguousarray(values[kept]) for name, values in columns.items()}
    shown = np.ones(len(kept), bool)
    shown[slice(*hidden)] = False
    return MultipleShooting(
        arm, cut_windows(arm, LogPortion(Log(log.time[kept], there, log.n_joints, log.source), shown), 0.05)
    )


def lanes(sh: MultipleShooting) -> list[Rollout]:
    """The file's own parameters; others, first states, torques; and impulses between them."""
    p, begun = sh.nominal_start()
    found, names = [Rollout(p, begun)], list(sh.arm.parameters.described)
    values = {name: sh.arm.parameters[name] * factor for name, factor in MOVED.items()} | SET
    for name, value in values.items():
        q = p.copy()
        q[names.index(name)] = value
        found.append(Rollout(q, begun))
    for k in range(4):
        moved = begun.copy()
        moved[:, k] += 1e-3
        found.append(Rollout(p, moved))
    push, kick = np.zeros((2, len(sh.record.time), 2))
    push[40:80, 0], kick[::60, 1] = 0.02, 0.05
    return [Rollout(p, begun, impulse=kick), *found, Rollout(p, begun, torque=push), Rollout(p, begun, push, kick)]


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_many_lanes_are_what_each_alone_would_be(build: Builder, profile: str) -> None:
    sh = shooting(build, profile)
    given = lanes(sh)
    many = sh.predict_all(given)
    assert len(many) == len(given) == 15 and sh.predict_all([]) == []
    assert len({sh._integration_step(lane) for lane in given}) == 2  # one is damped so much that its step is shorter
    size = np.abs(many[1]).max(0)
    for k, (lane, seen) in enumerate(zip(given, many, strict=True)):
        alone = sh.predict(lane)
        assert seen.shape == (len(sh.rows), len(sh.record.names))
        if profile == "portable":
            assert np.array_equal(seen, alone)
        assert np.abs((seen - alone) / size).max() < 1e-10
        apart = [np.abs((seen - other) / size).max() for other in many[:k]]
        assert all(other > 1e-7 for other in apart), (k, apart)


def test_little_memory_gives_the_same(build: Builder, monkeypatch: pytest.MonkeyPatch) -> None:
    many = (sh := shooting(build, "native")).predict_all(lanes(sh))
    monkeypatch.setattr(
        "hdagen.diagnosis.inference.multiple_shooting.WORKSPACE_BYTES", 3 * 8 * sum(a[0].size for a in seat(sh))
    )
    narrow = shooting(build, "native")
    assert narrow.width == 3 or narrow.width == narrow.arm.module.batch_width < 3
    for seen, other in zip(narrow.predict_all(lanes(narrow)), many, strict=True):
        np.testing.assert_allclose(seen, other, rtol=0, atol=1e-10 * np.abs(other).max())


def seat(sh: MultipleShooting) -> tuple[np.ndarray, ...]:
    """A thread's memory."""
    found = sh.workspaces.get()
    sh.workspaces.put(found)
    return found.inputs, found.constants, found.states


@pytest.mark.parametrize("torques, gaps", [(False, False), (False, True), (True, True)])
def test_what_is_seen_is_what_the_sensors_read_of_the_states(build: Builder, torques: bool, gaps: bool) -> None:
    """Positions, read late; the current that acts; and joint torques where they are measured."""
    sh = shooting(build, "native", torques, gaps)
    assert ("joint_torque_1" in sh.record.names) == torques
    assert (np.ptp(sh.rows) >= len(sh.rows)) == gaps
    for lane in lanes(sh):
        x, arm = sh.simulate_states(lane), sh.arm.with_parameters(lane.p)
        mean, at = arm.apply_input_stage(sh.record.command[:, :2], sh.steps, sh.record.initial_input)
        u = np.hstack([mean, sh.record.command[:, 2:]])
        if lane.torque is not None:
            u[:, :2] += lane.torque / 0.05  # N m/A
        seen = late.read_sensors(arm, sh.record.time[sh.rows], x, u[sh.rows], sh.begins) | {
            "motor_current": at[sh.rows]
        }
        found = sh.predict(lane)
        for column, (quantity, j) in zip(found.T, sh.record.outputs, strict=True):
            read = seen[quantity][:, j - 1]
            np.testing.assert_allclose(column, read, rtol=0, atol=1e-12 * np.abs(read).max())


@pytest.mark.parametrize("loud", [False, True])
def test_windows_that_nobody_looks_at_are_gone_through_for_what_remembers(build: Builder, loud: bool) -> None:
    """Without them nothing that is looked at would be another."""
    part, full = shooting(build, "portable", hidden=(100, 250)), shooting(build, "portable")
    looked = np.isin(full.rows, part.rows)
    assert 0 < len(part.rows) == looked.sum() < len(full.rows)
    p, begun = part.nominal_start()
    p[list(part.arm.parameters.described).index("hysteresis_torque_1")] = 2.0 * loud
    assert np.array_equal(part.predict(Rollout(p, begun)), full.predict(Rollout(p, begun))[looked])
    part.all_windows = part.selected_windows
    assert np.array_equal(part.predict(Rollout(p, begun)), full.predict(Rollout(p, begun))[looked]) != loud


def test_lanes_near_one_begin_their_windows_with_its_memory(build: Builder) -> None:
    """It is the same there; a first state tells of its own window alone; what changes the memory is as it is alone."""
    sh = shooting(build, "portable", hidden=(100, 250))
    p, begun = sh.nominal_start()
    names = list(sh.arm.parameters.described)
    p[names.index("hysteresis_torque_1")] = 2.0
    read, memory = sh.predict_with_memory(Rollout(p, begun))
    assert memory.shape == (len(sh.record.selected_windows), sh.arm.nx - sh.m) and np.abs(memory).max(0).any()
    base, other, moved = Rollout(p, begun, memory=memory), p.copy(), begun.copy()
    other[names.index("hysteresis_torque_1")] = 2.1
    third = sh.record.selected_windows[2]
    moved[third] += 1e-3
    push = np.zeros((len(sh.record.time), 2))
    push[sh.record.starts[third] : sh.record.ends[third]] = 0.02
    same, state, pushed, kicked, alone = sh.predict_near(
        base,
        [
            Rollout(p, begun),
            Rollout(p, moved),
            Rollout(p, begun, push),
            Rollout(p, begun, None, push),
            Rollout(other, begun),
        ],
    )
    assert np.array_equal(read, sh.predict(Rollout(p, begun))) and np.array_equal(same, read)
    assert np.array_equal(alone, sh.predict(Rollout(other, begun)))
    own = np.isin(sh.rows, np.arange(sh.record.starts[third], sh.record.ends[third]))
    for seen in (state, pushed, kicked):
        assert np.array_equal(seen[~own], read[~own]) and not np.array_equal(seen[own], read[own])
    assert not np.array_equal(sh.predict(Rollout(p, begun, memory=2.0 * memory)), read)


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_windows_that_run_side_by_side_are_what_each_alone_would_be(build: Builder, profile: str) -> None:
    """Windows of several lengths, with impulses; one that flies apart stays where it is, and the others do not."""
    arm, rng = Arm(build(FLEXIBLE, profile, EFFECTS).folder), np.random.default_rng(8)
    m, lengths, gaps = 8, rng.integers(1, 30, 13), rng.integers(0, 3, 13)
    ends = np.cumsum(lengths + gaps)
    edges, rows = np.stack([ends - lengths, ends], 1), int(ends[-1]) + 1
    u, dt = np.tile(rng.normal(0.0, 0.5, arm.nu), (rows, 1)), np.full(rows, 2e-3)
    jump, begun = np.zeros((rows, arm.nx)), np.zeros((13, m))
    jump[::7, m - 1] = 0.05
    begun[:, m // 2 :] = rng.normal(0.0, 0.5, (13, m // 2))
    begun[4, m - 1] = 99.0
    limit = np.full(arm.nx, np.inf)
    limit[m - 1] = 100.0
    memory = rng.normal(0.0, 1e-3, (13, arm.nx - m))
    jump[edges[4, 0], m - 1] = 2.0
    found = arm.rollout_windows(begun, edges, u, dt, 1e-3, limit, jump, memory=memory)
    alone = [
        arm.rollout_windows(begun[w : w + 1], edges[w : w + 1], u, dt, 1e-3, limit, jump, memory=memory[w : w + 1])
        for w in range(13)
    ]
    assert (alone[4] == alone[4][-1]).all()
    assert all(np.ptp(one[:, 0]) > 0.0 for w, one in enumerate(alone) if w != 4 and lengths[w] > 1)
    np.testing.assert_allclose(found, np.concatenate(alone), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_each_window_takes_the_steps_of_its_own_rows(build: Builder, profile: str) -> None:
    """As a lane beside others does: otherwise a difference of the two would be that of their steps."""
    arm, rng = Arm(build(FLEXIBLE, profile, EFFECTS).folder), np.random.default_rng(9)
    edges = np.arange(0, 90, 10)[:, None] + np.array([0, 9])
    dt = rng.uniform(0.8e-3, 2.4e-3, 90)
    u, begun, memory = np.full((90, arm.nu), 0.2), np.zeros((9, 8)), np.zeros((9, arm.nx - 8))
    limit = np.full(arm.nx, np.inf)
    found = arm.rollout_windows(begun, edges, u, dt, 1e-3, limit, memory=memory)
    alone = [
        arm.rollout_windows(begun[w : w + 1], edges[w : w + 1], u, dt, 1e-3, limit, memory=memory[w : w + 1])
        for w in range(9)
    ]
    np.testing.assert_allclose(found, np.concatenate(alone), rtol=1e-9, atol=1e-12)
    lanes = [np.stack([one] * 3) for one in (begun, u, memory, arm.c)]
    many = arm.rollout_windows(lanes[0], edges, lanes[1], dt, 1e-3, limit, None, lanes[3], memory=lanes[2])
    np.testing.assert_allclose(many, np.stack([found] * 3), rtol=1e-9, atol=1e-12)


def test_first_states_of_one_point_are_not_those_of_another_that_is_asked_for_meanwhile(build: Builder) -> None:
    sh = shooting(build, "native")
    p, _ = sh.nominal_start()
    late, place = p.copy(), list(sh.arm.parameters.described).index("sensor_delay_1")
    late[place] = 5e-3
    alone = [sh.measured_initial_states(p), sh.measured_initial_states(late)]
    assert not np.array_equal(alone[0], alone[1]) and sh.arm.p[place] == 0.0
    for found in (map_in_threads(lambda k: sh.measured_initial_states((p, late)[k % 2]), range(2)) for _ in range(300)):
        assert all(np.array_equal(a, b) for a, b in zip(found, alone, strict=True))


def test_the_input_stage_goes_by_its_own_parameters(build: Builder) -> None:
    """By nothing else, as its outcome is kept by them."""
    sh, rng = shooting(build, "portable"), np.random.default_rng(5)
    arm, described = sh.arm, list(sh.arm.parameters.described.values())
    assert {described[k].name for k in sh.input_parameters} == {"current_lag_1", "current_lag_2"}
    own = arm.p.copy()
    own[sh.input_parameters] = 1e-3, 2e-3
    outcomes = []
    for _ in range(5):
        p = np.array(
            [min(max(v * rng.uniform(0.9, 1.1) + 1e-9, q.low), q.high) for v, q in zip(own, described, strict=True)]
        )
        p[sh.input_parameters] = own[sh.input_parameters]
        outcomes.append(
            np.stack(arm.with_parameters(p).apply_input_stage(sh.command, sh.steps, sh.record.initial_input))
        )
    assert all(np.array_equal(one, outcomes[0]) for one in outcomes)


TORQUE_DRIVEN = """name = "driven by a torque"
gravity = [0.0, 0.0]
[[joint]]
length = 0.3
mass = 1.0
center_of_mass = 0.15
inertia = 0.01
[joint.drive]
rigid = true
ratio = 10.0
motor_inertia = 2e-5
viscous_friction = 1e-4
coulomb_friction = 0.005
[joint.limits]
torque = 10.0
"""


def test_a_measured_torque_tells_what_became_of_the_command(build: Builder) -> None:
    """Read as the input stage has it, at a noise that no filter of the command explains; alone it tells nothing."""
    arm = Arm(build(TORQUE_DRIVEN, effects=("current_loop_lag",)).folder)
    arm.parameters["current_lag_1"] = 3e-3
    log, shown = simulated(arm), np.ones(1200, bool)
    sh = MultipleShooting(arm, cut_windows(arm, LogPortion(log, shown), 0.05))
    assert sh.record.names[0] == "motor_torque_1"
    assert sh.record.noise[0] == pytest.approx(NOISE, rel=0.1)
    p, begun = sh.nominal_start()
    errors = {}
    for lag in (0.0, 3e-3, 12e-3):
        p[list(arm.parameters.described).index("current_lag_1")] = lag
        errors[lag] = float(np.std((sh.record.samples - sh.predict(Rollout(p, begun)))[:, 0]))
    assert errors[3e-3] == pytest.approx(NOISE, rel=0.1) and min(errors[0.0], errors[12e-3]) > 1.3 * NOISE
    alone = {name: values for name, values in log.columns.items() if name != "motor_torque_command_1"}
    assert cut_windows(arm, LogPortion(Log(log.time, alone, 1, "alone"), shown), 0.05).names == (
        "motor_position_1",
        "joint_position_1",
    )


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_nothing_jumps_where_much_is_there_a_little(build: Builder, share: float) -> None:
    """A fit moves all parameters at once: a parameter that does much as soon as it is there at all holds it back."""
    arm = Arm(build(FLEXIBLE, effects=EVERY).folder)
    log = simulated(arm)
    sh = MultipleShooting(arm, cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05))
    columns, described = (
        build_candidates(arm, guess_from_log(arm, sh.record)).columns,
        list(arm.parameters.described.values()),
    )
    rng, p = np.random.default_rng(1), sh.nominal_start()[0]
    for c in columns:
        q, there = described[c.index], rng.random() < share
        p[c.index] = min(max(c.center + there * c.spike_width * c.unit * abs(rng.standard_normal()), q.low), q.high)
    begun = sh.measured_initial_states(p)

    def moved(index: int, by: float) -> Rollout:
        other = p.copy()
        other[index] += by if other[index] + by <= described[index].high else -by
        return Rollout(other, begun)

    steps = [(c.index, share * c.spike_width * c.unit) for c in columns for share in (1e-4, 1.0)]
    base, *seen = sh.predict_all([Rollout(p, begun), *(moved(*step) for step in steps)])
    far = [float(np.linalg.norm((one - base) / sh.record.sample_noise)) for one in seen]
    jumps = {
        described[c.index].name: small
        for c, small, whole in zip(columns, far[::2], far[1::2], strict=True)
        if small > max(0.01 * whole, 1.0)
    }
    assert jumps == {}


QUICK = arms.arm("R", step=1e-4, drive=f"torque_constant = 0.05\nmax_current = 40.0\n{SENSORS}")


@pytest.fixture(scope="module")
def quick(build: Builder) -> MultipleShooting:
    """A joint whose robot file states a shorter step than the diagnosis takes, with every memory that is slowed."""
    arm = Arm(build(QUICK, "portable", MEMORY).folder)
    log = simulated(arm)
    return MultipleShooting(arm, cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05))


def test_memories_are_carried_by_the_step_that_lanes_take_whatever_the_robot_file_states(
    quick: MultipleShooting,
) -> None:
    """RK4 carries a decay up to 2.78 a step, and a memory of the file's own step would decay in that."""
    assert quick.longest_step > 2.78 * quick.arm.step_size
    p, begun = quick.nominal_start()
    described = list(quick.arm.parameters.described)
    for name, value in {"presliding_share_1": 1.0, "hysteresis_torque_1": 2.0}.items():
        p[described.index(name)] = value
    x = quick.simulate_states(Rollout(p, begun))
    memories = x[:, quick.m :]
    assert memories.shape[1] == 2
    assert (np.abs(memories).max(0) < 1.05).all() and np.abs(memories[:, 0]).max() > 0.95
    assert quick.arm.with_parameters(p).parameters["memory_step"] == quick.arm.step_size


def test_a_fit_moves_whatever_step_the_robot_file_states(quick: MultipleShooting) -> None:
    """A little of every memory is tolerated, so that none of its simulations is one without."""
    real = quick.arm.with_parameters(quick.arm.p)
    real.parameters["viscous_friction_1"] *= 5.0
    log = simulated(real)
    sh = MultipleShooting(quick.arm, cut_windows(quick.arm, LogPortion(log, np.ones(len(log), bool)), 0.05))
    words = build_candidates(sh.arm, guess_from_log(sh.arm, sh.record))
    (k,) = (k for k, atom in enumerate(words.members) if atom.name == "viscous_friction@1")
    fit = begin_fit(compute_sensitivities(sh, words, make_nominal_point(sh, words)), words, (k,), 0.1)
    found = advance_fit(advance_fit(fit, words), words)
    place = sh.arm.parameters.index("viscous_friction_1")
    assert found.sensitivities.point.p[place] == pytest.approx(real.p[place], rel=0.05)
    assert sh.rollout_count > 100 and not sh.failure_count


def test_a_rollout_takes_no_longer_steps_than_its_memories_are_prepared_for(quick: MultipleShooting) -> None:
    arm, T = quick.arm, 200
    u = np.zeros((T, arm.nu))
    u[:, 0] = 5.0
    x = arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=1e-3)
    finer = arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=MOST_MEMORY_DECAYS * arm.step_size)
    assert np.array_equal(x, finer)
    arm = arm.with_parameters(arm.p)
    arm.parameters["memory_step"] = 1e-3 / MOST_MEMORY_DECAYS
    assert arm.stable_step == arm.step_size
    assert not np.array_equal(arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=1e-3), finer)


def test_a_lane_that_reads_no_number_is_counted_and_left_out(quick: MultipleShooting) -> None:
    """Nothing is learnt from it: its column is 0, and as a model it is as wrong as one can be."""
    p, begun = quick.nominal_start()
    words = build_candidates(quick.arm, guess_from_log(quick.arm, quick.record))
    at = compute_sensitivities(quick, words, OperatingPoint(p, begun))
    before, bad = quick.failure_count, p.copy()
    bad[quick.arm.parameters.index("mass_1")] = np.nan
    seen = quick.predict(Rollout(bad, begun))
    assert not np.isfinite(seen).all() and quick.failure_count == before + 1
    left = weigh_residual(quick, seen)
    assert np.isfinite(left).all()
    assert (np.abs(left) == quick.record.channel_ranges / quick.record.sample_noise)[~np.isfinite(seen)].all()
    flies = p.copy()
    flies[quick.arm.parameters.index("motor_inertia_1")] = 1e-9
    quick.predict(Rollout(flies, begun))
    assert quick.failure_count == before + 2
    columns = compute_finite_differences(
        quick, at.point, at.residual, [(Rollout(bad, begun), 0.1), (Rollout(p, begun + 1e-3), 1.0)]
    )
    assert not columns[0].any() and columns[1].any()
    assert advance_fit(begin_fit(at, words, (), 0.1), words).score.evidence > -np.inf


def test_what_a_fit_sets_stays_within_the_bounds_however_narrow(quick: MultipleShooting) -> None:
    """Bounds may be narrower than what is tolerated, or than a step: those of a spring that the step carries are."""
    arm = quick.arm.with_parameters(quick.arm.p)
    described = arm.parameters.described = dict(arm.parameters.described)
    q = described["presliding_angle_1"]
    described["presliding_angle_1"] = replace(q, low=0.9 * q.nominal, high=1.1 * q.nominal)
    torque = described["hysteresis_torque_1"]  # that is then never absent
    described["hysteresis_torque_1"] = replace(torque, low=1.0, nominal=1.0)
    mass = described["mass_1"]
    described["mass_1"] = replace(mass, low=mass.nominal, high=mass.nominal * (1 + 1e-4))
    sh = MultipleShooting(arm, quick.record)
    words = build_candidates(arm, guess_from_log(arm, sh.record))
    low, high = np.array([(one.low, one.high) for one in described.values()]).T
    for c in words.columns:
        point = make_nominal_point(sh, words)
        lane, step = step_parameter(sh, words, point, c)
        assert (low <= lane.p).all() and (lane.p <= high).all(), c.parameter
        assert step and lane.p[c.index] == pytest.approx(point.p[c.index] + step * c.unit)
    for atom in words.members:
        p = arm.parameters.clip_to_bounds(sh.nominal_start()[0])
        atom.apply_shapes(arm, p)
        assert (low <= p).all() and (p <= high).all(), atom.name
    ends = words.theta_bounds(arm)
    assert (ends[0] <= 0.0).all() and (ends[1] >= 0.0).all()
    start = make_nominal_point(sh, words).p
    assert (low <= start).all() and (start <= high).all()
    k = next(k for k, atom in enumerate(words.members) if atom.name == "transmission_hysteresis@1")
    fit = begin_fit(
        compute_sensitivities(sh, words, OperatingPoint(start, sh.measured_initial_states(start))), words, (k,), 0.1
    )
    p = refit_without(fit, words, ()).sensitivities.point.p
    assert (low <= p).all() and (p <= high).all()
