"""The logs of a diagnosis after their repair: windows to fit, and motion to hold out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hdagen.arm.compiled_arm import Arm
from hdagen.data_quality.log_preparation import prepare_logs
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.models import Models
from hdagen.diagnosis.data.split import LogPortion, split_logs
from hdagen.diagnosis.data.windows import WindowedRecord, cut_windows
from hdagen.log.measured_log import Log
from hdagen.prediction.window_replay import Replay, check_log_fits_arm, replay


@dataclass(frozen=True, eq=False)
class PreparedData:
    """The repaired logs of one machine, and the parts that they are split into.

    Attributes:
        logs: the repaired logs.
        holdout: the repaired hold-out logs; empty where parts of ``logs`` are held out.
        fitted: the rows of the joined logs that the fit may use.
        held_out: the rows that no fit sees.
        window: length of a fitted window, s.
        record: the fitted rows, cut into windows.
        description: of the logs and their repairs, as diagnosis.json has it.

    """

    logs: tuple[Log, ...]
    holdout: tuple[Log, ...]
    fitted: LogPortion
    held_out: LogPortion
    window: float
    record: WindowedRecord
    description: Mapping[str, Any]

    @property
    def judged_logs(self) -> tuple[Log, ...]:
        """The logs that the held-out rows belong to."""
        return self.holdout or self.logs

    def replay_fitted(self, arm: Arm) -> Replay:
        """Replay the fitted logs on an arm, with errors counted as `replay_held_out` counts them.

        Args:
            arm: the model.

        Returns:
            The replay.

        Raises:
            PlantError: the model cannot be simulated.

        """
        return self._count_in_fit_noise(replay(arm, self.fitted.log))

    def replay_held_out(self, arm: Arm) -> Replay:
        """Replay the held-out logs on an arm. Errors count in the noise of the held-out or of the fitted motion,
        whichever is larger.

        Args:
            arm: the model.

        Returns:
            The replay.

        Raises:
            PlantError: the model cannot be simulated.

        """
        return self._count_in_fit_noise(replay(arm, self.held_out.log))

    def _count_in_fit_noise(self, found: Replay) -> Replay:
        """A replay with no less noise in a channel than the fitted motion has."""
        fitted = dict(zip(self.record.names, self.record.noise, strict=True))
        return replace(found, noise={name: max(noise, fitted.get(name, 0.0)) for name, noise in found.noise.items()})


def prepare_data(models: Models, logs: Sequence[Log], holdout: Sequence[Log]) -> PreparedData:
    """Repair logs or refuse them, and split them into windows to fit and motion to hold out.

    Args:
        models: of the robot.
        logs: logs of one machine.
        holdout: other motions of the machine; without any, blocks of each log are held out.

    Returns:
        The prepared data.

    Raises:
        LogError: a log cannot carry a diagnosis.

    """
    for log in (*logs, *holdout):
        check_log_fits_arm(models.nominal, log)
    repaired, other, fresh, description = prepare_logs(models.nominal, logs, holdout)
    fitted, held_out = split_logs(repaired, other, fresh)
    window = max(DATA.window_length, DATA.fewest_window_rows * fitted.log.period)
    record = cut_windows(models.full, fitted, window)
    return PreparedData(tuple(repaired), tuple(other), fitted, held_out, window, record, description)
