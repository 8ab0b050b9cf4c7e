"""`hdagen simulate`: a controller drives the compiled arm around a circle and is pushed; the log is written."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

EXAMPLE = """example:
  hdagen simulate paper --controller admittance_cartesian --push 3 4 15 0 --push 6 7 0 15 --gain stiffness_x=800 --out circle.parquet"""

LAWS = ("position", "impedance_cartesian", "impedance_joint", "admittance_cartesian", "admittance_joint")


def add_parser(commands: Any) -> None:
    """The command's arguments."""
    p = commands.add_parser(
        "simulate",
        help="drive the compiled arm around a circle, push it, and write the log",
        description="A controller drives the compiled arm around a circle of the tip, with set-valued friction, encoders and noise.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("robot", nargs="?", default="paper", help="a preset or a robot.toml (default: paper)")
    p.add_argument("--controller", choices=LAWS, default="impedance_cartesian")
    p.add_argument("--gain", action="append", default=[], metavar="NAME=VALUE", help="a gain of the controller, SI; may be repeated")
    p.add_argument("--push", action="append", nargs=4, type=float, default=[], metavar=("FROM", "TO", "FX", "FY"), help="s, s, N, N; may be repeated")
    p.add_argument("--seconds", type=float, default=10.0)
    p.add_argument("--radius", type=float, default=0.05, help="of the circle, m")
    p.add_argument("--center", nargs=2, type=float, default=None, metavar=("X", "Y"), help="of the circle, m (default: two thirds of the reach)")
    p.add_argument("--turn", type=float, default=5.0, help="seconds a turn")
    p.add_argument("--safe", choices=("zero", "damping"), default="damping", help="what the controller does after a fault")
    p.add_argument("--delay", type=int, default=0, help="ticks from a sample to its use")
    p.add_argument("--seed", type=int, default=0)
    p.add_argument("--profile", choices=("portable", "native"), default="portable")
    p.add_argument("--out", type=Path, default=Path("simulated.parquet"), help=".parquet or .csv (default: simulated.parquet)")
    p.add_argument("--json", action="store_true", help="print the figures as JSON")


def run(options: argparse.Namespace) -> int:
    """Simulate, write, print."""
    import numpy as np  # noqa: PLC0415
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from hdagen.control import Controller, Guard, Safe  # noqa: PLC0415
    from hdagen.log import write  # noqa: PLC0415
    from hdagen.plant import PlantError, load  # noqa: PLC0415
    from hdagen.reference import circle  # noqa: PLC0415
    from hdagen.simulate import Push, Sensors, ideal  # noqa: PLC0415
    from hdagen.simulate import run as simulate  # noqa: PLC0415

    arm = load(options.robot, profile=options.profile)
    gains = {}
    for text in options.gain:
        name, _, value = text.partition("=")
        try:
            gains[name] = float(value)
        except ValueError:
            raise PlantError(f"--gain {text}: give NAME=VALUE with a number, for instance stiffness_x=800.") from None
    safe = Safe[options.safe.upper()]
    damping = tuple(20 * j["drive"]["motor_inertia"]["nominal"] for j in arm.robot["joints"])  # the motors stop within 1/20 s
    controller = Controller(arm, options.controller, Guard(safe, safe_damping=damping), gains)
    reach = sum(joint["length"]["nominal"] for joint in arm.robot["joints"])
    center = tuple(options.center) if options.center else (2 * reach / 3, 0.0)
    path = circle(options.radius, center, options.turn, options.seconds, controller.guard.period)
    pushes = [Push(a, b, (x, y)) for a, b, x, y in options.push]
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("simulating", total=len(path.position))
        result = simulate(
            arm, controller, path, pushes, Sensors(delay=options.delay), options.seed, progress=lambda k, _: bar.update(task, completed=k)
        )
    write(result.log, options.out)
    cartesian = "mass_x" in controller.gains
    goal = path.position + (ideal(arm, controller, result.push, path.period) if cartesian else 0.0)
    gap = np.linalg.norm(result.tip - goal, axis=1)
    refused = int((result.status < 0).sum())
    figures = {
        "log": str(options.out),
        "rows": len(result.log),
        "largest_gap": float(gap.max()),
        "rms_gap": float(np.sqrt(np.mean(gap**2))),
        "largest_ideal_displacement": float(np.linalg.norm(goal - path.position, axis=1).max()),
        "ticks_limited": int((result.status > 0).sum()),
        "ticks_refused": refused,
        "first_refusal": controller.sentence(int(result.status[result.status < 0][0])) if refused else None,
        "rows_beyond_spring_law": result.beyond_law,
    }
    if options.json:
        print(json.dumps(figures, indent=1))
        return 0
    print(f"{options.out}: {figures['rows']} rows of {arm.robot['name']} under {options.controller}")
    against = "the ideal mass-damper-spring motion" if cartesian else "the circle"
    print(f"tip against {against}: {1e3 * gap.max():.2f} mm at most, {1e3 * figures['rms_gap']:.2f} mm rms")
    print(f"ticks limited {figures['ticks_limited']}, refused {refused}" + (f": {figures['first_refusal']}" if refused else ""))
    if result.beyond_law:
        print(f"the torsion lay beyond the spring law in {result.beyond_law} rows; there the law is its tangent.")
    return 0
