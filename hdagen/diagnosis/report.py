"""The report: verdict and gap first, then the candidates, measured against model, parameters, and how to reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hdagen.diagnosis.diagnose import Diagnosis
from hdagen.log import Log
from hdagen.pages import page
from hdagen.pages.bars import Bars, bars
from hdagen.pages.curves import Panel, Series, panels
from hdagen.pages.page import Section
from hdagen.pages.table import table
from hdagen.replay import Replay

SHOWN = 8  # candidates in the figures


def sentence(content: dict[str, Any]) -> str:
    """The verdict in one sentence."""
    gap, named = content["gap"], content["verdict"]
    if not named:
        what = "No effect above the size that counts was found"
    elif named[0].startswith("unknown"):
        joint = named[0].partition("@")[2]
        what = f"Joint {joint} misses something that no known effect explains"
    else:
        p = next(h["probability"] for h in content["hypotheses"] if h["effects"] == named)
        effect, _, joint = named[0].partition("@")
        at = f"on joint {joint}" if joint != "0" else "of the whole arm"
        what = f"{effect.replace('_', ' ').capitalize()} {at} is missing (probability {p:.2f}, not calibrated)"
    sure = "" if content["sure"] else "; this is not sure"
    return (
        f"{what}{sure}. On held-out motion the gap goes from {gap['before']:.3g} to {gap['after']:.3g} times the noise."
    )


def write(diagnosis: Diagnosis, path: Path) -> None:
    """report.html."""
    content = diagnosis.content
    page.write(
        path,
        f"Diagnosis of {content['robot']['name']}",
        sentence(content),
        [_gap(content), _candidates(content), _motion(diagnosis), _parameters(content), _data(content)],
        f"    hdagen diagnose {diagnosis.robot} {content['data']['log']}",
    )


def _gap(content: dict[str, Any]) -> Section:
    gap = content["gap"]
    channels = gap["by_channel"]
    whole = bars(
        "Gap on held-out motion",
        ["before", "after", "floor (noise alone)"],
        [Bars("gap", [gap["before"], gap["after"], gap["floor"]])],
        value_label="replay error (multiples of noise)",
        log=True,
    )
    by = bars(
        "Gap by channel",
        list(channels),
        [Bars(when, [c[when] for c in channels.values()]) for when in ("before", "after")],
        value_label="replay error (multiples of noise)",
        log=True,
    )
    text = (
        "Root mean square of the replay error in windows of 0.25 s, in multiples of each channel's noise, joined as "
        f"the geometric mean. Held out: {content['data']['held_out']}."
    )
    return Section("The gap", text, [whole, by])


def _candidates(content: dict[str, Any]) -> Section:
    rows = [[" and ".join(h["effects"]) or "none", h["probability"]] for h in content["hypotheses"]]
    shown = rows[:SHOWN]
    chart = bars(
        "Most probable hypotheses",
        [str(r[0]) for r in shown],
        [Bars("probability", [float(r[1]) for r in shown])],
        value_label="probability, not calibrated (1)",
    )
    text = (
        "Every effect of the model was tried on every joint, with the base parameters refitted within their tolerance "
        "and every other effect within a small size. An effect below 15 % of its usual size counts as none."
    )
    return Section("What is missing", text, [chart, table("All hypotheses", ["hypothesis", "probability"], rows)])


def _motion(diagnosis: Diagnosis) -> Section:
    log, n, first = diagnosis.held_out, diagnosis.held_out.n_joints, diagnosis.first
    shown = []
    for j in range(1, n + 1):
        for quantity in ("motor_position", "joint_position"):
            name = f"{quantity}_{j}"
            if name in log:
                shown.append(Panel(f"{name} error (rad)", _errors(log, name, diagnosis.before, diagnosis.after, first)))
    chart = panels("Measured less model, before and after", log.time[first:], shown)
    return Section("Measured against model", "Windows begin anew at the measured state every 0.25 s.", [chart])


def _errors(log: Log, name: str, before: Replay, after: Replay, first: int) -> list[Series]:
    return [
        Series("before", (log[name] - before.columns[name])[first:]),
        Series("after", (log[name] - after.columns[name])[first:]),
    ]


def _parameters(content: dict[str, Any]) -> Section:
    rows: list[list[str | float | None]] = []
    for cause in content["causes"]:
        if f"{cause['effect']}@{cause['joint']}" in content["verdict"]:
            rows += [[f"{cause['effect']}@{cause['joint']}: {k}", *_cells(v)] for k, v in cause["parameters"].items()]
    rows += [[name, *_cells(value)] for name, value in content["parameters"].items()]
    return Section(
        "Parameters", "As re-estimated with the verdict.", [table("Parameters", ["name", "value", "std", "unit"], rows)]
    )


def _cells(estimate: dict[str, Any]) -> list[str | float | None]:
    return [estimate["value"], estimate["std"], estimate["unit"]]


def _data(content: dict[str, Any]) -> Section:
    data = content["data"]
    said = [*data["warnings"], *data["notes"]]
    lines = [f"{data['duration']:.3g} s at {data['rate']:.5g} Hz.", *said]
    return Section("The data", "\n\n".join(lines))
