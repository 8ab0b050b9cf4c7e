"""Errors of simulations over long windows, over those of the model without any effect.

An error that has begun goes on, so each window counts as one observation of a channel, whatever its rows; a joint's
encoders count as one channel.

Legend: W windows, S sampled rows, M channels, I of them with a joint's encoders as one, L lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.diagnosis.data.data_settings import DATA
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.rollout import Rollout


@dataclass(eq=False)
class LongWindowErrors:
    """Errors in the windows of ``shooting``; ``p`` (np): parameters of the model without any effect."""

    shooting: MultipleShooting
    p: Array

    def __post_init__(self) -> None:
        record = self.shooting.record
        kinds = [(j, "" if quantity.endswith("position") else quantity) for quantity, j in record.outputs]
        channels = sorted(set(kinds))
        self.channel_index = np.array([channels.index(kind) for kind in kinds])
        self.window_index = np.repeat(np.arange(len(record.sampled_rows)), [len(rows) for rows in record.sampled_rows])
        self.window_count = len(record.sampled_rows)
        self.is_encoder = np.array([not quantity for _, quantity in channels])
        # the noise of what is read of inputs is all that no loop explains, which counts as it is
        noise = record.noise * np.where(self.is_encoder[self.channel_index], DATA.significant_noise_multiple, 1.0)
        self.usual_error = np.ones(len(kinds))
        self.usual_error = np.maximum(np.sqrt((self.simulate_errors([self.p])[0] ** 2).mean(0)), noise)
        self.noise_floor = self._average_encoders((noise / self.usual_error)[None] ** 2)[0]

    def simulate_errors(self, points: Sequence[Array]) -> Array:
        """Simulate the errors of the channels at some parameters.

        Args:
            points: parameters (np) of each lane.

        Returns:
            Errors (L, S, M), over the usual ones.

        """
        record = self.shooting.record
        predictions = np.stack(
            self.shooting.predict_all([Rollout(p, self.shooting.measured_initial_states(p)) for p in points])
        )
        return np.asarray(record.subtract_prediction(predictions) / self.usual_error)

    def _average_encoders(self, squares: Array) -> Array:
        """Average the squares of all channels (L, M) over each joint's encoders (L, I)."""
        counts = np.bincount(self.channel_index)
        return np.stack([np.bincount(self.channel_index, row) / counts for row in squares])

    def mean_squares(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """Compute the mean squares of errors, no less than those of the noise.

        Args:
            errors: errors (L, S, M).
            rows: the sampled rows that count.

        Returns:
            Mean squares (L, I).

        """
        errors = errors[:, rows]
        return np.maximum(
            self._average_encoders(np.einsum("lsm,lsm->lm", errors, errors) / errors.shape[1]), self.noise_floor
        )

    def log_misfit(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """Compute the misfit W Σ log e² of errors.

        Args:
            errors: errors (L, S, M).
            rows: the sampled rows that count.

        Returns:
            The misfits (L).

        """
        return np.asarray(len(np.unique(self.window_index[rows])) * np.log(self.mean_squares(errors, rows)).sum(1))

    def weigh_channels(self, errors: Array, rows: Mask | slice = slice(None)) -> Array:
        """Weigh the channels' squared errors as they count in the misfit near some errors.

        Args:
            errors: errors (S, M).
            rows: the sampled rows that count.

        Returns:
            The weights (M).

        """
        weight = 1.0 / (self.mean_squares(errors[None], rows)[0] * np.bincount(self.channel_index))[self.channel_index]
        weight *= len(np.unique(self.window_index[rows])) / len(self.window_index[rows])
        return np.asarray(weight)
