"""The same input gives the same numbers to the bit, whatever runs beside, on however many processors."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import arms
import numpy as np
import pytest
from compiled import Compiled
from replayed import FLEXIBLE, SENSORS, simulated
from test_shooting import EFFECTS, shooting

from hdagen.arm.compiled_arm import Arm, load
from hdagen.diagnosis.inference import multiple_shooting as shootings
from hdagen.diagnosis.search.null_model import fit_null_model, fit_without_effects
from hdagen.support import parallel

Builder = Callable[..., Compiled]
TEXT = arms.arm("R", drive=f"torque_constant = 0.05\nmax_current = 10.0\n{SENSORS}")
FLEET = """[[machine]]
name = "{0}"
robot = "robot.toml"
log = "{0}.csv"
"""


def test_a_fit_is_the_same_to_the_bit_with_one_thread_and_two(build: Builder, monkeypatch: pytest.MonkeyPatch) -> None:
    record = shooting(build, "native").record
    found = []
    for threads in (1, 2, 2):
        monkeypatch.setattr(parallel, "THREAD_COUNT", threads)
        monkeypatch.setattr(shootings, "THREAD_COUNT", threads)
        null = fit_null_model(Arm(build(FLEXIBLE, "native", EFFECTS).folder), record)
        fit = fit_without_effects(null.shooting, null.candidates)
        found.append(
            (
                null.fit.score.evidence,
                fit.score.evidence,
                fit.evidence_here,
                fit.sensitivities.point.p.tobytes(),
                fit.sensitivities.columns.tobytes(),
            )
        )
        assert null.candidates.spike_scale == null.fit.sensitivities.candidates.spike_scale
    assert found[0] == found[1] == found[2]


@pytest.mark.campaign
def test_a_diagnosis_is_the_same_to_the_bit_on_one_processor_and_two_alone_and_in_a_fleet(tmp_path: Path) -> None:
    if len(processors := sorted(os.sched_getaffinity(0))) < 2:
        pytest.skip("one processor")
    (tmp_path / "robot.toml").write_text(TEXT)
    for name, factor in {"first": 5.0, "second": 1.0}.items():
        arm = load(tmp_path / "robot.toml", out=tmp_path / "build")
        arm.parameters["viscous_friction_1"] *= factor
        log = simulated(arm, 4.0, seed=len(name))
        rows = np.column_stack([log.time, *log.columns.values()])
        header = ",".join(["time", *log.columns])
        np.savetxt(tmp_path / f"{name}.csv", rows, fmt="%.12g", delimiter=",", header=header, comments="")
    (tmp_path / "fleet.toml").write_text(FLEET.format("first") + FLEET.format("second"))

    def ran(out: str, cores: int, *arguments: str) -> None:
        command = [sys.executable, "-m", "hdagen", "diagnose", *arguments, "--out", out]
        subprocess.run(
            command,
            cwd=tmp_path,
            env={**os.environ, "HDAGEN_BUILD": str(tmp_path / "build")},
            preexec_fn=lambda: os.sched_setaffinity(0, processors[:cores]),
            capture_output=True,
            check=True,
        )

    alike = [str(tmp_path / name) for name in ("robot.toml", "first.csv")]  # as a fleet names them
    ran("twice", 2, *alike)
    ran("alone", 2, *alike)
    ran("narrow", 1, *alike)
    ran("jobs1", 1, "--fleet", "fleet.toml", "--jobs", "1")
    ran("jobs2", 2, "--fleet", "fleet.toml", "--jobs", "2")
    alone = (tmp_path / "alone" / "diagnosis.json").read_bytes()
    for folder in ("twice", "narrow", "jobs1/first", "jobs2/first"):
        assert (tmp_path / folder / "diagnosis.json").read_bytes() == alone, folder
    second = [(tmp_path / f"jobs{jobs}" / "second" / "diagnosis.json").read_bytes() for jobs in (1, 2)]
    assert second[0] == second[1]
