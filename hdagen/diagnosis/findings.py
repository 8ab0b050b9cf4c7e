"""What a decision says in diagnosis.json: verdict, causes, hypotheses, parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hdagen import verdict
from hdagen.diagnosis.candidates import PRESENT, SILENT
from hdagen.diagnosis.decide import SURE, Decision
from hdagen.diagnosis.fit_order import first_whole
from hdagen.diagnosis.fitting import Fitted
from hdagen.diagnosis.search import Search
from hdagen.diagnosis.separators import separate_by
from hdagen.diagnosis.told import Told
from hdagen.plant import Parameter

LEANS = {"tilt_x": "gravity_x", "tilt_y": "gravity_y"}  # what stands for a base that leans less than is named
SAID = 2.0  # standard deviations of one of several sizes of an effect, from which on it is there
END = 1e-9  # of an end of a parameter's range, or of its nominal, within which it stands at that end
LIKELY = 0.01  # probability from which another cause is named as confounded


def findings(found: Search, decision: Decision) -> dict[str, Any]:
    """All of diagnosis.json that the fit says; the gap, the robot and the data are added by who has them."""
    best = decision.best
    place = {atom.name: atom.place for fit in found.fitted for atom in fit.design.words.atoms}
    named = dict.fromkeys(n for h in decision.hypotheses for n in h.names if not n.startswith("unknown@"))
    likely = {name: decision.marginal(name) for name in named}
    told = Told(best if best.whole else first_whole(found.fitted), found.fitted[0].temperature)
    unseen = told.unseen() if decision.unseen is None else decision.unseen
    causes = []
    for name in sorted(likely, key=lambda name: -likely[name]):
        fit = next((h.fit for h in decision.hypotheses if name in h.names and h.fit), None)
        others = [o for o in likely if _instead(decision, name, o) > LIKELY]
        if name in decision.verdict and name in told.columns and not decision.lasting:
            others += told.beside(name)
        others = [o for o in dict.fromkeys(others) if o not in decision.verdict]
        causes.append(_cause(name, likely[name], _parameters(name, fit, decision), others))
    return {
        "schema": verdict.SCHEMA,
        "verdict": list(decision.verdict),
        "sure": decision.sure,
        "where": [_where(entry, place.get(entry, "motor")) for entry in decision.verdict],
        "causes": causes,
        "hypotheses": [{"effects": list(h.names), "probability": h.probability} for h in decision.hypotheses],
        "parameters": estimate_base(best),
        "unseen": [name for name in unseen if name not in decision.verdict],
        "method": {
            "calibrated": not decision.lasting,  # sealed checks have too few such cases
            "uncalibrated": decision.stated,
            "present_from": PRESENT,
            "sure_below": SURE,
            "tolerated_share": best.design.words.share,
            "unexplained_torque": best.score.at.s,
            "noise_scale": math.sqrt(best.score.at.level),
        },
    }


def _instead(decision: Decision, name: str, other: str) -> float:
    """The probability of another effect but for hypotheses in which it stands for something else of the verdict; none
    where the effect is surely there, whatever else is."""
    if name == other or name in decision.beside:
        return 0.0
    rest = set(decision.verdict) - {name} if name in decision.verdict else set()
    return sum(
        h.probability for h in decision.hypotheses if other in h.names and (name not in h.names or rest <= set(h.names))
    )


def _where(entry: str, place: str) -> dict[str, Any]:
    """Joint and place of an effect; its share and when it acts are not computed and stay empty."""
    return {"joint": int(entry.partition("@")[2]), "place": place, "share": None, "interval": None, "when": ""}


def _parameters(name: str, fit: Fitted | None, decision: Decision) -> dict[str, Any]:
    """Those of a candidate where it was fitted, or as they were read off, of which no std is known."""
    if fit is None and name not in decision.beside:
        return {}
    if name not in decision.beside:
        assert fit
        return estimates(fit, next(k for k in fit.atoms if fit.design.words.atoms[k].name == name))
    described = decision.best.design.shooting.arm.parameters.described
    read_off = decision.beside[name].items()
    return {key: {"value": value, "std": None, "unit": described[key].unit, "end": None} for key, value in read_off}


def _cause(name: str, probability: float, parameters: dict[str, Any], confounded: list[str]) -> dict[str, Any]:
    """A candidate that was tried."""
    effect, _, joint = name.partition("@")
    suffix = f"_{joint}" if joint != "0" else ""
    return {
        "effect": effect,
        "joint": int(joint),
        "probability": probability,
        "parameters": {k.removesuffix(suffix) if suffix else k: v for k, v in parameters.items()},
        "confounded_with": confounded,
        "separate_by": separate_by(name, confounded),
    }


def estimates(fit: Fitted, atom: int) -> dict[str, Any]:
    """Value, std and unit of the sizes of an atom where a fit stands, and of its shapes, of which no std is known. Of
    what is there in several ways the log may tell one and say nothing of another: that is not there, as what is at the
    edge of this motion may be in the middle of the next."""
    words, described = fit.design.words, fit.design.shooting.arm.parameters.described
    columns, (mean, covariance) = words.columns, fit.posterior
    free, std = words.free((atom,)), np.sqrt(np.diagonal(covariance))
    told = np.diagonal(np.linalg.inv(covariance / std / std[:, None]))  # 1 where nothing else makes up for it
    alone = (std / np.sqrt(np.maximum(told, 1.0)))[free]  # std, all others being held
    spread = {columns[k].parameter: float(std[k]) * columns[k].unit for k in free}
    names = (*spread, *words.atoms[atom].shapes)
    found = {name: _estimate(fit, described[name], list(described).index(name), spread.get(name)) for name in names}
    silent = [columns[k] for k, own in zip(free, alone, strict=True) if abs(mean[k]) < SAID * own]
    for column in silent if len(silent) < len(free) else ():
        found[column.parameter] |= {"value": column.center, "end": None}
    return found


def hypothetical(fit: Fitted, names: Sequence[str]) -> verdict.Verdict:
    """What a verdict of these effects would say, were it to stand where ``fit`` does."""
    there = [name for name in names if name in fit.names]
    atoms = {fit.design.words.atoms[k].name: k for k in fit.atoms}
    causes = [_cause(name, 1.0, estimates(fit, atoms[name]), []) for name in there]
    said = {"schema": verdict.SCHEMA, "verdict": there, "causes": causes, "parameters": estimate_base(fit)}
    return verdict.read(said)


def estimate_base(best: Fitted) -> dict[str, Any]:
    """The base parameters where a fit stands.

    Args:
        best: the fit of a set of effects, or of none.

    Returns:
        `parameters` of diagnosis.json. No base is quite level; what it leans, where no effect of the fit says that, is
        in gravity.

    """
    described, (_, covariance) = best.design.shooting.arm.parameters.described, best.posterior
    places = {name: k for k, name in enumerate(described)}
    free = [(k, c) for k, c in enumerate(best.design.words.columns) if c.atom not in best.atoms]
    spread = {c.parameter: math.sqrt(covariance[k, k]) * c.unit for k, c in free if c.spike > SILENT}
    found = {
        c.parameter: _estimate(best, described[c.parameter], c.index, spread[c.parameter])
        for _, c in free
        if c.base and described[c.parameter].tolerance > 0
    }
    for c in (c for _, c in free if c.parameter in LEANS and c.parameter in spread):
        gravity = described[LEANS[c.parameter]]
        one = found.get(gravity.name) or _estimate(best, gravity, places[gravity.name], 0.0)
        leaned = float(best.design.point.p[c.index]) - described[c.parameter].nominal
        one |= {"value": one["value"] + leaned, "std": math.hypot(one["std"], spread[c.parameter])}
        prior = gravity.tolerance * abs(gravity.nominal)
        found[gravity.name] = one | {"prior": math.hypot(prior, c.spike * c.unit)}
    return found


def _estimate(fit: Fitted, parameter: Parameter, place: int, std: float | None) -> dict[str, Any]:
    """``end``: which end of its range it was moved to, if one; beyond it the fit cannot go."""
    value, ends = float(fit.design.point.p[place]), {"low": parameter.low, "high": parameter.high}
    least = {name: END * max(abs(end), abs(parameter.nominal)) for name, end in ends.items()}
    end = next((name for name in ends if abs(value - ends[name]) <= least[name]), None)
    end = None if value == parameter.nominal else end
    return {"value": value, "std": std, "unit": parameter.unit, "end": end}
