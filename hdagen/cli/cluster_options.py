"""Options of commands that run many tasks: how many at a time here, or on which cluster."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hdagen.campaign.cluster_request import ClusterRequest

CLUSTER_OPTIONS = ("jobs", "scheduler", "scheduler_file", "tls_ca", "tls_cert", "tls_key", "insecure", "memory")


def add_cluster_options(parser: argparse.ArgumentParser, what: str, default_jobs: str) -> None:
    """Add the options.

    Args:
        parser: The parser of a command.
        what: What runs at the same time, in the plural.
        default_jobs: The default of --jobs, in words.

    """
    group = parser.add_argument_group("where tasks run", "docs/guides/clusters.md explains these options")
    group.add_argument("--jobs", type=int, metavar="J", help=f"{what} at the same time (default: {default_jobs})")
    group.add_argument("--memory", metavar="SIZE", help="memory of one task here, such as '2 GB' (default: its share)")
    group.add_argument("--scheduler", metavar="ADDRESS", help="run on this Dask cluster, such as tls://10.0.0.1:8786")
    group.add_argument("--scheduler-file", type=Path, metavar="FILE", help="the same, by the scheduler's own file")
    group.add_argument("--tls-ca", type=Path, metavar="PEM", help="certificate that signed all others")
    group.add_argument("--tls-cert", type=Path, metavar="PEM", help="certificate of this client")
    group.add_argument("--tls-key", type=Path, metavar="PEM", help="key of this client")
    group.add_argument("--insecure", action="store_true", help="take a tcp:// address, which nothing protects")


def refuse_file_as_folder(out: Path) -> None:
    """Refuse a file where a command keeps the results of its tasks, before anything is built.

    Args:
        out: What --out names.

    Raises:
        PlantError: It is a file.

    """
    from hdagen.arm.build_loader import PlantError

    if out.exists() and not out.is_dir():
        raise PlantError(f"--out {out} is a file; give a folder.")


def list_given_options(options: argparse.Namespace) -> list[str]:
    """List the options that were given.

    Args:
        options: The parsed arguments.

    Returns:
        The options as they are written.

    """
    return [f"--{name.replace('_', '-')}" for name in CLUSTER_OPTIONS if getattr(options, name) not in (None, False)]


def read_cluster_request(options: argparse.Namespace, default_jobs: int) -> ClusterRequest:
    """Read where tasks run.

    Args:
        options: The parsed arguments.
        default_jobs: Tasks at the same time where --jobs says nothing.

    Returns:
        The request, checked.

    Raises:
        PlantError: It cannot be used; one line a problem.

    """
    from hdagen.arm.build_loader import PlantError
    from hdagen.campaign.cluster_request import ClusterRequest

    jobs = default_jobs
    if options.jobs is not None:
        jobs = options.jobs
    asked = ClusterRequest(
        jobs,
        options.scheduler,
        options.scheduler_file,
        options.tls_ca,
        options.tls_cert,
        options.tls_key,
        options.insecure,
        options.memory,
    )
    problems = list(asked.list_problems())
    if asked.is_remote and options.jobs is not None:
        problems.append("--jobs: a cluster has its own workers; leave it out.")
    if problems:
        raise PlantError("\n".join(problems))
    return asked


def count_job_slots(threads_per_task: int) -> int:
    """Count the tasks that this machine's processors can work on at the same time.

    Args:
        threads_per_task: Threads that one task keeps busy.

    Returns:
        The count, at least 1.

    """
    return max((os.cpu_count() or 1) // threads_per_task, 1)
