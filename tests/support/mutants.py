"""Damaged copies of every kind of file that is read from outside, and what must become of each: it is read, or refused
in sentences that can be printed.

    python tests/support/mutants.py --count 100000 --jobs 2 --out DIR

DIR keeps each batch and a table of them, results.parquet; an interrupted campaign goes on by the same command.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gen.presets import find_presets
from gen.robot.description import RobotError
from gen.robot.load_robot import load as load_robot
from hdagen.adoption import verdict
from hdagen.arm.build_loader import PlantError
from hdagen.blind import calibrate
from hdagen.campaign import result_store
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.installation import describe_installation
from hdagen.campaign.task import Outcome, Status, Task, TaskFile, TaskFolder
from hdagen.data_quality.log_triage import triage
from hdagen.diagnosis.decision import calibration
from hdagen.fleet import fleet_diagnosis, fleet_file, fleet_page, machine_task
from hdagen.log.data_table import LogError
from hdagen.log.measured_log import read, write
from hdagen.model_import.model_file import ModelError
from hdagen.model_import.robot_writing import import_model
from hdagen.mpc.configuration import read_configuration
from hdagen.prediction.closed_loop_replay import read_controller

SLOWEST = 20.0  # s
MOST_MEMORY = 2 << 30  # bytes
REFUSALS = (LogError, PlantError, RobotError, ModelError, calibration.CalibrationError)
BATCH = 500  # mutants of one process of a campaign


class Hang(BaseException):
    """A file that takes longer than SLOWEST."""


@dataclass(frozen=True)
class Kind:
    """Files of one kind: what is damaged, by name; how one is read; ``share`` of all mutants."""

    name: str
    seeds: dict[str, bytes]
    reads: Callable[[Path], object]
    share: int = 1


# -- what is damaged --------------------------------------------------------------------------------------------------


def motion(rows: int = 240) -> dict[str, np.ndarray]:
    """Columns of a log of two joints."""
    t = np.arange(rows) / 1000
    columns = {"time": t}
    for joint in (1, 2):
        swing = np.sin(5 * t + joint)
        columns |= {
            f"motor_current_command_{joint}": 2 * swing,
            f"motor_current_{joint}": 2 * np.sin(5 * (t - 0.002) + joint),
            f"motor_position_{joint}": 80 * swing,
            f"joint_position_{joint}": swing,
        }
    return columns


COLUMNS = """ignore = ["spare"]
[time]
unit = "ms"
duplicates = "first"
[motor_current_1]
from = "motor_current_2"
unit = "mA"
scale = 3.0
sign = -1
shift_rows = 1
[motor_position_1]
unit = "counts"
counts_per_turn = 4096
wrap = "turn"
joint_side_ratio = 100
[joint_position_2]
subtract = "joint_position_1"
unit = "deg"
fill = "linear"
offset = 0.5
[motor_torque_2]
value = 0.0
"""
CONTROLLER = """[[joint]]
kp = 8.0
kv = 0.5
velocity_filter_samples = 2
limit = 5.0
encoder = "motor"
[[joint]]
kp = 9
kv = 0.7
torque_scale = -1.0
"""
PREDICTIVE = """[mpc]
nodes = 12
node = 0.02
space = "tip"
[weights]
position = 2.0
torque = 1e-3
[limits]
tip_speed = 0.4
joint_low = [-1.0, -2.0]
joint_high = 2.5
[[wall]]
normal = [0.0, 1.0]
offset = 0.1
stiffness = 1e4
force = 5.0
"""
FLEET = """[[machine]]
robot = "paper"
log = "log.csv"
columns = "columns.toml"
[[machine]]
robot = "emps"
log = "log.csv"
hold_out = "log.csv"
name = "Press 2"
"""
DIAGNOSIS: dict[str, Any] = {
    "schema": 2,
    "verdict": ["stribeck_friction@2", "unknown@1"],
    "sure": True,
    "gap": {"before": 30.0, "after": 2.0, "floor": 1.0, "shrink": 15.0},
    "causes": [
        {
            "effect": "stribeck_friction",
            "joint": 2,
            "probability": 0.9,
            "parameters": {"stribeck_torque": {"value": 0.01, "std": 1e-3}, "stribeck_speed": 3.0},
        }
    ],
    "hypotheses": [{"effects": ["stribeck_friction@2", "unknown@1"], "probability": 0.8}],
    "parameters": {"mass_1": 1.0, "coulomb_friction_1": {"value": 0.01}},
    "data": {"repaired": [{"what": "Cut."}], "warnings": ["Late."]},
    "robot": {"name": "arm", "sha256": "ab"},
}


def parquets(folder: Path) -> dict[str, bytes]:
    """One log as Parquet in several ways."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = motion()
    stamped = columns | {"time": pa.array((1e9 * columns["time"]).astype(np.int64), pa.timestamp("ns"))}
    ways: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "checked": (columns, {"compression": "zstd", "write_page_checksum": True}),
        "snappy": (columns, {"compression": "snappy", "row_group_size": 100}),
        "plain": (columns, {"compression": "none", "use_dictionary": False}),
        "stamped": (stamped, {"compression": "gzip", "data_page_version": "2.0"}),
    }
    for name, (table, how) in ways.items():
        pq.write_table(pa.table(table), folder / name, **how)
    return {name: (folder / name).read_bytes() for name in ways}


def mats(folder: Path) -> dict[str, bytes]:
    """One log as .mat in several ways."""
    import scipy.io

    ways: dict[str, dict[str, Any]] = {
        "packed": {"do_compression": True},
        "plain": {"do_compression": False},
        "four": {"format": "4"},
    }
    for name, how in ways.items():
        scipy.io.savemat(folder / f"{name}.mat", motion(), **how)
    return {name: (folder / f"{name}.mat").read_bytes() for name in ways}


MJCF = """<mujoco model="two"><compiler angle="radian"/><default><joint damping="0.1"/></default><worldbody>
<body name="a" pos="0 0 0.3"><joint name="j" axis="0 1 0" range="-1 1" armature="0.1"/>
<inertial pos="0 0.1 0" mass="2" fullinertia="0.03 0.02 0.03 0.001 0 0.002"/>
<body name="b" quat="1 1 0 0"><joint name="k" type="slide"/><geom size="0.1" mass="1"/><site name="t"/></body></body>
</worldbody><actuator><motor joint="j" gear="3" ctrlrange="-1 1"/></actuator></mujoco>"""
URDF = """<robot name="two"><link name="r"/><joint name="j" type="revolute"><parent link="r"/><child link="a"/>
<origin xyz="0 0 0.3" rpy="0.1 0 1.5708"/><axis xyz="0 0 1"/><limit effort="20" velocity="3" lower="-1" upper="1"/>
<dynamics damping="0.5" friction="0.2"/></joint><link name="a"><inertial><origin xyz="0.1 0 0" rpy="0.3 0 0"/>
<mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def kinds(folder: Path) -> tuple[Kind, ...]:
    """Every kind, its undamaged files made; ``folder`` keeps what they refer to."""
    write(motion(), folder / "log.csv")
    (folder / "columns.toml").write_text(COLUMNS)
    text = (folder / "log.csv").read_text()
    texts = {
        "commas": text,
        "semicolons": "# taken on a Monday\n" + text.replace(",", ";").replace(".", ","),
        "tabs": text.replace(",", "\t").replace("\n", "\r\n"),
    }
    robots = {name: Path(find_presets()[name]).read_bytes() for name in ("paper", "emps")}
    fits = [{"log_odds": 0.1 * k, "right": k % 3 > 0} for k in range(40)]
    data = {"schema": calibrate.DATA_SCHEMA, "kind": "single", "seed_hash": "0" * 64, "cases": fits}

    def through(path: Path) -> object:
        return read(folder / "log.csv", path, 2, holes=True)

    def kept(path: Path) -> object:
        (folder / "a" / "task.json").write_bytes(path.read_bytes())
        return told(folder)

    task = kept_task(folder)

    return (
        Kind("log.csv", {name: one.encode() for name, one in texts.items()}, looked_at, 30),
        Kind("log.parquet", parquets(folder), looked_at, 20),
        Kind("log.mat", mats(folder), looked_at, 0),  # by a process each: asked for by name
        Kind("columns.toml", {"columns": COLUMNS.encode()}, through, 12),
        Kind("robot.toml", robots, load_robot, 10),
        Kind("fleet.toml", {"fleet": FLEET.encode()}, lambda path: fleet_file.read_fleet(beside(path, folder)), 8),
        Kind("controller.toml", {"controller": CONTROLLER.encode()}, read_controller, 8),
        Kind("mpc.toml", {"predictive": PREDICTIVE.encode()}, read_configuration, 8),
        Kind("model.xml", {"mjcf": MJCF.encode()}, lambda path: import_model(str(path)), 0),
        Kind("model.urdf", {"urdf": URDF.encode()}, lambda path: import_model(str(path)), 0),
        Kind("diagnosis.json", {"diagnosis": json.dumps(DIAGNOSIS).encode()}, verdict.read_verdict, 10),
        Kind("task.json", {"task": task}, kept, 6),
        Kind("calibration.json", {"frozen": calibration.CALIBRATION_FILE.read_bytes()}, calibration.read, 2),
        Kind(
            "cases.json",
            {"data": json.dumps(data).encode()},
            lambda path: calibrate.freeze_calibration([path], folder / "f"),
            1,
        ),
    )


def looked_at(path: Path) -> object:
    """The log, every other time with its holes, and a look at what it holds."""
    holes = path.stat().st_size % 2 == 1
    log = read(path, holes=holes)
    if log.n_joints <= 2 and not holes:
        triage(log, [80.0] * log.n_joints)
    return log


def beside(path: Path, folder: Path) -> Path:
    """A copy of a fleet.toml where its logs are."""
    copy = folder / "fleet.toml"
    copy.write_bytes(path.read_bytes())
    return copy


def machine_of(folder: Path) -> fleet_file.FleetMachine:
    """The machine of a fleet in ``folder``."""
    return fleet_file.FleetMachine("a", "paper", folder / "log.csv", None, None)


def kept_task(folder: Path) -> bytes:
    """The task.json of a machine that is diagnosed."""
    (folder / "a").mkdir(exist_ok=True)
    task = machine_task.make_machine_task(machine_of(folder))
    found = DIAGNOSIS | {"parameters": {"mass_1": {"value": 1.0, "std": 0.1, "unit": "kg"}}}
    causes = [cause | {"parameters": {}} for cause in found["causes"]]
    row = machine_task.summarize_diagnosis(found | {"causes": causes})
    outcome = Outcome(Status.DONE, row, seconds=1.0, processor_seconds=1.0)
    result_store.ResultStore(folder).keep_outcome(task, task.hash_inputs(), outcome)
    return (folder / "a" / "task.json").read_bytes()


def told(folder: Path) -> object:
    """Table and page of a fleet of one machine, which an earlier run diagnosed."""
    machine = machine_of(folder)
    outcome = result_store.ResultStore(folder).find_finished(machine_task.make_machine_task(machine))
    if outcome is None:
        raise PlantError("it is diagnosed again.")
    result_store.ResultStore(folder).write_table({"a": outcome})
    results = [fleet_diagnosis.MachineResult(machine, outcome)]
    fleet_diagnosis.write_json(folder / "fleet.json", fleet_diagnosis.summarize_fleet(results))
    fleet_page.write_fleet_page(folder / "fleet.html", folder / "fleet.toml", results)
    return results


# -- how it is damaged ------------------------------------------------------------------------------------------------

WORDS = [
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e309", b"1e-320", b"-0.0", b"0x" + b"f" * 6000, b"7" * 330, b"7" * 5000),
    *(b"", b'"', b"'", b",", b";", b"\t", b"\n", b"\r\n", b"\0", b"\x1b[2J", b"\x07", b"\x7f", b"\xff\xfe", b"\xc3"),
    *(b"[", b"]", b"{", b"}", b"=", b".", b":", b'"""', b"\\u001b", b"\\n", b"null", b"true", b"{}", b"[]", b"-", b"#"),
    *(b"[" * 3000, b'{"a":' * 3000, b"a." * 3000, b"9" * 140_000, b'"' + b"x" * 140_000 + b'"', b"[[joint]]\n"),
    *("²".encode(), "\u202e".encode(), "\u2028".encode(), b"1979-05-27", b"../../x", b"/dev/zero", b"<script>", b"%s"),
    *(b"time", b"tip_force_x", b"motor_position_0", b"joint_position_99", b"[time]\n", b'"turn"', b"unknown@1", b"@99"),
]


def flip(content: bytearray, at: int, chance: random.Random) -> None:
    content[at] ^= 1 << chance.randrange(8)


def overwrite(content: bytearray, at: int, chance: random.Random) -> None:
    content[at : at + 4] = chance.choice([b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", chance.randbytes(4)])


def cut(content: bytearray, at: int, chance: random.Random) -> None:
    del content[at : at + chance.choice([1, 3, 30, 300])]


def end(content: bytearray, at: int, _: random.Random) -> None:
    del content[at:]


def insert(content: bytearray, at: int, chance: random.Random) -> None:
    content[at:at] = chance.choice(WORDS)


def replace(content: bytearray, at: int, chance: random.Random) -> None:
    word = chance.choice(WORDS)
    content[at : at + len(word)] = word


def double(content: bytearray, at: int, chance: random.Random) -> None:
    content[at:at] = content[at : at + chance.choice([5, 50, 500])]


def value(content: bytearray, at: int, chance: random.Random) -> None:
    """Another word in place of what stands between the next delimiters."""
    ends = [k for mark in (b",", b"=", b"\n", b"[", b"]", b":", b"}") if (k := content.find(mark, at)) >= 0]
    begin = min(ends, default=at) + 1
    ends = [k for mark in (b",", b"\n", b"]", b"}") if (k := content.find(mark, begin)) >= 0]
    content[begin : min(ends, default=begin)] = chance.choice(WORDS)


def swap(content: bytearray, _: int, chance: random.Random) -> None:
    """Two lines exchanged."""
    lines = content.split(b"\n")
    i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    content[:] = b"\n".join(lines)


DAMAGES = (flip, flip, overwrite, cut, end, insert, replace, double, value, value, swap)


def mutant(kind: Kind, number: int) -> bytes:
    """The damaged file of that number: the same in every process."""
    chance = random.Random(f"{kind.name} {number}")
    content = bytearray(chance.choice(list(kind.seeds.values())))
    for _ in range(chance.choice([1, 1, 1, 2, 4, 16])):
        near = chance.choice([len(content), min(len(content), 400)])  # headers are where most is decided
        at = chance.randrange(near) if near else 0
        if content or chance.random() < 0.5:
            chance.choice(DAMAGES if content else (insert,))(content, at, chance)
    return bytes(content)


# -- what becomes of it -----------------------------------------------------------------------------------------------


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raises Hang where the block takes longer."""

    def ring(*_: object) -> None:
        raise Hang(f"longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def fate(kind: Kind, content: bytes, folder: Path) -> str:
    """What becomes of a file: read, refused, or what went wrong, be it a hang, an exception or a warning."""
    path = folder / f"mutant.{kind.name.rpartition('.')[2]}"
    path.write_bytes(content)
    try:
        with limited(SLOWEST), warnings.catch_warnings():
            warnings.simplefilter("error")
            kind.reads(path)
    except REFUSALS as error:
        said = getattr(error, "problems", None) or str(error).split("\n")
        poor = [line for line in said if not line.strip() or not line.isprintable()]
        return f"cannot be printed: {poor[0]!r:.300}" if poor else "refused"
    except (Exception, Hang):
        return f"not foreseen: {traceback.format_exc()[-1500:]}"
    return "read"


def drawn(every: tuple[Kind, ...], count: int) -> Iterator[tuple[Kind, int]]:
    """``count`` pairs of a kind, by its share, and a number."""
    turns = [kind for kind in every for _ in range(kind.share)]
    random.Random(0).shuffle(turns)
    for number in range(count):
        yield turns[number % len(turns)], number


def tried(every: tuple[Kind, ...], count: int, folder: Path, first: int = 0) -> tuple[Counter[str], list[str]]:
    """How many mutants were read and refused, by kind; and what went wrong, with the number to make it again."""
    counts: Counter[str] = Counter()
    wrong = []
    for kind, number in drawn(every, first + count):
        if number < first:
            continue
        what = fate(kind, mutant(kind, number), folder)
        if what in ("read", "refused"):
            counts[f"{kind.name} {what}"] += 1
        else:
            wrong.append(f"{kind.name} {number} {what}")
    return counts, wrong


def try_batch(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """`tried` in a process of its own, whose death and memory are faults, too."""
    first, count, names = (parameters[key] for key in ("first", "count", "names"))
    command = [sys.executable, __file__, "--batch", str(first), "--count", str(count), "--kinds", *names]
    done = subprocess.run(command, cwd=folder.out.parent, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"counts": {}, "wrong": [f"from {first} on: the process died ({done.returncode}): {done.stderr[-500:]}"]}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    if answer["memory"] > MOST_MEMORY:
        answer["wrong"].append(f"from {first} on: {answer['memory']} bytes of memory")
    (folder.out / "batch.json").write_text(json.dumps(answer, indent=1))
    return {"counts": answer["counts"], "wrong": answer["wrong"]}


def print_batch(names: list[str], first: int, count: int, folder: Path) -> None:
    """What `try_batch` reads: a batch's counts, faults and memory."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    every = tuple(kind for kind in kinds(folder) if kind.name in names or (not names and kind.share))
    if names:
        every = tuple(Kind(kind.name, kind.seeds, kind.reads) for kind in every)
    counts, wrong = tried(every, count, folder, first)
    most = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps({"counts": counts, "wrong": wrong, "memory": most}))


def campaign(names: list[str], count: int, folder: Path, jobs: int = 1) -> tuple[Counter[str], list[str], bool]:
    """Counts and faults of batches of BATCH mutants, each a task that ``folder`` keeps, and whether some are left."""
    own = {"mutants.py": TaskFile(Path(__file__), "mutants.py")}
    shared = {"names": names, "code": describe_installation()["code"]}
    tasks = [
        Task(f"from {first} on", try_batch, {"first": first, "count": min(BATCH, count - first), **shared}, own)
        for first in range(0, count, BATCH)
    ]
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    store = result_store.ResultStore(folder)
    with store.hold_lock(), open_cluster(ClusterRequest(jobs=jobs), say) as runner:
        outcomes, interrupted = run_campaign(tasks, store, runner, say)
    for name, outcome in outcomes.items():
        counts.update(outcome.row.get("counts", {}))
        wrong += outcome.row.get("wrong", [])
        wrong += [f"{name}: {words}" for words in outcome.messages]
    return counts, wrong, interrupted


def say(words: str) -> None:
    """A sentence on the campaign, on standard error."""
    print(words, file=sys.stderr, flush=True)


def main() -> int:
    """A campaign; exit code 1 where something went wrong, 130 where it was interrupted."""
    p = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    p.add_argument("--count", type=int, default=100_000)
    p.add_argument("--kinds", nargs="*", default=[], help="such as log.mat (default: all but that)")
    p.add_argument("--jobs", type=int, default=1, help="batches at the same time")
    p.add_argument("--out", type=Path, metavar="DIR", help="keeps what is finished (default: nothing is kept)")
    p.add_argument("--batch", type=int, default=None, metavar="FIRST", help="only one batch, from this mutant on, here")
    options = p.parse_args()
    if options.batch is not None:
        with tempfile.TemporaryDirectory() as folder:
            print_batch(options.kinds, options.batch, options.count, Path(folder))
        return 0
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        kept = options.out or Path(place)
        kept.mkdir(parents=True, exist_ok=True)
        counts, wrong, interrupted = campaign(options.kinds, options.count, kept, options.jobs)
    print(json.dumps({"counts": counts, "seconds": round(time.monotonic() - begun), "wrong": len(wrong)}, indent=1))
    print("\n".join(wrong[:20]))
    if interrupted:
        return 130
    return 1 if wrong else 0


if __name__ == "__main__":
    from mutants import main as run_here  # by the name that workers can import

    sys.exit(run_here())
