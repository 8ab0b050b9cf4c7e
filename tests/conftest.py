"""Fixtures of all tests: builds made once a session, the folder of real data, and the option for campaigns."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import scipy.linalg  # noqa: F401 -- with libraries of its own, which threads are limited of
from chromium import close_browser
from compiled import Compiled, load
from cpu_times import CpuTimes
from generator_in_process import find_or_run_generator
from kept_builds import find_builds, remove_old_builds
from replayed import FLEXIBLE, simulated
from threadpoolctl import threadpool_limits
from uncompiled import find_settings, load_uncompiled

from gen.builder.build import build_robot as make
from hdagen.adoption import robot_update, verdict
from hdagen.arm import build_loader
from hdagen.arm.compiled_arm import Arm
from hdagen.log.measured_log import Log
from hdagen.paper.prototype.virtual_prototype import PROTOTYPE, TABLE_1, Bench

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    """--campaign, --cpu-times."""
    parser.addoption(
        "--campaign", action="store_true", help="also run the tests marked campaign: long, many more cases"
    )
    parser.addoption(
        "--cpu-times", type=Path, metavar="FILE", help="add the processor time of each test to FILE, one JSON a line"
    )


def pytest_configure(config: pytest.Config) -> None:
    """The marker of slow tests; tests of a file stay with one worker; Ctrl-C for the programs that tests interrupt,
    where a shell that runs this in the background has it ignored."""
    find_builds()  # before a fixture moves the user's cache
    threadpool_limits(1)  # threads of linear algebra that wait for each other take the processors of the other workers
    if config.getoption("dist", "no") == "load":  # the fixtures of a module are then made once, and not by each worker
        config.option.dist = "worksteal"
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line("markers", "campaign: takes minutes; runs with --campaign only")
    if file := config.getoption("--cpu-times"):
        config.pluginmanager.register(CpuTimes(file.absolute()))


def pytest_unconfigure(config: pytest.Config) -> None:
    """The browser ends; builds that many runs have left are thrown away, by the process that started the workers."""
    close_browser()
    if not hasattr(config, "workerinput"):
        remove_old_builds()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Campaigns are skipped unless asked for."""
    if not config.getoption("--campaign"):
        for item in items:
            if item.get_closest_marker("campaign") is not None:
                item.add_marker(pytest.mark.skip(reason="a campaign; run it with --campaign"))


@pytest.fixture(scope="session", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of the session's own, which workers share; what a command or a test builds lies with all other builds,
    and what lies there is found without a child process."""
    out = tmp_path_factory.getbasetemp()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_loader, "run_generator", find_or_run_generator)
        patch.setenv("HDAGEN_BUILD", str(find_builds()))
        patch.setenv("XDG_CACHE_HOME", str((out.parent if "PYTEST_XDIST_WORKER" in os.environ else out) / "cache"))
        yield


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Compiled]:
    """build(robot, profile="portable", effects=()) -> Compiled; robot: a preset's name or a robot.toml's text."""
    texts = tmp_path_factory.mktemp("robots")
    made: dict[tuple[str, str, tuple[str, ...]], Compiled] = {}

    def built(robot: str, profile: str = "portable", effects: tuple[str, ...] = ()) -> Compiled:
        key = (robot, profile, effects)
        if key not in made:
            source = robot
            if "\n" in robot:
                path = texts / f"{hashlib.sha256(robot.encode()).hexdigest()[:16]}.toml"
                path.write_text(robot)
                source = str(path)
            made[key] = load(make(source, profile, find_builds(), effects)[0])
        return made[key]

    return built


@pytest.fixture(scope="session")
def bench(build: Callable[..., Compiled]) -> Bench:
    """The paper's virtual prototype with its builds, native; runs that tests share are made once."""
    return Bench(folders={robot: build(robot, "native").folder for robot in (PROTOTYPE, TABLE_1)})


@pytest.fixture(scope="module")
def arm(build: Callable[..., Compiled]) -> Arm:
    """The arm of the simulated log."""
    return Arm(build(FLEXIBLE).folder)


@pytest.fixture(scope="module")
def good(arm: Arm) -> Log:
    """A log without a mistake, under gravity, driven in open loop."""
    return simulated(arm, 3.0)


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models that `adopt` asks for are described and checked as ever, and not compiled."""
    for module in (verdict, robot_update):
        monkeypatch.setattr(module, "load", load_uncompiled)
    monkeypatch.setattr(robot_update, "find_stable_settings", find_settings)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real and made logs; skips where there is none."""
    folder = Path(os.environ.get("HDAGEN_DATA", DATA))
    if not folder.is_dir():
        pytest.skip(f"no logs: neither $HDAGEN_DATA nor {DATA} is a folder")
    return folder


@pytest.fixture
def mount(tmp_path: Path) -> Iterator[Callable[..., Path]]:
    """mount(options, place=…) -> a file system of its own; skips where this user may mount none."""
    made: list[Path] = []

    def mounted(options: str, place: Path | None = None) -> Path:
        folder = place or tmp_path / f"mount_{len(made)}"
        folder.mkdir()
        if shutil.which("mount") is None:
            pytest.skip("there is no mount to make a small file system with")
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            pytest.skip(f"needs the right to mount a file system of its own: {done.stderr.strip()}")
        made.append(folder)
        return folder

    yield mounted
    for folder in made:
        subprocess.run(["umount", str(folder)], check=True)
