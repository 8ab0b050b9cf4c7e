"""The runtime arm: every wrong vector, parameter, folder and manifest is one sentence; nothing foreign is loaded."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import SMALL
from compiled import Compiled

import hdagen
from hdagen.arm.arm_parameters import UnknownParameter
from hdagen.arm.build_loader import PlantError
from hdagen.arm.compiled_arm import Arm
from hdagen.simulation.simulated_sensors import Sensors


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    return Arm(build("paper").folder)


@pytest.fixture
def folder(build: Callable[..., Compiled], tmp_path: Path) -> Path:
    """A copy of a build, to be damaged."""
    source = build(SMALL).folder
    return Path(shutil.copytree(source, tmp_path / source.name))


def sentence(call: Callable[[], Any], words: str) -> str:
    """The one sentence of the PlantError that the call raises, with these words in it."""
    with pytest.raises(PlantError, match=words) as caught:
        call()
    said = str(caught.value)
    assert len(said.splitlines()) == 1 and said.endswith("."), said
    return said


# -- vectors ----------------------------------------------------------------------------------------------------------

X, U = np.zeros(8), np.zeros(4)


@pytest.mark.parametrize(
    "call, words",
    [
        (lambda a: a.step(np.zeros(7), U), "the state x .* must have 8 entries, not the shape"),
        (lambda a: a.step(np.zeros((1, 8)), U), "must have 8 entries"),
        (lambda a: a.step(X + np.nan, U), "the state x .* holds NaN"),
        (lambda a: a.step("eight", U), "is not an array of real numbers"),
        (lambda a: a.step([1, [2]], U), "is not an array of real numbers"),
        (lambda a: a.step(X + 1j, U), "is not an array of real numbers"),
        (lambda a: a.step(X, [0.0, np.inf, 0.0, 0.0]), "the input u .* holds NaN or infinity"),
        (lambda a: a.step(X, U, h=0.0), "the step must be positive"),
        (lambda a: a.step(X, U, h=np.nan), "the step must be positive"),
        (lambda a: a.step(X, U, h="long"), "the step must be positive"),
        (lambda a: a.jacobians(X, np.zeros(2)), "the input u .* must have 4 entries"),
        (lambda a: a.rollout(X, U), r"u must be \(T, 4\)"),
        (lambda a: a.rollout(X, np.full((3, 4), np.nan)), "u holds NaN"),
        (lambda a: a.rollout(X, np.zeros((3, 4)), dt=[1e-3, 1e-3]), "or 3 of them"),
        (lambda a: a.rollout(X, np.zeros((3, 4)), dt=-1e-3), "one positive time"),
        (lambda a: a.rollout(X, np.zeros((3, 4)), dt=np.nan), "dt holds NaN"),
        (lambda a: a.rollout(X, np.zeros((3, 4)), most=0.0), "the step must be positive"),
        (lambda a: a.rollout_batch(X, np.zeros((3, 4))), r"takes x0 \(B, 8\) and u \(B, T, 4\)"),
        (lambda a: a.rollout_batch(np.zeros((2, 8)), np.zeros((3, 5, 4))), "takes x0"),
        (lambda a: a.rollout_batch(np.zeros((0, 8)), np.zeros((0, 5, 4))), "at least one trajectory"),
        (lambda a: a.rollout_batch(np.full((1, 8), np.inf), np.zeros((1, 5, 4))), "x0 holds NaN"),
        (lambda a: a.rollout_batch(np.zeros((2, 8)), np.zeros((2, 5, 4)), p=a.p), "takes p"),
        (lambda a: a.rest([0.1]), "q must have 2 entries"),
        (lambda a: a.rest([0.1, 0.2], [np.nan, 0.0]), "torque holds NaN"),
        (lambda a: a.evaluate("nothing"), "no function named nothing; there are"),
        (lambda a: a.evaluate("points"), "points takes q"),
        (lambda a: a.evaluate("points", q=[0, 0], v=[0, 0]), "points takes q, not q, v"),
        (lambda a: a.evaluate("points", q=np.zeros((2, 2, 2))), "q must have 2 entries"),
        (lambda a: a.rhs(np.zeros((3, 8)), np.zeros((2, 4))), r"\[2, 3\] rows"),
        (lambda a: a.index("elbow"), "no state or input named elbow"),
    ],
)
def test_a_wrong_vector_is_one_sentence(arm: Arm, call: Callable[[Arm], Any], words: str) -> None:
    sentence(lambda: call(arm), words)


def test_shapes_are_what_the_docs_say(arm: Arm) -> None:
    u = np.zeros((5, 4))
    x0 = arm.rest([0.5, 0.5])
    assert arm.step(x0, u[0]).shape == (8,) and arm.rollout(x0, u).shape == (6, 8)
    assert np.array_equal(arm.rollout(x0, u[:0]), [x0])
    assert arm.rollout_batch(np.tile(x0, (3, 1)), np.zeros((3, 5, 4))).shape == (3, 6, 8)
    assert arm.rhs(np.tile(x0, (7, 1)), u[0]).shape == (7, 8) and arm.rhs(np.zeros((0, 8)), u[0]).shape == (0, 8)
    d = arm.jacobians(x0, u[0])
    assert d.by_state.shape == (8, 8) and d.by_input.shape == (8, 4) and d.by_parameter.shape == (8, len(arm.p))
    h = 1e-6
    for k in range(8):  # columns, not rows, belong to the states
        moved = x0 + h * np.eye(8)[k]
        slope = (arm.step(moved, u[0]) - arm.step(2 * x0 - moved, u[0])) / (2 * h)
        assert np.allclose(d.by_state[:, k], slope, rtol=1e-3, atol=1e-3 * np.abs(d.by_state).max(axis=1))


# -- parameters -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0, 1e9, "heavy", None, [1.0]])
def test_a_wrong_parameter_is_one_sentence_and_changes_nothing(arm: Arm, value: Any) -> None:
    before, c = arm.p.copy(), arm.c.copy()
    sentence(lambda: arm.parameters.update({"mass_2": 0.95, "mass_1": value}), "parameter mass_1: .* is not within")
    assert np.array_equal(arm.p, before) and np.array_equal(arm.c, c)


def test_parameters_are_a_mapping(build: Callable[..., Compiled]) -> None:
    arm = Arm(build("paper").folder)
    assert "mass_1" in arm.parameters and "weight_1" not in arm.parameters
    assert arm.parameters.get("weight_1", 7.0) == 7.0 and len(list(arm.parameters)) == len(arm.parameters) == len(arm.p)
    for call in (lambda: arm.parameters["weight_1"], lambda: arm.parameters.update(weight_1=1.0)):
        assert sentence(call, "no parameter named weight_1; there are").startswith("no parameter")
        with pytest.raises((KeyError,)) as caught:
            call()
        assert isinstance(caught.value, UnknownParameter)
    with pytest.raises(PlantError, match="cannot be deleted"):
        del arm.parameters["mass_1"]
    x0 = arm.rest([0.5, 0.5])
    u = np.array([0.9, -0.7, 1.0, 2.0])
    before = arm.step(x0, u)
    arm.parameters["motor_inertia_1"] *= 1.05
    assert not np.array_equal(arm.step(x0, u), before)
    arm.parameters.reset()
    assert np.array_equal(arm.step(x0, u), before)


def test_two_arms_of_a_build_do_not_share_parameters(build: Callable[..., Compiled]) -> None:
    one, two = Arm(build("paper").folder), Arm(build("paper").folder)
    one.parameters["mass_1"] = 1.65
    assert two.parameters["mass_1"] == 1.6 and not np.array_equal(one.c, two.c)


# -- folders ----------------------------------------------------------------------------------------------------------


def manifest(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "manifest.json").read_text())


def forge(folder: Path, content: dict[str, Any]) -> None:
    """Write a manifest with a seal that fits it."""
    content = {name: value for name, value in content.items() if name != "seal"}
    content["seal"] = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(content))


def test_an_honest_copy_is_loaded(folder: Path) -> None:
    assert Arm(folder).n == Arm(str(folder)).n == 1


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "7", '"a"', "\ud800".encode("utf-8", "surrogatepass"), "[" * 10**5]
)
def test_a_manifest_that_is_none_is_refused(folder: Path, text: str | bytes) -> None:
    (folder / "manifest.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    said = sentence(lambda: Arm(folder), "manifest")
    assert "build again with `hdagen build" in said


@pytest.mark.parametrize("name", ["parameters", "state", "build", "library", "robot", "constants"])
def test_a_changed_manifest_is_refused(folder: Path, name: str) -> None:
    changed = manifest(folder)
    changed[name] = changed[name][:-1] if isinstance(changed[name], (list, str)) else None
    (folder / "manifest.json").write_text(json.dumps(changed))
    sentence(lambda: Arm(folder), "not as it was written")


@pytest.mark.parametrize(
    "change, words",
    [
        ({"schema": 2}, "schema is not 1"),
        ({"build": "0123456789abcdef"}, "does not belong to this folder"),
        ({"library": "../../evil.so"}, "does not belong to this folder"),
        ({"files": {}}, "does not belong to this folder"),
        ({"cpu": ["quantum"]}, "a processor with quantum, which this one lacks"),
        ({"parameters": []}, "not what a build writes"),
        ({"parameters": [{"name": "mass_1"}]}, "not what a build writes"),
        ({"state": None}, "not what a build writes"),
        ({"constants": 3}, "not what a build writes"),
        ({"constants": -1}, "not what a build writes"),
        ({"robot": {}}, "not what a build writes"),
        ({"functions": [{}]}, "not what a build writes"),
    ],
)
def test_a_forged_manifest_with_a_fitting_seal_is_refused(folder: Path, change: dict[str, Any], words: str) -> None:
    forge(folder, {**manifest(folder), **change})
    sentence(lambda: Arm(folder), words)


def test_forged_lengths_reach_no_memory(folder: Path) -> None:
    """The library checks every buffer itself, so a lie about sizes ends in a refusal."""
    forged = manifest(folder)
    for function in forged["functions"]:
        function["outputs"] = [[name, 1] for name, _ in function["outputs"]]
    forge(folder, forged)
    arm = Arm(folder)
    with pytest.raises(ValueError, match="must have"):
        arm.outputs(np.zeros(arm.nx), np.zeros(arm.nu))


@pytest.mark.parametrize("suffix", [".so", ".c", ".h"])
def test_a_file_that_changed_or_went_is_refused(folder: Path, suffix: str) -> None:
    path = next(p for p in sorted(folder.iterdir()) if p.suffix == suffix)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(bytes(content))
    sentence(lambda: Arm(folder), "missing or not what was built")
    path.unlink()
    sentence(lambda: Arm(folder), "missing or not what was built")


def test_a_library_that_cannot_be_loaded_is_one_sentence(folder: Path) -> None:
    forged = manifest(folder)
    (folder / forged["library"]).write_bytes(b"\x7fELF not really")
    forged["files"][forged["library"]] = hashlib.sha256(b"\x7fELF not really").hexdigest()
    forge(folder, forged)
    sentence(lambda: Arm(folder), "cannot be loaded")


def test_a_library_of_another_build_is_refused(folder: Path, build: Callable[..., Compiled]) -> None:
    other, forged = build("paper"), manifest(folder)
    content = (other.folder / other.manifest["library"]).read_bytes()
    (folder / forged["library"]).write_bytes(content)
    forged["files"][forged["library"]] = hashlib.sha256(content).hexdigest()
    forge(folder, forged)
    sentence(lambda: Arm(folder), "of another build")


def test_a_renamed_folder_and_a_file_for_a_folder_are_refused(folder: Path, tmp_path: Path) -> None:
    renamed = folder.rename(tmp_path / "arm-0123456789abcdef")
    sentence(lambda: Arm(renamed), "does not belong to this folder")
    sentence(lambda: Arm(tmp_path / "nowhere"), "manifest.json cannot be read")


# -- building on first use --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "robot, changes, words",
    [
        ("", {}, "names no robot"),
        ("a\0b", {}, "names no robot"),
        ("x" * 5000, {}, "names no robot"),
        ("nowhere.toml", {}, "nowhere.toml: found no such file"),
        ("--help", {}, "--help: found no such file"),
        ("paper", {"profile": "fastest"}, "no profile named fastest; there are portable, native"),
        ("paper", {"effects": "backlash"}, "effects takes names in a tuple"),
        ("paper", {"effects": ("magic",)}, "magic"),
    ],
)
def test_a_robot_that_is_none_is_one_sentence(tmp_path: Path, robot: str, changes: dict[str, Any], words: str) -> None:
    sentence(lambda: hdagen.load_robot(robot, out=tmp_path / "build", **changes), words)
    assert not (tmp_path / "build").exists()


@pytest.fixture
def child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """child(body): the text of a program that stands in for the child process that builds."""

    def stand_in(body: str) -> None:
        path = tmp_path / "python"
        path.write_text(f"#!{os.path.realpath(sys.executable)}\nimport sys\n{body}\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setattr(sys, "executable", str(path))

    return stand_in


def test_a_child_that_says_much_on_both_pipes_does_not_hang(
    child: Callable[[str], None], folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    lines = (
        "sys.stdout.write('x' * 10**6 + chr(10)); sys.stdout.flush()\nsys.stderr.write('noise ' * 10**5 + chr(10))\n"
    )
    child(f"{lines}print('building it', file=sys.stderr)\nprint({str(folder)!r})")
    assert hdagen.load_robot("paper", out=tmp_path / "build").folder == folder
    assert capfd.readouterr().err == "building it\n", "only the message of a build is passed on"


@pytest.mark.parametrize(
    "body, words",
    [
        ("sys.exit(1)", "the build of paper failed without a word"),
        ("pass", "the build of paper failed without a word"),
        ("print('no compiler was found; install gcc.', file=sys.stderr); sys.exit(2)", "no compiler was found"),
        ("print('/nowhere/at-all')", "manifest.json cannot be read"),
    ],
)
def test_a_child_that_fails_is_one_sentence(
    child: Callable[[str], None], tmp_path: Path, body: str, words: str
) -> None:
    child(body)
    sentence(lambda: hdagen.load_robot("paper", out=tmp_path / "build"), words)


def test_gen_beside_hdagen_builds_whatever_lies_in_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gen").mkdir()
    (tmp_path / "gen" / "__main__.py").write_text("raise SystemExit('foreign code ran')")
    monkeypatch.chdir(tmp_path)
    sentence(lambda: hdagen.load_robot("nowhere.toml", out=tmp_path / "build"), "found no such file")


def test_exact_sensors_are_without_error() -> None:
    assert Sensors.exact(2) == Sensors((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.0, 0, (0.0, 0.0), (0.0, 0.0))
