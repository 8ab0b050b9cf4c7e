"""The figure of an effect as SVG: its term at its typical size, over the signal that it depends on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from gen.effects.effect import Effect, Port, Signals
from gen.model.arm_model import Model
from gen.robot.load_robot import load

SAMPLES = 601
MOST_TICKS = 7
RATIO = 100.0
SLOW = 30.0  # rad/s
STICKING = 0.5  # rad/s, width of the drawn sign of the speed
RANGES = {  # signal: (lowest, highest, label), in the order in which the abscissa is chosen
    "torsion": (-2e-3, 2e-3, "torsion φ, rad"),
    "current": (-12.0, 12.0, "current i, A"),
    "spring_torque": (-30.0, 30.0, "torque of the springs, N m"),
    "joint_torque": (-30.0, 30.0, "joint torque τ, N m"),
    "motor_velocity": (-300.0, 300.0, "motor speed θ̇, rad/s"),
    "direction": (-300.0, 300.0, "motor speed θ̇, rad/s"),
    "motor_position": (0.0, 4 * np.pi, "motor angle θ, rad"),
    "joint_position": (-np.pi, np.pi, "joint angle q, rad"),
    "joint_velocity": (-3.0, 3.0, "joint speed q̇, rad/s"),
    "torsion_rate": (-0.05, 0.05, "torsion rate φ̇, rad/s"),
}
UNITS = {
    Port.INPUT: "A", Port.WARMTH: "share", Port.FRICTION: "N m", Port.MOTOR: "N m", Port.REACTION: "share",
    Port.TORSION: "rad", Port.PLAY: "rad", Port.SERIES: "share", Port.TRANSMISSION: "N m", Port.BASE: "m/s²",
    Port.MASS: "kg", Port.LINK: "N m", Port.SENSOR: "rad", Port.TORQUE_SENSOR: "N m",
}  # fmt: skip


@dataclass(frozen=True)
class Motion:
    """A motion that moves the memory of an effect.

    Attributes:
        signal: The signal that moves.
        amplitude: Amplitude of its integral; 0 for a steady rate.
        rate: Largest rate.
        seconds: Duration.
        label: Label of the abscissa, the integral of the signal; None for time.

    """

    signal: str
    amplitude: float
    rate: float
    seconds: float
    label: str | None = None

    def place_at(self, t: np.ndarray) -> np.ndarray:
        """The integral of the signal at the instants ``t`` (n)."""
        return self.amplitude * np.sin(self.rate / self.amplitude * t)

    def rate_at(self, t: np.ndarray) -> np.ndarray:
        """The signal at the instants ``t`` (n)."""
        if not self.amplitude:
            return np.full(len(t), self.rate)
        return self.rate * np.cos(self.rate / self.amplitude * t)


MOTIONS = (
    Motion("torsion_rate", 1e-3, 6e-3, 2.1, "torsion φ, rad"),
    Motion("motor_velocity", 0.2, 1.2, 2.1, "motor angle θ, rad"),
    Motion("joint_velocity", 0.0, 1.0, 0.4),
    Motion("joint_torque", 0.0, 10.0, 0.4),
)
WARMING = Motion("motor_velocity", 0.0, 100.0, 200.0)


@dataclass(frozen=True)
class Curve:
    """What is drawn.

    Attributes:
        x: Abscissa (n).
        y: Ordinate (n).
        x_label: Label of the abscissa.
        y_label: Label of the ordinate.
        reference: A second ordinate (n), dashed, or None.

    """

    x: np.ndarray
    y: np.ndarray
    x_label: str
    y_label: str
    reference: np.ndarray | None = None


def draw_effect(effect: Effect) -> str:
    """The figure of an effect.

    Args:
        effect: The effect.

    Returns:
        An SVG document.

    """
    return draw_curve(effect_curve(effect))


def effect_curve(effect: Effect) -> Curve:
    """The term of an effect at its typical size, over the signal that it depends on.

    Effects with a memory follow a motion; a delay and a lag answer a step of the command; a term that depends on no
    signal is drawn over its amplitude.

    Args:
        effect: The effect.

    Returns:
        The curve.

    """
    values = typical_values(effect)
    if effect.port in (Port.DELAY, Port.LAG):
        return _step_answer(effect, values)
    if effect.port is Port.SERIES:
        return _spring_line(values)
    term, signals, states, rates = _effect_term(effect, values)
    read = [name for name in RANGES if ca.depends_on(ca.vertcat(term, *rates), signals[name])]
    if effect.states:
        return _memory_curve(effect, term, signals, states, rates)
    if not read and effect.port is Port.FRICTION:
        return _dry_friction(values["coulomb_friction"])
    if not read:
        return _amplitude_line(effect, values)
    name = read[0]
    low, high, label = RANGES[name]
    if effect.port is Port.FRICTION and label == RANGES["motor_velocity"][2]:
        low, high = -SLOW, SLOW  # dry friction changes at low speeds
    if name == "motor_position" and ca.depends_on(term, signals["ratio"]):
        high = 4 * np.pi * RATIO
    x = np.linspace(low, high, SAMPLES)
    shown = np.tanh(x / STICKING) if name == "direction" else x
    given = {name: shown, "ratio": np.full(SAMPLES, RATIO)}
    y = _evaluate_term(term, signals, states, given)
    return Curve(x, y, label, f"{effect.port.value}, {UNITS[effect.port]}")


@cache
def _quantities_of(effect: Effect) -> dict[str, Any]:
    """The model's quantities of the whole arm and of the joint that the effect acts at, by name without its number."""
    robot = load("paper_table1" if effect.port is Port.SERIES else "paper")
    model = Model(robot, (effect,))
    joint = model.n if effect.joints == "last" else 1
    return {q.name.removesuffix(f"_{q.joint}"): q for q in model.quantities if q.joint in (0, joint)}


def typical_values(effect: Effect) -> dict[str, float]:
    """The parameters that an effect may read, its amplitudes at their typical size.

    Args:
        effect: The effect.

    Returns:
        Values by name.

    """
    found = {}
    for name, quantity in _quantities_of(effect).items():
        away = quantity.typical if name in effect.amplitudes and quantity.typical else 0.0
        found[name] = quantity.nominal + away
    return found


def _effect_term(
    effect: Effect, values: Mapping[str, float]
) -> tuple[Any, dict[str, Any], dict[str, Any], tuple[Any, ...]]:
    """The term as a graph, with the symbols of signals and states, and the rates of the states."""
    names = [field.name for field in fields(Signals) if field.name != "states"]
    signals = {name: ca.SX.sym(name) for name in names}
    states = {state.name: ca.SX.sym(state.name) for state in effect.states}
    found = effect.equation(Signals(**signals, states=states), values)
    rates: tuple[Any, ...] = ()
    if effect.states:
        found, rates = found
    if isinstance(found, tuple):  # a vector in the plane: its length
        found = ca.norm_2(ca.vertcat(*found))
    return ca.SX(found), signals, states, tuple(map(ca.SX, rates))


def _evaluate_term(
    term: Any, signals: Mapping[str, Any], states: Mapping[str, Any], given: Mapping[str, np.ndarray]
) -> np.ndarray:
    """The term (n) where some signals are given (n) and all others are 0."""
    symbols = {**signals, **states}
    function = ca.Function("term", list(symbols.values()), [term])
    size = len(next(iter(given.values())))
    columns = [given.get(name, np.zeros(size)) for name in symbols]
    return np.asarray(function.map(size)(*(column[None, :] for column in columns))).ravel()


def _memory_curve(
    effect: Effect, term: Any, signals: Mapping[str, Any], states: Mapping[str, Any], rates: tuple[Any, ...]
) -> Curve:
    """The term of an effect with a memory along a motion that moves it."""
    moving = (motion for motion in MOTIONS if any(ca.depends_on(rate, signals[motion.signal]) for rate in rates))
    motion = WARMING if effect.port is Port.WARMTH else next(moving)
    t = np.linspace(0.0, motion.seconds, 20 * SAMPLES)
    symbols = {**signals, **states}
    function = ca.Function("memory", list(symbols.values()), [term, *rates])
    x, h, y = np.zeros(len(states)), t[1] - t[0], np.zeros(len(t))
    for k, rate in enumerate(motion.rate_at(t)):
        given = {motion.signal: rate, "ratio": RATIO, "friction_level": 0.1, "direction": np.tanh(rate / STICKING)}
        given |= dict(zip(states, x, strict=True))
        value, *change = function(*(given.get(name, 0.0) for name in symbols))
        y[k] = float(value)
        x = x + h * np.array([float(one) for one in change])
    unit = f"{effect.port.value}, {UNITS[effect.port]}"
    if motion.label is None:
        return Curve(t[::20], y[::20], "time, s", unit)
    return Curve(motion.place_at(t)[::20], y[::20], motion.label, unit)


def _step_answer(effect: Effect, values: Mapping[str, float]) -> Curve:
    """A step of the command, and the current that arrives."""
    (late,) = (values[name] for name in effect.amplitudes)
    t = np.linspace(-late, 5 * late, SAMPLES)
    command = (t >= 0).astype(float)
    arrived = (t >= late).astype(float)
    if effect.port is Port.LAG:
        arrived = np.where(t < 0, 0.0, 1 - np.exp(-np.maximum(t, 0) / late))
    return Curve(1e3 * t, arrived, "time, ms", "current / command (dashed)", command)


def _dry_friction(level: float) -> Curve:
    """The torque of dry friction with a constant level."""
    speed = np.linspace(-SLOW, SLOW, SAMPLES)
    return Curve(speed, -level * np.tanh(speed / STICKING), RANGES["motor_velocity"][2], "friction torque, N m")


def _spring_line(values: Mapping[str, float]) -> Curve:
    """The torque of a linear spring that a rigid drive lacks."""
    torsion = np.linspace(-2e-3, 2e-3, 3)
    return Curve(torsion, torsion / 1e-4, "torsion φ, rad", "joint torque of the spring, N m")


def _amplitude_line(effect: Effect, values: Mapping[str, float]) -> Curve:
    """The term over the first amplitude, from 0 to twice its typical size."""
    name = effect.amplitudes[0]
    size = values[name] or 1.0
    values = {**values, **dict.fromkeys(effect.amplitudes, 0.0)}
    x = np.linspace(0.0, 2 * size, 3)
    y = [float(ca.DM(_constant_term(effect, {**values, name: value}))) for value in x]
    return Curve(x, np.array(y), name, f"{effect.port.value}, {UNITS[effect.port]}")


def _constant_term(effect: Effect, values: Mapping[str, float]) -> Any:
    term = _effect_term(effect, values)[0]
    return ca.evalf(term)


# -- SVG --------------------------------------------------------------------------------------------------------------

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 520, 220, 88, 20, 12, 44
STYLE = (
    "text{font:12px sans-serif;fill:#444}.axis{stroke:#999;fill:none}.grid{stroke:#e4e4e4;fill:none}"
    ".term{stroke:#1f5fa8;stroke-width:2;fill:none}.reference{stroke:#888;stroke-dasharray:5 4;fill:none}"
)


def draw_curve(curve: Curve) -> str:
    """A curve in a pair of axes.

    Args:
        curve: The curve.

    Returns:
        An SVG document.

    """
    every = [curve.y] if curve.reference is None else [curve.y, curve.reference]
    low, high = min(map(np.min, every)), max(map(np.max, every))
    margin = 0.06 * (high - low) or max(abs(high), 1.0)
    xs, ys = (float(curve.x.min()), float(curve.x.max())), (float(low - margin), float(high + margin))
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{STYLE}</style>']
    parts.append(f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>')
    for value in axis_ticks(*xs):
        x = _pixel_across(value, xs)
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
        parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">{_format_tick(value)}</text>')
    for value in axis_ticks(*ys):
        y = _pixel_down(value, ys)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{_format_tick(value)}</text>')
    parts.append(f'<path class="axis" d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}"/>')
    if curve.reference is not None:
        parts.append(f'<path class="reference" d="{_svg_path(curve.x, curve.reference, xs, ys)}"/>')
    parts.append(f'<path class="term" d="{_svg_path(curve.x, curve.y, xs, ys)}"/>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">{curve.x_label}</text>')
    up = (TOP + HEIGHT - BOTTOM) / 2
    parts.append(f'<text transform="translate(14 {up}) rotate(-90)" text-anchor="middle">{curve.y_label}</text></svg>')
    return "\n".join(parts) + "\n"


def axis_ticks(low: float, high: float) -> list[float]:
    """Round values within a range, no more than `MOST_TICKS`.

    Args:
        low: Lower end.
        high: Upper end, above ``low``.

    Returns:
        The values, ascending.

    """
    decade = 10.0 ** np.floor(np.log10(high - low) - 1)
    for step in (factor * decade for factor in (1, 2, 5, 10, 20, 50)):
        first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
        if last - first < MOST_TICKS:
            break
    return [float(step * k) for k in range(first, last + 1)]


def _format_tick(value: float) -> str:
    if abs(value) < 1e-12:
        return "0"
    text = f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return text.replace("-", "−")


def _pixel_across(value: Any, xs: tuple[float, float]) -> Any:
    return LEFT + (WIDTH - LEFT - RIGHT) * (value - xs[0]) / (xs[1] - xs[0])


def _pixel_down(value: Any, ys: tuple[float, float]) -> Any:
    return TOP + (HEIGHT - TOP - BOTTOM) * (ys[1] - value) / (ys[1] - ys[0])


def _svg_path(x: np.ndarray, y: np.ndarray, xs: tuple[float, float], ys: tuple[float, float]) -> str:
    """The line through the points, rounded to tenths of a pixel; points on a straight line are left out."""
    points = np.column_stack((_pixel_across(x, xs), _pixel_down(y, ys)))
    turns = np.zeros(len(points), bool)
    kept = 0
    for k in range(1, len(points) - 1):
        ahead, here = points[k + 1] - points[kept], points[k] - points[kept]
        away = abs(ahead[0] * here[1] - ahead[1] * here[0]) / max(float(np.hypot(*ahead)), 1e-9)
        if away > 0.02:
            turns[k], kept = True, k
    turns[[0, -1]] = True
    return "M" + "L".join(f"{a:.1f} {b:.1f}" for a, b in points[turns])
