"""A child process that makes the logs of one case: a request on standard input, the truth on standard output.

    python -m hdagen.blind.realities.log_maker < request.json

The truth is never written to a file. The request: ``seed``, ``kind``, ``family`` and ``background`` of the
population, ``index`` of the case, ``motion`` "log" or "hold_out", its length ``seconds``, ``out`` the path of the
log, and ``truth``, the parameters of an earlier answer (then they are not drawn again). The answer: ``snr``, the
ratio of the true effects to the noise on the channel that shows them best, and ``parameters``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hdagen.blind.realities.arm_world import LARGEST_COMMAND, ArmWorld
from hdagen.blind.realities.cases import draw_cases
from hdagen.blind.realities.joint_arms import JointArmCase
from hdagen.blind.realities.maxwell_motion import draw_point_moves
from hdagen.blind.realities.maxwell_reality import simulate_arm
from hdagen.blind.realities.model_arms import ModelCase
from hdagen.blind.realities.population import MAXWELL, read_population
from hdagen.blind.realities.rigid_joints import JointCase
from hdagen.blind.realities.signal_to_noise import measure_signal_to_noise
from hdagen.blind.realities.two_joint_arms import ArmCase, TwoJointArm, draw_effect_parameters, draw_true_parameters
from hdagen.blind.realities.two_joint_motion import Motion, draw_circle_motion, draw_rich_motion
from hdagen.log.measured_log import write

JointEffects = dict[str, dict[str, float]]  # parameters by effect
EffectParameters = dict[tuple[str, int], dict[str, float]]  # parameters by effect and joint
CHANNEL_NOISE_KEYS = {
    "motor_current": "current_noise",
    "motor_position": "motor_encoder_resolution",
    "joint_position": "joint_encoder_resolution",
}


def make_arm_log(
    case: ArmCase, motion: str, seconds: float, found: EffectParameters | None
) -> tuple[dict[str, np.ndarray], EffectParameters, float]:
    """Make a log of a case.

    Args:
        case: the drawn case.
        motion: "log" or "hold_out".
        seconds: length of the motion, s.
        found: parameters of every effect from an earlier log of the case; None to draw them.

    Returns:
        The log's columns by name, the parameters of every effect in it, and the signal-to-noise ratio of the true
        effects (0 where the parameters were given).

    """
    robot, path = case.machine, _draw_motion(case, motion, seconds)
    seed, simulate = case.seed ^ (motion == "hold_out"), _choose_simulator(case)
    if found is not None:
        return simulate(_make_world(case, found), robot.joints, path, seed), found, 0.0
    ends = _motion_limits(path)
    without = None
    if case.truth:
        named = {(one.effect, one.joint) for one in case.truth}
        quiet = {key: value for key, value in draw_effect_parameters(case, ends).items() if key not in named}
        without = simulate(_make_world(case, quiet), robot.joints, path, seed)
        ends = {j: {**ends[j], "peak": float(np.abs(without[f"motor_current_command_{j}"]).max())} for j in ends}
    found = draw_effect_parameters(case, ends)
    log, snr = simulate(_make_world(case, found), robot.joints, path, seed), 0.0
    if without:
        snr = measure_signal_to_noise(log, without, _list_noise(robot))
    return log, found, snr


def make_chain_log(
    case: JointArmCase, motion: str, seconds: float, found: EffectParameters | None
) -> tuple[dict[str, np.ndarray], EffectParameters, float]:
    """Make a log of a case of joints, as `make_arm_log` does of an arm.

    Args:
        case: the drawn case.
        motion: "log" or "hold_out".
        seconds: length of the motion, s.
        found: parameters of every effect from an earlier log of the case; None to draw them.

    Returns:
        The log's columns by name, the parameters of every effect in it, and the signal-to-noise ratio of the true
        effects (0 where the parameters were given).

    """
    from hdagen.blind.realities.joint_arm_reality import simulate_chain

    if found is not None:
        return simulate_chain(case, motion, seconds, found), found, 0.0
    found, snr = case.effect_parameters(seconds), 0.0
    log = simulate_chain(case, motion, seconds, found)
    if case.truth:
        named = {(one.effect, one.joint) for one in case.truth}
        quiet = {key: p for key, p in found.items() if key not in named}
        without = simulate_chain(case, motion, seconds, quiet)
        torque = {f"motor_torque_{j}": joint["input_noise"] for j, joint in enumerate(case.machine.joints, 1)}
        snr = measure_signal_to_noise(log, without, case.robot.noise() | torque)
    return log, found, snr


def _choose_simulator(case: ArmCase) -> Callable[..., dict[str, np.ndarray]]:
    """The simulator of the case's family; MuJoCo is loaded where it is needed."""
    if case.family == MAXWELL:
        return simulate_arm
    from hdagen.blind.realities.arm_reality import simulate_world

    return simulate_world


def _draw_motion(case: ArmCase, motion: str, seconds: float) -> Motion:
    seed = case.seed // 3 + (motion == "hold_out")
    if case.kind == "task":
        first, second = case.robot.joints
        return draw_circle_motion(seed, (first["length"], second["length"]), seconds)
    if case.family == MAXWELL:
        return draw_point_moves(seed, seconds)
    return draw_rich_motion(seed, seconds)


def _make_world(case: ArmCase, found: EffectParameters) -> ArmWorld:
    arm, first, second = JointEffects(), JointEffects(), JointEffects()
    for (effect, joint), p in found.items():
        (arm, first, second)[joint][effect] = p
    return ArmWorld(draw_true_parameters(case.machine, case.seed), [first, second], arm, case.machine.gravity)


def _motion_limits(path: Motion) -> dict[int, dict[str, float]]:
    """The angles that the motion reaches at each joint, rad, and the controller's largest command, A."""
    reached = zip(path.position.min(axis=0), path.position.max(axis=0), strict=True)
    return {
        j: {"peak": LARGEST_COMMAND, "lowest": float(low), "highest": float(high)}
        for j, (low, high) in enumerate(reached, 1)
    }


def _list_noise(robot: TwoJointArm) -> dict[str, float]:
    """The standard deviation of each channel's noise; an encoder rounds to its resolution."""
    found = {}
    for channel, key in CHANNEL_NOISE_KEYS.items():
        for j, joint in enumerate(robot.joints, 1):
            found[f"{channel}_{j}"] = joint[key] if key == "current_noise" else joint[key] / np.sqrt(12.0)
    return found


def pack_parameters(found: EffectParameters) -> dict[str, dict[str, float]]:
    """Key parameters by name@joint, as JSON needs it.

    Args:
        found: parameters by effect and joint.

    Returns:
        The same parameters by name@joint.

    """
    return {f"{effect}@{joint}": p for (effect, joint), p in found.items()}


def unpack_parameters(found: Mapping[str, Mapping[str, float]]) -> EffectParameters:
    """Undo `pack_parameters`.

    Args:
        found: parameters by name@joint.

    Returns:
        The same parameters by effect and joint.

    """
    return {(key.split("@")[0], int(key.split("@")[1])): dict(p) for key, p in found.items()}


def main() -> None:
    """Answer one request."""
    request: dict[str, Any] = json.load(sys.stdin)
    case = draw_cases(request["seed"], read_population(request), request["index"] + 1)[-1]
    if isinstance(case, JointCase):
        from hdagen.blind.realities import joint_reality

        log = joint_reality.make_joint_log(case, request["motion"], request["seconds"])
        told = {"snr": case.snr(), "parameters": case.friction_parameters()}
    elif isinstance(case, ModelCase):
        from hdagen.blind.realities import model_reality

        label = case.label()
        stated = (request.get("truth") or {}).get(f"{case.effect}@{case.joint}")
        log, drawn, snr = model_reality.make_model_log(case, request["motion"], request["seconds"], stated)
        told = {"snr": snr, "parameters": dict.fromkeys((*label["verdict"], *label["optional"]), drawn)}
    else:
        assert isinstance(case, ArmCase | JointArmCase)
        known = None
        if request.get("truth") is not None:
            wrong = {str(one) for one in case.numbers}
            known = unpack_parameters({name: p for name, p in request["truth"].items() if name not in wrong})
        how = request["motion"], request["seconds"], known
        log, found, snr = make_arm_log(case, *how) if isinstance(case, ArmCase) else make_chain_log(case, *how)
        numbers = {str(one): {"factor": one.factor} for one in case.numbers}
        told = {"snr": snr, "parameters": pack_parameters(found) | numbers}
    write(log, request["out"])
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()
