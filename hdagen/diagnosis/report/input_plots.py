"""Pictures of effects on the input: command and answer over time, and the answer over the command."""

from __future__ import annotations

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.effect_catalogue import Plot
from hdagen.diagnosis.report.effect_picture import EffectPicture
from hdagen.diagnosis.report.report_settings import REPORT
from hdagen.diagnosis.report.residual_curves import ROBOT_FILE_WORDS, draw_points_and_fit, write_title
from hdagen.diagnosis.residuals.effect_agreement import measure_agreement
from hdagen.diagnosis.residuals.residual_torque import ResidualTorque
from hdagen.diagnosis.residuals.residual_trace import trace_residual
from hdagen.log.column_map import name_command_channel
from hdagen.pages.curves import Panel, Plane, Series, draw_panels, draw_planes

OVER_TIME = "command_rate"  # the abscissa of effects that shift a command in time: over the command they are a ring


def draw_input(sight: ResidualTorque, entry: str, plot: Plot, joint: int) -> list[EffectPicture]:
    """Draw an effect on the input of a motor.

    Args:
        sight: the residual of the held-out log.
        entry: the effect, name@joint.
        plot: that fits the effect.
        joint: the joint.

    Returns:
        The pictures: over time, where the effect changes most, and over the command unless that is a ring.

    """
    if not sight.motion.has_measured_input(joint):
        return [_draw_missing_torque(sight, entry, joint)]
    shown = [sight.balance.simulate_inputs(p)[1][:, joint - 1] for p in (sight.before, sight.after)]
    name, log = sight.motion.arm.input_names[joint - 1], sight.motion.log
    word, unit = sight.motion.input_word(joint), sight.motion.input_unit(joint)
    command, measured, clear = log[name_command_channel(name)], log[name], slice(REPORT.settling_rows, None)
    alike = measure_agreement((measured - shown[0])[clear], (shown[1] - shown[0])[clear])
    seconds = REPORT.delay_scene_seconds if plot.abscissa == OVER_TIME else REPORT.scene_seconds
    span = _find_liveliest_rows(shown[1] - shown[0], log.period, seconds)
    drawn = [
        Series("command", command[span], color="ink", draw="step", dash="dotted"),
        Series("measured", measured[span], color="grey", dash="solid", width=3.4),
        Series("robot file", shown[0][span], color="green", dash="dashed"),
        Series("model with the effect", shown[1][span], color="vermilion", dash="solid"),
    ]
    scene = draw_panels(
        f"{write_title(entry)}: command and answer",
        log.time[span],
        [Panel(f"{word} ({unit})", drawn, f"motor {joint}", height=1.5)],
        caption=f"The moment in which the effect changes most. {alike.describe(ROBOT_FILE_WORDS)}",
    )
    if plot.abscissa == OVER_TIME:
        return [EffectPicture(scene, alike)]
    over = draw_planes(
        f"{write_title(entry)}: {word} over command",
        [Plane(draw_points_and_fit(command[clear], measured[clear], shown[1][clear]), f"motor {joint}")],
        x_label=f"command ({unit})",
        y_label=f"{word} ({unit})",
        equal=False,
    )
    return [EffectPicture(scene, alike), EffectPicture(over)]


def _draw_missing_torque(sight: ResidualTorque, entry: str, joint: int) -> EffectPicture:
    """Where no input is measured: the command, and the torque that the motion shows beyond it, over time."""
    seen = trace_residual(sight, "motor", joint, entry)
    alike = measure_agreement(seen.after + seen.effect_part, seen.effect_part)
    time, gaps = sight.motion.time, np.full(len(sight.motion.time), np.nan)
    points, added = gaps.copy(), gaps.copy()
    points[seen.instants], added[seen.instants] = seen.after + seen.effect_part, seen.effect_part
    span = _find_liveliest_rows(np.nan_to_num(added), sight.motion.grid.period, REPORT.scene_seconds)
    command = sight.balance.inputs(sight.parameters_without(entry))[:, joint - 1]
    word, unit = sight.motion.input_word(joint), sight.motion.input_unit(joint)
    panels = [
        Panel(f"commanded {word} ({unit})", [Series("command", command[span], color="ink", draw="step")]),
        Panel(
            f"torque beyond it ({seen.unit})",
            [
                Series("log", points[span], color="grey", dash="solid", width=3.4),
                Series("model with the effect", added[span], color="vermilion", dash="solid"),
            ],
        ),
    ]
    drawn = draw_panels(
        f"{write_title(entry)}: command and answer",
        time[span],
        panels,
        caption=f"No {word} is logged: the answer is the torque that the motion shows beyond the command, in the "
        f"moment in which the effect changes most. {alike.describe()}",
    )
    return EffectPicture(drawn, alike)


def _find_liveliest_rows(change: Array, period: float, seconds: float) -> slice:
    """The rows of a short scene in which the effect changes most."""
    rows = max(round(seconds / period), 20)
    summed = np.convolve(np.abs(change)[REPORT.settling_rows :], np.ones(rows), "valid")
    first = REPORT.settling_rows + (int(np.argmax(summed)) if len(summed) else 0)
    return slice(first, first + rows)
