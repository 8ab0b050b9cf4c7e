"""The project itself: what README, .ci/run, pyproject and the documents say of each other and of the code holds."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from compiled import Compiled

import hdagen
from gen.builder.effect_figures import draw_effect
from gen.builder.effects_table import make_effects_page
from gen.effects import ALL
from gen.effects.effect import Effect
from hdagen.blind.label_seal import hash_seed
from hdagen.diagnosis.decision import calibration

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CI = ROOT / ".ci" / "run"
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
DOCS = ROOT / "docs"
DOCUMENTS = sorted(path for path in DOCS.rglob("*.md") if not path.is_relative_to(DOCS / "examples"))
IMPORTED_AS = {"pin": "pinocchio", "pytest-xdist": "xdist", "z3-solver": "z3"}


def blocks(kind: str, before: str = "", text: str = README) -> list[str]:
    """The fenced blocks of a text in that language that follow the line ``before`` at once."""
    return re.findall(rf"^{re.escape(before)}```{kind}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(name: str) -> list[str]:
    return blocks("sh", f"<!-- command: {name} -->\n")


# -- the two commands -------------------------------------------------------------------------------------------------


def test_the_readme_has_the_two_commands_of_one_line_each() -> None:
    assert re.findall(r"<!-- command: (\w+) -->", README) == ["setup", "test"]
    assert [len(commands(name)) for name in ("setup", "test")] == [1, 1]
    assert all(commands(name)[0].count("\n") == 1 for name in ("setup", "test"))


def test_the_first_command_brings_everything_and_runs_the_demo() -> None:
    make, install, demo = commands("setup")[0].strip().split(" && ")
    assert make == "python3 -m venv .venv"
    assert install == ".venv/bin/pip install -e '.[mujoco,test]'"
    assert demo == ".venv/bin/hdagen demo"
    assert PROJECT["project"]["scripts"] == {"hdagen": "hdagen.__main__:main"}
    assert "pytest" in names(PROJECT["project"]["optional-dependencies"]["test"])


PROGRAMS = ("pip", "ruff", "clang-format", "mypy", "pytest", "hdagen")


def checkout(folder: Path, setup: str, test: str) -> Callable[..., tuple[int, str, list[str]]]:
    """A repository of .ci/run, a README with these commands, and a .venv whose programs only note how they were called.

    The returned function runs .ci/run there: exit code, output, and the calls in order.
    """
    (folder / ".ci").mkdir(parents=True)
    (folder / ".ci" / "run").write_bytes(CI.read_bytes())
    (folder / ".gitignore").write_text(".venv/\n")
    fenced = "<!-- command: {} -->\n```sh\n{}\n```\n"
    (folder / "README.md").write_text("# x\n" + fenced.format("setup", setup) + "then\n" + fenced.format("test", test))
    calls = folder.parent / "calls"
    programs = folder / ".venv" / "bin"
    programs.mkdir(parents=True)
    without_root = folder.parent / "bin"
    without_root.mkdir()
    newest = f"""[ "$1" = -c ] && exec "{sys.executable}" "$@"
[ "$1" = --version ] && echo "Python 3.13.99" && exit
mkdir -p "$3/bin"
for name in pip python hdagen; do
    printf '#!/bin/sh\\necho "newest %s $1" >>"{calls}"\\n' $name >"$3/bin/$name"
    chmod +x "$3/bin/$name"
done"""
    for path, body in [
        *((programs / name, f'echo "{name} $*" >>"{calls}"') for name in PROGRAMS),
        (programs / "python", f'echo "python $1 $2" | head -n 1 >>"{calls}"'),
        (without_root / "id", "echo 1000"),
        (without_root / "python3.13", newest),
    ]:
        path.write_text(f"#!/bin/sh\n{body}\n")
        path.chmod(0o755)
    git = ["git", "-c", "user.name=x", "-c", "user.email=x@example.org"]
    for arguments in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "x"]):
        subprocess.run([*git, *arguments], cwd=folder, check=True, stdin=subprocess.DEVNULL)

    def run(**environment: str) -> tuple[int, str, list[str]]:
        calls.unlink(missing_ok=True)
        path = f"{without_root}:{environment.pop('PATH', os.environ['PATH'])}"
        done = subprocess.run(
            ["bash", folder / ".ci" / "run"],
            cwd=folder.parent,
            env={**os.environ, **environment, "PATH": path},
            capture_output=True,
            text=True,
            check=False,
        )
        called = calls.read_text().splitlines() if calls.exists() else []
        return done.returncode, done.stdout + done.stderr, called

    return run


def test_ci_runs_the_readme_s_commands_then_lint_types_and_the_wheel(tmp_path: Path) -> None:
    run = checkout(tmp_path / "a b", ".venv/bin/hdagen one && .venv/bin/hdagen two", ".venv/bin/pytest three")
    code, said, calls = run(CI="true")
    assert code == 0, said
    assert calls == [
        "hdagen one",
        "hdagen two",
        "pytest three",
        "pip install -q -e .[lint]",
        "ruff check",
        "ruff format --check",
        "clang-format --dry-run --Werror gen/templates/*.[ch] gen/templates/*/*.[ch]",
        "mypy ",
        "python -m pip",
        "python -c ",
        "python -m pip",
        "python -m pip",
        "python -c ",
        "python -c ",
        "python -m hdagen",
        "python --version ",
        "newest pip install",
        "newest python -m",
        "newest hdagen build",
    ]


def test_ci_stops_where_the_first_command_fails(tmp_path: Path) -> None:
    code, said, calls = checkout(tmp_path / "a", ".venv/bin/hdagen one && false", ".venv/bin/pytest three")()
    assert code == 1
    assert calls == ["hdagen one"]
    assert "FAILED" in said


def test_ci_fails_and_says_so_where_a_later_step_fails_or_the_checkout_is_dirtied(tmp_path: Path) -> None:
    code, said, calls = checkout(tmp_path / "a", "touch left-behind", "false")()
    assert code == 1
    assert said[said.rindex("failed after") :].split("\n")[1:] == ["  false", "  git status", ""]
    assert "?? left-behind" in said
    assert "mypy " in calls


def test_ci_leaves_an_active_environment_of_another_python_alone(tmp_path: Path) -> None:
    old = tmp_path / "old"
    (old / "bin").mkdir(parents=True)
    (old / "bin" / "python3").write_text("#!/bin/sh\nexit 1\n")
    (old / "bin" / "python3").chmod(0o755)
    setup = """python3 -c 'import sys; print("found", sys.version_info >= (3, 11))'; echo "in ${VIRTUAL_ENV-none}"; """
    run = checkout(tmp_path / "a", setup + 'echo "path ${PYTHONPATH-none}"', "true")
    path = f"{old / 'bin'}:{os.environ['PATH']}"
    for active in ({"VIRTUAL_ENV": str(old)}, {}):  # activated, or only first on the path
        code, said, _ = run(PATH=path, PYTHONPATH="/nowhere", **active)
        assert code == 0, said
        assert "found True\nin none\npath none\n" in said


# -- README and documents ---------------------------------------------------------------------------------------------


def test_the_page_of_effects_is_current() -> None:
    found = (DOCS / "method" / "effects.md").read_text(encoding="utf-8")
    assert found == make_effects_page(), "call `python -m gen.builder.effects_table docs`"


@pytest.mark.parametrize("effect", ALL, ids=lambda effect: effect.name)
def test_the_figure_of_an_effect_is_current(effect: Effect) -> None:
    found = (DOCS / "images" / "effects" / f"{effect.name}.svg").read_text(encoding="utf-8")
    drawn = draw_effect(effect)
    assert re.sub(r"[\d.]+", "", found) == re.sub(r"[\d.]+", "", drawn), (
        "call `python -m gen.builder.effects_table docs`"
    )
    numbers = [[float(value) for value in re.findall(r"\d+\.?\d*", text)] for text in (found, drawn)]
    assert numbers[0] == pytest.approx(numbers[1], abs=0.11)


def test_contributing_answers_ten_questions_with_files_that_are_there() -> None:
    rows = CONTRIBUTING.partition("<!-- questions: begin -->")[2].partition("<!-- questions: end -->")[0]
    files = re.findall(r"^\| .*\? \| `([\w/.]+)` \|$", rows, re.MULTILINE)
    assert len(files) == 10
    assert [path for path in files if not (ROOT / path).is_file()] == []


def test_no_check_was_made_on_a_seed_of_the_calibration() -> None:
    kinds = json.loads((ROOT / "docs" / "blind.json").read_text(encoding="utf-8"))
    checks = [check for kind in kinds.values() for check in kind["checks"]]
    assert {check["seed_hash"] for check in checks}.isdisjoint(calibration.read().seeds)
    for check in checks:
        assert hash_seed(check["seed"]) == check["seed_hash"]
    for kind in kinds.values():
        assert kind["cases"] == sum(check["cases"] for check in kind["checks"]) == kind["summary"]["failed"]["count"]


def test_the_page_has_full_rows_for_every_effect() -> None:
    rows = [row for row in make_effects_page().splitlines() if row.startswith("| ")]
    listed = [row.split("`")[1] for row in rows if row.startswith("| [`")]
    assert listed == [effect.name for effect in ALL]
    for row in rows[1:]:
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]
        widths = {"| [`": 3, "| `": 4, "| number": 4}
        assert len(cells) == next((n for start, n in widths.items() if row.startswith(start)), 2) or not any(cells)
        assert all(cells) or not any(cells), row


def test_the_readme_s_python_names_what_is_public() -> None:
    (code,) = blocks("python")
    ast.parse(code)
    names_used = set(re.findall(r"hdagen\.(\w+)\(", code))
    assert names_used >= {"load_robot", "read_log", "diagnose"}
    assert names_used <= set(hdagen.__all__)


def test_the_reference_s_python_runs(build: Callable[..., Compiled]) -> None:
    code = "\n".join(blocks("python", text=(DOCS / "reference" / "python.md").read_text(encoding="utf-8")))
    assert "hdagen.load_robot(" in code
    environment = {**os.environ, "HDAGEN_BUILD": str(build("paper").folder.parent)}
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_the_readme_says_what_the_guard_is_not() -> None:
    sentence = "not a safety-rated function; use it behind a certified stop"
    assert sentence in README
    assert "(docs/project/safety.md)" in README[README.index(sentence) :][:200]


def links(path: Path) -> Iterator[str]:
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith(("http://", "https://", "#")):
            yield target.partition("#")[0]


@pytest.mark.parametrize("path", [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCUMENTS], ids=lambda path: path.name)
def test_every_link_leads_somewhere(path: Path) -> None:
    assert [target for target in links(path) if not (path.parent / target).exists()] == []


def test_the_index_lists_every_document_once() -> None:
    listed = [target for target in links(ROOT / "docs" / "README.md") if target.endswith(".md")]
    documents = [path.relative_to(DOCS).as_posix() for path in DOCUMENTS]
    assert sorted(listed) == sorted(name for name in documents if name != "README.md")


# -- package ----------------------------------------------------------------------------------------------------------


def test_every_folder_of_code_is_a_package() -> None:
    folders = {path.parent for half in ("gen", "hdagen") for path in (ROOT / half).rglob("*.py")}
    assert [str(folder) for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_every_file_beside_the_code_is_package_data() -> None:
    data = PROJECT["tool"]["setuptools"]["package-data"]
    packages = [path.parent for half in ("gen", "hdagen") for path in (ROOT / half).rglob("__init__.py")]
    taken = set()
    for package in packages:
        name = ".".join(package.relative_to(ROOT).parts)
        for pattern in (*data["*"], *data.get(name, ())):
            taken |= set(package.glob(pattern))
    files = {path for half in ("gen", "hdagen") for path in (ROOT / half).rglob("*") if path.is_file()}
    beside = {path for path in files if path.suffix not in (".py", ".pyc")}
    assert {path.parent.name for path in beside} >= {"templates", "presets"}
    assert sorted(str(path.relative_to(ROOT)) for path in beside - taken) == []


def test_the_package_s_page_leads_nowhere_and_every_document_is_shipped() -> None:
    page = ROOT / PROJECT["project"]["readme"]
    text = page.read_text(encoding="utf-8")
    assert list(links(page)) == [] and "![" not in text and "://" not in text
    assert set(blocks("python", text=text)) and "behind a certified stop" in text
    shipped = (ROOT / "MANIFEST.in").read_text(encoding="utf-8").split()
    assert {"docs", "tests", ".ci", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md"} <= set(shipped)


@pytest.mark.parametrize("package", ["gen", "hdagen"])
def test_windows_is_refused_in_a_sentence(package: str) -> None:
    code = f"import sys; sys.platform = 'win32'; import {package}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stderr.splitlines()[-1].startswith("ImportError: hdagen does not run on Windows; use Linux, ")
    systems = [line for line in PROJECT["project"]["classifiers"] if line.startswith("Operating System")]
    assert systems == ["Operating System :: POSIX :: Linux"]
    assert all(
        "Windows" in (ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/project/package.md")
    )


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=!~;\[ ]", requirement, maxsplit=1)[0] for requirement in requirements}


def imported(folder: str) -> set[str]:
    """Top-level names that the Python files of a folder import from outside the standard library and the project."""
    found = set()
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.partition(".")[0])
    folders = (ROOT / "tests", ROOT / "docs" / "examples")
    own = {"gen", "hdagen", *(path.stem for folder in folders for path in folder.rglob("*.py"))}
    return found - own - sys.stdlib_module_names


def test_what_the_code_imports_is_what_pyproject_asks_for() -> None:
    needed = names(PROJECT["project"]["dependencies"])
    extras = PROJECT["project"]["optional-dependencies"]
    for_tests = needed | names(extras["test"])
    assert imported("gen") <= {IMPORTED_AS.get(name, name) for name in needed}
    assert imported("hdagen") <= {
        IMPORTED_AS.get(name, name)
        for name in needed | names(extras["blind"]) | names(extras["paper"]) | names(extras["pandas"])
    }
    assert imported("tests") <= {IMPORTED_AS.get(name, name) for name in for_tests}


def test_every_dependency_is_documented() -> None:
    text = (ROOT / "docs" / "project" / "dependencies.md").read_text(encoding="utf-8")
    extras = PROJECT["project"]["optional-dependencies"]
    for heading, wanted in (
        ("## To run", PROJECT["project"]["dependencies"]),
        *((f"## Extra `{extra}`", requirements) for extra, requirements in extras.items()),
    ):
        section = text.partition(f"{heading}\n")[2].partition("\n## ")[0]
        assert set(re.findall(r"^\| `([\w-]+)` \|", section, re.MULTILINE)) == names(wanted), heading


def test_the_versions_agree() -> None:
    version = PROJECT["project"]["version"]
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert hdagen.__version__ == version
    assert next(name for name in re.findall(r"^## (.+)$", changelog, re.MULTILINE) if name != "Unreleased") == version
    assert citation()["version"] == version


def citation() -> dict[str, str]:
    """The `key: value` lines at the top level of CITATION.cff; a key of a list or a folded text has "" or its mark."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    for line in text.splitlines():
        assert re.fullmatch(r"([a-z-]+:( .+)?|  .*\S)", line), line
    pairs = re.findall(r"^([a-z-]+):[ ]?(.*)$", text, re.MULTILINE)
    assert len(pairs) == len(dict(pairs))
    return {key: value.strip('"') for key, value in pairs}


def test_the_citation_has_what_the_format_asks_for() -> None:
    cited = citation()
    assert set(cited) >= {"cff-version", "message", "title", "authors", "version", "license"}
    assert cited["cff-version"] == "1.2.0"
    assert cited["license"] == PROJECT["project"]["license"]
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_every_version_of_the_changelog_tells_its_changes_to_numbers() -> None:
    versions = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert versions
    for version in versions:
        assert re.search(r"^### Changes to numbers\n\n\S", version, re.MULTILINE), version.partition("\n")[0]
