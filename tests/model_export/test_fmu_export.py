"""`hdagen export fmu`: valid units in FMI 2.0 and 3.0 that move as `hdagen.simulate` does and refuse what is wrong."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from replayed import FLEXIBLE, INPUT_AND_SENSOR
from space_robots import chain

from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.control.guard_limits import Guard, Safe
from hdagen.control.guarded_controller import Controller
from hdagen.control.reference_motion import Reference
from hdagen.model_export import fmu_writer
from hdagen.model_export.corrected_robot import CorrectedRobot
from hdagen.model_export.fmu_units import find_base_powers
from hdagen.model_export.fmu_variables import list_variables
from hdagen.simulation.simulator import Push, Sensors, Simulation, run

VERSIONS = ("2.0", "3.0")
VERDICT = {"command_delay_1": 3.3e-3, "current_lag_2": 2e-3, "coulomb_friction_2": 0.06, "eccentricity_sine_1": 1e-3}
PERIOD, SECONDS = 2e-3, 0.3
START = np.array([0.3, -0.4])  # rad


@pytest.fixture(scope="module")
def robot(build: Callable[..., Any]) -> CorrectedRobot:
    """The arm with a verdict in it: late and slow commands, more friction, an encoder off its axis."""
    file = Arm(build(FLEXIBLE, "portable", INPUT_AND_SENSOR).folder)
    corrected = file.with_parameters(file.p)
    corrected.parameters.update(VERDICT)
    return CorrectedRobot("test arm", file, corrected)


@pytest.fixture(scope="module")
def units(robot: CorrectedRobot, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("units")
    for version in VERSIONS:
        fmu_writer.write(robot, folder / f"{version}.fmu", fmi=version)
    return {version: folder / f"{version}.fmu" for version in VERSIONS}


@pytest.fixture(scope="module")
def simulated(robot: CorrectedRobot) -> Simulation:
    """A run of the corrected arm, held up against gravity and pushed."""
    arm = robot.corrected
    guard = Guard(Safe.ZERO, PERIOD, torque_limit=(0.5, 0.5), torque_rate=(50.0, 50.0))
    controller = Controller(arm, "position", guard)
    time = np.arange(round(SECONDS / PERIOD)) * PERIOD
    way = 0.2 * np.sin(2 * np.pi * time / SECONDS)[:, None] * [1.0, -1.5]
    rate = np.gradient(way, PERIOD, axis=0)
    motion = Reference("joint", PERIOD, START + way, rate, np.gradient(rate, PERIOD, axis=0))
    return run(arm, controller, motion, (Push(0.1, 0.2, (20.0, -10.0)),), Sensors(current_noise=(0.0, 0.0)))


# -- validity and motion ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_a_unit_is_valid_and_moves_as_the_simulation_does(
    units: dict[str, Path], robot: CorrectedRobot, simulated: Simulation, version: str
) -> None:
    assert validate_fmu(str(units[version])) == []
    arm, log = robot.corrected, simulated.log
    commands = [f"motor_current_command_{j}" for j in (1, 2)]
    given = np.hstack([np.stack([log[name] for name in commands], axis=1), simulated.push])
    names = [*commands, "tip_force_x", "tip_force_y"]
    signals = np.array(
        [(t, *row) for t, row in zip(log.time, given, strict=True)], [(n, float) for n in ["time", *names]]
    )
    outputs = [v.name for v in list_variables(arm) if v.causality == "output"]
    found = fmpy.simulate_fmu(
        str(units[version]),
        stop_time=log.time[-1],
        step_size=PERIOD,
        output_interval=PERIOD,
        input=signals,
        start_values={f"joint_position_start_{j}": START[j - 1] for j in (1, 2)},
        output=outputs,
    )
    shown = np.stack([log[f"motor_current_{j}"] for j in (1, 2)], axis=1)
    truth = {f"motor_current_{j}": shown[:, j - 1] for j in (1, 2)}
    for name, values in arm.outputs(simulated.state, np.hstack([shown, simulated.push])).items():
        labels = "xy" if name.startswith("tip") else "12"
        truth |= {f"{name}_{label}": values[:, k] for k, label in enumerate(labels)}
    assert set(truth) == set(outputs)
    assert np.ptp(truth["joint_position_2"]) > 0.1 and np.abs(truth["torsion_1"]).max() > 1e-4
    for name, values in truth.items():
        assert np.abs(found[name] - values).max() <= 1e-9 * max(1.0, np.abs(values).max()), name


def test_an_arm_in_space_has_force_and_moment_on_its_tip(build: Callable[..., Any], tmp_path: Path) -> None:
    arm = Arm(build(chain("RR", 3)).folder)  # as other tests
    fmu_writer.write(CorrectedRobot("space", arm, arm), tmp_path / "arm.fmu")
    assert validate_fmu(str(tmp_path / "arm.fmu")) == []
    count, held = 50, {"tip_force_z": 3.0, "tip_moment_x": -0.5}
    outputs = [v.name for v in list_variables(arm) if v.causality == "output"]
    signals = np.array([(t, *held.values()) for t in (0.0, 1.0)], [(name, float) for name in ("time", *held)])
    steps = {"stop_time": count * PERIOD, "step_size": PERIOD, "output_interval": PERIOD}
    found = fmpy.simulate_fmu(str(tmp_path / "arm.fmu"), input=signals, output=outputs, **steps)
    u = np.zeros((count + 1, arm.nu))
    for name, value in held.items():
        u[:, arm.index(name)] = value
    x = arm.rollout(arm.rest([0.0, 0.0]), u[:count], PERIOD, exact=True)
    truth = arm.outputs(x, u)
    assert np.ptp(truth["tip"], axis=0).max() > 1e-3
    for k, axis in enumerate("xyz"):
        assert np.abs(found[f"tip_{axis}"] - truth["tip"][:, k]).max() < 1e-9
        assert np.abs(found[f"tip_velocity_{axis}"] - truth["tip_velocity"][:, k]).max() < 1e-9
        assert np.abs(found[f"tip_angular_velocity_{axis}"] - truth["tip_velocity"][:, 3 + k]).max() < 1e-9


def test_the_verdict_is_in_the_unit_and_the_changes_are_listed(robot: CorrectedRobot, tmp_path: Path) -> None:
    written = fmu_writer.write(robot, tmp_path / "arm.fmu")
    assert {change.where: change.after for change in written.changes} == VERDICT
    read = fmpy.read_model_description(str(tmp_path / "arm.fmu"))
    starts = {v.name: v.start for v in read.modelVariables if v.causality == "parameter"}
    for name, value in robot.corrected.parameters.items():
        assert float(starts[name]) == value
    variability = {v.name: v.variability for v in read.modelVariables}
    assert (
        variability["coulomb_friction_1"] == variability["command_delay_1"] == variability["longest_step"] == "tunable"
    )
    assert variability["ratio_1"] == variability["length_2"] == variability["joint_position_start_1"] == "fixed"


def test_equal_robots_give_equal_bytes(robot: CorrectedRobot, units: dict[str, Path], tmp_path: Path) -> None:
    fmu_writer.write(robot, tmp_path / "again.fmu", fmi="3.0")
    assert (tmp_path / "again.fmu").read_bytes() == units["3.0"].read_bytes()
    names = zipfile.ZipFile(units["2.0"]).namelist()
    assert not [name for name in names if "python" in name or ".." in name or name.startswith("/")]


# -- parameters, states and refusals ----------------------------------------------------------------------------------


class Unit:
    """A unit of either version, through the same few calls."""

    def __init__(self, path: Path, folder: Path, version: str, token: str | None = None) -> None:
        read = fmpy.read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in read.modelVariables}
        self.slave = {"2.0": FMU2Slave, "3.0": FMU3Slave}[version](
            guid=token or read.guid,
            unzipDirectory=fmpy.extract(str(path), str(folder)),
            modelIdentifier=read.coSimulation.modelIdentifier,
            instanceName="unit",
        )
        self.version, self.time = version, 0.0
        self.slave.instantiate()

    def start(self) -> None:
        if self.version == "2.0":
            self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def set(self, **values: float) -> None:
        write = self.slave.setReal if self.version == "2.0" else self.slave.setFloat64
        write([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        read = self.slave.getReal if self.version == "2.0" else self.slave.getFloat64
        return list(read([self.references[name] for name in names]))

    def step(self, count: int = 1) -> list[float]:
        for _ in range(count):
            self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=PERIOD)
            self.time += PERIOD
        return self.get("joint_position_1", "motor_velocity_2", "motor_current_1")


@pytest.fixture(params=VERSIONS)
def unit(request: pytest.FixtureRequest, units: dict[str, Path], tmp_path: Path) -> Iterator[Unit]:
    made = Unit(units[request.param], tmp_path / "unit", request.param)
    yield made
    made.slave.freeInstance()


@contextmanager
def refused() -> Iterator[None]:
    with pytest.raises(FMICallException):
        yield


def test_a_state_that_is_set_again_gives_the_same_bits(unit: Unit) -> None:
    unit.start()
    unit.set(motor_current_command_1=2.0, motor_current_command_2=-3.0)
    unit.step(10)
    suffix = {"2.0": "FMUstate", "3.0": "FMUState"}[unit.version]
    state = getattr(unit.slave, f"get{suffix}")()
    first, time = unit.step(20), unit.time
    load = {"2.0": "deSerializeFMUstate", "3.0": "deserializeFMUState"}[unit.version]
    content = getattr(unit.slave, f"serialize{suffix}")(state)
    for again in (state, getattr(unit.slave, load)(content)):
        getattr(unit.slave, f"set{suffix}")(again)
        unit.time = time - 20 * PERIOD
        assert unit.step(20) == first
    with refused():
        getattr(unit.slave, load)(b"x" + content[1:])
    getattr(unit.slave, f"free{suffix}")(state)


def test_a_reset_unit_starts_again(unit: Unit) -> None:
    unit.set(joint_position_start_1=0.5)
    unit.start()
    assert unit.get("joint_angle_1") == [0.5]
    unit.set(motor_current_command_1=4.0)
    unit.step(10)
    unit.slave.reset()
    unit.time = 0.0
    unit.start()
    assert unit.get("joint_angle_1", "motor_velocity_1") == [0.0, 0.0]


def test_a_tuned_parameter_acts_at_once_and_a_fixed_one_is_refused(unit: Unit) -> None:
    unit.start()
    unit.set(motor_current_command_1=6.0)
    unit.step(50)
    turning = unit.get("motor_velocity_1")[0]
    assert abs(turning) > 1.0
    unit.set(coulomb_friction_1=10.0, motor_current_command_1=0.0)
    unit.step(50)
    assert unit.get("motor_velocity_1") == [0.0]  # it sticks
    with refused():
        unit.set(ratio_1=99.0)
    with refused():
        unit.set(joint_position_start_1=0.1)


def test_what_is_wrong_is_refused_and_changes_nothing(unit: Unit) -> None:
    with refused():
        unit.step()  # not initialized
    unit.start()
    for wrong in (
        {"motor_current_command_1": float("nan")},
        {"tip_force_x": float("inf")},
        {"coulomb_friction_1": -1.0},
        {"longest_step": 0.0},
        {"joint_position_1": 1.0},
        {"time": 1.0},
    ):
        with refused():
            unit.set(**wrong)
    assert unit.get("motor_current_command_1", "tip_force_x", "coulomb_friction_1") == [0.0, 0.0, 0.03]
    unit.references["nothing"] = 100_000
    with refused():
        unit.get("nothing")
    with refused():
        unit.slave.doStep(currentCommunicationPoint=0.0, communicationStepSize=0.0)
    unit.set(motor_current_command_1=1e300)
    with refused():
        unit.step(3)
    with refused():
        unit.step()  # a diverged unit is over


@pytest.mark.parametrize("version", VERSIONS)
def test_a_description_of_another_unit_is_refused(units: dict[str, Path], tmp_path: Path, version: str) -> None:
    with pytest.raises(Exception, match="nstantiate"):
        Unit(units[version], tmp_path / "unit", version, "{00000000-0000-0000-0000-000000000000}")


def test_refusals_of_the_export(robot: CorrectedRobot, tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=r"--fmi 1\.0: possible are 3\.0 and 2\.0\."):
        fmu_writer.write(robot, tmp_path / "arm.fmu", fmi="1.0")
    with pytest.raises(PlantError, match="cannot be written"):
        fmu_writer.write(robot, tmp_path / "no" / "arm.fmu")
    assert list(tmp_path.iterdir()) == []


# -- sources ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version, prefix", [("2.0", "FMI2_FUNCTION_PREFIX"), ("3.0", "FMI3_FUNCTION_PREFIX")])
@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_the_sources_are_strict_c99_and_take_a_prefix(
    units: dict[str, Path], tmp_path: Path, version: str, prefix: str, cc: str
) -> None:
    if shutil.which(cc) is None:
        pytest.skip(f"{cc} is not installed here")
    folder = Path(fmpy.extract(str(units[version]), str(tmp_path / "unit"))) / "sources"
    read = fmpy.read_model_description(str(units[version]))
    listed = read.buildConfigurations[0].sourceFileSets[0].sourceFiles
    assert sorted(listed) == sorted(path.name for path in folder.glob("*.c"))
    strict = [cc, "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([*strict, "-fsyntax-only", *listed], cwd=folder, check=True)
    wrapper = next(name for name in listed if name == f"hda_fmi{version[0]}.c")
    subprocess.run([*strict, f"-D{prefix}=arm_", "-c", wrapper, "-o", "object.o"], cwd=folder, check=True)
    symbols = subprocess.run(["nm", "object.o"], cwd=folder, check=True, capture_output=True, text=True).stdout
    defined = {line.split()[-1] for line in symbols.splitlines() if " T " in line}
    assert f"arm_fmi{version[0]}DoStep" in defined and not [name for name in defined if name.startswith("fmi")]


@pytest.mark.parametrize(
    "unit, powers",
    [
        ("N m s²/rad", {"kg": 1, "m": 2, "rad": -1}),
        ("1/(N m)", {"kg": -1, "m": -2, "s": 2}),
        ("kg m²", {"kg": 1, "m": 2}),
        ("m/s²", {"m": 1, "s": -2}),
        ("N m/A", {"kg": 1, "m": 2, "s": -2, "A": -1}),
        ("1", {}),
        ("furlong", None),
        ("", {}),
    ],
)
def test_units_have_their_powers_of_base_units(unit: str, powers: dict[str, int] | None) -> None:
    assert find_base_powers(unit) == powers


def test_every_unit_of_a_model_is_known(robot: CorrectedRobot) -> None:
    assert {v.unit for v in list_variables(robot.corrected) if find_base_powers(v.unit) is None} == set()
