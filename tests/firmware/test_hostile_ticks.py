"""Ticks of every controller under hostile inputs, calls and floating-point environments: a legal torque, always.

Each tick runs in an environment drawn at random (rounding, traps, flags that stand, subnormal numbers flushed) and
again in the default one: the torque, the status and every bit of the context are the same, and the environment is
given back.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from compilers import COMPILERS, STRICT, compiled, compiler, said
from guard_library import TEMPLATES, sizes
from mpc_arms import built

from hdagen.mpc.predictive_controller import MPC

HERE = Path(__file__).parents[1] / "support"
ASIDE = {  # what the predictive controller does not call
    f"hda_{part}.c" for part in ("batch", "control", "filters", "input", "late", "laws", "loops", "rodas", "windows")
}
QUICK = ("gcc", "gcc 32 bit", "clang sanitized")  # both compilers, both widths; of two sanitizers that compile sooner
LAWS = ("control", "guard", "guard_calls", "guard_config", "laws", "limit", "model", "prepare")


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the programs; both are of one build, whose objects they share."""
    return tmp_path_factory.mktemp("programs")


@pytest.mark.parametrize(
    "name, ticks",
    [
        *((name, 20_000) for name in QUICK),
        *(pytest.param(name, 200_000, marks=pytest.mark.campaign) for name in COMPILERS),
    ],
)
def test_every_law_holds_its_contract(programs: Path, name: str, ticks: int) -> None:
    """Null pointers, refused configurations and the memory of refused ticks besides; no allocation."""
    arm = built()[0]
    nominal = np.array([quantity["nominal"] for quantity in arm.manifest["parameters"]])
    gains = [np.array([g["nominal"] for g in law["gains"]]) for law in arm.manifest["controllers"]]
    (programs / "numbers").write_bytes(np.concatenate([nominal, *gains]).tobytes())
    sources = [arm.folder / f"hda_{part}.c" for part in LAWS]
    run = compiled(name, HERE / "control_harness.c", sources, [arm.folder], programs)
    assert int(said([run, programs / "numbers", str(ticks)])) == ticks * len(gains) == ticks * 5


@pytest.mark.parametrize(
    "name, ticks, problems",
    [
        *((name, 1000, 500) for name in QUICK),
        *(
            pytest.param(name, ticks, ticks // 10, marks=pytest.mark.campaign)
            for name in COMPILERS
            for ticks in [100_000 if "sanitized" in name else 1_000_000]
        ),
    ],
)
def test_predictive_control_holds_its_contract(programs: Path, name: str, ticks: int, problems: int) -> None:
    """Adversarial problems for its solvers besides; no allocation."""
    arm, configuration = built()
    (programs / "mpc_settings.h").write_text(MPC(arm, configuration).format_header())
    files = sorted(path for path in arm.folder.glob("hda_*.c") if not path.name.startswith("hda_python"))
    parts = [path for path in files if path.name not in ASIDE]
    run = compiled(name, HERE / "mpc_harness.c", parts, [arm.folder, programs], programs)
    assert f"{ticks} ticks without an allocation" in said([run, str(ticks), str(problems)])


def test_arithmetic_with_excess_precision_is_refused(tmp_path: Path) -> None:
    """x87 compares numbers that no double holds: a limit would hold for them and not for the torque that is sent."""
    command = [*compiler("gcc 32 bit"), "-mfpmath=387", *STRICT, f"-I{sizes(tmp_path, 2)}", f"-I{TEMPLATES}"]
    made = subprocess.run(
        [*command, "-fsyntax-only", str(TEMPLATES / "hda_limit.c")], capture_output=True, text=True, check=False
    )
    assert made.returncode != 0
    assert "compile with -msse2 -mfpmath=sse" in made.stderr


@pytest.mark.parametrize("name, flags", [("gcc", ("-DHDA_FLOAT_AS_IT_IS",)), ("gcc 32 bit", ("-ffreestanding",))])
def test_the_guard_compiles_where_no_environment_is_held(tmp_path: Path, name: str, flags: tuple[str, ...]) -> None:
    command = [*compiler(name), *STRICT, *flags, f"-I{sizes(tmp_path, 2)}", f"-I{TEMPLATES}", "-S", "-o", "-"]
    assert "hda_guard_begin_held" in (made := said([*command, TEMPLATES / "hda_guard_calls.c"]))
    assert not any(word in made for word in ("fegetenv", "ldmxcsr"))
