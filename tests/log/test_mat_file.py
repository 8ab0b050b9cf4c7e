"""A .mat file is read in a child process: what is good comes back exactly, what is crafted harms nobody."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from hdagen.log.data_table import LogError
from hdagen.log.mat_file import read_mat
from hdagen.log.measured_log import read


def variables() -> dict[str, object]:
    """What people keep in a .mat: vectors either way, small integers, a struct, matrices, and what is no channel."""
    steps = np.arange(50)
    return {
        "t": (steps * 1e-3)[:, None],
        "vir": np.sin(steps * 0.3)[None, :],
        "pulses": (steps % 6).astype(np.uint8)[:, None],
        "rec": {"pos": np.vstack([steps * 0.5, steps * -0.25]), "t": steps * 2.0, "who": "me"},
        "tall": np.column_stack([steps * 1.0, steps * 3.0, steps * 7.0]),
        "gain": 160.18,
        "impedance": steps * (1 + 2j),
        "name": "EMPS",
        "cell": np.array([[1, "a"]], dtype=object),
        "empty": np.empty((0, 0)),
    }


@pytest.mark.parametrize("compressed", [False, True])
def test_every_real_numeric_variable_comes_back_exactly_and_nothing_else(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / 'it\'s a "log".mat'
    given = variables()
    scipy.io.savemat(path, given, do_compression=compressed)
    arrays = read_mat(path)
    steps = np.arange(50)
    expected = {
        "t": steps * 1e-3,
        "vir": np.sin(steps * 0.3),
        "pulses": (steps % 6).astype(float),
        "rec.pos(1,:)": steps * 0.5,
        "rec.pos(2,:)": steps * -0.25,
        "rec.t": steps * 2.0,
        "tall(:,1)": steps * 1.0,
        "tall(:,2)": steps * 3.0,
        "tall(:,3)": steps * 7.0,
        "gain": np.array([160.18]),
    }
    assert set(arrays) == set(expected)
    for name, values in expected.items():
        assert arrays[name].dtype == np.float64
        assert np.array_equal(arrays[name], values), name


def test_a_small_integer_does_not_overflow(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"pulses": np.full(100, 200, dtype=np.uint8)})
    assert read_mat(path)["pulses"].sum() == 20000.0


def test_a_log_comes_out_of_a_mat_by_the_names_of_columns_toml(tmp_path: Path) -> None:
    path, columns = tmp_path / "log.mat", tmp_path / "columns.toml"
    scipy.io.savemat(path, variables())
    columns.write_text(
        '[time]\nfrom = "t"\n[motor_torque_command_1]\nfrom = "vir"\nunit = "V"\nscale = 2.0\n'
        '[joint_position_1]\nfrom = "rec.pos(2,:)"\nunit = "deg"\n'
    )
    log = read(path, columns)
    assert np.array_equal(log["motor_torque_command_1"], 2.0 * np.sin(np.arange(50) * 0.3))
    assert np.allclose(log["joint_position_1"], np.deg2rad(np.arange(50) * -0.25), rtol=1e-15)
    columns.write_text('[time]\nfrom = "t"\n[motor_current_1]\nfrom = "gain"\n[joint_position_1]\nfrom = "rec.t"\n')
    with pytest.raises(LogError, match="differ in length.*gain 1"):
        read(path, columns)


@pytest.mark.parametrize(
    "head", [b"MATLAB 7.3 MAT-file, Platform: GLNXA64", b"\x89HDF\r\n\x1a\n", b" " * 512 + b"\x89HDF\r\n\x1a\n"]
)
def test_version_7_3_is_refused_with_how_to_save_it(tmp_path: Path, head: bytes) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(head + bytes(600))
    with pytest.raises(LogError, match="7.3 .HDF5. file.*save.*'-v7'"):
        read_mat(path)


@pytest.mark.parametrize("content", [b"", b"\0", b"time,motor_current_1\n0,1\n", bytes(range(256)) * 8])
def test_what_is_no_mat_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(content)
    with pytest.raises(LogError, match="not a readable .mat file"):
        read_mat(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="nowhere.mat: cannot be read"):
        read_mat(tmp_path / "nowhere.mat")


def test_a_file_that_unpacks_beyond_the_memory_allowed_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.mat"
    scipy.io.savemat(path, {"zeros": np.zeros(40_000_000)}, do_compression=True)
    assert path.stat().st_size < 1_000_000
    with pytest.raises(LogError, match="needs more than 128 MB"):
        read_mat(path, memory=128 << 20)


def test_a_file_that_takes_too_long_is_given_up(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, variables())
    start = time.monotonic()
    with pytest.raises(LogError, match="longer than 0.05 s"):
        read_mat(path, seconds=0.05)
    assert time.monotonic() - start < 5


def mutated(content: bytes, random: np.random.Generator) -> bytes:
    """The content with bytes changed, a stretch cut out or doubled, or its end cut off."""
    damaged = bytearray(content)
    for _ in range(int(random.integers(1, 8))):
        at = int(random.integers(124, len(damaged)))
        kind = random.integers(0, 4)
        if kind == 0:
            damaged[at] = int(random.integers(0, 256))
        elif kind == 1:
            damaged[at : at + 4] = random.bytes(4)
        elif kind == 2:
            length = int(random.integers(1, 64))
            damaged[at : at + length] = damaged[at : at + length] * int(random.integers(0, 3))
        else:
            del damaged[max(200, at) :]
    return bytes(damaged)


@pytest.mark.parametrize("cases", [24, pytest.param(600, marks=pytest.mark.campaign)])
def test_mutated_files_neither_kill_nor_hang_nor_give_anything_but_numbers(tmp_path: Path, cases: int) -> None:
    path = tmp_path / "log.mat"
    originals = []
    for compressed in (False, True):
        scipy.io.savemat(path, variables(), do_compression=compressed)
        originals.append(path.read_bytes())
    random = np.random.default_rng(20240607)

    def attempt(case: int, content: bytes) -> str:
        victim = tmp_path / f"{case}.mat"
        victim.write_bytes(content)
        try:
            arrays = read_mat(victim, seconds=20, memory=512 << 20)
        except LogError as error:
            assert len(error.problems) == 1 and str(victim) in error.problems[0]
            return "crashed" if "crashed" in error.problems[0] else "refused"
        assert all(a.dtype == np.float64 and a.ndim == 1 for a in arrays.values())
        return "read"

    contents = [mutated(originals[case % 2], random) for case in range(cases)]
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(attempt, range(cases), contents))
    refused, read_ = outcomes.count("refused"), outcomes.count("read")
    print(f"{refused} refused, {read_} read, {outcomes.count('crashed')} crashed the child")
    assert len(outcomes) == cases
    assert refused > cases / 10 and read_ > cases / 40  # the damage is neither total nor none
