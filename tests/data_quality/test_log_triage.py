"""Triage: each mistake is found, on the right joint, and the line of columns.toml that it names repairs it."""

from __future__ import annotations

import itertools
import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdagen.data_quality.finding import Severity
from hdagen.data_quality.log_triage import Triage, triage
from hdagen.log.channel_statistics import compute_channel_statistics, estimate_noise, find_quantisation_step
from hdagen.log.measured_log import Log, read, write

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
RATIOS = (100.0, 80.0)
RESOLUTIONS = {"motor_position": 2 * np.pi / 4096, "joint_position": 2 * np.pi / 2**20}
CONSTANT = 0.05  # N m/A
PERIOD = 1e-3


def simulate(seconds: float = 6.0, pushes: bool = True) -> Log:
    """Two links in the vertical plane behind flexible gears, position controlled, with friction, noise and encoders.

    Written for these tests alone: rigid links whose joint torque twists the gear, semi-implicit Euler at 0.1 ms. The
    controller reads and commands once a millisecond; the current follows within it.
    """
    inertia, coupling, gravity = np.array([0.25, 0.09]), 0.05, np.array([6.0, 2.0])
    stiffness, reflected = 8000.0, np.array([1.3e-4 * r**2 for r in RATIOS])
    ratios, random = np.array(RATIOS), np.random.default_rng(11)
    q, speed, torque, previous = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    steps = round(seconds / PERIOD)
    out = {name: np.zeros((steps, 2)) for name in ("command", "current", "motor", "joint", "reference", "force")}
    for k in range(steps):
        time = k * PERIOD
        ramp = min(1.0, time)
        reference = ramp * np.array(
            [
                0.6 * np.sin(2.1 * time) + 0.1 * np.sin(11 * time),
                0.7 * np.sin(3.3 * time + 1) + 0.08 * np.sin(13 * time),
            ]
        )
        force = np.array([6.0, -3.0]) if pushes and 2.0 < time < 2.6 else np.zeros(2)
        command = np.clip((900 * (reference - q) - 60 * speed) / ratios / CONSTANT, -15, 15)
        row = {
            "command": command,
            "current": previous + 0.01 * random.standard_normal(2),
            "motor": ratios * (q + torque / stiffness),
            "joint": q,
            "reference": reference,
            "force": force,
        }
        for name, values in row.items():
            out[name][k] = values
        previous = command
        for _ in range(10):
            mass = np.array(
                [
                    [inertia[0] + reflected[0] + 2 * coupling * np.cos(q[1]), inertia[1] + coupling * np.cos(q[1])],
                    [inertia[1] + coupling * np.cos(q[1]), inertia[1] + reflected[1]],
                ]
            )
            friction = 3.0 * np.tanh(speed / 0.01) + 0.5 * speed
            weight = np.array([gravity[0] * np.cos(q[0]) + gravity[1] * np.cos(q.sum()), gravity[1] * np.cos(q.sum())])
            arm = 0.15 * np.array([[-np.sin(q[0]), np.cos(q[0])], [-np.sin(q.sum()), np.cos(q.sum())]])
            pushed = np.array([(arm[0] + arm[1]) @ force, arm[1] @ force])
            acceleration = np.linalg.solve(mass, ratios * CONSTANT * command - friction - weight + pushed)
            torque = weight + inertia * acceleration - pushed
            speed = speed + 1e-4 * acceleration
            q = q + 1e-4 * speed
    columns = {}
    for j in (1, 2):
        columns[f"motor_current_command_{j}"] = out["command"][:, j - 1]
        columns[f"motor_current_{j}"] = out["current"][:, j - 1]
        for name in ("motor", "joint"):
            step = RESOLUTIONS[f"{name}_position"]
            columns[f"{name}_position_{j}"] = step * np.rint(out[name][:, j - 1] / step)
        columns[f"joint_position_reference_{j}"] = out["reference"][:, j - 1]
    columns["tip_force_x"], columns["tip_force_y"] = out["force"].T
    return Log(PERIOD * np.arange(steps), columns, 2, "simulated")


@pytest.fixture(scope="module")
def good() -> Log:
    """A log without a mistake."""
    return simulate()


def changed(log: Log, **columns: np.ndarray) -> Log:
    """The log with other columns in place of its own."""
    return Log(log.time, log.columns | columns, log.n_joints, log.source)


def look(log: Log, stated: bool = True) -> Triage:
    """Triage with all that a robot file can state, or with the ratios alone."""
    if not stated:
        return triage(log, RATIOS[: log.n_joints])
    resolutions = {f"{name}_{j}": step for name, step in RESOLUTIONS.items() for j in (1, 2)}
    return triage(log, RATIOS, resolutions, max_currents=(15.0, 15.0), position_limits=((-2.5, 2.5), (-2.5, 2.5)))


@pytest.mark.parametrize("stated", [True, False])
def test_a_good_log_raises_no_suspicion(good: Log, stated: bool) -> None:
    found = look(good, stated)
    assert found.refusals == () and found.warnings == ()


def test_a_triage_says_rate_steps_noise_and_lag(good: Log) -> None:
    found = look(good)
    assert found.rows == 6000 and found.rate == pytest.approx(1000) and found.jitter < 1e-9 and found.dropped == 0
    channels = {channel.name: channel for channel in found.channels}
    for j in (1, 2):
        assert channels[f"motor_position_{j}"].step == pytest.approx(RESOLUTIONS["motor_position"], rel=1e-6)
        assert channels[f"joint_position_{j}"].step == pytest.approx(RESOLUTIONS["joint_position"], rel=1e-6)
        assert channels[f"motor_current_{j}"].noise == pytest.approx(0.01, rel=0.15)
        assert channels[f"motor_current_{j}"].step == 0.0
        assert found.lags[f"motor_current_{j}"] == pytest.approx(1e-3, abs=1e-4)
    words = "\n".join(found.words())
    assert "6000 rows" in words and "1000 Hz" in words and "motor_current_1 lags its command by 1 ms" in words
    data = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert data["rate"] == found.rate and data["channels"]["motor_current_1"]["noise"] > 0 and data["refused"] == []


def test_noise_is_told_from_a_moving_signal() -> None:
    time, random = np.arange(4000) * 1e-3, np.random.default_rng(2)
    signal = 8 * np.sin(2 * np.pi * 7 * time) + 3 * np.sin(2 * np.pi * 23 * time)
    for size in (1e-3, 1e-2, 1.0):
        assert estimate_noise(signal + size * random.standard_normal(4000)) == pytest.approx(size, rel=0.2)
    assert estimate_noise(np.zeros(100)) == 0.0


@pytest.mark.parametrize("step", [1e-9, 6e-6, 0.0015, 1.0])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_steps_are_found_and_only_where_there_are_any(step: float, kind: type) -> None:
    random = np.random.default_rng(4)
    counts = np.cumsum(random.integers(-30, 31, 5000))
    if kind is np.float32:
        counts = counts % 20000  # float32 has 24 bits
    values = np.asarray(step * counts, dtype=kind).astype(float)
    assert find_quantisation_step(np.unique(values)) == pytest.approx(step, rel=1e-3)
    assert find_quantisation_step(np.unique(random.standard_normal(5000))) == 0.0
    assert find_quantisation_step(np.unique(np.sin(np.arange(5000) * 1e-3))) == 0.0


def shift(values: np.ndarray, rows: int) -> np.ndarray:
    """Down by ``rows``, the first or last value repeated."""
    index = np.clip(np.arange(len(values)) - rows, 0, len(values) - 1)
    return values[index]


def reverse(*names: str) -> Callable[[Log], Log]:
    return lambda log: changed(log, **{name: -log[name] for name in names})


def times(factor: float, *names: str) -> Callable[[Log], Log]:
    return lambda log: changed(log, **{name: factor * log[name] for name in names})


def swap(first: str, second: str) -> Callable[[Log], Log]:
    return lambda log: changed(log, **{first: log[second], second: log[first]})


def wrap(name: str, low: float = 0.0) -> Callable[[Log], Log]:
    return lambda log: changed(log, **{name: (log[name] - low) % (2 * np.pi) + low})


DEGREE = 180 / np.pi
SWAPPED = '[motor_position_1]\nfrom = "motor_position_2"\n[motor_position_2]\nfrom = "motor_position_1"'
SWAPPED_CURRENTS = "\n".join(
    f'[{base}_{j}]\nfrom = "{base}_{3 - j}"' for base in ("motor_current", "motor_current_command") for j in (1, 2)
)
# what is wrong: (how the log is spoilt, the finding, its joint, the columns.toml that repairs it)
MISTAKES: dict[str, tuple[Callable[[Log], Log], str, int, str]] = {
    "motor encoder wraps": (wrap("motor_position_2"), "wrapped", 2, "[motor_position_2]\nwrap = 6.283185307179586"),
    "motor encoder wraps at half a turn": (
        wrap("motor_position_1", -np.pi),
        "wrapped",
        1,
        "[motor_position_1]\nwrap = 6.283185307179586",
    ),
    "joint encoder wraps": (wrap("joint_position_1"), "wrapped", 1, "[joint_position_1]\nwrap = 6.283185307179586"),
    "encoder wraps in degrees": (
        lambda log: changed(log, joint_position_1=(DEGREE * log["joint_position_1"]) % 360),
        "wrapped",
        1,
        '[joint_position_1]\nwrap = 360\nunit = "deg"',
    ),
    "joint in degrees": (times(DEGREE, "joint_position_2"), "degrees", 2, '[joint_position_2]\nunit = "deg"'),
    "motor in degrees": (times(DEGREE, "motor_position_1"), "degrees", 1, '[motor_position_1]\nunit = "deg"'),
    "both in degrees": (
        times(DEGREE, "motor_position_1", "joint_position_1"),
        "degrees",
        1,
        '[motor_position_1]\nunit = "deg"\n[joint_position_1]\nunit = "deg"',
    ),
    "motor angle at joint scale": (
        times(1 / 80, "motor_position_2"),
        "joint_scale",
        2,
        "[motor_position_2]\njoint_side_ratio = 80",
    ),
    "motor in degrees at joint scale": (
        times(DEGREE / 100, "motor_position_1"),
        "degrees",
        1,
        '[motor_position_1]\nunit = "deg"\njoint_side_ratio = 100',
    ),
    "motor in turns": (times(1 / (2 * np.pi), "motor_position_2"), "units", 2, '[motor_position_2]\nunit = "turn"'),
    "current reversed": (
        reverse("motor_current_1", "motor_current_command_1"),
        "reversed",
        1,
        "[motor_current_1]\nsign = -1\n[motor_current_command_1]\nsign = -1",
    ),
    "measured current reversed": (reverse("motor_current_2"), "reversed", 2, "[motor_current_2]\nsign = -1"),
    "joint encoder reversed": (reverse("joint_position_2"), "reversed", 2, "[joint_position_2]\nsign = -1"),
    "both encoders reversed": (
        reverse("joint_position_1", "motor_position_1", "joint_position_reference_1"),
        "reversed",
        1,
        "\n".join(f"[{n}_1]\nsign = -1" for n in ("joint_position", "motor_position", "joint_position_reference")),
    ),
    "reference reversed": (
        reverse("joint_position_reference_1"),
        "reversed",
        1,
        "[joint_position_reference_1]\nsign = -1",
    ),
    "reference in degrees": (
        times(DEGREE, "joint_position_reference_2"),
        "degrees",
        2,
        '[joint_position_reference_2]\nunit = "deg"',
    ),
    "command logged a row late": (
        lambda log: changed(log, motor_current_command_1=shift(log["motor_current_command_1"], 1)),
        "row_shift",
        1,
        "[motor_current_command_1]\nshift_rows = -1",
    ),
    "measurement logged a row early": (
        lambda log: changed(log, motor_current_2=shift(log["motor_current_2"], -1)),
        "row_shift",
        2,
        "[motor_current_2]\nshift_rows = 1",
    ),
    "milliamperes": (
        times(1e3, "motor_current_1", "motor_current_command_1"),
        "milliamperes",
        1,
        '[motor_current_1]\nunit = "mA"\n[motor_current_command_1]\nunit = "mA"',
    ),
    "measured in milliamperes": (times(1e3, "motor_current_2"), "milliamperes", 2, '[motor_current_2]\nunit = "mA"'),
    "motor encoders swapped": (swap("motor_position_1", "motor_position_2"), "swapped", 1, SWAPPED),
    "currents swapped": (
        lambda log: swap("motor_current_1", "motor_current_2")(
            swap("motor_current_command_1", "motor_current_command_2")(log)
        ),
        "swapped",
        2,
        SWAPPED_CURRENTS,
    ),
}


@pytest.mark.parametrize("stated", [True, False], ids=["robot file", "ratios alone"])
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_refused_named_and_repaired(good: Log, tmp_path: Path, mistake: str, stated: bool) -> None:
    spoil, name, joint, repair = MISTAKES[mistake]
    spoilt = spoil(good)
    found = look(spoilt, stated)
    refused = [f for f in found.findings if f.severity is Severity.REFUSE]
    assert (name, joint) in {(f.name, f.joint) for f in refused}
    assert {f.name for f in refused} <= {name, "degrees" if "degrees" in mistake else name}  # no other explanation
    spoilt_joints = {j for _, j in {(n, int(n[-1])) for n in _changed(good, spoilt)}}
    assert {f.joint for f in refused} <= spoilt_joints  # a sound joint is never accused
    text = "\n".join(found.refusals)
    keys = [line for line in repair.splitlines() if line and not line.startswith(("[", "from"))]
    assert "columns.toml" in text and (not keys or any(key in text for key in keys)), text
    path, columns = tmp_path / "log.parquet", tmp_path / "columns.toml"
    write(spoilt, path)
    columns.write_text(repair)
    repaired = look(read(path, columns, joints=2), stated)
    assert repaired.refusals == () and repaired.warnings == ()


def _changed(before: Log, after: Log) -> list[str]:
    return [name for name in before.columns if not np.array_equal(before[name], after[name])]


def test_a_command_logged_a_row_early_is_a_warning_for_a_slow_drive_looks_the_same(good: Log) -> None:
    found = look(changed(good, motor_current_command_1=shift(good["motor_current_command_1"], -1)))
    assert found.refusals == ()
    assert any(
        "row k-2" in sentence and "shift_rows = 1 under [motor_current_command_1]" in sentence
        for sentence in found.warnings
    )


@pytest.mark.parametrize("rows", [3, 8, 40])
def test_a_delay_of_the_drive_is_measured_and_not_refused(good: Log, rows: int) -> None:
    found = look(changed(good, motor_current_2=shift(good["motor_current_2"], rows)))
    assert found.refusals == () and found.lags["motor_current_2"] == pytest.approx((1 + rows) * PERIOD, abs=2e-4)


def test_a_command_under_the_name_of_a_measurement_is_refused(good: Log) -> None:
    found = look(changed(good, motor_current_1=good["motor_current_command_1"]))
    assert any('ignore = ["motor_current_1"]' in sentence for sentence in found.refusals)


def test_another_robots_ratio_is_refused(good: Log) -> None:
    found = triage(good, (50.0, 80.0))
    assert [f.joint for f in found.findings if f.name == "ratio"] == [1]
    assert "moves 99.98 times" in found.refusals[0] and "ratio 50" in found.refusals[0]
    with pytest.raises(ValueError, match="2 joints"):
        triage(good, (100.0,))


def test_resolution_and_limits_that_do_not_fit_are_warnings(good: Log) -> None:
    found = triage(good, RATIOS, {"motor_position_1": 1e-4}, position_limits=((-0.5, 0.5), None))
    assert found.refusals == ()
    assert [(f.name, f.joint) for f in found.findings if f.severity is Severity.WARN] == [
        ("limits", 1),
        ("resolution", 1),
    ]


def test_glitches_and_jumps_of_an_encoder_are_told_apart(good: Log) -> None:
    glitch = good["joint_position_1"].copy()
    glitch[[1000, 3000]] += 9.0
    found = look(changed(good, joint_position_1=glitch), stated=False)
    assert any("rows" in s and "first after row 1000" in s for s in found.warnings)
    jump = good["joint_position_1"].copy()
    jump[2500:] += 5.0
    found = look(changed(good, joint_position_1=jump), stated=False)
    assert [(f.name, f.joint) for f in found.findings if f.severity is Severity.REFUSE] == [("jump", 1)]
    assert "first after row 2500" in found.refusals[0]


def test_a_reference_may_jump(good: Log) -> None:
    steps = np.sign(np.sin(2 * good.time)) * 0.5 + 1e-3 * np.sin(good.time)
    assert look(changed(good, joint_position_reference_1=steps), stated=False).refusals == ()


def dropped(log: Log, keep: np.ndarray) -> Log:
    return Log(log.time[keep], {n: v[keep] for n, v in log.columns.items()}, log.n_joints, log.source)


def test_dropped_rows_are_counted_and_too_many_refused(good: Log) -> None:
    random = np.random.default_rng(8)
    few = random.random(len(good)) > 0.03
    few[[0, -1]] = True
    found = look(dropped(good, few))
    assert found.dropped == np.count_nonzero(~few) and found.refusals == ()
    assert [f.name for f in found.findings if f.severity is Severity.WARN] == ["dropped"]
    many = random.random(len(good)) > 0.35
    many[[0, -1]] = True
    assert any("too many" in sentence for sentence in look(dropped(good, many)).refusals)
    hole = np.ones(len(good), bool)
    hole[2000:2400] = False
    found = look(dropped(good, hole))
    assert (
        found.dropped == 400
        and found.gaps == 1
        and any("longest of 0.401 s after row 2000" in s for s in found.warnings)
    )


def test_a_position_may_move_far_while_rows_are_missing(good: Log) -> None:
    position = good["joint_position_1"]
    low, high = sorted((int(np.argmin(position)), int(np.argmax(position))))
    hole = np.ones(len(good), bool)
    hole[low + 1 : high] = False
    found = look(dropped(good, hole), stated=False)
    assert not {"jump", "wrapped", "glitch"} & {f.name for f in found.findings}


def test_short_still_and_saturated_logs_are_warned_of(good: Log) -> None:
    assert any("lasts 0.499 s" in s for s in look(good.rows(1000, 1500)).warnings)
    still = changed(good, motor_position_2=np.zeros(len(good)), joint_position_2=1e-5 * good["joint_position_2"])
    names = [(f.name, f.joint) for f in look(still, stated=False).findings if f.severity is not Severity.NOTE]
    assert names == [("still", 2), ("still", 2)]
    limited = np.clip(good["motor_current_command_1"], -4, 4)
    measured = shift(limited, 1) + 1e-3 * np.sin(good.time * 1e4)
    found = look(changed(good, motor_current_command_1=limited, motor_current_1=measured))
    assert any("motor_current_command_1 sits at -4 or 4" in s for s in found.warnings)
    refused = [(f.name, f.joint) for f in found.findings if f.severity is Severity.REFUSE]
    assert refused == [("saturated", 1)]  # the motion is that of the current before it was cut


def test_what_is_missing_is_said_with_its_cost(good: Log) -> None:
    kept = ("motor_current_command_1", "motor_position_1")
    found = triage(Log(good.time, {n: good[n] for n in kept}, 1, ""), RATIOS[:1])
    notes = [f.sentence for f in found.findings if f.name == "missing"]
    assert len(notes) == 3 and found.refusals == ()
    assert any(note.startswith("joint_position_1 is not logged") for note in notes)
    assert any(note.startswith("motor_current_1 is not logged: delay") for note in notes)


def test_a_sign_that_little_speaks_for_is_a_warning(good: Log) -> None:
    wander = np.cumsum(np.random.default_rng(6).standard_normal(len(good)))
    wander = (wander - wander.mean()) / wander.std() * good["motor_current_1"].std()
    kept = {n: good[n] for n in ("joint_position_1", "motor_position_1")}
    found = triage(Log(good.time, kept | {"motor_current_1": wander - good["motor_current_1"]}, 1, ""), RATIOS[:1])
    assert found.refusals == () and any("a reversed sign, or a hand" in sentence for sentence in found.warnings)


@pytest.mark.parametrize("stiffness", [0.0, 30.0, 300.0])
@pytest.mark.parametrize("damping", [3.0, 30.0])
def test_a_compliant_arm_pushed_by_hand_is_not_accused(stiffness: float, damping: float) -> None:
    """Moved by forces alone, unlogged: the motor only holds back and takes power out, and is no reversed one."""
    random = np.random.default_rng(1)
    time, ratio, inertia = np.arange(8000) * PERIOD, 100.0, 1.3
    force = 6 * np.sin(2 * np.pi * 0.7 * time) * (np.sin(2 * np.pi * 0.13 * time) > 0) + 3 * np.sin(9 * time)
    q, torque, speed = np.zeros(len(time)), np.zeros(len(time)), 0.0
    for k in range(1, len(time)):
        seen = RESOLUTIONS["joint_position"] * np.rint(q[max(k - 2, 0) : k] / RESOLUTIONS["joint_position"])
        torque[k] = -stiffness * seen[-1] - damping * (seen[-1] - seen[0]) / PERIOD
        speed += PERIOD * (torque[k] + force[k] - 0.3 * np.tanh(speed / 0.01)) / inertia
        q[k] = q[k - 1] + PERIOD * speed
    measured = torque / ratio + 1e-3 * random.standard_normal(len(time))
    log = Log(time, {"motor_torque_1": measured, "joint_position_1": q}, 1, "")
    assert np.ptp(q) > 0.02 and np.mean(torque[:-1] * np.diff(q)) < 0
    assert triage(log, (ratio,)).refusals == ()


def one_joint(time: np.ndarray, position: np.ndarray, **columns: np.ndarray) -> Log:
    """A log of one joint with torque and position."""
    speed = np.gradient(np.convolve(np.pad(position, 7, mode="edge"), np.ones(15) / 15, "valid"), time)
    torque = np.gradient(speed, time) + 0.1 * speed + 0.05 * np.tanh(20 * speed)
    return Log(time, {"motor_torque_1": torque, "joint_position_1": position} | columns, 1, "one joint")


def there_and_back(time: np.ndarray, rest: float) -> np.ndarray:
    """From −1 to 1 rad and back at limited acceleration, with ``rest`` s at both ends."""
    phase = np.mod(time, 2 * (1 + rest))
    half = np.clip(np.where(phase < 1 + rest, phase, 2 * (1 + rest) - phase - rest), 0, 1)
    return -1 + 2 * np.where(half < 0.5, 2 * half**2, 1 - 2 * (1 - half) ** 2)


@pytest.mark.parametrize("period", [1e-3, 5e-3, 1e-2, 2e-2])
@pytest.mark.parametrize("step", [2 * np.pi / 4096, 2 * np.pi / 2**20])
def test_a_joint_that_rests_at_its_turning_points_is_not_cut_off(period: float, step: float) -> None:
    time = np.arange(0, 8, period)
    rests = np.round(there_and_back(time, 0.2) / step) * step
    assert triage(one_joint(time, rests), (10.0,)).refusals == ()
    swings = np.round(np.sin(3 * time) / step) * step
    assert triage(one_joint(time, swings), (10.0,)).refusals == ()
    cut = triage(one_joint(time, np.clip(swings, -0.8, 0.9)), (10.0,))
    told = step < 1e-5 or period > 2e-3  # where the joint goes on by one count a row a kink is not seen
    assert any("the sensor's range has ended" in sentence for sentence in cut.refusals) == told


def test_a_log_of_two_rates_has_lost_no_row(good: Log) -> None:
    time = np.concatenate([np.arange(400) * 5.3e-3, 2.12 + np.arange(800) * 3.5e-3])
    found = triage(one_joint(time, np.sin(3 * time)), (10.0,))
    assert found.dropped == 0 and found.refusals == ()


def test_a_motion_that_changes_within_a_few_rows_has_lost_none() -> None:
    """Slow sampling of quick moves: a row goes twice as far as those around, but not as its neighbours."""
    time = np.arange(0, 24, 0.02)
    hurry = 1.2 * np.exp(-(((time % 1.0 - 0.5) / 0.02) ** 2))
    position = np.cumsum(0.02 * np.sign(np.sin(0.9 * time)) * (0.2 + 0.2 * hurry))
    names = {one.name for one in triage(one_joint(time, position), (10.0,)).findings}
    assert "dropped" not in names
    kept = np.ones(len(time), bool)
    kept[100::60] = False
    rows = Log(time[: kept.sum()], {"joint_position_1": np.sin(0.9 * time)[kept]}, 1, "one joint")
    told = triage(Log(rows.time, rows.columns | {"motor_torque_1": np.sin(rows.time)}, 1, ""), (10.0,)).findings
    assert "dropped" in {one.name for one in told}


def test_a_lead_in_a_slow_sine_is_a_phase_and_not_a_row() -> None:
    """Ahead of its command, but as unlike it there as anywhere."""
    time, random = np.arange(0, 10, 2e-3), np.random.default_rng(7)
    command = np.sin(2 * np.pi * 0.6 * time)
    measured = 0.8 * np.sin(2 * np.pi * 0.6 * (time + 0.03)) + 0.12 * np.sin(2 * np.pi * 1.8 * time + 0.4)
    measured += 0.02 * random.standard_normal(len(time))
    position = -np.sin(2 * np.pi * 0.6 * time)
    log = Log(
        time, {"motor_torque_command_1": command, "motor_torque_1": measured, "joint_position_1": position}, 1, ""
    )
    found = triage(log, (6.0,))
    assert found.lags["motor_torque_1"] < -0.008
    assert "row_shift" not in {f.name for f in found.findings if f.severity is not Severity.NOTE}
    assert any("which cannot be, and hardly better" in f.sentence for f in found.findings)


def test_a_current_that_is_held_is_read_though_its_sensor_has_noise(good: Log) -> None:
    """Motors without current, or with one that stays: commands that stand still, measurements that do so but for noise
    and the rise at the beginning."""
    random, rise = np.random.default_rng(4), 1 - np.exp(-np.arange(len(good)) / 3.0)
    for level in (0.0, 0.73):
        held = {f"motor_current_command_{j}": np.full(len(good), level) for j in (1, 2)}
        held |= {f"motor_current_{j}": level * rise + 0.01 * random.normal(size=len(good)) for j in (1, 2)}
        assert not [s for s in look(changed(good, **held)).refusals if "it is not read" in s], level
        lost = held | {"motor_current_1": held["motor_current_1"] + 0.2 * np.sin(9 * good.time)}
        assert any("motor_current_command_1 stays at" in s for s in look(changed(good, **lost)).refusals), level


def test_what_a_passive_joint_s_sensor_reads_is_no_input_that_was_lost(good: Log) -> None:
    random = np.random.default_rng(9)
    small = 0.05 * float(np.std(good["motor_current_2"])) * random.standard_normal(len(good))
    passive = changed(good, motor_current_command_1=np.zeros(len(good)), motor_current_1=small)
    found = look(passive)
    assert not [f for f in found.findings if f.name == "still" and f.severity is Severity.REFUSE]
    assert any("motor_current_command_1 stays at 0" in s and "a passive joint" in s for s in found.warnings)
    lost = look(changed(good, motor_current_command_1=np.zeros(len(good))))
    assert any("motor_current_command_1 stays at 0 while motor_current_1 does not" in s for s in lost.refusals)


def test_a_reference_that_is_not_reached_is_no_mistake_and_another_joint_s_is_a_warning(good: Log) -> None:
    weak = changed(good, joint_position_reference_1=5 * good["joint_position_reference_1"])
    steps = changed(good, joint_position_reference_1=np.sign(np.sin(0.7 * good.time)) + 1e-3 * good.time)
    for log in (weak, steps):
        found = look(log, stated=False)
        assert found.refusals == () and found.warnings == ()
    names = ("joint_position_reference_1", "joint_position_reference_2")
    found = look(swap(*names)(good), stated=False)
    assert [(f.name, f.joint) for f in found.findings if f.severity is Severity.WARN] == [
        ("unrelated", 1),
        ("unrelated", 2),
    ]
    assert "does follow joint_position_2" in found.warnings[0]


# Logs of others


def stated(path: Path) -> dict[str, object]:
    """What triage wants of a robot.toml."""
    joints = tomllib.loads(path.read_text())["joint"]
    resolutions = {
        f"{side}_position_{j}": joint["sensor"][f"{side}_encoder_resolution"]
        for j, joint in enumerate(joints, start=1)
        for side in ("motor", "joint")
        if f"{side}_encoder_resolution" in joint.get("sensor", {})
    }
    return {
        "ratios": [joint["drive"]["ratio"] for joint in joints],
        "resolutions": resolutions,
        "max_currents": [joint["drive"].get("max_current") for joint in joints],
    }


@pytest.mark.parametrize("kind", ["single", "pair", "task", "background"])
def test_made_logs_raise_no_suspicion(data_dir: Path, kind: str) -> None:
    cases = sorted((data_dir / "made" / kind).glob("case-*"))
    if not cases:
        pytest.skip(f"no made logs of kind {kind}")
    for case, name in itertools.product(cases[:: 1 if kind == "pair" else 3], ("log", "hold_out")):
        facts = stated(case / "robot.toml")
        found = triage(read(case / f"{name}.parquet", joints=2), **facts)  # type: ignore[arg-type]
        assert found.refusals == () and found.warnings == (), (case, found.refusals, found.warnings)
        wrong = reverse("motor_current_1", "motor_current_command_1")(read(case / f"{name}.parquet"))
        refused = [f for f in triage(wrong, **facts).findings if f.severity is Severity.REFUSE]  # type: ignore[arg-type]
        assert {(f.name, f.joint) for f in refused} == {("reversed", 1)}, case


def test_real_logs_raise_no_suspicion_and_a_reversed_one_does(data_dir: Path) -> None:
    emps, dfki = data_dir / "real" / "emps", data_dir / "real" / "dfki_double_pendulum"
    if not emps.is_dir() or not dfki.is_dir():
        pytest.skip("the logs of EMPS and of the double pendulum are not there")
    for file, columns in (("DATA_EMPS", "columns"), ("DATA_EMPS_PULSES", "columns_pulses")):
        log = read(emps / f"{file}.mat", EXAMPLES / "emps" / f"{columns}.toml")
        assert triage(log, (1.0,), prismatic=(1,)).refusals == ()
        wrong = reverse("motor_torque_command_1")(log)
        assert [f.name for f in triage(wrong, (1.0,), prismatic=(1,)).findings if f.severity is Severity.REFUSE] == [
            "reversed"
        ]
    paths = sorted(dfki.glob("**/trajectory.csv"))
    for path in paths:
        assert triage(read(path, EXAMPLES / "dfki" / "columns.toml"), (6.0, 6.0)).refusals == (), path
    log = read(paths[-1], EXAMPLES / "dfki" / "columns.toml")
    turned = triage(reverse("motor_torque_command_2")(log), (6.0, 6.0))
    assert ("reversed", 2) in {(f.name, f.joint) for f in turned.findings if f.severity is Severity.REFUSE}
    degrees = triage(times(DEGREE, "joint_position_1")(log), (6.0, 6.0))
    assert ("degrees", 1) in {(f.name, f.joint) for f in degrees.findings if f.severity is Severity.REFUSE}


def test_a_still_joint_of_a_real_robot_is_not_accused(data_dir: Path, tmp_path: Path) -> None:
    paths = sorted((data_dir / "real" / "kinova_gen3_sedki" / "jointwise_motion").glob("joint_[26]_trapez.csv"))
    if not paths:
        pytest.skip("the Kinova logs are not there")
    columns = tmp_path / "columns.toml"
    for path, joint in itertools.product(paths, (2, 4, 6)):
        columns.write_text(
            f'[time]\nfrom = "Time"\nunit = "ms"\n[motor_current_1]\nfrom = "Cur{joint}"\n'
            f'[joint_position_1]\nfrom = "Position{joint}"\n[joint_velocity_1]\nfrom = "Velocity{joint}"\n'
        )
        found = triage(read(path, columns), (100.0,))
        assert found.refusals == ()
        moved = compute_channel_statistics("q", read(path, columns)["joint_position_1"]).is_moving
        assert moved == (f"joint_{joint}_" in path.name)
        assert ("still" in {f.name for f in found.findings}) != moved
