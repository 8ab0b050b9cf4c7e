"""The C of a build as firmware takes it: strict C99, its symbols, its example, C++; and the module's manners."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import weakref
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from arms import ALL_EFFECTS, CHAINS, MIXED
from compiled import Compiled
from graphs import toml
from stub_compiler import stub_compiler

from gen.builder import build as builds
from gen.builder.compiler import PROFILES as COMPILED
from gen.builder.compiler import compiler_flags, find_compiler

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
PROFILES, COMPILERS = ("portable", "native"), ("gcc", "clang")
ROBOTS = CHAINS | {"RP": MIXED}
DIAGONAL = [("portable", "gcc"), ("native", "clang")]  # each profile and each compiler once
Sources = Callable[[str, str], Path]


def compiler(name: str) -> str:
    """The newest program of that name; skips where there is none."""
    found = shutil.which(name) or next((p for n in range(30, 9, -1) if (p := shutil.which(f"{name}-{n}"))), None)
    if found is None:
        pytest.skip(f"{name} is not installed here")
    return found


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Sources:
    """sources(chain, profile) -> the folder of a build of that chain with every effect, nothing in it compiled."""
    out, made = tmp_path_factory.mktemp("sources"), dict[tuple[str, str], Path]()
    stub = str(stub_compiler(out))

    def folder(chain: str, profile: str) -> Path:
        if (chain, profile) not in made:
            with pytest.MonkeyPatch.context() as m:
                m.setenv("CC", stub)
                find_compiler.cache_clear()
                made[chain, profile] = builds.build_robot(toml(out, ROBOTS[chain]), profile, out, ALL_EFFECTS)[0]
            find_compiler.cache_clear()
        return made[chain, profile]

    return folder


@pytest.fixture(scope="module")
def objects(sources: Sources, tmp_path_factory: pytest.TempPathFactory) -> Sources:
    """objects(profile, compiler) -> the folder of "RP"'s objects, made for firmware; a warning is an error."""
    made = dict[tuple[str, str], Path]()

    def folder(profile: str, cc: str) -> Path:
        if (profile, cc) not in made:
            made[profile, cc] = tmp_path_factory.mktemp("objects")
            _optimised(sources("RP", profile), profile, cc, made[profile, cc])
        return made[profile, cc]

    return folder


def run(command: list[str], folder: Path) -> str:
    """What a command says; fails with its words where it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stderr}"
    return done.stdout + done.stderr


def c_files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.c"))


# -- strict C99 -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("profile, cc", DIAGONAL)
@pytest.mark.parametrize("chain", CHAINS)
def test_every_file_is_strict_c99(sources: Sources, chain: str, profile: str, cc: str) -> None:
    """The other pairs of a profile and a compiler see "RP", whose objects are made with the same warnings."""
    folder = sources(chain, profile)
    command = [
        compiler(cc),
        "-std=c99",
        *STRICT,
        *(f for f in compiler_flags(profile) if f.startswith("-m")),
        "-fsyntax-only",
    ]
    assert {"hda_model.c", "hda_step.c", "hda_python.c", "example.c"} <= set(c_files(folder))
    assert run([*command, *c_files(folder)], folder) == ""


@pytest.mark.parametrize("profile, cc", [*itertools.product(PROFILES, COMPILERS)])
def test_optimising_finds_nothing_to_warn_of(objects: Sources, profile: str, cc: str) -> None:
    """Uninitialised values and vectors that cross calls are found while optimising only."""
    assert len(list(objects(profile, cc).glob("*.o"))) > 15


@pytest.mark.campaign
@pytest.mark.parametrize("chain, profile, cc", [*itertools.product(CHAINS, PROFILES, COMPILERS)])
def test_optimising_any_chain_finds_nothing(
    sources: Sources, chain: str, profile: str, cc: str, tmp_path: Path
) -> None:
    _optimised(sources(chain, profile), profile, cc, tmp_path)


def _optimised(folder: Path, profile: str, cc: str, out: Path) -> None:
    for name in c_files(folder):
        command = [
            compiler(cc),
            *compiler_flags(profile),
            "-fno-pic",
            "-Werror",
            "-c",
            name,
            "-o",
            str(out / f"{name}.o"),
        ]
        assert run(command, folder) == "", name


def test_vectors_of_every_width_compile(sources: Sources, tmp_path: Path) -> None:
    folder = sources("RP", "native")
    strict = [compiler("gcc"), "-std=c99", "-O2", *STRICT, "-c", "-o", str(tmp_path / "object.o")]
    widths = {"": 2, "-mavx2": 4, "-mavx512f": 8} if os.uname().machine == "x86_64" else {"": 2}
    for flag, width in widths.items():
        machine = [flag] if flag else []
        assert run([*strict, *machine, "hda_native.c"], folder) == ""
        defined = run([*strict[:-2], "-dM", "-E", *machine, "hda_batch_rhs.h"], folder)
        assert re.search(r"#define HDA_BATCH_WIDTH (\d)", defined).group(1) == str(width)  # type: ignore[union-attr]


def test_no_number_changes_its_type_unseen(sources: Sources) -> None:
    folder = sources("RP", "portable")
    command = [compiler("gcc"), "-std=c99", "-Wconversion", "-Werror"]
    assert run([*command, "-fsyntax-only", *c_files(folder)], folder) == ""


def firmware(folder: Path) -> list[str]:
    """The objects in a folder of objects that know nothing of Python."""
    names = sorted(path.name for path in folder.glob("*.o"))
    return [name for name in names if not name.startswith(("hda_python", "example"))]


# -- symbols ----------------------------------------------------------------------------------------------------------

LIBC = {"memcpy", "memmove", "memset", "memcmp"}
TRIGONOMETRY = {"sin", "cos", "sincos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"}
LIBM = {"exp", "expm1", "log", "log1p", "sqrt", "pow", "fabs", "floor", "ceil", "fmin", "fmax", "fmod", "hypot"}
LIBM |= {"copysign", *TRIGONOMETRY}
LINKER = {"_GLOBAL_OFFSET_TABLE_"}


@pytest.mark.parametrize("profile", PROFILES)
def test_firmware_allocates_and_keeps_nothing(objects: Sources, profile: str) -> None:
    """Of the standard library it takes copies of memory and elementary functions; it defines no variable."""
    folder = objects(profile, "gcc")
    needed, defined, variables = set(), set(), []
    for name in firmware(folder):
        for line in run([compiler("nm"), name], folder).splitlines():
            kind, symbol = line.split()[-2:]
            if kind == "U":
                needed.add(symbol)
            elif kind.isupper():
                defined.add(symbol)
            if kind in "bBdDcCgGsS":
                variables.append((name, symbol))
    assert variables == []
    assert {symbol for symbol in defined if not symbol.startswith("hda_")} == set()
    assert needed - defined - LIBC - LIBM - LINKER == set()
    assert {"hda_prepare", "hda_step", "hda_step_exact", "hda_rollout_batch", "hda_controller_tick"} <= defined


@pytest.mark.parametrize("profile", PROFILES)
def test_the_library_exports_hda_names_only_and_is_small(build: Callable[..., Compiled], profile: str) -> None:
    made = build("paper", profile)
    library = made.folder / made.manifest["library"]
    assert library.stat().st_size <= 500_000
    listed = run([compiler("nm"), "-D", "--defined-only", str(library)], made.folder)
    exported = {line.split()[-1] for line in listed.splitlines()}
    assert {symbol for symbol in exported if not symbol.startswith("hda_")} == {"PyInit_hda"}
    assert {f"hda_{f['name']}" for f in made.manifest["functions"]} <= exported
    headers = "".join(path.read_text() for path in made.folder.glob("*.h"))
    declared = set(re.findall(r"HDA_API [\w ]*?\*?(hda_\w+)\(", headers))
    assert declared == exported - {"PyInit_hda"}


# -- without Python ---------------------------------------------------------------------------------------------------


def expected_tips(made: Compiled) -> np.ndarray:
    """What example.c prints, by the module: t, x, y a row."""
    x, c, h = made.x(), made.prepare(), np.array([made.manifest["robot"]["step"]])
    n = len(made.manifest["robot"]["joints"])
    u = np.zeros(len(made.manifest["input"]))
    u[:n] = [slot["bound"] * (-0.2 if j % 2 else 0.2) for j, slot in enumerate(made.manifest["input"][:n])]
    first = made.states.index("joint_position_1")
    rows = []
    for k in range(1001):
        if k % 200 == 0:
            rows.append([k * h[0], *made("points", x[first : first + n], c)[0][-2:]])
        (x,) = made("step_exact", x, u, c, h)
    return np.array(rows)


def printed_tips(text: str) -> np.ndarray:
    return np.array([[float(v) for v in re.findall(r"[-+]?\d+\.\d+", line)] for line in text.splitlines()])


@pytest.mark.parametrize("robot, profile, cc", [("paper", "portable", "gcc"), ("emps", "native", "clang")])
def test_cmake_builds_the_example_and_it_steps_as_python_does(
    build: Callable[..., Compiled], robot: str, profile: str, cc: str, tmp_path: Path
) -> None:
    made, cmake = build(robot, profile), compiler("cmake")
    folder = tmp_path / "firmware"
    shutil.copytree(made.folder, folder)
    for library in folder.glob("*.so"):
        library.unlink()  # nothing of Python's is needed
    strict = [f"-DCMAKE_C_COMPILER={compiler(cc)}", "-DCMAKE_C_FLAGS=-Werror"]
    run([cmake, "-S", str(folder), "-B", str(tmp_path / "out"), *strict], tmp_path)
    run([cmake, "--build", str(tmp_path / "out"), "--parallel", "2"], tmp_path)
    tips = printed_tips(run([str(tmp_path / "out" / "example")], tmp_path))
    assert tips.shape == (6, 3)
    assert np.abs(tips - expected_tips(made)).max() < 2e-6, "it prints six digits"
    assert np.ptp(tips[:, 1:], axis=0).max() > 1e-3, "the tip has to move to show anything"
    assert json.loads((made.folder / "manifest.json").read_text()) == made.manifest


def test_the_example_harms_no_memory(sources: Sources, tmp_path: Path) -> None:
    folder = sources("R", "portable")
    files = [name for name in c_files(folder) if not name.startswith("hda_python")]
    command = [compiler("gcc"), "-std=c99", "-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    run([*command, *files, "-o", str(tmp_path / "example"), "-lm"], folder)
    tips = printed_tips(run([str(tmp_path / "example")], tmp_path))
    assert np.isfinite(tips).all()
    assert tips.shape == (6, 3)


@pytest.mark.parametrize("cxx", ["g++", "clang++"])
def test_cpp_includes_the_headers_and_links(sources: Sources, objects: Sources, cxx: str, tmp_path: Path) -> None:
    folder = sources("RP", "portable")
    headers = ["hda.h", "hda_guard.h", "hda_limit.h", "hda_rollout.h", "hda_sizes.h", "hda_control.h"]
    text = "".join(f'#include "{header}"\n' for header in headers * 2)
    text += (
        "int main() { static const double p[HDA_NP] = HDA_NOMINAL; double c[HDA_NC]; hda_prepare(p, c);\n"
        "  return c[0] == p[0] ? hda_batch_width() - 1 : 2; }\n"
    )
    (tmp_path / "main.cpp").write_text(text)
    compiled = objects("portable", "gcc")
    parts = [str(compiled / name) for name in firmware(compiled)]
    command = [
        compiler(cxx),
        "-std=c++11",
        *STRICT,
        "-I",
        str(folder),
        "main.cpp",
        *parts,
        "-no-pie",
        "-o",
        "main",
        "-lm",
    ]
    run(command, tmp_path)
    run([str(tmp_path / "main")], tmp_path)


def test_the_manual_shows_c_that_compiles_and_the_flags_that_are_used(sources: Sources, tmp_path: Path) -> None:
    manual = (Path(__file__).parents[2] / "docs" / "guides" / "firmware.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```c\n(.*?)```", manual, re.DOTALL)
    (tmp_path / "shown.c").write_text(f'#include "hda.h"\nint main(void) {{\n{shown}return 0;\n}}\n')
    command = [compiler("gcc"), "-std=c99", *STRICT, "-I", str(sources("R", "portable")), "-fsyntax-only", "shown.c"]
    assert run(command, tmp_path) == ""
    for profile, used in COMPILED.items():
        assert f"| `{profile}` | `{' '.join(used)}` |" in manual


# -- the module's manners ---------------------------------------------------------------------------------------------


def test_misuse_of_the_module_raises(build: Callable[..., Compiled]) -> None:
    made = build("emps")
    module, q, c, M = made.module, np.zeros(1), made.prepare(), np.zeros(1)
    module.bind("mass_matrix", q, c, M).run()
    assert M[0] > 0
    frozen, matrix = np.zeros(1), np.zeros((4, 1))
    frozen.flags.writeable = False
    wrong: list[tuple[type[Exception], str, Callable[..., object], tuple[object, ...]]] = [
        (TypeError, "mass_matrix takes 3 arrays, not 2", module.bind, ("mass_matrix", q, c)),
        (ValueError, "no function named 'mass'", module.bind, ("mass", q, c, M)),
        (
            ValueError,
            f"c must have {c.size} entries, not {c.size - 1}",
            module.bind,
            ("mass_matrix", q, c[1:].copy(), M),
        ),
        (TypeError, "q must hold float64", module.bind, ("mass_matrix", q.astype("f4"), c, M)),
        (TypeError, "q must hold float64", module.bind, ("mass_matrix", q.astype("i8"), c, M)),
        (TypeError, "M must be a writable contiguous array", module.bind, ("mass_matrix", q, c, frozen)),
        (TypeError, "c must be a contiguous array", module.bind, ("mass_matrix", q, np.zeros(72)[::2], M)),
        (TypeError, "q must be a contiguous array", module.bind, ("mass_matrix", 0.0, c, M)),
        (TypeError, "bind takes", module.bind, ()),
        (TypeError, "map takes", module.map, ("mass_matrix",)),
        (ValueError, "M must have 1 entries, not 4", module.map, ("mass_matrix", 3, q, c, matrix)),
        (ValueError, "M must have 1 entries, not 4", module.map, ("mass_matrix", 2**61, q, c, matrix)),
        (ValueError, "rollout: kind is 0 to 3", module.rollout, (4, q, q, c, q, 1.0, 1, q)),
        (ValueError, "count is larger", module.rollout, (2, q, q, c, q, 1.0, 2**62, q)),
        (TypeError, "rollout takes", module.rollout, ()),
    ]
    for error, words, call, arguments in wrong:
        with pytest.raises(error, match=re.escape(words)):
            call(*arguments)
    with pytest.raises(TypeError, match="cannot create"):
        type(module.bind("mass_matrix", q, c, M))()


def test_bound_arrays_live_as_long_as_the_binding(build: Callable[..., Compiled]) -> None:
    made = build("emps")
    arrays = [np.zeros(1), made.prepare(), np.zeros(1)]
    kept = [weakref.ref(array) for array in arrays]
    bound = made.module.bind("mass_matrix", *arrays)
    arrays.clear()
    bound.run()
    assert kept[2]() == pytest.approx(95.1089)  # kg, carriage and rotor
    del bound
    assert [reference() for reference in kept] == [None] * 3
    with pytest.raises(TypeError):
        made.module.bind("mass_matrix", (array := np.zeros(1)), made.prepare(), None)
    assert sys.getrefcount(array) == 2, "a refused binding keeps nothing"


def test_a_hash_and_a_batch_width_come_with_the_module(build: Callable[..., Compiled]) -> None:
    for profile, widths in (("portable", {1}), ("native", {2, 4, 8})):
        made = build("emps", profile)
        assert made.module.build == made.manifest["build"] == made.folder.name.rpartition("-")[2]
        assert made.module.batch_width in widths
