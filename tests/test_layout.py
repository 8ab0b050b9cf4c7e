"""The structure holds: who imports whom, imports that do nothing, sizes of files and functions, what lies where."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest
from compiled import Compiled

ROOT = Path(__file__).parents[1]
PACKAGES = ("gen", "hdagen")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
SYMBOLS = {"casadi", "sympy"}
UNSAFE = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml", "ruamel"}
STARTERS = {"subprocess", "multiprocessing", "pty", "pexpect", "sh", "invoke"}
LOGS = {"pyarrow", "pandas", "polars", "h5py", "csv"}  # what reads a table of measurements


@cache
def read_tree(path: Path) -> ast.Module:
    """A file's syntax, read once for all tests."""
    return ast.parse(path.read_text(encoding="utf-8"))


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def imported(path: Path) -> Iterator[str]:
    """The modules that a file imports anywhere in it, relative ones by their full name."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(read_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def tops(path: Path) -> set[str]:
    return {module.split(".")[0] for module in imported(path)}


# -- who imports whom -------------------------------------------------------------------------------------------------


def test_there_is_something_to_look_at() -> None:
    found = {name(path) for path in MODULES}
    assert {
        "gen/builder/build.py",
        "gen/effects/payload.py",
        "hdagen/log/measured_log.py",
        "hdagen/arm/compiled_arm.py",
    } <= found
    assert "casadi" in tops(ROOT / "gen" / "model" / "arm_model.py")
    assert "gen.effects.effect" in set(imported(ROOT / "gen" / "effects" / "payload.py"))


@pytest.mark.parametrize("package, forbidden", [("hdagen", {"gen", *SYMBOLS}), ("gen", {"hdagen", *LOGS})])
def test_the_halves_meet_in_files_only(package: str, forbidden: set[str]) -> None:
    crossing = {name(path): tops(path) & forbidden for path in MODULES if name(path).startswith(f"{package}/")}
    assert {path: found for path, found in crossing.items() if found} == {}


def test_one_file_of_gen_starts_programs() -> None:
    assert [name(p) for p in MODULES if name(p).startswith("gen/") and tops(p) & STARTERS] == [
        "gen/builder/compiler.py"
    ]


def test_nothing_unsafe_reads_or_runs() -> None:
    """No pickle, no YAML, no eval; and no program is started through a shell."""
    found = []
    for path in MODULES:
        found += [(name(path), module) for module in tops(path) & UNSAFE]
        for node in ast.walk(read_tree(path)):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            shell = any(k.arg == "shell" and ast.unparse(k.value) != "False" for k in node.keywords)
            starts = re.fullmatch(r"os\.(system|popen|exec\w+|spawn\w+|posix_spawnp?)|pty\.spawn", called)
            if called in ("eval", "exec", "compile", "__import__") or starts or shell:
                found.append((name(path), called))
    assert found == []


# -- floors -----------------------------------------------------------------------------------------------------------

FLOORS = (  # from the roof to the ground: a file imports from folders that stand further down, or from its own
    "gen",
    "gen/builder",
    "gen/mpc",
    "gen/c_code",
    "gen/model",
    "gen/robot",
    "gen/effects",
    "gen/presets",
    "hdagen",
    "hdagen/cli",
    "hdagen/api",
    "hdagen/bench",
    "hdagen/blind",
    "hdagen/blind/realities",
    "hdagen/demo",
    "hdagen/fleet",
    "hdagen/comparison",
    "hdagen/model_export",
    "hdagen/paper",
    "hdagen/paper/figures",
    "hdagen/paper/prototype",
    "hdagen/mpc/benchmark",
    "hdagen/mpc",
    "hdagen/campaign",
    "hdagen/excitation",
    "hdagen/diagnosis",
    "hdagen/diagnosis/report",
    "hdagen/diagnosis/holdout",
    "hdagen/diagnosis/decision",
    "hdagen/diagnosis/search",
    "hdagen/diagnosis/initialization",
    "hdagen/diagnosis/inference",
    "hdagen/diagnosis/residuals",
    "hdagen/diagnosis/data",
    "hdagen/diagnosis/stages",
    "hdagen/prediction",
    "hdagen/data_quality",
    "hdagen/adoption",
    "hdagen/simulation",
    "hdagen/control",
    "hdagen/arm",
    "hdagen/model_import",
    "hdagen/log",
    "hdagen/pages",
    "hdagen/support",
    "hdagen/data",
)
TWICE = {"ownership", "build"}  # one file, byte for byte, in both halves; a command whose name says what the other does


def module(dotted: str) -> Path | None:
    """The file of a module of the project, by its dotted name."""
    base = ROOT.joinpath(*dotted.split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)


def imported_files(path: Path) -> Iterator[Path]:
    """The project's files that a file imports, inside functions and for annotations (TYPE_CHECKING) as well."""
    for node in ast.walk(read_tree(path)):
        if isinstance(node, ast.Import):
            found = [module(alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{name(path)}:{node.lineno}: a relative import; name the module whole"
            found = [module(f"{node.module}.{a.name}") or module(str(node.module)) for a in node.names]
        else:
            continue
        yield from (target for target in found if target and target != path)


@cache
def find_arrows() -> dict[Path, set[Path]]:
    """What each file imports; found by the first test that asks, not by every process that collects tests."""
    return {path: set(imported_files(path)) for path in MODULES}


def circle(arrows: Mapping[Path, set[Path]]) -> list[Path]:
    """What cannot be put in an order in which every arrow leads back: the circles, and what stands on them."""
    left = {path: set(targets) for path, targets in arrows.items()}
    while free := {path for path, targets in left.items() if not targets & left.keys()}:
        left = {path: targets for path, targets in left.items() if path not in free}
    while loose := left.keys() - set().union(*left.values()):  # nothing of the rest imports it
        left = {path: targets for path, targets in left.items() if path not in loose}
    return sorted(left)


def test_no_circle_between_files() -> None:
    assert [name(path) for path in circle(find_arrows())] == []


def test_folders_form_floors() -> None:
    """Every folder has its floor, and no arrow leads up."""
    assert {name(path.parent) for path in MODULES} == set(FLOORS)
    floor = {folder: -height for height, folder in enumerate(FLOORS)}
    up = [
        f"{name(path)} imports {name(target)}"
        for path, targets in find_arrows().items()
        for target in targets
        if path.parent != target.parent and floor[name(target.parent)] > floor[name(path.parent)]
    ]
    assert sorted(up) == []


def test_no_file_name_has_two_meanings() -> None:
    places: dict[str, list[str]] = {}
    for path in MODULES:
        if path.stem not in ("__init__", "__main__"):
            places.setdefault(path.stem, []).append(name(path))
    assert {stem: found for stem, found in places.items() if len(found) > 1 and stem not in TWICE} == {}


def test_the_top_of_hdagen_is_its_face() -> None:
    assert [path.name for path in sorted((ROOT / "hdagen").glob("*.py"))] == ["__init__.py", "__main__.py"]


def test_names_of_test_files_stand_once() -> None:
    """Tests have no __init__.py, so that pytest knows a file by its base name alone."""
    names = [path.name for path in (ROOT / "tests").rglob("*.py")]
    assert sorted(found for found in set(names) if names.count(found) > 1) == []
    assert not list((ROOT / "tests").rglob("__init__.py"))


# -- imports do nothing -----------------------------------------------------------------------------------------------

DEFINES = (ast.Import, ast.ImportFrom, ast.Assign, ast.AnnAssign, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


def test_modules_hold_definitions_only() -> None:
    doing = []
    for path in MODULES:
        for node in read_tree(path).body:
            text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            merged = isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.BitOr)
            guarded = isinstance(node, ast.If) and re.fullmatch(
                r"TYPE_CHECKING|__name__ == '__main__'|sys\.(platform|version_info) .*", ast.unparse(node.test)
            )
            if not (text or merged or guarded or isinstance(node, DEFINES)):
                doing.append(f"{name(path)}:{node.lineno}: {ast.unparse(node)[:60]}")
    assert doing == []


WATCH = """
import contextlib, importlib, io, json, multiprocessing, os, pathlib, signal, sys, threading, warnings
warnings.simplefilter("error")

def state():
    return {
        "files": sorted(map(str, pathlib.Path().rglob("*"))), "threads": threading.active_count(),
        "children": len(multiprocessing.active_children()), "environment": dict(os.environ), "folder": os.getcwd(),
        "signals": [str(signal.getsignal(s)) for s in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)],
    }

foreign = ["numpy", "casadi", "sympy", "scipy", "scipy.signal", "pyarrow", "pyarrow.parquet", "rich", "tomlkit", "osqp"]
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    for module in foreign:  # what these do when they are imported is theirs
        with contextlib.suppress(ImportError):
            importlib.import_module(module)
did, before = {}, state()
for module in json.loads(sys.argv[1]):
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        importlib.import_module(module)
    after = state()
    changed = [what for what in after if after[what] != before[what]] + (["output"] if said.getvalue() else [])
    if changed:
        did[module] = changed
    before = after
print(json.dumps(did))
"""


def test_importing_any_module_does_nothing(tmp_path: Path) -> None:
    modules = [name(p).removesuffix(".py").removesuffix("/__init__").replace("/", ".") for p in MODULES]
    command = [sys.executable, "-B", "-c", WATCH, json.dumps(modules)]
    environment = {"PYTHONPATH": str(ROOT), "PATH": "", "HOME": str(tmp_path)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert json.loads(done.stdout) == {}


# -- names and docstrings ---------------------------------------------------------------------------------------------

# Verbs that stand alone: the public API's, the entry points of commands, and those of the field.
ONE_WORD = {
    *("adopt", "check", "compare", "diagnose", "excite", "export", "replay", "simulate", "triage"),
    *("load", "read", "write", "run", "main", "step", "tick", "circle"),
}
MOST_ONE_WORD_SHARE = 0.15  # of all functions at the top of a file

Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_names() -> set[tuple[Path, str]]:
    """File and name of all that another folder imports or an `__all__` lists; of both, where it is defined."""
    found: set[tuple[Path, str]] = set()
    for path in MODULES:
        for node in ast.walk(read_tree(path)):
            if isinstance(node, ast.ImportFrom) and (home := module(str(node.module))):
                if home.parent != path.parent or path.name == "__init__.py":
                    found |= {(home, alias.name) for alias in node.names}
            elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
                found |= {(path, entry) for entry in ast.literal_eval(node.value)}
    return found


def public_functions() -> Iterator[tuple[str, Function]]:
    """Where it stands, and the function: the public ones at the top of files, and the methods of public classes."""
    public = public_names()
    for path in MODULES:
        for node in read_tree(path).body:
            if not isinstance(node, Function | ast.ClassDef) or (path, node.name) not in public:
                continue
            members = node.body if isinstance(node, ast.ClassDef) else [node]
            for one in members:
                if isinstance(one, Function) and (one is node or not one.name.startswith("_")):
                    yield f"{name(path)}:{one.lineno} {one.name}", one


def missing_sections(function: Function) -> list[str]:
    """What the docstring of a public function lacks of Google's convention: a first sentence, Args, Returns."""
    said = ast.get_docstring(function) or ""
    missing = []
    if not re.match(r"[A-Z`].*?[.:](?=\s|$)", said, re.DOTALL):
        missing.append("a sentence")
    arguments = [a.arg for a in (*function.args.args, *function.args.kwonlyargs) if a.arg not in ("self", "cls")]
    if not arguments:
        return missing
    described = re.search(r"^Args:\n((?: +.*\n?|\n)+)", said, re.MULTILINE)
    if not described:
        return [*missing, "Args"]
    named = re.findall(r"^ {4}\*{0,2}(\w+)(?: \(.*?\))?:", described[1], re.MULTILINE)
    missing += [f"Args: {argument}" for argument in arguments if argument not in named]
    gives = function.returns is not None and ast.unparse(function.returns) not in ("None", "NoReturn")
    tells = re.match(r"(Return|Tell|Name|Count|List|Find)\b", said)  # the sentence itself says what comes back
    if gives and not tells and not re.search(r"^(Returns|Yields):", said, re.MULTILINE):
        missing.append("Returns")
    return missing


def test_public_docstrings_say_arguments_and_results() -> None:
    said = {place: missing_sections(function) for place, function in public_functions()}
    assert len(said) > 300
    assert {place: missing for place, missing in said.items() if missing} == {}


def test_functions_are_verb_phrases() -> None:
    """No public function of one word outside a short list, and few private ones."""
    names = [(name(p), n.name) for p in MODULES for n in read_tree(p).body if isinstance(n, Function)]
    one = [(path, each) for path, each in names if "_" not in each.strip("_")]
    assert [entry for entry in one if not entry[1].startswith("_") and entry[1] not in ONE_WORD] == []
    assert len(one) <= MOST_ONE_WORD_SHARE * len(names)


# -- sizes ------------------------------------------------------------------------------------------------------------


def test_no_file_is_long() -> None:
    kinds = {".py", ".c", ".h", ".js", ".css", ".txt", ".toml"}
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.suffix in kinds)
    lines = {name(path): path.read_text(encoding="utf-8").count("\n") for path in files}
    assert {path: count for path, count in lines.items() if count > 400} == {}


def test_no_function_is_long() -> None:
    long = []
    for path in MODULES:
        for node in ast.walk(read_tree(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > 60:
                    long.append(f"{name(path)}:{node.lineno} {node.name}: {lines} lines")
    assert long == []


MOST_METHODS = 24  # with those of the bases
OF_MANY_METHODS = {
    "Arm": "a compiled robot as a user calls it: each method is one function of the library, or checks its arguments",
    "MPC": "stands in the place of any other controller, so it has their methods beside its own",
}


def test_no_class_has_many_methods() -> None:
    classes: dict[str, list[ast.ClassDef]] = {}
    for path in MODULES:
        for node in ast.walk(read_tree(path)):
            if isinstance(node, ast.ClassDef):
                classes.setdefault(node.name, []).append(node)

    def methods(node: ast.ClassDef) -> set[str]:
        found = {one.name for one in node.body if isinstance(one, ast.FunctionDef | ast.AsyncFunctionDef)}
        for base in (ast.unparse(base).rpartition(".")[2] for base in node.bases):
            for other in classes.get(base, []):
                found |= methods(other)
        return found

    counts = {name: max(len(methods(node)) for node in nodes) for name, nodes in classes.items()}
    assert {name for name, count in counts.items() if count > MOST_METHODS} == set(OF_MANY_METHODS)


def test_no_module_is_a_drawer() -> None:
    drawers = {"utils", "util", "common", "helpers", "helper", "misc", "tools"}
    assert [name(p) for p in [*MODULES, *(ROOT / "tests").rglob("*.py")] if p.stem in drawers] == []


# -- numbers ----------------------------------------------------------------------------------------------------------

NO_SETTINGS = {  # module-level numbers of the diagnosis and of predictions that nobody tunes
    "GOLDEN_RATIO_STEP": "mathematics",
    "WAVES_OF_ORDER": "mathematics: a sine and a cosine",
    "MOTOR_WAVE_ORDERS": "the orders of an effect's parameters",
    "SMALLEST_POSITIVE": "rounding",
    "ROUNDING_FLOOR": "rounding",
    "_WINDOW_ROUNDING": "rounding",
    "_LEAST_POSITION_NOISE": "rounding",
    "INSTANTS_PER_CALL": "time: it changes no number",
    "CALIBRATION_SCHEMA": "number of a format",
    "GAP_DIGITS": "number of a format",
    "LARGEST_FILE_BYTES": "limit of a file",
    "LARGEST_SEARCHES_BYTES": "limit of a file",
    "_MOST_CONTROLLER_BYTES": "limit of a file",
    "_MOST_FILTER_SAMPLES": "limit of a file's value",
    "WORKSPACE_BYTES": "limit of memory",
}
ONE_A_FILE = {"EFFECT", "LOGGER", "PLANE_FORM"}  # by design: each effect's file, and each that logs, has its own


def assigned_constants(path: Path) -> Iterator[tuple[str, ast.expr]]:
    """The upper-case names that a module assigns at its top, each with its expression."""
    for node in read_tree(path).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            names, values = [target], [node.value]
            if isinstance(target, ast.Tuple):
                names = target.elts
                values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value] * len(names)
            yield from (
                (name.id, value)
                for name, value in zip(names, values, strict=True)
                if isinstance(name, ast.Name) and name.id.isupper()
            )


def has_number(value: ast.expr | ast.keyword) -> bool:
    """Whether an expression has a number beside 0 and 1, outside of texts and functions."""
    if isinstance(value, ast.JoinedStr | ast.Lambda):
        return False
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and value.value not in (0, 1)
    return any(has_number(child) for child in ast.iter_child_nodes(value) if isinstance(child, ast.expr | ast.keyword))


def test_tuned_numbers_of_the_diagnosis_are_settings() -> None:
    """A tuned number is a field of a settings class, with its unit, its reason and the data it was chosen on."""
    loose = [
        f"{name(path)}: {constant}"
        for room in ("prediction", "diagnosis")
        for path in (ROOT / "hdagen" / room).rglob("*.py")
        if path.name != "progress.py"  # shares of time, which change no number
        for constant, value in assigned_constants(path)
        if has_number(value) and constant not in NO_SETTINGS
    ]
    assert loose == []


@pytest.mark.parametrize("package", PACKAGES)
def test_no_constant_has_two_values(package: str) -> None:
    values: dict[str, dict[str, list[str]]] = {}
    for path in (path for path in MODULES if name(path).startswith(f"{package}/")):
        for constant, value in assigned_constants(path):
            values.setdefault(constant.strip("_"), {}).setdefault(ast.unparse(value), []).append(name(path))
    assert {
        constant: list(found.values())
        for constant, found in values.items()
        if len(found) > 1 and constant not in ONE_A_FILE
    } == {}


# -- what lies where --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tracked() -> list[Path]:
    """The files of the repository; skips where this is none."""
    try:
        done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("git is not installed, so the repository's files are not known")
    if done.returncode or not done.stdout:
        pytest.skip("this is no git repository, so its files are not known")
    return [path for entry in done.stdout.split("\0") if entry and (path := ROOT / entry).is_file()]


def test_the_top_of_the_repository(tracked: list[Path]) -> None:
    top = {path.relative_to(ROOT).parts[0] for path in tracked}
    files = {"pyproject.toml", "README.md", "LICENSE", "CITATION.cff", "CHANGELOG.md", "CONTRIBUTING.md", "MANIFEST.in"}
    assert {entry for entry in top if not entry.startswith(".")} == {"gen", "hdagen", "tests", "docs", *files}
    made = ["build/arm-0/hda.h", ".venv/bin/python", "gen/__pycache__/build.pyc", "hdagen.egg-info/PKG-INFO"]
    ignored = subprocess.run(["git", "check-ignore", *made], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ignored.stdout.split() == made


ELSEWHERE = {
    "address of a package registry": "|".join(  # in two halves, so that none stands here either
        re.escape(name + end)
        for name, end in (
            ("pypi", ".org"),
            ("pythonhosted", ".org"),
            ("npmjs", ".org"),
            ("npmjs", ".com"),
            ("crates", ".io"),
            ("anaconda", ".org"),
            ("proxy.golang", ".org"),
            ("index", "-url"),
        )
    ),
    "path of one machine": r"(?<![\w.}])/(?:work|home|root|Users|tmp|mnt|opt/venv)/",
}


def test_files_speak_of_no_machine_and_no_registry(tracked: list[Path]) -> None:
    found = []
    for path in tracked:
        if path == Path(__file__):
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        for what, pattern in ELSEWHERE.items():
            found += [f"{name(path)}: {what}: {match.group()}" for match in re.finditer(pattern, text)]
    assert found == []


def test_a_build_speaks_of_no_machine(build: Callable[..., Compiled]) -> None:
    folder = build("emps").folder
    for path in folder.iterdir():
        content = path.read_bytes()
        assert [place for place in (ROOT, folder.parent, sys.prefix) if str(place).encode() in content] == [], path.name
