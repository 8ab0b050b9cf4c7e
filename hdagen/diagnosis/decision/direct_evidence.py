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
from hdagen.arm.effect_catalogue import EffectCatalogue
from hdagen.diagnosis.data.split import Mask
from hdagen.diagnosis.data.windows import WindowedRecord
from hdagen.diagnosis.decision.direct_evidence_settings import DIRECT_EVIDENCE
from hdagen.diagnosis.decision.posterior import PLACES_BETWEEN_ENCODERS, Decision, Hypothesis
from hdagen.diagnosis.inference.candidate_settings import CANDIDATES
from hdagen.diagnosis.initialization.encoder_regression import EncoderDifference, read_encoder_differences
from hdagen.diagnosis.initialization.initial_guess import fit_input_effects

ANGLE_TERMS = ("constant", "joint_sine", "joint_cosine")  # errors of an encoder that a torque by angle would look like


@dataclass(frozen=True)
class DirectEvidence:
    """An effect that is present.

    ``name`` is effect@joint, ``parameters`` has their values in SI, ``remaining_share`` is the share of the error
    without it that remains with it (1). ``resembles_torque``: an unknown torque could show in the same way.
    """

    name: str
    parameters: Mapping[str, float]
    remaining_share: float
    resembles_torque: bool = False

    @property
    def content(self) -> dict[str, Any]:
        """As diagnosis.json has it."""
        effect, _, joint = self.name.partition("@")
        parameters = {name.removesuffix(f"_{joint}"): value for name, value in self.parameters.items()}
        return {"effect": effect, "joint": int(joint), "parameters": parameters, "left": self.remaining_share}


def find_direct_evidence(arm: Arm, record: WindowedRecord) -> list[DirectEvidence]:
    """Find the effects of inputs and joint encoders that a log shows by themselves.

    Args:
        arm: the model with every effect.
        record: windows of the log.

    Returns:
        The effects that explain most of the error of their channel.

    """
    found = [*_find_input_effects(arm, record)]
    for apart in read_encoder_differences(arm, record):
        found += _find_encoder_effects(arm.effects, add_motor_torque(apart))
    return [one for one in found if one.remaining_share < DIRECT_EVIDENCE.largest_remaining_share]


def add_direct_evidence(decision: Decision, found: Sequence[DirectEvidence]) -> Decision:
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
    added = [one for one in found if not _is_already_explained(one, decision)]
    if not added:
        return decision
    unexplained = tuple(name for name in decision.verdict if name.startswith("unknown@"))
    known = {name for name in decision.verdict if name not in unexplained} | {one.name for one in added}
    names = (*sorted(known), *unexplained)
    leading = next(h for h in decision.hypotheses if h.names == decision.verdict)
    same = next((h for h in decision.hypotheses if h.names == names), Hypothesis(names, 0.0, None))
    others = [h for h in decision.hypotheses if h not in (leading, same)]
    probable, rest = max(leading.probability, same.probability), sum(h.probability for h in others)
    share = 0.0  # of the other hypotheses; the leading one keeps its calibrated probability
    if rest > 0.0:
        share = (1.0 - probable) / rest
    hypotheses = [replace(h, probability=h.probability * share) for h in others]
    if not leading.names:  # the hypothesis of no effect is always among them
        hypotheses.append(replace(leading, probability=0.0))
    hypotheses.append(Hypothesis(names, probable if share else 1.0, same.fit or leading.fit))
    read_off = {one.name: one.parameters for one in added}
    if same.fit:
        read_off = {}
    ordered = tuple(sorted(hypotheses, key=lambda h: -h.probability))
    return replace(
        decision, hypotheses=ordered, verdict=names, best=same.fit or decision.best, direct_evidence=read_off
    )


def _is_already_explained(one: DirectEvidence, decision: Decision) -> bool:
    """Whether the verdict has the effect, or another one that shows at the same place.

    For an effect of the input that is another effect of the same input. For an effect of a joint's encoder it is an
    effect between the encoders. An unknown torque stands for the encoder's bias or eccentricity, too: a torque that
    varies with the angle would look alike.
    """
    places = {atom.name: atom.place for atom in decision.best.sensitivities.candidates.members}
    joint = one.name.partition("@")[2]
    here = [other for other in decision.verdict if other.partition("@")[2] == joint]
    if places.get(one.name) == "input":
        return any(places.get(other) == "input" for other in here)
    torque = one.resembles_torque and f"unknown@{joint}" in here
    return torque or any(places.get(other) in PLACES_BETWEEN_ENCODERS for other in here)


def _find_input_effects(arm: Arm, record: WindowedRecord) -> Iterator[DirectEvidence]:
    """Of each joint the effect of its input that best explains the measured input by its command."""
    best: dict[int, DirectEvidence] = {}
    for effect, name, j, value, share in fit_input_effects(arm, record):
        size = abs(value - arm.parameters.described[name].nominal)
        counts = size > CANDIDATES.present_size * (arm.parameters.described[name].typical or np.inf)
        if counts and (j not in best or share < best[j].remaining_share):
            best[j] = DirectEvidence(f"{effect}@{j}", {name: value}, share)
    yield from best.values()


def add_motor_torque(one: EncoderDifference) -> EncoderDifference:
    """Add the motor's torque to the terms of a joint's torsion.

    Whatever pushes the link goes through the spring, known or not, and so through the torque that the motor sends into
    the gear. An encoder's error does not.

    Args:
        one: the torsion of a joint, with the terms that explain it.

    Returns:
        The same, with that torque among its terms (N m).

    """
    return replace(one, load_terms=np.column_stack([one.load_terms, one.motor_terms]))


def _find_encoder_effects(effects: EffectCatalogue, one: EncoderDifference) -> Iterator[DirectEvidence]:
    """Effects of the joint's encoder, from its reading back along the signal chain, each with the ratio of the
    torsion's residual with and without it."""
    every = np.ones(len(one.parameters), bool)
    whole = one.regress_terms(every, one.loaded_rows)
    left = _cross_validate_residual(one, every)
    for effect in (name for name in reversed(tuple(effects)) if effects[name].place == "sensor"):
        own = np.array([q.effect == effect for q in one.parameters])
        if not own.any():
            continue
        usual = [q.typical or np.inf for q, chosen in zip(one.parameters, own, strict=True) if chosen]
        if np.linalg.norm(whole[: len(own)][own] / usual) < CANDIDATES.present_size:
            continue
        sizes = zip(one.parameters, whole, own, strict=False)
        parameters = {q.name: min(max(float(value), q.low), q.high) for q, value, chosen in sizes if chosen}
        share = left / _cross_validate_residual(one, ~own)
        alike = all(q.encoder_term in ANGLE_TERMS for q, chosen in zip(one.parameters, own, strict=True) if chosen)
        yield DirectEvidence(f"{effect}@{one.joint}", parameters, share, alike)


def _cross_validate_residual(one: EncoderDifference, which: Mask) -> float:
    """Cross-validated residual of the torsion (rms, rad), fitted by the terms of ``which`` parameters and by torque."""
    rows = np.flatnonzero(one.loaded_rows)
    parts = np.array_split(rows, DIRECT_EVIDENCE.folds)
    squares = 0.0
    for part in parts:
        training_rows = one.loaded_rows.copy()
        training_rows[part] = False
        validation_rows = np.zeros(len(training_rows), bool)
        validation_rows[part] = True
        squares += float((one.subtract_terms(one.regress_terms(which, training_rows), validation_rows) ** 2).sum())
    return float(np.sqrt(squares / max(len(rows), 1)))
