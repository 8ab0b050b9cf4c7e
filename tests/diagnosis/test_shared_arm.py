"""Arms that threads share: whatever reads an arm leaves its parameters alone, so one log gives the same bits always."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, HYSTERESIS, RIGID, RIGID_SEVERAL, simulated

from gen.effects import ALL
from hdagen.adoption.verdict import read_verdict
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import LogPortion
from hdagen.diagnosis.data.windows import cut_windows
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.initialization.initial_guess import guess_from_log
from hdagen.diagnosis.residuals.residual_torque import see_residual_torque
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import replay

Builder = Callable[..., Compiled]
EVERY = tuple(effect.name for effect in ALL)
EMPTY = {"schema": 2, "verdict": [], "causes": [], "parameters": {}}


@pytest.fixture(params=[(FLEXIBLE, EVERY), (RIGID, RIGID_SEVERAL)], ids=["flexible", "rigid"])
def given(build: Builder, request: pytest.FixtureRequest) -> tuple[Arm, Log]:
    """An arm away from its robot file, which cannot be set, and a log of it."""
    robot, effects = request.param
    arm = Arm(build(robot, effects=effects).folder)
    names = [name for name in arm.parameters if name.startswith("mass_")]
    arm.parameters.update({name: 1.1 * arm.parameters[name] for name in names})
    more = HYSTERESIS | {"sensor_delay_1": 2e-3, "sensor_delay_2": 2e-3}
    arm.parameters.update({name: value for name, value in more.items() if name in arm.parameters})
    log = simulated(arm, 0.6)
    arm.c.flags.writeable = arm.p.flags.writeable = False
    return arm, log


def test_an_arm_with_other_parameters_leaves_the_first_as_it_is(given: tuple[Arm, Log]) -> None:
    arm, _ = given
    p, x, u = arm.p.copy(), np.full(arm.nx, 1e-3), np.zeros(arm.nu)
    moved = np.array([q.nominal for q in arm.parameters.described.values()])
    own = arm.rhs(x, u)
    other = arm.with_parameters(moved)
    assert np.array_equal(other.p, moved) and np.array_equal(other.c, Arm(arm.folder).c)
    assert other.parameters["mass_1"] == moved[list(arm.parameters).index("mass_1")] != arm.parameters["mass_1"]
    assert not np.array_equal(other.rhs(x, u), own)
    moved[:] = 0.0  # nor does the other hang on what it was given
    other.parameters["mass_1"] = 2.0 * arm.parameters["mass_1"]
    other.parameters.reset()
    assert np.array_equal(other.c, Arm(arm.folder).c)
    assert np.array_equal(arm.p, p) and np.array_equal(arm.rhs(x, u), own)


def test_what_reads_an_arm_never_sets_it(given: tuple[Arm, Log]) -> None:
    """Its constants are locked here: whatever would set them fails."""
    arm, log = given
    assert arm.stability.longest_step(arm.p) > 0.0 and arm.stable_step > 0.0
    found = replay(arm, log)
    seen = cut_windows(arm, LogPortion(log, np.ones(len(log), bool)), 0.05)
    guess_from_log(arm, seen)
    shooting = MultipleShooting(arm, seen)
    shooting.measured_initial_states(arm.p * 1.01)
    sight = see_residual_torque(arm, read_verdict(EMPTY), log, found, found)
    for p in (sight.before, sight.after):
        asked = (
            sight.balance.residual(p).motor,
            *sight.balance.simulate_inputs(p),
            sight.balance.link_torque(p),
            sight.balance.encoder_error(p, sight.before),
        )
        assert all(np.isfinite(one).all() for one in asked)
    with pytest.raises(TypeError, match="writable"):
        arm.parameters.reset()


def test_replays_of_one_arm_in_many_threads_have_the_same_bits(build: Builder) -> None:
    """The first of them find what an arm finds out about itself once, while the others are at work."""
    folder = build(FLEXIBLE, effects=EVERY).folder
    log = simulated(Arm(folder), 1.2)
    for _ in range(3):
        arm = Arm(folder)
        arm.parameters.update({f"mass_{j}": 1.2 * arm.parameters[f"mass_{j}"] for j in (1, 2)})
        with ThreadPoolExecutor(4) as pool:
            states = [one.states for one in pool.map(partial(replay, arm), [log] * 4)]
        assert all(np.array_equal(one, states[0]) for one in states)
