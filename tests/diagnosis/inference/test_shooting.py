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
from hdagen.arm.compiled_arm import DECAYS, Arm
from hdagen.diagnosis.data.split import Portion
from hdagen.diagnosis.data.windows import record
from hdagen.diagnosis.inference.local_fit import advanced, lessened
from hdagen.diagnosis.inference.local_fit import begun as begin_fit
from hdagen.diagnosis.inference.multiple_shooting import Lane, Shooting
from hdagen.diagnosis.inference.sensitivities import Point, _differences, _moved, design, residual
from hdagen.diagnosis.initialization.candidate_list import dictionary
from hdagen.diagnosis.initialization.initial_guess import suggested
from hdagen.diagnosis.search.null_model import first
from hdagen.log.measured_log import Log
from hdagen.support.parallel import together

Builder = Callable[..., Compiled]
EFFECTS = ("presliding_friction", "transmission_hysteresis", "sensor_delay", "current_loop_lag")
MOVED = {"torsional_damping_1": 100.0, "viscous_friction_1": 1.1, "coulomb_friction_2": 0.9, "mass_2": 1.02}  # times
SET = {"sensor_delay_1": 1e-3, "current_lag_2": 1e-3, "hysteresis_torque_1": 2.0}


def shooting(
    build: Builder, profile: str, torques: bool = False, gaps: bool = False, hidden: tuple[int, int] = (0, 0)
) -> Shooting:
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
    return Shooting(arm, record(arm, Portion(Log(log.time[kept], there, log.n_joints, log.source), shown), 0.05))


def lanes(sh: Shooting) -> list[Lane]:
    """The file's own parameters; others, first states, torques; and impulses between them."""
    p, begun = sh.begin()
    found, names = [Lane(p, begun)], list(sh.arm.parameters.described)
    values = {name: sh.arm.parameters[name] * factor for name, factor in MOVED.items()} | SET
    for name, value in values.items():
        q = p.copy()
        q[names.index(name)] = value
        found.append(Lane(q, begun))
    for k in range(4):
        moved = begun.copy()
        moved[:, k] += 1e-3
        found.append(Lane(p, moved))
    push, kick = np.zeros((2, len(sh.record.time), 2))
    push[40:80, 0], kick[::60, 1] = 0.02, 0.05
    return [Lane(p, begun, impulse=kick), *found, Lane(p, begun, torque=push), Lane(p, begun, push, kick)]


@pytest.mark.parametrize("profile", ["portable", "native"])
def test_many_lanes_are_what_each_alone_would_be(build: Builder, profile: str) -> None:
    sh = shooting(build, profile)
    given = lanes(sh)
    many = sh.all(given)
    assert len(many) == len(given) == 15 and sh.all([]) == []
    assert len({sh._step(lane) for lane in given}) == 2  # one is damped so much that its step is shorter
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
    many = (sh := shooting(build, "native")).all(lanes(sh))
    monkeypatch.setattr("hdagen.diagnosis.inference.multiple_shooting.MEMORY", 3 * 8 * sum(a[0].size for a in seat(sh)))
    narrow = shooting(build, "native")
    assert narrow.width == 3 or narrow.width == narrow.arm.module.batch_width < 3
    for seen, other in zip(narrow.all(lanes(narrow)), many, strict=True):
        np.testing.assert_allclose(seen, other, rtol=0, atol=1e-10 * np.abs(other).max())


def seat(sh: Shooting) -> tuple[np.ndarray, ...]:
    """A thread's memory."""
    found = sh.seats.get()
    sh.seats.put(found)
    return found.inputs, found.constants, found.states


@pytest.mark.parametrize("torques, gaps", [(False, False), (False, True), (True, True)])
def test_what_is_seen_is_what_the_sensors_read_of_the_states(build: Builder, torques: bool, gaps: bool) -> None:
    """Positions, read late; the current that acts; and joint torques where they are measured."""
    sh = shooting(build, "native", torques, gaps)
    assert ("joint_torque_1" in sh.record.names) == torques
    assert (np.ptp(sh.rows) >= len(sh.rows)) == gaps
    for lane in lanes(sh):
        x, arm = sh.states(lane), sh.arm.at(lane.p)
        mean, at = arm.acting(sh.record.command[:, :2], sh.steps, sh.record.before)
        u = np.hstack([mean, sh.record.command[:, 2:]])
        if lane.torque is not None:
            u[:, :2] += lane.torque / 0.05  # N m/A
        seen = late.read(arm, sh.record.time[sh.rows], x, u[sh.rows], sh.begins) | {"motor_current": at[sh.rows]}
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
    p, begun = part.begin()
    p[list(part.arm.parameters.described).index("hysteresis_torque_1")] = 2.0 * loud
    assert np.array_equal(part.predict(Lane(p, begun)), full.predict(Lane(p, begun))[looked])
    part.whole = part.brief
    assert np.array_equal(part.predict(Lane(p, begun)), full.predict(Lane(p, begun))[looked]) != loud


def test_lanes_near_one_begin_their_windows_with_its_memory(build: Builder) -> None:
    """It is the same there; a first state tells of its own window alone; what changes the memory is as it is alone."""
    sh = shooting(build, "portable", hidden=(100, 250))
    p, begun = sh.begin()
    names = list(sh.arm.parameters.described)
    p[names.index("hysteresis_torque_1")] = 2.0
    read, memory = sh.recalled(Lane(p, begun))
    assert memory.shape == (len(sh.record.kept), sh.arm.nx - sh.m) and np.abs(memory).max(0).any()
    base, other, moved = Lane(p, begun, memory=memory), p.copy(), begun.copy()
    other[names.index("hysteresis_torque_1")] = 2.1
    third = sh.record.kept[2]
    moved[third] += 1e-3
    push = np.zeros((len(sh.record.time), 2))
    push[sh.record.starts[third] : sh.record.ends[third]] = 0.02
    same, state, pushed, kicked, alone = sh.near(
        base, [Lane(p, begun), Lane(p, moved), Lane(p, begun, push), Lane(p, begun, None, push), Lane(other, begun)]
    )
    assert np.array_equal(read, sh.predict(Lane(p, begun))) and np.array_equal(same, read)
    assert np.array_equal(alone, sh.predict(Lane(other, begun)))
    own = np.isin(sh.rows, np.arange(sh.record.starts[third], sh.record.ends[third]))
    for seen in (state, pushed, kicked):
        assert np.array_equal(seen[~own], read[~own]) and not np.array_equal(seen[own], read[own])
    assert not np.array_equal(sh.predict(Lane(p, begun, memory=2.0 * memory)), read)


def test_first_states_of_one_point_are_not_those_of_another_that_is_asked_for_meanwhile(build: Builder) -> None:
    sh = shooting(build, "native")
    p, _ = sh.begin()
    late, place = p.copy(), list(sh.arm.parameters.described).index("sensor_delay_1")
    late[place] = 5e-3
    alone = [sh.begun(p), sh.begun(late)]
    assert not np.array_equal(*alone) and sh.arm.p[place] == 0.0
    for found in (together(lambda k: sh.begun((p, late)[k % 2]), range(2)) for _ in range(300)):
        assert all(np.array_equal(a, b) for a, b in zip(found, alone, strict=True))


def test_the_input_stage_goes_by_its_own_parameters(build: Builder) -> None:
    """By nothing else, as its outcome is kept by them."""
    sh, rng = shooting(build, "portable"), np.random.default_rng(5)
    arm, described = sh.arm, list(sh.arm.parameters.described.values())
    assert {described[k].name for k in sh.staging} == {"current_lag_1", "current_lag_2"}
    own = arm.p.copy()
    own[sh.staging] = 1e-3, 2e-3
    outcomes = []
    for _ in range(5):
        p = np.array(
            [min(max(v * rng.uniform(0.9, 1.1) + 1e-9, q.low), q.high) for v, q in zip(own, described, strict=True)]
        )
        p[sh.staging] = own[sh.staging]
        outcomes.append(np.stack(arm.at(p).acting(sh.command, sh.steps, sh.record.before)))
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
    sh = Shooting(arm, record(arm, Portion(log, shown), 0.05))
    assert sh.record.names[0] == "motor_torque_1"
    assert sh.record.noise[0] == pytest.approx(NOISE, rel=0.1)
    p, begun = sh.begin()
    errors = {}
    for lag in (0.0, 3e-3, 12e-3):
        p[list(arm.parameters.described).index("current_lag_1")] = lag
        errors[lag] = float(np.std((sh.record.told - sh.predict(Lane(p, begun)))[:, 0]))
    assert errors[3e-3] == pytest.approx(NOISE, rel=0.1) and min(errors[0.0], errors[12e-3]) > 1.3 * NOISE
    alone = {name: values for name, values in log.columns.items() if name != "motor_torque_command_1"}
    assert record(arm, Portion(Log(log.time, alone, 1, "alone"), shown), 0.05).names == (
        "motor_position_1",
        "joint_position_1",
    )


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_nothing_jumps_where_much_is_there_a_little(build: Builder, share: float) -> None:
    """A fit moves all parameters at once: a parameter that does much as soon as it is there at all holds it back."""
    arm = Arm(build(FLEXIBLE, effects=tuple(e.name for e in ALL if e.name != "missing_compliance")).folder)
    log = simulated(arm)
    sh = Shooting(arm, record(arm, Portion(log, np.ones(len(log), bool)), 0.05))
    columns, described = dictionary(arm, suggested(arm, sh.record)).columns, list(arm.parameters.described.values())
    rng, p = np.random.default_rng(1), sh.begin()[0]
    for c in columns:
        q, there = described[c.index], rng.random() < share
        p[c.index] = min(max(c.center + there * c.spike * c.unit * abs(rng.standard_normal()), q.low), q.high)
    begun = sh.begun(p)

    def moved(index: int, by: float) -> Lane:
        other = p.copy()
        other[index] += by if other[index] + by <= described[index].high else -by
        return Lane(other, begun)

    steps = [(c.index, share * c.spike * c.unit) for c in columns for share in (1e-4, 1.0)]
    base, *seen = sh.all([Lane(p, begun), *(moved(*step) for step in steps)])
    far = [float(np.linalg.norm((one - base) / sh.record.spread)) for one in seen]
    jumps = {
        described[c.index].name: small
        for c, small, whole in zip(columns, far[::2], far[1::2], strict=True)
        if small > max(0.01 * whole, 1.0)
    }
    assert jumps == {}


QUICK = arms.arm("R", step=1e-4, drive=f"torque_constant = 0.05\nmax_current = 40.0\n{SENSORS}")


@pytest.fixture(scope="module")
def quick(build: Builder) -> Shooting:
    """A joint whose robot file states a shorter step than the diagnosis takes, with every memory that is slowed."""
    arm = Arm(build(QUICK, "portable", MEMORY).folder)
    log = simulated(arm)
    return Shooting(arm, record(arm, Portion(log, np.ones(len(log), bool)), 0.05))


def test_memories_are_carried_by_the_step_that_lanes_take_whatever_the_robot_file_states(quick: Shooting) -> None:
    """RK4 carries a decay up to 2.78 a step, and a memory of the file's own step would decay in that."""
    assert quick.most > 2.78 * quick.arm.step_size
    p, begun = quick.begin()
    described = list(quick.arm.parameters.described)
    for name, value in {"presliding_share_1": 1.0, "hysteresis_torque_1": 2.0}.items():
        p[described.index(name)] = value
    x = quick.states(Lane(p, begun))
    memories = x[:, quick.m :]
    assert memories.shape[1] == 2
    assert (np.abs(memories).max(0) < 1.05).all() and np.abs(memories[:, 0]).max() > 0.95
    assert quick.arm.at(p).parameters["memory_step"] == quick.arm.step_size


def test_a_fit_moves_whatever_step_the_robot_file_states(quick: Shooting) -> None:
    """A little of every memory is tolerated, so that none of its simulations is one without."""
    real = quick.arm.at(quick.arm.p)
    real.parameters["viscous_friction_1"] *= 5.0
    log = simulated(real)
    sh = Shooting(quick.arm, record(quick.arm, Portion(log, np.ones(len(log), bool)), 0.05))
    words = dictionary(sh.arm, suggested(sh.arm, sh.record))
    (k,) = (k for k, atom in enumerate(words.atoms) if atom.name == "viscous_friction@1")
    fit = begin_fit(design(sh, words, first(sh, words)), words, (k,), 0.1)
    found = advanced(advanced(fit, words), words)
    place = sh.arm.parameters.place("viscous_friction_1")
    assert found.design.point.p[place] == pytest.approx(real.p[place], rel=0.05)
    assert sh.run > 100 and not sh.failed


def test_a_rollout_takes_no_longer_steps_than_its_memories_are_prepared_for(quick: Shooting) -> None:
    arm, T = quick.arm, 200
    u = np.zeros((T, arm.nu))
    u[:, 0] = 5.0
    x = arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=1e-3)
    finer = arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=DECAYS * arm.step_size)
    assert np.array_equal(x, finer)
    arm = arm.at(arm.p)
    arm.parameters["memory_step"] = 1e-3 / DECAYS
    assert arm.stable_step == arm.step_size
    assert not np.array_equal(arm.rollout(arm.rest(np.zeros(1)), u, dt=1e-3, exact=True, most=1e-3), finer)


def test_a_lane_that_reads_no_number_is_counted_and_left_out(quick: Shooting) -> None:
    """Nothing is learnt from it: its column is 0, and as a model it is as wrong as one can be."""
    p, begun = quick.begin()
    words = dictionary(quick.arm, suggested(quick.arm, quick.record))
    at = design(quick, words, Point(p, begun))
    before, bad = quick.failed, p.copy()
    bad[quick.arm.parameters.place("mass_1")] = np.nan
    seen = quick.predict(Lane(bad, begun))
    assert not np.isfinite(seen).all() and quick.failed == before + 1
    left = residual(quick, seen)
    assert np.isfinite(left).all()
    assert (np.abs(left) == quick.record.span / quick.record.spread)[~np.isfinite(seen)].all()
    flies = p.copy()
    flies[quick.arm.parameters.place("motor_inertia_1")] = 1e-9
    quick.predict(Lane(flies, begun))
    assert quick.failed == before + 2
    columns = _differences(quick, at.point, at.residual, [(Lane(bad, begun), 0.1), (Lane(p, begun + 1e-3), 1.0)])
    assert not columns[0].any() and columns[1].any()
    assert advanced(begin_fit(at, words, (), 0.1), words).score.evidence > -np.inf


def test_what_a_fit_sets_stays_within_the_bounds_however_narrow(quick: Shooting) -> None:
    """Bounds may be narrower than what is tolerated, or than a step: those of a spring that the step carries are."""
    arm = quick.arm.at(quick.arm.p)
    described = arm.parameters.described = dict(arm.parameters.described)
    q = described["presliding_angle_1"]
    described["presliding_angle_1"] = replace(q, low=0.9 * q.nominal, high=1.1 * q.nominal)
    torque = described["hysteresis_torque_1"]  # that is then never absent
    described["hysteresis_torque_1"] = replace(torque, low=1.0, nominal=1.0)
    mass = described["mass_1"]
    described["mass_1"] = replace(mass, low=mass.nominal, high=mass.nominal * (1 + 1e-4))
    sh = Shooting(arm, quick.record)
    words = dictionary(arm, suggested(arm, sh.record))
    low, high = np.array([(one.low, one.high) for one in described.values()]).T
    for c in words.columns:
        point = first(sh, words)
        lane, step = _moved(sh, words, point, c)
        assert (low <= lane.p).all() and (lane.p <= high).all(), c.parameter
        assert step and lane.p[c.index] == pytest.approx(point.p[c.index] + step * c.unit)
    for atom in words.atoms:
        p = arm.parameters.within(sh.begin()[0])
        atom.shape(arm, p)
        assert (low <= p).all() and (p <= high).all(), atom.name
    ends = words.bounds(arm)
    assert (ends[0] <= 0.0).all() and (ends[1] >= 0.0).all()
    start = first(sh, words).p
    assert (low <= start).all() and (start <= high).all()
    k = next(k for k, atom in enumerate(words.atoms) if atom.name == "transmission_hysteresis@1")
    fit = begin_fit(design(sh, words, Point(start, sh.begun(start))), words, (k,), 0.1)
    p = lessened(fit, words, ()).design.point.p
    assert (low <= p).all() and (p <= high).all()
