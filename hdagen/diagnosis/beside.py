"""What is surely missing, whatever else is.

A torque that no effect explains bends all that is fitted to torques. Two things it leaves alone: what the drive makes
of its commands, where that is measured, and what lies between the two encoders of a joint beside the torsion, which is
told by the torque that the motion asks for and by the one that the motor sends into the gear. So an effect of the input
or of an encoder that explains most of that is there, whatever else is; it is read off there, before any model is
simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdagen.diagnosis.candidates import PRESENT
from hdagen.diagnosis.decide import GEAR, Decision, Hypothesis
from hdagen.diagnosis.portion import Mask
from hdagen.diagnosis.record import Record
from hdagen.diagnosis.starts import driven
from hdagen.diagnosis.torsion import Between, between
from hdagen.plant import Arm

HALF = 0.5  # of what there is without it, that an effect must leave at most: it explains three quarters of the variance
FOLDS = 4  # parts of a log, each of which is told by what the others tell
ENCODER = {
    "sensor_delay": ("sensor_delay",),
    "encoder_bias": ("encoder_bias",),
    "encoder_eccentricity": ("eccentricity_sine", "eccentricity_cosine"),
}


@dataclass(frozen=True)
class Sure:
    """An effect that is there: name@joint, its parameters with their values, and the ``share`` of the error that it
    leaves of what there is without it."""

    name: str
    parameters: Mapping[str, float]
    share: float

    @property
    def content(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        effect, _, joint = self.name.partition("@")
        parameters = {name.removesuffix(f"_{joint}"): value for name, value in self.parameters.items()}
        return {"effect": effect, "joint": int(joint), "parameters": parameters, "left": self.share}


def sure(arm: Arm, record: Record) -> list[Sure]:
    """The effects of inputs and joint encoders that the log shows by themselves."""
    encoders = (one for apart in between(arm, record) for one in _between(borne(apart)))
    return [one for one in (*_inputs(arm, record), *encoders) if one.share < HALF]


def beside(decision: Decision, found: Sequence[Sure]) -> Decision:
    """The decision with what is there whatever else is: where a set with that was fitted, that is said, else the
    parameters are those that were read off. What the verdict has at the same place of the same joint stands for it."""
    added = [one for one in found if not _stands_for(one.name, decision)]
    if not added:
        return decision
    strange = tuple(name for name in decision.verdict if name.startswith("unknown@"))
    known = {name for name in decision.verdict if name not in strange} | {one.name for one in added}
    names = (*sorted(known), *strange)
    said = next(h for h in decision.hypotheses if h.names == decision.verdict)
    same = next((h for h in decision.hypotheses if h.names == names), Hypothesis(names, 0.0, None))
    others = [h for h in decision.hypotheses if h not in (said, same)]
    probable, rest = max(said.probability, same.probability), sum(h.probability for h in others)
    share = (1.0 - probable) / rest if rest > 0.0 else 0.0  # of what else it may be: that is as it was calibrated
    hypotheses = [replace(h, probability=h.probability * share) for h in others]
    hypotheses += [] if said.names else [replace(said, probability=0.0)]  # none is always among them
    hypotheses.append(Hypothesis(names, probable if share else 1.0, same.fit or said.fit))
    return replace(
        decision,
        hypotheses=tuple(sorted(hypotheses, key=lambda h: -h.probability)),
        verdict=names,
        best=same.fit or decision.best,
        beside={} if same.fit else {one.name: one.parameters for one in added},
    )


def _stands_for(name: str, decision: Decision) -> bool:
    """Whether the verdict has it, or what shows at the same place: another effect of the joint's input; of a joint's
    encoder what acts between the encoders, and of its bias or eccentricity a torque that is not known: one that goes
    with the angle would look alike."""
    places = {atom.name: atom.place for atom in decision.best.design.words.atoms}
    effect, _, joint = name.partition("@")
    here = [other for other in decision.verdict if other.partition("@")[2] == joint]
    if places.get(name) == "input":
        return any(places.get(other) == "input" for other in here)
    torque = effect != "sensor_delay" and f"unknown@{joint}" in here
    return torque or any(places.get(other) in GEAR for other in here)


def _inputs(arm: Arm, record: Record) -> Iterator[Sure]:
    """Of each joint the effect of its input that leaves least of what is measured beside the command."""
    best: dict[int, Sure] = {}
    for effect, name, j, value, share in driven(arm, record):
        size = abs(value - arm.parameters.described[name].nominal)
        counts = size > PRESENT * (arm.parameters.described[name].typical or np.inf)
        if counts and (j not in best or share < best[j].share):
            best[j] = Sure(f"{effect}@{j}", {name: value}, share)
    yield from best.values()


def borne(one: Between) -> Between:
    """The same with what the motor sends into the gear among what twists it: what pushes the link, known or not, goes
    through the spring and is felt there, and an encoder's error is not."""
    return replace(one, borne=np.column_stack([one.borne, one.driven]))


def _between(one: Between) -> Iterator[Sure]:
    """Effects of the joint's encoder, by what of the twist is left with and without each."""
    every = np.ones(len(one.parameters), bool)
    names, whole = [q.name for q in one.parameters], one.told(every, one.loaded)
    left = _left(one, every)
    for effect, amplitudes in ENCODER.items():
        own = np.array([name in {f"{a}_{one.j}" for a in amplitudes} for name in names])
        if not own.any():
            continue
        usual = [q.typical or np.inf for q, chosen in zip(one.parameters, own, strict=True) if chosen]
        if np.linalg.norm(whole[: len(own)][own] / usual) < PRESENT:
            continue
        sizes = zip(one.parameters, whole, own, strict=False)
        parameters = {q.name: min(max(float(value), q.low), q.high) for q, value, chosen in sizes if chosen}
        yield Sure(f"{effect}@{one.j}", parameters, left / _left(one, ~own))


def _left(one: Between, which: Mask) -> float:
    """What the terms of ``which`` parameters and torque leave of the twist (rms) in each part of the log, as the other
    parts tell them."""
    rows = np.flatnonzero(one.loaded)
    parts = np.array_split(rows, FOLDS)
    squares = 0.0
    for part in parts:
        seen = one.loaded.copy()
        seen[part] = False
        here = np.zeros(len(seen), bool)
        here[part] = True
        squares += float((one.left(one.told(which, seen), here) ** 2).sum())
    return float(np.sqrt(squares / max(len(rows), 1)))
