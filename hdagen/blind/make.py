"""A child process that makes the logs of one case: a request on standard input, what is true of it on standard output.

    python -m hdagen.blind.make < request.json

Nothing of the truth is written to a file. The request: ``seed``, ``kind``, ``index`` of the case, ``motion`` "log" or
"hold_out", ``seconds`` how long, ``out`` the path of the log, ``truth`` what an earlier answer said (then it is not
found anew). The answer: ``snr``, how far the true effects stand above the noise of the channel that shows them best,
and ``parameters``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from hdagen.blind import joint_reality
from hdagen.blind.arms import ArmCase, TwoJointArm, parameters, scattered
from hdagen.blind.cases import cases
from hdagen.blind.joints import JointCase
from hdagen.blind.motion import Motion, circle, rich
from hdagen.blind.reality import MOST_CURRENT, World, simulate
from hdagen.log import write

Parameters = dict[tuple[str, int], dict[str, float]]
CHANNELS = {
    "motor_current": "current_noise",
    "motor_position": "motor_encoder_resolution",
    "joint_position": "joint_encoder_resolution",
}


def make(
    case: ArmCase, motion: str, seconds: float, found: Parameters | None
) -> tuple[dict[str, np.ndarray], Parameters, float]:
    """The log, the parameters of every effect in it, and the true effects' signal-to-noise ratio (0 for hold-outs)."""
    robot, path = case.robot, _motion(case, motion, seconds)
    seed = case.seed ^ (motion == "hold_out")
    if found is not None:
        return simulate(_world(case, found), robot.joints, path, seed), found, 0.0
    ends = _ends(path)
    without = None
    if case.truth:
        named = {(one.effect, one.joint) for one in case.truth}
        quiet = {key: value for key, value in parameters(case, ends).items() if key not in named}
        without = simulate(_world(case, quiet), robot.joints, path, seed)
        ends = {j: {**ends[j], "peak": float(np.abs(without[f"motor_current_command_{j}"]).max())} for j in ends}
    found = parameters(case, ends)
    log = simulate(_world(case, found), robot.joints, path, seed)
    return log, found, _snr(log, without, robot) if without else 0.0


def _motion(case: ArmCase, motion: str, seconds: float) -> Motion:
    seed = case.seed // 3 + (motion == "hold_out")
    if case.kind == "task":
        first, second = case.robot.joints
        return circle(seed, (first["length"], second["length"]), seconds)
    return rich(seed, seconds)


def _world(case: ArmCase, found: Parameters) -> World:
    of_joints = [{effect: p for (effect, joint), p in found.items() if joint == j} for j in (0, 1, 2)]
    return World(scattered(case.robot, case.seed), of_joints[1:], of_joints[0], case.robot.gravity)


def _ends(path: Motion) -> dict[int, dict[str, float]]:
    """What the motion reaches at each joint, and the most that the controller may ask for."""
    reached = zip(path.position.min(axis=0), path.position.max(axis=0), strict=True)
    return {
        j: {"peak": MOST_CURRENT, "lowest": float(low), "highest": float(high)}
        for j, (low, high) in enumerate(reached, 1)
    }


def _snr(log: Mapping[str, np.ndarray], without: Mapping[str, np.ndarray], robot: TwoJointArm) -> float:
    """Root mean square of what the effects change, in multiples of the channel's noise; the best channel's."""
    found = []
    for channel, key in CHANNELS.items():
        for j, joint in enumerate(robot.joints, 1):
            noise = joint[key] if key == "current_noise" else joint[key] / np.sqrt(12.0)
            change = log[f"{channel}_{j}"] - without[f"{channel}_{j}"]
            found.append(float(np.sqrt(np.mean(change**2))) / noise)
    return max(found)


def packed(found: Parameters) -> dict[str, dict[str, float]]:
    """For JSON: parameters by name@joint."""
    return {f"{effect}@{joint}": p for (effect, joint), p in found.items()}


def unpacked(found: Mapping[str, Mapping[str, float]]) -> Parameters:
    """The other way round."""
    return {(key.split("@")[0], int(key.split("@")[1])): dict(p) for key, p in found.items()}


def main() -> None:
    """Answer one request."""
    request: dict[str, Any] = json.load(sys.stdin)
    case = cases(request["seed"], request["kind"], request["index"] + 1)[-1]
    if isinstance(case, JointCase):
        log = joint_reality.make(case, request["motion"], request["seconds"])
        told = {"snr": case.snr(), "parameters": case.parameters()}
    else:
        assert isinstance(case, ArmCase)
        known = unpacked(request["truth"]) if request.get("truth") is not None else None
        log, found, snr = make(case, request["motion"], request["seconds"], known)
        told = {"snr": snr, "parameters": packed(found)}
    write(log, request["out"])
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()
