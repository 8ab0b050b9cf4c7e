"""One program: build, check, list, describe and doctor beside `python -m gen`, nearest names, completion, start."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import arms
import pytest
from compiled import Compiled

from gen.presets import find_presets
from hdagen.__main__ import COMMANDS, main
from hdagen.arm import installation_check
from hdagen.arm.installation_check import is_within_bounds


@pytest.fixture
def robot(build: Callable[..., Compiled], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A robot file whose build lies in the folder of builds."""
    monkeypatch.setenv("HDAGEN_BUILD", str(build(arms.SMALL).folder.parent))
    monkeypatch.chdir(tmp_path)
    Path("robot.toml").write_text(arms.SMALL)
    return "robot.toml"


# -- build, check, list, describe -------------------------------------------------------------------------------------


def test_build_prints_the_folder_that_gen_made(
    robot: str, build: Callable[..., Compiled], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", robot]) == 0
    assert Path(capsys.readouterr().out.strip()) == build(arms.SMALL).folder
    assert main(["build", robot, "--json"]) == 0
    assert Path(json.loads(capsys.readouterr().out)["folder"]) == build(arms.SMALL).folder


def test_check_says_what_gen_says(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", robot]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("test arm: 1 joint, ") and lines[-1].endswith(" (portable) is there")
    assert main(["check", robot, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"is_right": True, "lines": lines, "problems": []}


def test_check_lists_every_problem_and_fails(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(robot).write_text(arms.SMALL.replace("mass = ", "mas = ").replace("ratio = 20.0", "ratio = -1"))
    assert main(["check", robot]) == 2
    printed = capsys.readouterr()
    assert not printed.out
    assert "did you mean mass?" in printed.err and "ratio" in printed.err


def test_list_names_every_preset(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    rows = capsys.readouterr().out.splitlines()[1:]
    assert [row.split()[0] for row in rows] == list(find_presets())
    assert main(["list", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert {entry["preset"]: Path(entry["file"]) for entry in listed} == find_presets()
    assert next(entry["joints"] for entry in listed if entry["preset"] == "paper_three_joints") == 3


def test_describe_prints_what_the_manifest_says(
    robot: str, build: Callable[..., Compiled], capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = build(arms.SMALL).manifest
    assert main(["describe", robot]) == 0
    text = capsys.readouterr().out
    for name in (*(q["name"] for q in manifest["parameters"]), *(e["name"] for e in manifest["effects"])):
        assert f" {name} " in text, name
    assert "step: 0.0005 s, by RK4" in text and "rigid" in text
    assert main(["describe", robot, "--json"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert all(described[key] == manifest[key] for key in ("robot", "effects", "state", "input", "parameters"))
    assert described["step_limits"] == {"step": 5e-4, "is_stiff": False, "at_rated_torque": None}


def test_describe_one_parameter_or_suggest_the_nearest(robot: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["describe", robot, "mass_1", "--json"]) == 0
    assert [q["name"] for q in json.loads(capsys.readouterr().out)["parameters"]] == ["mass_1"]
    assert main(["describe", robot, "mas_1", "ratio_1", "ineria_1"]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("no parameter named mas_1; there are mass_1,")
    assert second.startswith("no parameter named ineria_1; there are inertia_1,")


# -- nearest names ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["diagnos"], "there is no command 'diagnos' (did you mean diagnose?); possible are build, check, "),
        (["nothing-like-it"], "there is no command 'nothing-like-it'; possible are build, "),
        (["simulate", "--controller", "positon"], "argument --controller: found 'positon' (did you mean position?), "),
        (["--print-completion", "bsh"], "argument --print-completion: found 'bsh' (did you mean bash?), "),
    ],
)
def test_a_misspelt_word_is_answered_by_the_nearest(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert words in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("command", ["build", "check", "describe"])
def test_a_misspelt_preset_is_answered_by_the_nearest(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([command, "papr"]) == 2
    assert "papr: found no such file (did you mean paper?), possible is a robot.toml or one" in capsys.readouterr().err


# -- doctor -----------------------------------------------------------------------------------------------------------


def examine(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """What `hdagen doctor` prints with other variables in its environment."""
    code = f"import os, sys; os.environ.update({environment!r}); from hdagen.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "doctor", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_doctor_finds_everything_here(robot: str, tmp_path: Path) -> None:
    done = examine("--json", HDAGEN_BUILD=str(tmp_path / "not-made-yet"))
    found = {finding["subject"]: finding for finding in json.loads(done.stdout)}
    for subject in ("Python", "generator", "C compiler", "builds folder", "casadi", "numpy"):
        assert found[subject]["is_good"], found[subject]
    missing = [subject for subject, finding in found.items() if finding["is_needed"] and not finding["is_good"]]
    assert done.returncode == int(bool(missing)), missing
    assert {"mujoco", "matplotlib"} <= {subject for subject, finding in found.items() if not finding["is_needed"]}
    assert not (tmp_path / "not-made-yet").exists()


def test_doctor_names_the_cure_of_a_compiler_that_does_not_work(robot: str, tmp_path: Path) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text('#!/bin/sh\n[ "$1" = --version ] && echo "cc 1.0" && exit\necho "no libc" >&2\nexit 1\n')
    compiler.chmod(compiler.stat().st_mode | stat.S_IXUSR)
    done = examine(CC=str(compiler))
    (line,) = [line for line in done.stdout.splitlines() if " C compiler: " in line]
    assert done.returncode == 1
    assert line.startswith("missing  C compiler: the compiler failed with code 1: ") and line.endswith("no libc")
    (line,) = [line for line in examine(CC="no-such").stdout.splitlines() if " C compiler: " in line]
    assert line.startswith("missing  C compiler: $CC: found no-such, ") and line.endswith("correct or unset it.")


def test_doctor_names_the_cure_of_a_folder_that_others_may_write(robot: str, tmp_path: Path) -> None:
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    done = examine(HDAGEN_BUILD=str(shared))
    (line,) = [line for line in done.stdout.splitlines() if " builds folder: " in line]
    assert done.returncode == 1 and line.startswith("missing  builds folder: ") and "chmod go-w" in line


def test_doctor_tells_versions_that_do_not_fit_and_packages_that_are_not_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = {"numpy": "1.26.4", "rich": "15.0.0", "mujoco": None, "matplotlib": "3.9"}
    required = ["numpy<3,>=2.0.2", "rich>=13.7", "absent>=1", 'mujoco<5,>=4; extra == "blind"']
    for name in ("_check_generator", "_check_compiler", "_check_build_folder"):
        monkeypatch.setattr(
            installation_check, name, lambda: installation_check.InstallationFinding("x", True, True, "")
        )
    monkeypatch.setattr("hdagen.arm.installation_check.metadata.requires", lambda _: required)
    monkeypatch.setattr(installation_check, "_find_version", found.get)
    assert main(["doctor"]) == 1
    lines = capsys.readouterr().out.splitlines()[4:]
    assert lines == [
        "missing  numpy: 1.26.4 is not <3,>=2.0.2; pip install 'numpy<3,>=2.0.2'",
        "ok       rich: 15.0.0",
        "missing  absent: not installed; pip install 'absent>=1'",
        "optional mujoco: not installed; for `hdagen blind`, and `hdagen export` with --into or --prove:"
        " pip install 'hdagen[mujoco]'",
        "ok       matplotlib: 3.9",
    ]


@pytest.mark.parametrize(
    ("version", "bounds", "fits"),
    [
        ("3.8.2", "==3.8.2", True),
        ("3.8.20", "==3.8.2", False),
        ("2.0", "<2", False),
        ("1.19.0rc1", "<2,>=1.13.1", True),
        ("1.13", ">=1.13.1", False),
        ("26", ">=17", True),
        ("5", "", True),
    ],
)
def test_versions_are_compared_by_their_numbers(version: str, bounds: str, fits: bool) -> None:
    assert is_within_bounds(version, bounds) is fits


# -- completion and start ---------------------------------------------------------------------------------------------


def print_completion(shell: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", shell])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_a_completion_script_knows_every_command(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    script = print_completion(shell, capsys)
    assert all(command in script for command in COMMANDS)
    if path := shutil.which(shell):
        done = subprocess.run([path, "-n"], input=script, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")


def test_bash_completes_commands_options_choices_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "robot.toml").write_text("")
    script = tmp_path / "completion.bash"
    script.write_text(print_completion("bash", capsys))

    def complete(*words: str) -> list[str]:
        code = f"source {script}; COMP_WORDS=(hdagen {' '.join(words)}); COMP_CWORD={len(words)}; _shtab_hdagen"
        code += '; printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run(["bash", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert complete("des") == ["describe"]
    assert complete("diagnose", "--fail") == ["--fail-above", "--fail-on"]
    assert complete("simulate", "--controller", "pos") == ["position"]
    assert complete("check", "rob") == ["robot.toml"]


def test_help_loads_nothing_that_takes_time() -> None:
    slow = ("numpy", "rich", "shtab", "logging", "tomllib", "subprocess", "pyarrow", "scipy")
    code = f"import sys, hdagen.__main__ as m; m.build_parser(); print([n for n in {slow} if n in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_doctor_runs_where_no_package_is_installed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = str(Path(installation_check.__file__).parents[2])
    code = f"import sys; sys.path.insert(0, {root!r}); from hdagen.__main__ import main; sys.exit(main())"

    def run(*arguments: str) -> Any:
        command = [sys.executable, "-S", "-E", "-c", code, *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    done = run("doctor")
    assert done.returncode == 1 and done.stderr == ""
    assert "ok       Python: " in done.stdout and "missing  " in done.stdout
    done = run("list")
    assert done.returncode == 2
    assert done.stderr == "a package cannot be loaded (No module named 'rich'); `hdagen doctor` says what is missing.\n"
