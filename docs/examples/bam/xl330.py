"""The XL330 servo of BAM's pendulum logs: how they are read, its position law, and what torque its motor gives.

Source: Duclusaud, Passault, Padois, Ly, Extended friction models for the physics simulation of servo actuators (ICRA
2025), II; kt, R and the horn's offset as BAM identified them with its Coulomb-viscous model on these logs (M1).
Everything here is at the servo's output; angles are the pendulum's from hanging down, rad.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RATIO = 288.35  # of the gear
TORQUE_CONSTANT = 0.32321138819018436  # kt, N m/A and V s/rad
RESISTANCE = 4.7636501514851926  # R, ohm
OFFSET = 0.01795252374733891  # rad: the encoder's zero against the vertical
SUPPLY = 7.4  # V, nominal
GAIN = (
    4096 / (2 * np.pi) / (256 * 885)
)  # duty a rad of error and unit of the firmware's P gain: counts, its scale, PWM steps


@dataclass(frozen=True, eq=False)
class Recording:
    """One log, a row an entry: ``time`` s, ``position`` and ``goal`` rad, ``supply`` V, ``duty`` -1 to 1, ``on`` where
    the motor is connected, each (T,); ``gain`` duty a rad of error; ``speed`` rad/s of the first row."""

    gain: float
    time: np.ndarray
    position: np.ndarray
    goal: np.ndarray
    supply: np.ndarray
    duty: np.ndarray
    on: np.ndarray
    speed: float


def read(path: Path) -> Recording:
    """A raw log of BAM. Its `load` is the PWM in counts of 1/885, as 16 bits without sign."""
    content = json.loads(path.read_text(encoding="utf-8"))
    rows = content["entries"]
    if content["motor"] != "xl330":
        raise SystemExit(f"{path}: the log of a servo {content['motor']}; this example knows the xl330 alone.")

    def column(name: str) -> np.ndarray:
        return np.array([row[name] for row in rows], dtype=float)

    counts = column("load")
    if not np.array_equal(counts, np.rint(counts)):
        raise SystemExit(f"{path}: load is interpolated, and its sign is lost with that; take the raw log.")
    return Recording(
        gain=GAIN * content["kp"],
        time=column("timestamp"),
        position=column("position"),
        goal=column("goal_position"),
        supply=column("input_volts"),
        duty=np.where(counts > 32767, counts - 65536, counts) / 885,
        on=column("torque_enable") > 0,
        speed=float(rows[0]["speed"]),
    )


def torque(duty: np.ndarray, supply: np.ndarray | float, speed: np.ndarray, on: np.ndarray) -> np.ndarray:
    """N m at the output: of the current that duty times supply drives against the back-EMF; 0 where disconnected."""
    return np.where(on, TORQUE_CONSTANT / RESISTANCE * (duty * supply - TORQUE_CONSTANT * speed), 0.0)
