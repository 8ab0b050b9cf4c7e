"""Clusters of separate processes, each with a folder, a cache and a home of its own, as on machines without a common
disk."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import trivial_tasks
from distributed import Security

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.campaign_run import run_campaign
from hdagen.campaign.cluster import open_cluster
from hdagen.campaign.cluster_request import ClusterRequest
from hdagen.campaign.result_store import ResultStore
from hdagen.campaign.task import Task

ROOT = Path(__file__).parents[2]
SUPPORT = Path(__file__).parent


@dataclass
class Site:
    """A scheduler and its workers; ``folder`` holds a folder for each of them, and the certificates."""

    folder: Path
    address: str = ""
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @property
    def certificates(self) -> dict[str, Path]:
        """The files of the certificates, by the names of their options."""
        return {
            "tls_ca": self.folder / "cert.pem",
            "tls_cert": self.folder / "cert.pem",
            "tls_key": self.folder / "key.pem",
        }

    def ask(self, **changes: object) -> ClusterRequest:
        """A request for this cluster."""
        return ClusterRequest(**({"scheduler": self.address} | self.certificates | changes))  # type: ignore[arg-type]

    def options(self) -> list[str]:
        """The options of a command that runs on this cluster."""
        words = ["--scheduler", self.address]
        for name, path in self.certificates.items():
            words += [f"--{name.replace('_', '-')}", str(path)]
        return words

    def start(self, name: str, module: str, *arguments: str, **environment: str) -> Path:
        """Starts a process of Dask with its own folder, home, cache and place for temporary files."""
        place = self.folder / name
        for part in ("home", "tmp", "work"):
            (place / part).mkdir(parents=True, exist_ok=True)
        own = {
            "HOME": str(place / "home"),
            "XDG_CACHE_HOME": str(place / "home" / "cache"),
            "TMPDIR": str(place / "tmp"),
            "PATH": os.environ["PATH"],
            "PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT))),
            "OMP_NUM_THREADS": "1",
            "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
        }
        secured = []
        for option, path in self.certificates.items():
            secured += [f"--{option.replace('_ca', '-ca-file').replace('_', '-')}", str(path)]
        with (place / "log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                [sys.executable, "-m", module, *arguments, *secured],
                cwd=place / "work",
                env=own | environment,
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        return place

    def start_scheduler(self, port: int = 0) -> None:
        """Starts the scheduler and waits for its address."""
        told = self.folder / "scheduler.json"
        told.unlink(missing_ok=True)
        where = ["--host", "127.0.0.1", "--port", str(port), "--protocol", "tls", "--dashboard-address", "127.0.0.1:0"]
        self.start("scheduler", "distributed.cli.dask_scheduler", *where, "--scheduler-file", str(told))
        await_true(lambda: told.exists() and told.stat().st_size > 10)
        time.sleep(0.1)
        self.address = json.loads(told.read_text())["address"]

    def start_worker(self, name: str, *more: str, **environment: str) -> Path:
        """Starts a worker under a nanny, which starts it again when it dies."""
        where = [self.address, "--host", "127.0.0.1", "--nthreads", "1", "--dashboard-address", "127.0.0.1:0", *more]
        return self.start(name, "distributed.cli.dask_worker", *where, **environment)

    def kill(self, name: str) -> None:
        """kill -9 of a process and of all that it started."""
        process = self.processes.pop(name)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def log(self, name: str) -> str:
        """What a process said."""
        return (self.folder / name / "log").read_text()


def start_client(site: Site, out: Path, count: int, calls: Path) -> subprocess.Popen[bytes]:
    """Starts a client of a cluster, which runs `main` here."""
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(SUPPORT)))}
    command = [sys.executable, __file__, str(site.folder), site.address, str(out), str(count), str(calls)]
    with (site.folder / "client.log").open("ab") as log:
        return subprocess.Popen(command, env=os.environ | paths, stdout=log, stderr=log, start_new_session=True)


def main(folder: str, address: str, out: str, count: str, calls: str) -> int:
    """Squares so many numbers on a cluster; exit code 2 with a sentence where the scheduler is lost."""
    store, site = ResultStore(Path(out)), Site(Path(folder), address)
    tasks = [
        Task(f"square {k}", trivial_tasks.write_square, {"number": k, "seconds": 0.02, "calls": calls})
        for k in range(int(count))
    ]
    try:
        with store.hold_lock(), open_cluster(site.ask(), print) as runner:
            run_campaign(tasks, store, runner, print)
    except PlantError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def await_true(is_so: object, seconds: float = 300.0) -> None:
    """Waits until something holds."""
    until = time.monotonic() + seconds
    while not is_so():  # type: ignore[operator]
        assert time.monotonic() < until, "it never came true"
        time.sleep(0.02)


def write_certificates(folder: Path) -> None:
    """A certificate that signs itself, and its key."""
    made = Security.temporary().get_tls_config_for_role("client")
    (folder / "cert.pem").write_text(made["cert"])
    (folder / "key.pem").write_text(made["key"])


@contextmanager
def open_site(folder: Path, workers: Sequence[str] = ()) -> Iterator[Site]:
    """A scheduler with these workers; all of them end with the block."""
    folder.mkdir(parents=True, exist_ok=True)
    write_certificates(folder)
    site = Site(folder)
    try:
        site.start_scheduler()
        for name in workers:
            site.start_worker(name)
        await_true(lambda: all("Registered" in site.log(name) for name in workers))
        yield site
    finally:
        for name in list(site.processes):
            site.kill(name)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
