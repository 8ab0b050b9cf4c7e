"""The predictive controller's C: compiled alone, bit for bit what Python gets; what it asks of the outside."""

from __future__ import annotations

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from mpc_arms import built

from hdagen.arm.compiled_arm import Arm
from hdagen.mpc.predictive_controller import MPC

HERE = Path(__file__).parents[1] / "support"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic")


@pytest.fixture(scope="module")
def arm() -> Arm:
    return built()[0]


@pytest.fixture(scope="module")
def objects(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the controller's C compiled as firmware would, and its settings as a header; no warning in ours."""
    folder = tmp_path_factory.mktemp("objects")
    (folder / "mpc_settings.h").write_text(MPC(arm, built()[1]).format_header())
    sources = sorted(f for f in arm.folder.glob("hda_*.c") if not f.name.startswith("hda_python"))

    def compiled(source: Path) -> str:
        command = [gcc(), *FLAGS, "-c", str(source), "-o", str(folder / f"{source.stem}.o")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return "" if source.name.startswith("hda_osqp_") else done.stderr

    with ThreadPoolExecutor(2) as pool:
        assert "".join(pool.map(compiled, sources)) == ""
    return folder


def gcc() -> str:
    """The compiler; skips where there is none."""
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed here")
    return compiler


def program(folder: Path, arm: Arm, main: Path, objects: Path, *more: str, but: str = "") -> Path:
    """The objects with a main; ``but``: the file that ``more`` brings compiled otherwise."""
    out = folder / main.stem
    parts = sorted(str(f) for f in objects.glob("*.o") if f.stem != but)
    command = [gcc(), *FLAGS, *more, f"-I{arm.folder}", f"-I{objects}", str(main), *parts, "-lm", "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out


def test_the_example_compiled_alone_gives_what_python_gets_bit_for_bit(arm: Arm, objects: Path, tmp_path: Path) -> None:
    run = program(tmp_path, arm, arm.folder / "example_mpc.c", objects)
    lines = subprocess.run([str(run)], capture_output=True, text=True, check=True).stdout.split("\n")[:-1]
    theirs = np.array([[float(v) for v in line.split()] for line in lines])
    assert theirs.shape == (300, 1 + arm.n)
    c = built()[1]
    controller = MPC(arm, c)
    x, u = np.zeros(arm.nx), np.zeros(arm.nu)
    for j in range(1, arm.n + 1):
        x[arm.index(f"joint_position_{j}")] = 0.5
        x[arm.index(f"motor_position_{j}")] = 0.5 * arm.parameters[f"ratio_{j}"]
    tip = arm.evaluate("points", q=np.full(arm.n, 0.5))["points"][-2:]
    controller.path[:] = np.r_[tip, 0.0, 0.0]
    constants = np.array([arm.parameters[f"torque_constant_{j}"] for j in range(1, arm.n + 1)])
    q, theta = (
        slice(arm.index(f"{what}_position_1"), arm.index(f"{what}_position_1") + arm.n) for what in ("joint", "motor")
    )
    for k in range(300):
        force = (10.0 if 50 <= k < 150 else 0.0, 0.0)
        status = controller.tick(k * 1e-3, motor_position=x[theta], joint_position=x[q], tip_force=force)
        assert [status, *controller.torque] == theirs[k].tolist(), k
        controller.prepare()
        u[: arm.n], u[arm.n] = controller.torque / constants, force[0]
        for _ in range(2):
            x = arm.step(x, u, exact=True)
    assert np.abs(theirs[60:150, 1:]).max() > 1e-3


ELEMENTARY = {"sin", "cos", "sincos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sqrt", "pow", "tanh"}
ELEMENTARY |= {"fmin", "fmax", "fmod", "ceil", "floor"}


def test_firmware_takes_copies_and_elementary_functions_and_no_memory(objects: Path) -> None:
    """What the objects ask of the outside; none of it allocates, prints or locks."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm of binutils is not installed here")
    done = subprocess.run([nm, *map(str, objects.glob("*.o"))], capture_output=True, text=True, check=True)
    needed, defined = set[str](), set[str]()
    for words in map(str.split, done.stdout.splitlines()):
        if len(words) in (2, 3) and len(words[-2]) == 1:
            (needed if words[-2] == "U" else defined).add(words[-1])
    asked = needed - defined - {"_GLOBAL_OFFSET_TABLE_"}
    assert {"memcpy", "sin", "cos", "exp"} <= asked
    assert asked <= {"memcpy", "memmove", "memset", "memcmp"} | ELEMENTARY


@pytest.mark.parametrize("width", [1, 2, 4, 8])
def test_vectors_of_every_width_give_the_same_torques(arm: Arm, objects: Path, tmp_path: Path, width: int) -> None:
    """Nodes are linearised side by side, as many as a vector holds; how many does not move the torques."""
    line = arm.folder / "hda_mpc_line.c"
    wide = tmp_path / "line.o"
    command = [gcc(), *FLAGS, "-Werror", "-Wno-psabi", f"-DHDA_BATCH_WIDTH={width}", "-c", str(line), "-o", str(wide)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = []
    for more, but in ((), ""), ((str(wide),), line.stem):
        run = program(tmp_path, arm, HERE / "mpc_widths.c", objects, *more, but=but)
        text = subprocess.run([str(run)], capture_output=True, text=True, check=True).stdout
        found.append(np.array([[float(v) for v in row.split()] for row in text.splitlines()]))
    one, other = found
    assert one.shape == other.shape == (200, 1 + arm.n + arm.manifest["mpc"]["nodes"])
    assert 0.1 < np.median(np.abs(one[:, 1 : 1 + arm.n])) < 0.7  # N m: not at their limits
    assert np.array_equal(one[:, 0], other[:, 0])
    assert np.abs(one - other).max() < 1e-9 * np.abs(one).max()
