"""Direct evidence: effects that a log shows without any fit of the whole model.

A torque that no effect explains spoils every estimate that is fitted to torques. It leaves two comparisons alone: the
measured input against its command, and the motor's encoder against the joint's. The torsion between the two encoders
follows from the torque that the motion requires and from the torque that the motor sends into the gear. So an effect of
the input or of an encoder that explains most of such a comparison is present, whatever else is. Its parameters are
fitted to the comparison alone, before any model is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hdagen.arm.compiled_arm import Arm
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.data.windows import Record
from hdagen.diagnosis.decision.posterior import GEAR, Decision, Hypothesis
from hdagen.diagnosis.inference.candidate_priors import PRESENT
from hdagen.diagnosis.initialization.encoder_regression import Between, between
from hdagen.diagnosis.initialization.initial_guess import driven

HALF = 0.5  # of the error without it, that an effect must leave at most: it explains three quarters of the variance
FOLDS = 4  # parts of a log, each of which is predicted from the others
ENCODER = {
    "sensor_delay": ("sensor_delay",),
    "encoder_bias": ("encoder_bias",),
    "encoder_eccentricity": ("eccentricity_sine", "eccentricity_cosine"),
}


@dataclass(frozen=True)
class Sure:
    """An effect that is present: ``name`` (effect@joint), its parameters with their values in SI, and the ``share`` of
    the error without it that remains with it (1)."""

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
    """Find the effects of inputs and joint encoders that a log shows by themselves.

    Args:
        arm: the model with every effect.
        record: windows of the log.

    Returns:
        The effects that explain most of the error of their channel.

    """
    found = [*_inputs(arm, record)]
    for apart in between(arm, record):
        found += _between(borne(apart))
    return [one for one in found if one.share < HALF]


def beside(decision: Decision, found: Sequence[Sure]) -> Decision:
    """Add the effects with direct evidence to a verdict.

    Where a hypothesis with these effects was fitted, the verdict takes that fit; otherwise it takes their parameters
    from the direct evidence. An effect of the verdict at the same place of the same joint already stands for one of
    them.

    Args:
        decision: of the fits.
        found: effects with direct evidence.

    Returns:
        The decision with these effects, or the same one where it has them all.

    """
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
    share = 0.0  # of the other hypotheses; the leading one keeps its calibrated probability
    if rest > 0.0:
        share = (1.0 - probable) / rest
    hypotheses = [replace(h, probability=h.probability * share) for h in others]
    if not said.names:  # the hypothesis of no effect is always among them
        hypotheses.append(replace(said, probability=0.0))
    hypotheses.append(Hypothesis(names, probable if share else 1.0, same.fit or said.fit))
    read_off = {one.name: one.parameters for one in added}
    if same.fit:
        read_off = {}
    ordered = tuple(sorted(hypotheses, key=lambda h: -h.probability))
    return replace(decision, hypotheses=ordered, verdict=names, best=same.fit or decision.best, beside=read_off)


def _stands_for(name: str, decision: Decision) -> bool:
    """Whether the verdict has the effect, or another one that shows at the same place.

    For an effect of the input that is another effect of the same input. For an effect of a joint's encoder it is an
    effect between the encoders. An unknown torque stands for the encoder's bias or eccentricity, too: a torque that
    varies with the angle would look alike.
    """
    places = {atom.name: atom.place for atom in decision.best.design.words.atoms}
    effect, _, joint = name.partition("@")
    here = [other for other in decision.verdict if other.partition("@")[2] == joint]
    if places.get(name) == "input":
        return any(places.get(other) == "input" for other in here)
    torque = effect != "sensor_delay" and f"unknown@{joint}" in here
    return torque or any(places.get(other) in GEAR for other in here)


def _inputs(arm: Arm, record: Record) -> Iterator[Sure]:
    """Of each joint the effect of its input that best explains the measured input by its command."""
    best: dict[int, Sure] = {}
    for effect, name, j, value, share in driven(arm, record):
        size = abs(value - arm.parameters.described[name].nominal)
        counts = size > PRESENT * (arm.parameters.described[name].typical or np.inf)
        if counts and (j not in best or share < best[j].share):
            best[j] = Sure(f"{effect}@{j}", {name: value}, share)
    yield from best.values()


def borne(one: Between) -> Between:
    """Add the motor's torque to the terms of a joint's torsion.

    Whatever pushes the link goes through the spring, known or not, and so through the torque that the motor sends into
    the gear. An encoder's error does not.

    Args:
        one: the torsion of a joint, with the terms that explain it.

    Returns:
        The same, with that torque among its terms (N m).

    """
    return replace(one, borne=np.column_stack([one.borne, one.driven]))


def _between(one: Between) -> Iterator[Sure]:
    """Effects of the joint's encoder, each with the ratio of the torsion's residual with and without it."""
    every = np.ones(len(one.parameters), bool)
    names, whole = [q.name for q in one.parameters], one.told(every, one.loaded)
    left = _left(one, every)
    for effect, amplitudes in ENCODER.items():
        wanted = {f"{a}_{one.j}" for a in amplitudes}
        own = np.array([name in wanted for name in names])
        if not own.any():
            continue
        usual = [q.typical or np.inf for q, chosen in zip(one.parameters, own, strict=True) if chosen]
        if np.linalg.norm(whole[: len(own)][own] / usual) < PRESENT:
            continue
        sizes = zip(one.parameters, whole, own, strict=False)
        parameters = {q.name: min(max(float(value), q.low), q.high) for q, value, chosen in sizes if chosen}
        yield Sure(f"{effect}@{one.j}", parameters, left / _left(one, ~own))


def _left(one: Between, which: Mask) -> float:
    """Cross-validated residual of the torsion (rms, rad), fitted by the terms of ``which`` parameters and by torque."""
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
