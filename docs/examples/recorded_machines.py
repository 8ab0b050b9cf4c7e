"""The recorded sets of real machines: their files, their robot files, and what is known of them from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

FRICTIONS = (
    "coulomb_friction",
    "viscous_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "presliding_friction",
    "quadratic_friction",
    "position_dependent_friction",
)


@dataclass(frozen=True)
class Recording:
    """Recorded files and how each becomes a log: ``pattern`` under the folder of the sets; ``converter`` under
    docs/examples, a map of columns or a script, and what the script takes beside the file."""

    pattern: str
    converter: str
    argument: str = ""
    joints: int = 1


@dataclass(frozen=True)
class Case:
    """One diagnosis: ``robot`` a preset or a file under docs/examples. Of each part of ``answer`` the verdict has to
    have a name, and none of ``wrong``; a name without @joint means any joint."""

    name: str
    machine: str
    robot: str
    logs: tuple[Recording, ...]
    hold_out: tuple[Recording, ...] = ()
    answer: tuple[tuple[str, ...], ...] = ()
    wrong: tuple[str, ...] = ()


def _emps(file: str, columns: str) -> tuple[Recording]:
    return (Recording(f"emps/{file}.mat", f"emps/{columns}.toml"),)


def _bam(*times: str) -> tuple[Recording, ...]:
    return tuple(Recording(f"bam/xl330_2026-01/raw/2026-01-15_{time}.json", "bam/convert.py") for time in times)


def _double_pendulum(time: str) -> tuple[Recording]:
    runs = "dfki_double_pendulum/experiment_records/design_C.1/sys_id/20230629"
    return (Recording(f"{runs}/20230629-{time}/trajectory.csv", "dfki/columns_both_torques.toml", joints=2),)


def _simple_pendulum(motion: str) -> tuple[Recording]:
    return (Recording(f"dfki_simple_pendulum/{motion}_measured.csv", "dfki_simple/columns.toml"),)


def _kinova(joint: int) -> Case:
    log = Recording(f"kinova_gen3_sedki/jointwise_motion/joint_{joint}_trapez.csv", "kinova/convert.py", str(joint))
    answer = (("torque_ripple@1", "kinematic_error@1"),)
    return Case(f"kinova_{joint}", f"Kinova Gen3, joint {joint}", f"kinova/joint_{joint}.toml", (log,), answer=answer)


def _kuka(axis: int) -> Case:
    log, held = (
        Recording(f"kuka_kr300/data/recorded_trajectories/* FF {run} *s/data.mat", "kuka/convert.py", str(axis))
        for run in "AB"
    )
    return Case(
        f"kuka_{axis}",
        f"KUKA KR300, axis {axis}",
        f"kuka/axis_{axis}.toml",
        (log,),
        (held,),
        answer=(("sensor_delay@1",),),
        wrong=("stiffness@1", "missing_compliance@1", "backlash@1"),
    )


CASES = (
    Case(
        "emps",
        "EMPS without its friction",
        "emps/without_friction.toml",
        _emps("DATA_EMPS", "columns"),
        _emps("DATA_EMPS_PULSES", "columns_pulses"),
        answer=(("coulomb_friction@1",),),
    ),
    Case(
        "emps_published",
        "EMPS as published",
        "emps",
        _emps("DATA_EMPS", "columns"),
        _emps("DATA_EMPS_PULSES", "columns_pulses"),
        wrong=("coulomb_friction@1",),
    ),
    Case(
        "bam",
        "BAM's XL330 pendulum, model M1",
        "bam/robot.toml",
        _bam("10h28m*", "10h29m0*", "10h29m[45]*", "10h30m*"),  # gains 100, 200, 800
        _bam("10h29m[123]*"),  # gain 400
        answer=(("load_dependent_friction@1",),),
    ),
    Case(
        "dfki_fast",
        "DFKI double pendulum 1.1, fast",
        "dfki_1_1",
        _double_pendulum("154220"),
        _double_pendulum("154548"),
        answer=tuple((f"{name}@{joint}",) for name in ("coulomb_friction", "current_loop_lag") for joint in (1, 2)),
    ),
    Case(
        "dfki_slow",
        "DFKI double pendulum 1.1, slow",
        "dfki_1_1",
        _double_pendulum("143524"),
        _double_pendulum("143601"),
        answer=(FRICTIONS,),
    ),
    *map(_kinova, (4, 5, 7)),
    *map(_kuka, (1, 2, 3)),
    Case(
        "dfki_simple_collocation",
        "DFKI simple pendulum, direct collocation",
        "dfki_simple/robot.toml",
        _simple_pendulum("direct_collocation"),
        _simple_pendulum("ddp"),
        answer=(("coulomb_friction@1",),),
    ),
    Case(
        "dfki_simple_ddp",
        "DFKI simple pendulum, ddp",
        "dfki_simple/robot.toml",
        _simple_pendulum("ddp"),
        _simple_pendulum("direct_collocation"),
        answer=(("coulomb_friction@1",),),
    ),
    Case(
        "dfki_simple_1kg",
        "DFKI simple pendulum with 1 kg",
        "dfki_simple/robot.toml",
        _simple_pendulum("energy_shaping_1kg"),
        answer=(("payload@1",),),
    ),
)
