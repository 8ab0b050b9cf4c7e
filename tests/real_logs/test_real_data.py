"""The figures that replays of real logs must reach, and the same machinery on the made ones.

Sources: Janot, Gautier, Brunot, Data set and reference models of EMPS (2019); the models and logs of the DFKI double
pendulum.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdagen.arm.compiled_arm import Arm
from hdagen.cli import replay as replay_command
from hdagen.log.measured_log import Log, read
from hdagen.prediction.closed_loop_replay import read_controller, replay_closed_loop
from hdagen.prediction.driving_inputs import read_driving_inputs
from hdagen.prediction.inverse_dynamics import compute_force_error
from hdagen.prediction.window_replay import replay

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
EMPS, DFKI = EXAMPLES / "emps", EXAMPLES / "dfki"
IDENT, PULSES = "DATA_EMPS", "DATA_EMPS_PULSES"
COLUMNS = {IDENT: "columns.toml", PULSES: "columns_pulses.toml"}
MEASURED = ("motor_position", "joint_position", "motor_velocity", "joint_velocity", "motor_current")


@pytest.fixture(scope="module")
def arm(build: Callable) -> Callable[[str], Arm]:
    """arm(preset or text) -> a fresh Arm."""
    return lambda robot: Arm(build(robot).folder)


@pytest.fixture(scope="module")
def emps(data_dir: Path) -> Callable[..., Log]:
    """emps(file, columns=its own) -> the log."""
    folder = data_dir / "real" / "emps"
    if not folder.is_dir():
        pytest.skip(f"no EMPS logs in {folder}")

    def log(name: str, columns: str | None = None) -> Log:
        return read(folder / f"{name}.mat", EMPS / (columns or COLUMNS[name]), 1)

    return log


@pytest.fixture(scope="module")
def dfki(data_dir: Path) -> list[Log]:
    """The ten logs of 2023-06-29."""
    folder = data_dir / "real" / "dfki_double_pendulum"
    files = sorted(folder.glob("experiment_records/design_C.1/sys_id/20230629/*/trajectory.csv"))
    if not files:
        pytest.skip(f"no double-pendulum logs in {folder}")
    assert len(files) == 10
    return [read(file, DFKI / "columns.toml", 2) for file in files]


@pytest.fixture(scope="module")
def cases(data_dir: Path) -> Path:
    """The folder of made logs."""
    folder = data_dir / "made"
    if not folder.is_dir():
        pytest.skip(f"no made logs in {folder}")
    return folder


# -- EMPS -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "most"), [(IDENT, 0.25e-3), (PULSES, 0.30e-3)])
def test_emps_is_replayed_within_a_fraction_of_a_millimetre_and_friction_is_why(
    name: str, most: float, arm: Callable, emps: Callable
) -> None:
    log = emps(name)
    error = replay(arm("emps"), log, 0.25).errors["joint_position_1"]
    assert error <= most
    robot = (EMPS / "without_friction.toml").read_text()
    without_dry = replay(arm(robot), log, 0.25).errors["joint_position_1"]
    without_any = replay(arm(robot.replace("viscous_friction = 203.5034", "viscous_friction = 0.0")), log, 0.25).errors[
        "joint_position_1"
    ]
    assert without_dry >= 8 * error
    assert without_any >= 2 * without_dry


def test_emps_without_friction_is_the_preset_but_for_that(arm: Callable) -> None:
    with_it, without = arm("emps"), arm((EMPS / "without_friction.toml").read_text())
    differ = {name for name in with_it.parameters if with_it.parameters[name] != without.parameters[name]}
    assert differ == {"coulomb_friction_1", "bias_1"}
    assert without.parameters["coulomb_friction_1"] == 0.0 == without.parameters["bias_1"]


@pytest.mark.parametrize(("name", "published"), [(IDENT, 4.08), (PULSES, 5.98)])
def test_emps_force_error_is_the_published_one(name: str, published: float, arm: Callable, emps: Callable) -> None:
    log, robot = emps(name), arm("emps")
    found = compute_force_error(robot, log, read_driving_inputs(robot, log, "command")[0])
    assert 100 * found.relative[0] == pytest.approx(published, abs=1.0)


def test_the_pulses_are_in_the_command_already(arm: Callable, emps: Callable) -> None:
    log = emps(PULSES)
    pulses = emps(PULSES, "columns_pulses_loop.toml")["tip_force_x"]
    assert set(np.round(pulses / 35.15065188248547)) == {0.0, 5.0}
    twice = Log(log.time, {**log.columns, "tip_force_x": pulses}, 1, "pulses added again")
    robot = arm("emps")
    assert replay(robot, twice).errors["joint_position_1"] > 10 * replay(robot, log).errors["joint_position_1"]


@pytest.mark.parametrize(
    ("name", "columns", "position", "published"),
    [(IDENT, "columns.toml", 1.78e-6, 5.85), (PULSES, "columns_pulses_loop.toml", 2.5e-6, 8.94)],
)
def test_emps_in_closed_loop(
    name: str, columns: str, position: float, published: float, arm: Callable, emps: Callable
) -> None:
    log = emps(name, columns)
    found = replay_closed_loop(arm("emps"), log, read_controller(EMPS / "controller.toml"))
    assert found.errors["joint_position_1"] == pytest.approx(position, rel=0.05)
    whole = emps(name)["motor_torque_command_1"]  # law and pulses, to which the published share refers
    share = 100 * found.errors["motor_torque_command_1"] / np.sqrt(np.mean(whole**2))
    assert 4.0 < share < published


def test_emps_by_the_command(
    arm: Callable, emps: Callable, data_dir: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HDAGEN_BUILD", str(arm("emps").folder.parent))
    parser = argparse.ArgumentParser()
    replay_command.add_parser(parser.add_subparsers())
    log = emps(IDENT)
    arguments = ["replay", "emps", log.source, "--columns", str(EMPS / "columns.toml"), "--json"]
    assert replay_command.run(parser.parse_args(arguments)) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["errors"]["joint_position_1"] <= 0.25e-3 and figures["windows"] == 100
    assert 100 * figures["force_error"][0] == pytest.approx(4.08, abs=1.0)


# -- DFKI double pendulum ---------------------------------------------------------------------------------------------

LISTED = {"2_0": (0.024, 0.041), "1_0": (0.025, 0.044), "3_0": (0.072, 0.349), "1_1": (0.127, 0.236)}  # rad, joint 1, 2
# One of the eight figures is missed by 9 %: model 3.0 at joint 1 errs by 0.078 rad, and so it does in the equations
# below, which share nothing with the project. It diverges within a window, and its error hangs on where windows lie:
# begun at twelve other rows the same replay errs by 0.069 to 0.082 rad at joint 1.
LOOSE = {("3_0", 1): 0.10}


@pytest.fixture(scope="module")
def found(arm: Callable, dfki: list[Log]) -> dict[str, np.ndarray]:
    """rms errors (2) of each model over all rows of all logs."""
    errors = {}
    for model in LISTED:
        robot, squares, rows = arm(f"dfki_{model}"), np.zeros(2), 0
        for log in dfki:
            one = replay(robot, log, 0.25)
            squares += len(log) * np.square([one.errors["joint_position_1"], one.errors["joint_position_2"]])
            rows += len(log)
        errors[model] = np.sqrt(squares / rows)
    return errors


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("model", LISTED)
def test_the_double_pendulums_models_err_as_listed(model: str, joint: int, found: dict[str, np.ndarray]) -> None:
    tolerance = LOOSE.get((model, joint), 0.05)
    assert found[model][joint - 1] == pytest.approx(LISTED[model][joint - 1], rel=tolerance)


@pytest.mark.parametrize("joint", [1, 2])
def test_the_double_pendulums_models_err_in_the_order_listed(joint: int, found: dict[str, np.ndarray]) -> None:
    listed = sorted(LISTED, key=lambda model: LISTED[model][joint - 1])
    assert sorted(found, key=lambda model: found[model][joint - 1]) == listed


def published(data_dir: Path, model: str) -> dict[str, float]:
    """Parameters of a model as its authors wrote them."""
    folder = data_dir / "real" / "dfki_double_pendulum" / "system_identification" / "identified_parameters"
    text = (folder / "design_C.1" / f"model_{model.replace('_', '.')}" / "model_parameters.yml").read_text()
    return {key: float(value) for key, value in (line.split(":") for line in text.splitlines() if line.strip())}


def pendulum(p: dict[str, float], q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Accelerations (W, 2) of the double pendulum at angles q from hanging down and rates v under joint torques u."""
    s1, s2, c2, s12 = np.sin(q[:, 0]), np.sin(q[:, 1]), np.cos(q[:, 1]), np.sin(q.sum(1))
    h = p["m2"] * p["l1"] * p["r2"]
    a = p["I1"] + p["I2"] + p["m2"] * p["l1"] ** 2 + 2 * h * c2 + (p["gr"] ** 2 + 1) * p["Ir"]
    b = p["I2"] + h * c2 - p["gr"] * p["Ir"]
    d = p["I2"] + p["gr"] ** 2 * p["Ir"]
    friction = [p[f"b{j}"] * v[:, j - 1] + p[f"cf{j}"] * np.arctan(100 * v[:, j - 1]) for j in (1, 2)]
    weight = p["g"] * p["m2"] * p["r2"] * s12
    pull = p["g"] * (p["m1"] * p["r1"] + p["m2"] * p["l1"]) * s1 + weight
    first = u[:, 0] - friction[0] - pull + h * s2 * v[:, 1] * (2 * v[:, 0] + v[:, 1])
    second = u[:, 1] - friction[1] - weight - h * s2 * v[:, 0] ** 2
    return np.stack([d * first - b * second, a * second - b * first], 1) / (a * d - b * b)[:, None]


def windowed(p: dict[str, float], log: Log) -> np.ndarray:
    """Errors (rows, 2) of all windows side by side, by RK4 a row."""
    q, v, u = (
        np.stack([k * log[f"{name}_{j}"] for j in (1, 2)], 1)
        for name, k in (("joint_position", 1.0), ("joint_velocity", 1.0), ("motor_torque_command", p["gr"]))
    )
    row = replay_starts(log)
    end = np.append(row[1:], len(log))
    at, rate, errors = q[row], v[row], []
    while (live := row < end).any():
        errors.append((at - q[np.minimum(row, len(log) - 1)])[live])
        here = np.minimum(row, len(log) - 2)
        h, force = (log.time[here + 1] - log.time[here])[:, None], u[here]
        k1 = pendulum(p, at, rate, force)
        k2 = pendulum(p, at + h / 2 * rate, rate + h / 2 * k1, force)
        k3 = pendulum(p, at + h / 2 * (rate + h / 2 * k1), rate + h / 2 * k2, force)
        k4 = pendulum(p, at + h * (rate + h / 2 * k2), rate + h * k3, force)
        at, rate = at + h * rate + h * h / 6 * (k1 + k2 + k3), rate + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        row = row + 1
    return np.concatenate(errors)


def replay_starts(log: Log) -> np.ndarray:
    """First row of every quarter of a second."""
    return np.unique(np.searchsorted(log.time - log.time[0], np.arange(0.0, log.time[-1] - log.time[0], 0.25) - 1e-9))


@pytest.mark.parametrize("model", LISTED)
def test_the_authors_own_equations_err_alike(
    model: str, found: dict[str, np.ndarray], dfki: list[Log], data_dir: Path
) -> None:
    p = published(data_dir, model)
    errors = np.concatenate([windowed(p, log) for log in dfki])
    assert found[model] == pytest.approx(np.sqrt(np.mean(errors**2, axis=0)), rel=0.02)


# -- causality and the made logs --------------------------------------------------------------------------------------


def unmoved(robot: Arm, log: Log, windows: tuple[int, ...]) -> None:
    """Noise after the start of each of ``windows`` leaves its prediction as it was, to the byte."""
    true, rng = replay(robot, log), np.random.default_rng(3)
    for k in windows:
        first, end = int(true.starts[k]), int([*true.starts, len(log)][k + 1])
        columns = {}
        for name, values in log.columns.items():
            columns[name] = values.copy()
            if name.rpartition("_")[0] in MEASURED:
                columns[name][first + 1 :] = values.mean() + values.std() * rng.standard_normal(len(log) - first - 1)
        again = replay(robot, Log(log.time, columns, log.n_joints, log.source))
        for name, values in true.columns.items():
            assert again.columns[name][:end].tobytes() == values[:end].tobytes(), (name, k)


def test_no_measurement_inside_a_window_reaches_it(arm: Callable, emps: Callable, dfki: list[Log], cases: Path) -> None:
    unmoved(arm("emps"), emps(IDENT).rows(0, 3000), (0, 3, 11))
    unmoved(arm("dfki_2_0"), dfki[0].rows(0, 1500), (0, 5, 10))
    case = cases / "single" / "case-010"
    unmoved(arm((case / "robot.toml").read_text()), read(case / "log.parquet").rows(0, 2000), (0, 1, 4, 7))


SAMPLE = ("single/case-000", "single/case-011", "single/case-024", "single/case-025", "pair/case-002", "task/case-000")


@pytest.mark.parametrize("name", SAMPLE)
def test_a_made_log_is_replayed(name: str, arm: Callable, cases: Path) -> None:
    """Base parameters 4 % off and at most two effects missing: wrong, but never wild; currents show only their
    noise."""
    case = cases / name
    log = read(case / "hold_out.parquet", joints=2)
    found = replay(arm((case / "robot.toml").read_text()), log)
    assert all(np.isfinite(values).all() for values in found.columns.values())
    assert found.columns["time"].tobytes() == log.time.tobytes()
    assert not any("bounds" in note or "at rest where" in note for note in found.notes)
    for j in (1, 2):
        assert found.errors[f"motor_current_{j}"] == pytest.approx(0.01, rel=0.03)  # A, the sensor's noise
        assert 1.0 < found.errors[f"motor_position_{j}"] / found.noise[f"motor_position_{j}"] < 3e4
        assert found.errors[f"joint_position_{j}"] < 0.07  # rad
