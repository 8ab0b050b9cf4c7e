"""Opens what runs tasks: this process, a cluster of processes on this machine, or one at an address."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.cluster_request import ClusterRequest, format_bytes
from hdagen.campaign.task_runner import DaskRunner, InProcessRunner, TaskRunner

if TYPE_CHECKING:
    from distributed import Client, LocalCluster

ANSWER_SECONDS = 10.0  # s in which a scheduler must answer
_UNUSED_CHECKS = ("idle-timeout", "no-workers-timeout")  # of the scheduler, four times a second
_REPORT_INTERVAL = 5.0  # s between reports of workers here; Dask's own is 0.5 s, which costs as much as the rest
_LOCAL_ADDRESS = "127.0.0.1"
_SETTINGS: dict[str, Any] = {
    **{f"distributed.worker.memory.{name}": False for name in ("target", "spill", "pause")},  # a kill is the limit
    "distributed.admin.large-graph-warning-threshold": "1TB",  # logs travel in their task
    "distributed.deploy.lost-worker-timeout": "8760h",  # a worker that starts again is not given up
    "distributed.worker.memory.monitor-interval": "500ms",
    # What Dask does on its own while tasks run, which takes 3 % of a processor on each worker:
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.tick.cycle": "10s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.system-monitor.disk": False,
    "distributed.scheduler.work-stealing": False,  # this side chooses the worker
    "distributed.scheduler.active-memory-manager.start": False,
    # What Dask remembers of tasks that have ended:
    "distributed.admin.low-level-log-length": 10,
    "distributed.admin.system-monitor.log-length": 10,
    "distributed.diagnostics.computations.max-history": 1,
}


@contextmanager
def open_cluster(
    asked: ClusterRequest, say: Callable[[str], None], needs_processes: bool = False
) -> Iterator[TaskRunner]:
    """Open what runs tasks.

    Args:
        asked: Where tasks run.
        say: Hears a sentence on addresses and workers.
        needs_processes: Whether tasks must not run in this process, which knows what they may not know.

    Yields:
        The runner.

    Raises:
        PlantError: The request cannot be used, or no scheduler answers; one line a problem.

    """
    if problems := list(asked.list_problems()):
        raise PlantError("\n".join(problems))
    if not asked.is_remote and asked.jobs == 1 and not needs_processes:
        yield InProcessRunner()
        return
    with _configure_dask(), _connect(asked, say) as (client, memory):
        runner = DaskRunner(client, say, memory)
        try:
            yield runner
        finally:
            runner.cancel_all()


@contextmanager
def _configure_dask() -> Iterator[None]:
    """The settings of Dask for this run, and its log kept off the terminal."""
    import dask
    import distributed.scheduler  # registers settings and loggers, too

    settings = dict(_SETTINGS)
    if not _has_dashboard():
        settings["distributed.scheduler.http.routes"] = []
    silent = logging.CRITICAL + 1
    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(silent)
    try:
        # The scheduler of this process tells workers how often they report; a lost one is noticed without it.
        with dask.config.set(settings), patch.object(distributed.scheduler, "heartbeat_interval", _tell_interval):
            yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


@contextmanager
def _connect(asked: ClusterRequest, say: Callable[[str], None]) -> Iterator[tuple[Client, str]]:
    """A client of the cluster, and how much memory a task may take. Raises PlantError."""
    from distributed import Client, LocalCluster, Security

    if asked.is_remote:
        with _connect_to_address(asked, say) as client:
            yield client, ""
        return
    memory: Any = asked.count_memory_bytes() or "auto"
    cluster = LocalCluster(
        n_workers=asked.jobs,
        threads_per_worker=1,
        processes=True,
        host=_LOCAL_ADDRESS,
        protocol="tls://",
        security=Security.temporary(),
        dashboard_address=f"{_LOCAL_ADDRESS}:0",
        memory_limit=memory,
        silence_logs=logging.CRITICAL + 1,
        scheduler_sync_interval=3600,  # s
    )
    assert cluster.scheduler is not None
    for name in _UNUSED_CHECKS:
        cluster.scheduler.periodic_callbacks[name].callback_time = 60_000  # ms
    try:
        with Client(cluster) as client:
            if _has_dashboard():
                say(f"dashboard: {cluster.dashboard_link}")
            else:
                say("dashboard: none, as bokeh is not installed; `pip install bokeh` lets the next run have one.")
            yield client, _find_memory_limit(cluster)
    finally:
        with suppress(TimeoutError):
            cluster.close(timeout=5)


def _tell_interval(worker_count: int) -> float:
    """Seconds between a worker's reports."""
    return _REPORT_INTERVAL


def _has_dashboard() -> bool:
    """Whether the package that draws Dask's dashboard is installed."""
    return importlib.util.find_spec("bokeh") is not None


def _find_memory_limit(cluster: LocalCluster) -> str:
    """Memory of one worker, in words."""
    limits = [worker.memory_manager.memory_limit for worker in cluster.workers.values()]
    if not limits or not limits[0]:
        return ""
    return format_bytes(float(limits[0]))


@contextmanager
def _connect_to_address(asked: ClusterRequest, say: Callable[[str], None]) -> Iterator[Client]:
    from distributed import Client, Security

    address, security = asked.find_address(), None
    if asked.is_insecure and address.startswith("tcp://"):
        say(f"{address}: nothing is encrypted, and whoever reaches the scheduler runs programs on its workers.")
    if address.startswith("tls://"):
        security = Security(
            tls_ca_file=str(asked.tls_ca),
            tls_client_cert=str(asked.tls_cert),
            tls_client_key=str(asked.tls_key),
            require_encryption=True,
        )
    try:
        client = Client(address, security=security, timeout=ANSWER_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # an answer that never comes, a certificate that is refused or none
        raise PlantError(
            f"{address}: no scheduler answers within {ANSWER_SECONDS:g} s, or it does not take this certificate "
            f"({_shorten_reason(error)}); check address and certificates."
        ) from None
    try:
        if "dashboard" in client.scheduler_info()["services"]:
            say(f"dashboard, if the scheduler's computer has bokeh: {client.dashboard_link}")
        yield client
    finally:
        with suppress(OSError, RuntimeError):  # its scheduler is lost
            client.close(timeout=5)


def _shorten_reason(error: BaseException) -> str:
    reason: BaseException = error
    while reason.__cause__ is not None:
        reason = reason.__cause__
    lines = str(reason).splitlines() or [type(reason).__name__]
    return lines[0][:120]
