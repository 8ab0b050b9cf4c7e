"""`hdagen simulate`: a controller drives the compiled arm along a path of the tip or the joints, and is pushed; the log
is written."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdagen.cli.simulated_path import add_path_arguments, choose_posture, make_path, name_posture

if TYPE_CHECKING:
    from hdagen.arm.compiled_arm import Arm
    from hdagen.simulation.simulator import Push, SpacePush

SIMULATE_EXAMPLE = """example:
  hdagen simulate paper --controller admittance_cartesian --push 3 4 15 0 --push 6 7 0 15 --gain stiffness_x=800 --out
  circle.parquet
  hdagen simulate panda --path lissajous --radius 0.1 --push 3 4 0 0 -15 --push 6 7 0 0 0 0 2 0"""

CONTROLLERS = ("position", "impedance_cartesian", "impedance_joint", "admittance_cartesian", "admittance_joint", "mpc")


def add_parser(commands: Any) -> None:
    """Add the command and its arguments.

    Args:
        commands: The subparsers of `hdagen`.

    """
    p = commands.add_parser(
        "simulate",
        help="drive the compiled arm along a path, push it, and write the log",
        description="A controller drives the compiled arm along a path: dry friction, encoders, noise.",
        epilog=SIMULATE_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    p.add_argument("--built", action="store_true", help="ROBOT is the folder of a build, whose compiled code is run")
    p.add_argument(
        "--controller",
        choices=CONTROLLERS,
        help="default: impedance_cartesian; impedance_joint for paths of the joints",
    )
    p.add_argument("--config", default=None, metavar="controller.toml", help="of --controller mpc: docs/guides/mpc.md")
    p.add_argument(
        "--gain",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a gain of the controller, SI; may be repeated",
    )
    p.add_argument(
        "--push",
        action="append",
        nargs="+",
        type=float,
        default=[],
        metavar="NUMBER",
        help="FROM TO FX FY (s, s, N, N); in space FROM TO FX FY FZ [MX MY MZ]; may be repeated",
    )
    p.add_argument("--seconds", type=float, default=10.0)
    add_path_arguments(p)
    p.add_argument(
        "--safe", choices=("zero", "damping"), default="damping", help="what the controller does after a fault"
    )
    p.add_argument("--delay", type=int, default=0, help="ticks from a sample to its use")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--profile", choices=("portable", "native"), default="portable")
    p.add_argument(
        "--out", type=Path, default=Path("simulated.parquet"), help=".parquet or .csv (default: simulated.parquet)"
    )
    p.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Simulate a closed loop, write its log, print.

    Args:
        options: The parsed arguments.

    Returns:
        The exit code.

    Raises:
        PlantError: An option is not possible, or a build fails.

    """
    from rich.console import Console
    from rich.progress import Progress

    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import Arm, load
    from hdagen.control.guard_limits import Guard, Safe
    from hdagen.control.guarded_controller import Controller
    from hdagen.log.data_table import find_write_problems
    from hdagen.log.measured_log import write
    from hdagen.simulation.closed_loop_figures import summarize_run
    from hdagen.simulation.simulated_sensors import Sensors
    from hdagen.simulation.simulator import run as simulate

    if problems := find_write_problems(options.out):
        raise PlantError("\n".join(f"--out {problem}" for problem in problems))
    if options.controller == "mpc":
        return _simulate_predictive(options)
    if options.config:
        raise PlantError("--config is of the predictive controller; take --controller mpc, or leave it out.")
    gains = _parse_gains(options.gain)
    arm = Arm(options.robot) if options.built else load(options.robot, profile=options.profile)
    guard = Guard(Safe[options.safe.upper()], safe_damping=_choose_damping(arm))
    posture = choose_posture(arm, options)
    path = make_path(arm, options, posture, guard.period)
    law = options.controller or {"tip": "impedance_cartesian", "joint": "impedance_joint"}[path.space]
    controller = Controller(arm, law, guard, gains)
    controller.configure(guard, name_posture(arm, tuple(controller.gains), posture) | gains)
    pushes = _read_pushes(options.push)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("simulating", total=len(path.position))

        def progress(done: int, _: int) -> None:
            bar.update(task, completed=done)

        sensors = Sensors(delay=options.delay)
        result = simulate(arm, controller, path, pushes, sensors, options.seed, posture, progress)
    write(result.log, options.out)
    figures = {"log": str(options.out), "rows": len(result.log), **summarize_run(arm, controller, path, result)}
    if options.json:
        print(json.dumps(figures, indent=1))
    else:
        print(f"{options.out}: {figures['rows']} rows of {arm.robot['name']} under {law}")
        _print_figures(figures)
    return 0


def _simulate_predictive(options: argparse.Namespace) -> int:
    """The same with the predictive controller, whose record goes beside the log."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.arm.compiled_arm import load
    from hdagen.control.reference_motion import convert_to_joint_motion
    from hdagen.mpc.configuration import Configuration, read_configuration
    from hdagen.mpc.recorded_simulation import format_simulated_run, simulate_with_record
    from hdagen.mpc.tick_record import find_record_path
    from hdagen.simulation.simulated_sensors import Sensors

    c = Configuration()
    if options.config:
        c = read_configuration(options.config)
    if options.gain:
        raise PlantError("--gain is of the other controllers; the predictive one takes --config controller.toml.")
    if options.built:
        raise PlantError("--built is of the other controllers; the predictive one is built for its configuration.")
    arm = load(options.robot, profile=options.profile, mpc=c)
    posture = choose_posture(arm, options)
    path = make_path(arm, options, posture, float(c["mpc.period"]))
    if c["mpc.space"] == "joint" and path.space == "tip":
        path = convert_to_joint_motion(arm, path, posture)
    if c["mpc.space"] != path.space:
        raise PlantError("the path is of the joints and mpc.space of the configuration is tip; make them equal.")
    pushes, sensors = _read_pushes(options.push), Sensors(delay=options.delay)
    start = posture if arm.moves_in_space else None
    found, result = simulate_with_record(arm, c, path, pushes, sensors, options.seed, options.out, start)
    if options.json:
        figures: dict[str, Any] = {"log": str(options.out), "record": str(find_record_path(options.out))}
        if result:
            figures |= asdict(result)
        print(json.dumps(figures, indent=1))
    else:
        print(
            f"{options.out} and {find_record_path(options.out)}: {len(found.times)} rows of {arm.robot['name']}"
            " under mpc"
        )
        print("\n".join(format_simulated_run(found, result)))
    return 0


def _choose_damping(arm: Arm) -> tuple[float, ...]:
    """Damping of the safe state, N m s/rad: a motor stops in 1/20 s; one without a rotor of its own in 10 rad/s."""
    found = []
    for joint, slot in zip(arm.robot["joints"], arm.manifest["input"], strict=False):
        rotor = joint["drive"]["motor_inertia"]["nominal"]
        found.append(20 * rotor or 0.1 * slot["bound"])
    return tuple(found)


def _read_pushes(stated: list[list[float]]) -> list[Push | SpacePush]:
    """The pushes; one of too few numbers is refused."""
    from hdagen.arm.build_loader import PlantError
    from hdagen.simulation.simulator import Push, SpacePush

    for numbers in stated:
        if len(numbers) not in (4, 5, 8):
            raise PlantError(f"--push takes FROM TO FX FY, in space FROM TO FX FY FZ [MX MY MZ], not {len(numbers)}.")
    made: list[Push | SpacePush] = []
    for start, end, *force in stated:
        if len(force) == 2:
            made.append(Push(start, end, (force[0], force[1])))
        else:
            made.append(SpacePush(start, end, tuple(force)))
    return made


def _parse_gains(given: list[str]) -> dict[str, float]:
    from hdagen.arm.build_loader import PlantError

    gains = {}
    for text in given:
        name, _, value = text.partition("=")
        try:
            gains[name] = float(value)
        except ValueError:
            raise PlantError(f"--gain {text}: give NAME=VALUE with a number, for instance stiffness_x=800.") from None
    return gains


def _print_figures(figures: dict[str, Any]) -> None:
    largest, rms = 1e3 * figures["largest_gap"], 1e3 * figures["rms_gap"]
    what, unit = "tip", "mm"
    if figures["against"] == "the joints' motion":
        what, unit = "joints", "mrad"
    print(f"{what} against {figures['against']}: {largest:.2f} {unit} at most, {rms:.2f} {unit} rms")
    if "largest_turn_gap" in figures:
        largest, rms = 1e3 * figures["largest_turn_gap"], 1e3 * figures["rms_turn_gap"]
        print(f"its orientation: {largest:.2f} mrad at most, {rms:.2f} mrad rms")
    why = ""
    if figures["ticks_refused"]:
        why = f": {figures['first_refusal']}"
    print(f"ticks limited {figures['ticks_limited']}, refused {figures['ticks_refused']}{why}")
    if beyond := figures["rows_beyond_spring_law"]:
        print(f"the torsion lay beyond the spring law in {beyond} rows; there the law is its tangent.")
