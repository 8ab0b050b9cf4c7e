"""A command that is killed at random moments, one time after the other; prints what was found as JSON.

kill_commands.py COMMAND FOLDER COUNT SEED makes COUNT kills of `hdagen COMMAND` (adopt, blind, diagnose, fleet, paper),
which writes into FOLDER/out; then it runs once to its end.

It forks itself when all is imported. What takes long and writes nothing is done before (the diagnosis) or stands for
itself (the diagnosis of a fleet's machines and of sealed cases).
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import trivial_tasks
from replayed import FLEXIBLE, diagnosis
from test_diagnosis_report import TRUTHS, seen

from gen.builder.build import build_robot
from gen.effects import ALL
from hdagen import __main__
from hdagen.arm.compiled_arm import Arm
from hdagen.blind import sealed_check as blind
from hdagen.diagnosis import pipeline as diagnosed
from hdagen.diagnosis.data.split import LogPortion, mark_holdout_blocks
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.holdout.unseen_motion import HoldoutMotion
from hdagen.fleet import fleet_diagnosis
from hdagen.log.measured_log import write

TOKEN = f"HDAGEN_TEST_KILLED_{os.getpid()}"  # in the environment of all that the command starts


# -- what is run ------------------------------------------------------------------------------------------------------


def prepare_adopt(folder: Path) -> list[str]:
    (folder / "robot.toml").write_text(FLEXIBLE)
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis()))
    (folder / "out").mkdir(exist_ok=True)
    named = ["diagnosis.json", "robot.toml", "out/new.toml"]
    return ["adopt", *(str(folder / name) for name in named[:2]), "--out", str(folder / named[2]), "--force"]


def prepare_diagnose(folder: Path) -> list[str]:
    names = tuple(one.name for one in ALL)
    arm = Arm(build_robot(str(robot(folder)), "portable", Path(os.environ["HDAGEN_BUILD"]), names)[0])
    sight, said, log, before, after = seen(arm, {"cable_spring@2": TRUTHS["cable_spring@2"][0]})
    said["robot"]["identity"] = "0" * 64
    held = LogPortion(log, mark_holdout_blocks(log.time))
    motion = HoldoutMotion(held, lambda _: before, before, before, before)
    found = SimpleNamespace(content=said, after=after, holdout=motion, residual_torque=sight, failures=())
    write(log, folder / "log.parquet")
    whole = Diagnosis(found, folder / "robot.toml", (str(folder / "log.parquet"),), ())  # type: ignore[arg-type]
    setattr(diagnosed, "diagnose", lambda *_, **__: whole)  # noqa: B010 - its type is another
    return ["diagnose", str(folder / "robot.toml"), str(folder / "log.parquet"), "--out", str(folder / "out")]


def robot(folder: Path) -> Path:
    (folder / "robot.toml").write_text(FLEXIBLE)
    return folder / "robot.toml"


def prepare_fleet(folder: Path) -> list[str]:
    fleet_diagnosis.diagnose_fleet = partial(fleet_diagnosis.diagnose_fleet, make_task=trivial_tasks.make_stand_in)
    robot(folder)
    text = ""
    for name in "abcd":
        (folder / f"{name}.csv").write_text("find payload@2")
        text += f'[[machine]]\nrobot = "robot.toml"\nlog = "{name}.csv"\n'
    (folder / "fleet.toml").write_text(text)
    return ["diagnose", "--fleet", str(folder / "fleet.toml"), "--jobs", "1", "--out", str(folder / "out")]


def prepare_paper(folder: Path) -> list[str]:
    return ["paper", "table1", "fig3b", "--out", str(folder / "out")]


BLIND = """#!{python}
import json, shutil, sys
from pathlib import Path
out = Path(sys.argv[sys.argv.index("--out") + 1])
if sys.argv[1] == "diagnose":
    out.mkdir(exist_ok=True)
    said = {{"schema": 2, "verdict": [], "sure": False, "causes": [], "hypotheses": [], "gap": {{}}}}
    (out / "diagnosis.json").write_text(json.dumps(said))
else:
    shutil.copy("hold_out.parquet", out)
"""


def prepare_blind(folder: Path) -> list[str]:
    (folder / "stand_in.py").write_text(BLIND.format(python=sys.executable))
    stand_in = (sys.executable, str(folder / "stand_in.py"))
    setattr(blind, "Check", partial(blind.Check, program=stand_in))  # noqa: B010 - it is a class
    given = ["--kind", "none", "--cases", "2", "--seed", "of a test", "--jobs", "2", "--seconds", "4"]
    return ["blind", *given, "--out", str(folder / "out")]


PREPARE = {name.removeprefix("prepare_"): f for name, f in globals().items() if name.startswith("prepare_")}


# -- what is found ----------------------------------------------------------------------------------------------------


def ends_with(words: bytes) -> Callable[[Path], bool]:
    return lambda path: path.read_bytes().rstrip().endswith(words)


WHOLE: dict[str, Callable[[Path], object]] = {
    ".json": lambda path: json.loads(path.read_text()),
    ".toml": lambda path: tomllib.loads(path.read_text()),
    ".parquet": pq.read_table,
    ".html": ends_with(b"</html>"),
    ".svg": ends_with(b"</svg>"),
    ".png": ends_with(b"IEND\xaeB\x60\x82"),
}


def find_broken(folder: Path) -> list[str]:
    """The files that are half-written; parts, whose names begin with a point, count as none."""
    broken = []
    for path in folder.rglob("[!.]*"):
        if path.is_file() and path.suffix in WHOLE:
            try:
                whole = WHOLE[path.suffix](path) is not False
            except (ValueError, OSError):
                whole = False
            broken += [] if whole else [path.name]
    return broken


def find_parts(folder: Path) -> list[str]:
    """What stands beside files while they are written."""
    return [path.name for path in folder.rglob(".*") if ".part-" in path.name]


def find_orphans() -> list[int]:
    """Processes that the command started and that live."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            lives = place.joinpath("stat").read_text().rpartition(")")[2].split()[0] != "Z"
            if lives and f"{TOKEN}=1".encode() in place.joinpath("environ").read_bytes().split(b"\0"):
                found.append(int(place.name))
        except OSError:
            continue
    return found


# -- the kills --------------------------------------------------------------------------------------------------------


def started(arguments: list[str]) -> int:
    """The process that runs the command; it says nothing."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.environ[TOKEN] = "1"
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        code = __main__.main(arguments)
    finally:
        os._exit(code)


def await_true(what: Callable[[], object], seconds: float) -> bool:
    until = time.monotonic() + seconds
    while not what() and time.monotonic() < until:
        time.sleep(1e-3)
    return bool(what())


def has_ended(child: int) -> bool:
    """Whether a child waits to be asked for its exit code."""
    return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def has_parts_or_ended(out: Path, child: int) -> bool:
    """Whether files are being written, or no longer."""
    return bool(find_parts(out)) or has_ended(child)


def begin_anew(out: Path) -> None:
    """Empty the folder into which the command writes."""
    shutil.rmtree(out)
    out.mkdir()


def main(command: str, folder: Path, count: int, seed: int) -> dict[str, object]:
    """Counts of kills and of parts that they left; what was half-written; orphans; the exit code of the run to the end
    and the parts that it left."""
    rng, out = random.Random(seed), folder / "out"
    arguments = PREPARE[command](folder)
    os.waitpid(started(arguments), 0)  # what it builds is there from now on
    found: dict[str, Any] = {"kills": 0, "left": 0, "broken": find_broken(out), "orphans": 0}
    begin_anew(out)
    begun = time.monotonic()
    os.waitpid(started(arguments), 0)
    took = time.monotonic() - begun
    for kill in range(count):
        if kill % 3 == 0:
            begin_anew(out)
        child = started(arguments)
        if kill % 2:  # every other one surely while files are written
            await_true(partial(has_parts_or_ended, out, child), took)
            time.sleep(rng.uniform(0.0, 2e-3))
        else:
            await_true(partial(has_ended, child), rng.uniform(0.0, took))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        found["kills"] += 1
        found["broken"] += find_broken(out)
        found["orphans"] += not await_true(lambda: not find_orphans(), 10.0)
        found["left"] += bool(find_parts(out))
    _, status = os.waitpid(started(arguments), 0)
    files = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
    return found | {"code": os.waitstatus_to_exitcode(status), "parts": find_parts(out), "files": files}


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))))
