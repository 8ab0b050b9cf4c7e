"""The residual torque of a log before and after a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hdagen.adoption import verdict
from hdagen.arm.arrays import Array
from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.residuals.measured_motion import MeasuredMotion
from hdagen.diagnosis.residuals.torque_balance import TorqueBalance
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay


@dataclass(frozen=True, eq=False)
class ResidualTorque:
    """The torque balance of a log under the model before and after a verdict, whose effects the model has.

    Attributes:
        balance: The torques along the log's motion.
        before: Parameters (np) by the robot file.
        after: Parameters (np) by the verdict.
        parameter_indices: Places in p of each effect's parameters, by name@joint.

    """

    balance: TorqueBalance
    before: Array
    after: Array
    parameter_indices: Mapping[str, tuple[int, ...]]

    @property
    def motion(self) -> MeasuredMotion:
        """The log's motion."""
        return self.balance.motion

    def parameters_without(self, entry: str) -> Array:
        """Return the parameters (np) after the verdict, with one effect as the robot file has it.

        Args:
            entry: the effect, name@joint.

        """
        p = self.after.copy()
        for place in self.parameter_indices.get(entry, ()):
            p[place] = self.before[place]
        return p


def see_residual_torque(arm: Arm, said: verdict.Verdict, log: Log, before: Replay, after: Replay) -> ResidualTorque:
    """Compare a log with the model before and after a verdict.

    Args:
        arm: a model that has the verdict's effects.
        said: the verdict.
        log: the log of both replays.
        before: replay of the robot file.
        after: replay of the verdict.

    Returns:
        The torque balance of the log before and after.

    Raises:
        PlantError: the arm lacks a parameter of the verdict.

    """
    changed, _ = verdict.apply_verdict(arm, said)
    names = list(arm.parameters.described)
    own = {f"{e.name}@{e.joint}": tuple(map(names.index, e.parameters)) for e in said.effects}
    nominal = np.array([q.nominal for q in arm.parameters.described.values()])
    motion = MeasuredMotion(arm.with_parameters(nominal), log, (before, after))
    return ResidualTorque(TorqueBalance(motion), nominal, changed.p.copy(), own)
