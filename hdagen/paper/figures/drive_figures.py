"""The drive: Tables I and II, the torque-torsion loop of Fig. 3 (b), the stiffness curve of Fig. 8."""

from __future__ import annotations

from functools import partial

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.paper.figures.compliance_figures import BASE_SET, PUSHED_SECONDS
from hdagen.paper.prototype.figure_result import Axes, Choice, Claim, Curve, Grid, Part, Result
from hdagen.paper.prototype.step_response import measure_responses
from hdagen.paper.prototype.virtual_prototype import (
    CIRCLE_PUSHES,
    PERIOD,
    TABLE_1,
    Bench,
    DrivenRun,
    cartesian_gains,
    drive_arm,
    paper_circle,
    simulate_pushed,
)

K1, K2, K3, T1, T2 = 1.0e4, 1.4e4, 1.6e4, 3.9, 12.0  # N m/rad, N m: catalogue of the CSG-17-100, Fig. 8
HYSTERESIS_LOSS = 2.9e-4  # rad, hysteresis loss, catalogue: 1 arcmin
LOCKING_FRICTION = 0.5  # N m of dry friction, which locks the motor under every load of these figures
LOCKED_MOTOR = {
    f"{key}_{j}": value
    for key, value in (("coulomb_friction", LOCKING_FRICTION), ("friction_smoothing", 3.0))
    for j in (1, 2)
}
NO_HYSTERESIS = {"hysteresis_torque_1": 0.0, "hysteresis_torque_2": 0.0}
TABLE_1_ROTOR = 1.21e-4 + 0.079e-4  # kg m², J_m + J_w of Table I
NO_GEAR_FRICTION = {"coulomb_friction_1": 0.0}
LEVER_ARM = 0.3  # m from joint 1 to the tip of the straight arm
NO_LOAD_CURRENT, NO_LOAD_SPEED, LARGEST_EFFICIENCY = 0.493, 3730 * 2 * np.pi / 60, 0.85  # A, rad/s: Table II


def make_table1(bench: Bench) -> Result:
    """Make Table I: the parameters that follow from the catalogue beside the printed ones."""
    made, printed = bench.arm().robot["joints"][0]["drive"], bench.arm(TABLE_1).robot["joints"][0]
    nominal = {name: made[name]["nominal"] for name in made if isinstance(made[name], dict)}
    rows: list[tuple[str, str, float, str]] = [
        ("K_w0 (N m/rad)", "2.5517", nominal["wave_generator_stiffness"], "(29): 2 τ_fs/(N ψ)"),
        ("K_f0 (N m/rad)", "9743.94", nominal["flexspline_stiffness"], "(28) corrected, at the mid-torques"),
        ("c_f (1/(N m))", "0.0831", nominal["flexspline_stiffening"], "(28) corrected"),
        ("c_w (1/(N m))", "27.027", nominal["wave_generator_stiffening"], "(31)"),
        ("τ_fs (N m)", "0.037", nominal["coulomb_friction"], "catalogue"),
        ("N", "100", nominal["ratio"], "catalogue"),
        ("K_f (N m/rad)", "10000", K1, "catalogue, K_1"),
        ("J_m + J_w (kg m²)", "0.0001289", printed["drive"]["motor_inertia"]["nominal"], "Table I, as printed"),
        ("J_a (kg m²)", "0.876", printed["inertia"]["nominal"], "Table I, as printed"),
        ("l_a (m)", "0.15", printed["length"]["nominal"], "Table I, as printed"),
    ]
    same = [_rounds_to(value, text) for _, text, value, _ in rows]
    cells = [
        (name, text, value, "yes" if fits else "no", source)
        for (name, text, value, source), fits in zip(rows, same, strict=True)
    ]
    claims = [
        Claim(
            "K_w0 = 2.5517, K_f0 = 9743.94, c_f = 0.0831, c_w = 27.027 follow from the catalogue by (27) to (31)",
            f"{nominal['wave_generator_stiffness']:.4f}, {nominal['flexspline_stiffness']:.2f}, "
            f"{nominal['flexspline_stiffening']:.4f}, {nominal['wave_generator_stiffening']:.3f}",
            all(same[:4]),
            "with (28) as corrected: torques in place of torsions, at T1/2 and (T1 + T2)/2; as printed its root is "
            "imaginary",
        ),
        Claim(
            "J_m = 1.21e-4 kg m² (Table I) and 835 g cm² (Table II)",
            "1.21e-4 against 8.35e-5 kg m²",
            False,
            "the two tables disagree; the prototype has Table II's, the preset `paper_table1` Table I's",
        ),
    ]
    text = "Springs of the compiled arm, which `gen` makes from the catalogue's numbers, beside the printed ones."
    grid = Grid(
        "Table I: parameters of the validation model", ("parameter", "paper", "here", "same digits", "from"), cells, 7
    )
    title = "Parameters of the validation model"
    return Result("table1", title, text, [grid], claims, {"rows": cells}, 1, [_choose_rotor(bench)])


def _choose_rotor(bench: Bench) -> Choice:
    """The choice of the rotor's inertia, by runs of Fig. 11's middle set."""
    gains, path = cartesian_gains(*BASE_SET.values()), paper_circle(PUSHED_SECONDS)
    other = {f"motor_inertia_{j}": TABLE_1_ROTOR for j in (1, 2)}
    words = []
    for name, changes in (("Table II's", {}), ("Table I's", other)):
        run = bench.compute_once(
            ("rotor", name), partial(simulate_pushed, bench, "admittance", gains, path, changes=changes)
        )
        settling, overshoot, largest = measure_responses((run.tip - path.position)[:, None], CIRCLE_PUSHES, PERIOD)[
            0, 0
        ]
        words.append(
            f"{name}: Fig. 11's middle set settles in {settling:.2f} s, overshoots by {100 * overshoot:.0f} %, moves "
            f"{1e3 * largest:.1f} mm"
        )
    return Choice("rotor inertia J_m", words[0], f"{words[1]}, with a controller that believes the other")


def _rounds_to(value: float, text: str) -> bool:
    """Whether the value rounds to the text."""
    decimals = len(text.partition(".")[2])
    return f"{value:.{decimals}f}" == text


def make_table2(bench: Bench) -> Result:
    """Make Table II: the motor's no-load current and speed, without and with the gear's friction."""
    plant = bench.arm(changes=NO_GEAR_FRICTION)
    geared = bench.arm()
    seconds, constant = 7.5, geared.parameters["torque_constant_1"]
    rows = round(seconds / 1e-3)
    needed = NO_LOAD_CURRENT + geared.parameters["coulomb_friction_1"] / constant
    runs = {
        "motor alone": _spin_motor(plant, NO_LOAD_CURRENT, rows),
        "with the gear's friction": _spin_motor(geared, NO_LOAD_CURRENT, rows),
        f"the same at {needed:.2f} A": _spin_motor(geared, needed, rows),
    }
    speed = {name: _motor_speed(one) for name, one in runs.items()}
    reached = {name: float(values[-100:].mean()) for name, values in speed.items()}
    start = geared.parameters["coulomb_friction_1"] / constant
    time = np.arange(rows) * 1e-3
    stall = NO_LOAD_CURRENT / (1 - np.sqrt(LARGEST_EFFICIENCY)) ** 2
    claims = [
        Claim(
            "no-load speed 3730 rpm at an input current of 493 mA",
            f"{reached['motor alone'] * 30 / np.pi:.0f} rpm after {seconds:g} s at 493 mA, the gear's friction off",
            abs(reached["motor alone"] / NO_LOAD_SPEED - 1) < 0.01,
            "the motor's losses are put down as viscous, 6.6e-5 N m s/rad, so this holds them to be used rightly",
        ),
        Claim(
            "the motor drives the gear",
            f"not at its no-load current: the gear starts from {start:.2f} A on and needs {needed:.2f} A at 3730 rpm",
            None,
            "τ_fs/k_m = 0.705 A; Table I's starting torque is 1.4 times the motor's no-load torque, 0.0259 N m",
        ),
        Claim("maximum efficiency 85 %", f"stall current {stall:.0f} A at the voltage of the no-load speed", None,
              "η = (1 − √(I_0/I_stall))²; far above the 15 A of the amplifier, so it never limits the arm"),
    ]  # fmt: skip
    parts: list[Part] = [
        Axes("motor of joint 1 at a constant current", "time (s)", "motor speed (rad/s)",
             [Curve(name, time, values) for name, values in speed.items()]),
        Grid("Table II: parameters of the DC motor", ("parameter", "paper", "here"), [
            ("motor inertia J_m (kg m²)", 8.35e-5, geared.parameters["motor_inertia_1"] - 7.9e-6),
            ("torque constant k_m (N m/A)", 0.0525, constant),
            ("no-load current (A)", NO_LOAD_CURRENT, NO_LOAD_CURRENT),
            ("no-load speed (rad/s)", NO_LOAD_SPEED, reached["motor alone"]),
            ("current to start the gear (A)", None, start),
            ("current at that speed with the gear (A)", None, needed),
        ]),
    ]  # fmt: skip
    numbers = {"speed_reached": reached, "start_current": start, "current_with_gear": needed, "stall_current": stall}
    logs = dict(zip(("motor_alone", "with_friction", "with_gear"), (run.log for run in runs.values()), strict=True))
    robots = {"motor_alone": bench.robot_file(NO_GEAR_FRICTION)}
    text = (
        "The drive of joint 1 spun up by a constant current; speeds are differences of what the Hall sensor says "
        "over 0.1 s."
    )
    return Result("table2", "Parameters of the DC motor", text, parts, claims, numbers, 1, logs=logs, robots=robots)


def _spin_motor(plant: Arm, current: float, rows: int) -> DrivenRun:
    given = np.zeros((rows, 2))
    given[:, 0] = current * np.clip(np.arange(rows) / 50.0, 0, 1)
    return drive_arm(plant, given, np.zeros((rows, 2)), [0.0, 0.0])


def _motor_speed(run: DrivenRun) -> Array:
    theta, back = run.log["motor_position_1"], 100
    return np.concatenate([np.zeros(back), (theta[back:] - theta[:-back]) / (back * 1e-3)])


def _load_locked_joint(bench: Bench, torque: Array, changes: dict[str, float]) -> tuple[DrivenRun, Array, Array]:
    """Load joint 1 of the straight arm by a force across the tip, its input locked; return the run, the logged torsion
    and the true torsion."""
    arm = bench.arm(changes={**LOCKED_MOTOR, **changes})
    push = np.zeros((len(torque), 2))
    push[:, 1] = torque / LEVER_ARM
    found = drive_arm(arm, np.zeros((len(torque), 2)), push, [0.0, 0.0])
    seen = found.log["motor_position_1"] / arm.parameters["ratio_1"] - found.log["joint_position_1"]
    truth = arm.outputs(found.state, np.hstack([np.zeros_like(push), push]))["torsion"][:, 0]
    return found, seen, truth


def _loop_width(torsion: Array, torque: Array) -> float:
    """Width of the loop: distance of rising and falling torsion at no torque; 0 where no torque is passed once only."""
    at = np.flatnonzero(np.diff(np.sign(torque)))
    place = [torsion[k] - torque[k] * (torsion[k + 1] - torsion[k]) / (torque[k + 1] - torque[k]) for k in at]
    if len(place) < 2:
        return 0.0
    return abs(place[-1] - place[-2])


def make_fig3b(bench: Bench) -> Result:
    """Make Fig. 3 (b): the torque-torsion loop, input locked."""
    time = np.arange(15000) * 1e-3
    load = -12.0 * np.sin(2 * np.pi * time / 6.0) * np.clip(time / 1.0, 0, 1)
    run, seen, truth = _load_locked_joint(bench, load, {})
    law, _, reversible = _load_locked_joint(bench, load, NO_HYSTERESIS)
    whole = slice(3000, None)
    width, none = (
        _loop_width(truth[whole], run.joint_torque[whole, 0]),
        _loop_width(reversible[whole], law.joint_torque[whole, 0]),
    )
    turn = slice(9000, 15000)
    loss = abs(float(np.trapezoid(run.joint_torque[turn, 0], truth[turn])))
    claims = [
        Claim(
            "torque against torsion is a loop whose width is the hysteresis loss Ψ (Fig. 3 (b); catalogue: 2.9e-4 rad)",
            f"{width:.3g} rad at no torque, {loss * 1e3:.2f} mJ a turn",
            abs(width / HYSTERESIS_LOSS - 1) < 0.1,
            "by a hysteresis element beside the springs of (11)",
        ),
        Claim(
            "(4) to (11) model the hysteresis",
            f"with the laws alone the loop is {none:.1e} rad wide",
            False,
            "the laws give one torque for a torsion, whichever way it came; Ψ enters them as a stiffness only",
        ),
    ]
    curves = [
        Curve("log, disc of 2¹⁸ counts", seen, run.log["joint_torque_1"], "points", "grey", width=0.6),
        Curve("truth", truth, run.joint_torque[:, 0], color="blue", dash="solid"),
        Curve("springs of (11) alone", reversible, law.joint_torque[:, 0], color="vermilion", dash="dashed"),
    ]
    parts = [Axes("input locked, load of 6 s a turn", "torsion (rad)", "joint torque (N m)", curves)]
    choice = Choice(
        "shape of the loop", "a Dahl element, ψ/2 of half height times the stiffness at no torque, turning over 1e-4 "
                        f"rad: {width:.3g} rad wide, {loss * 1e3:.2f} mJ a turn",
        f"turning over {'; '.join(_describe_loop(bench, load, angle, turn) for angle in (5e-5, 2e-4))}; none "
        "(the paper's "
        "laws): no loop; the catalogue gives the width and not the shape",
    )  # fmt: skip
    text = "Joint 1 of the straight arm, its motor held, loaded slowly by a force across the tip."
    numbers = {"width": width, "width_of_laws_alone": none, "loss_per_turn": loss, "psi": HYSTERESIS_LOSS}
    logs = {"loaded": run.log, "springs_alone": law.log}
    robots = {"loaded": bench.robot_file(LOCKED_MOTOR), "springs_alone": bench.robot_file(LOCKED_MOTOR | NO_HYSTERESIS)}
    return Result("fig3b", "Hysteresis effect", text, parts, claims, numbers, 1, [choice], logs, robots)


def _describe_loop(bench: Bench, load: Array, angle: float, turn: slice) -> str:
    """Width and loss of the loop of a hysteresis that turns over another angle, rad."""
    run, _, truth = _load_locked_joint(bench, load, {"hysteresis_angle_1": angle})
    loss = abs(float(np.trapezoid(run.joint_torque[turn, 0], truth[turn])))
    return f"{angle:g} rad: {_loop_width(truth[3000:], run.joint_torque[3000:, 0]):.3g} rad wide, {loss * 1e3:.2f} mJ"


def make_fig8(bench: Bench) -> Result:
    """Make Fig. 8: stiffness against torque."""
    load = -np.linspace(0.0, 20.0, 12000)
    run, _, truth = _load_locked_joint(bench, load, NO_HYSTERESIS)
    torque, torsion = np.abs(run.joint_torque[:, 0]), np.abs(truth)
    grid = np.linspace(0.5, 19.5, 39)
    low, high = (np.interp(grid + side, torque, torsion) for side in (-0.25, 0.25))
    stiffness = 0.5 / (high - low)
    drive = bench.arm().robot["joints"][0]["drive"]
    k_f0, c_f = (drive[name]["nominal"] for name in ("flexspline_stiffness", "flexspline_stiffening"))
    flexspline = k_f0 * (1 + (c_f * grid) ** 2)
    lines = np.where(grid < T1, K1, np.where(grid < T2, K2, K3))
    mids = {"T1/2": T1 / 2, "(T1+T2)/2": (T1 + T2) / 2}
    at_mids = {name: float(k_f0 * (1 + (c_f * value) ** 2)) for name, value in mids.items()}
    at_zero = float(
        1 / (1 / k_f0 + 1 / (drive["ratio"]["nominal"] ** 2 * drive["wave_generator_stiffness"]["nominal"]))
    )
    over = float(k_f0 * (1 + (c_f * T2) ** 2))
    claims = [
        Claim(
            "(27) fits the three stiffnesses of the catalogue, determining c_f and K_f0",
            f"K_1 and K_2 at the mid-torques: {at_mids['T1/2']:.0f} and {at_mids['(T1+T2)/2']:.0f} N m/rad",
            all(abs(found / wanted - 1) < 1e-6 for found, wanted in zip(at_mids.values(), (K1, K2), strict=True)),
        ),
        Claim(
            "the third region has K_3 (16 000 N m/rad)",
            f"{over:.0f} N m/rad at T2 = 12 N m and rising with the torque's square",
            False,
            "a parabola through two stiffnesses misses the third; above T2 the law is stiffer than the catalogue",
        ),
    ]
    parts = [
        Axes("torque and torsion", "torsion (rad)", "joint torque (N m)", [
            Curve("log of the arm, truth", torsion, torque, color="blue", dash="solid"),
            Curve("catalogue, three lines", _catalogue_torsion(grid), grid, color="grey", dash="dashed"),
        ]),
        Axes("stiffness", "joint torque (N m)", "stiffness (N m/rad)", [
            Curve("whole drive, from the log", grid, stiffness, "points", "blue", width=2.0),
            Curve("flexspline, (9) corrected", grid, flexspline, color="vermilion", dash="solid"),
            Curve("catalogue K_1, K_2, K_3", grid, lines, "step", "grey", "dashed"),
        ]),
    ]  # fmt: skip
    text = (
        "Joint 1 loaded once to 20 N m with its motor held, the hysteresis element off; stiffness is the slope over "
        "0.5 N m."
    )
    numbers = {
        "at_mid_torques": at_mids,
        "at_T2": over,
        "at_no_torque": at_zero,
        "torque": grid,
        "stiffness": stiffness,
    }
    robots = {"loaded": bench.robot_file(LOCKED_MOTOR | NO_HYSTERESIS)}
    return Result(
        "fig8", "Stiffness curve of the drive", text, parts, claims, numbers, 2, logs={"loaded": run.log}, robots=robots
    )


def _catalogue_torsion(torque: Array) -> Array:
    return np.minimum(torque, T1) / K1 + np.clip(torque - T1, 0, T2 - T1) / K2 + np.clip(torque - T2, 0, None) / K3
