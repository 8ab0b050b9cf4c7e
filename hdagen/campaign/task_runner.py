"""Runs tasks in this process, or on the workers of a Dask cluster, one task a worker at a time."""

from __future__ import annotations

import queue
import time
import uuid
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from hdagen.arm.build_loader import PlantError
from hdagen.campaign.build_transport import pack_build
from hdagen.campaign.file_transport import SentFiles
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.campaign.task_execution import ENDED, NEEDS_BUILD, NEEDS_FILES, execute_on_worker, execute_payload
from hdagen.campaign.worker_admission import Admission, end_process

if TYPE_CHECKING:
    from distributed import Client, Future

MOST_BUILDS_OF_TASK = 8  # builds that a worker without a compiler may ask for
MOST_KILLED_WORKERS = 3  # workers that a task may end before it is refused
_TIME_CHECK_INTERVAL = 1.0  # s between looks at time limits and workers
_LONELY_CHECK_INTERVAL = 0.2  # s between looks while no task is on a worker
_REPLY_SECONDS = 60.0  # s in which the result of a task that has ended must arrive
_LONGEST_WAIT_FOR_WORKERS = 600.0  # s without any worker


TaskEnds = Generator[tuple[Task, Outcome], None, None]


class TaskRunner(Protocol):
    """Anything that runs tasks."""

    def run_tasks(self, tasks: Iterable[Task]) -> TaskEnds:
        """Run tasks.

        Args:
            tasks: The tasks, taken one by one as there is room.

        Yields:
            Each task with its outcome, as it ends.

        Raises:
            PlantError: No further task can be run.

        """


class InProcessRunner:
    """Runs one task after the other in this process."""

    def run_tasks(self, tasks: Iterable[Task]) -> TaskEnds:
        """Run tasks, one after the other.

        Args:
            tasks: The tasks.

        Yields:
            Each task with its outcome.

        Raises:
            PlantError: This machine cannot run tasks: its disk is full, or has no folder for temporary files.

        """
        for task in tasks:
            payload = _make_payload(task)
            if isinstance(payload, Outcome):
                yield task, payload
                continue
            reply = execute_payload(payload)
            if reply["kind"] == ENDED:
                yield task, _read_reply(reply)
            elif reply["kind"] == NEEDS_BUILD:
                yield task, Outcome(Status.FAILED, messages=tuple(reply["messages"]))
            else:
                raise PlantError(f"{reply['messages'][0]}; make room there, or set $TMPDIR to another folder.")


@dataclass
class _Attempt:
    """A task with its worker, the builds that travel with it, the number of workers that it ended, and the time at
    which it is stopped."""

    task: Task
    builds: tuple[Mapping[str, Any], ...] = ()
    kills: int = 0
    worker: str = ""
    deadline: float = float("inf")


class DaskRunner:
    """Runs tasks on the admitted workers of a cluster, one task a worker at a time.

    This side chooses the worker: so it knows which task was on a worker that is lost, and an innocent one is never
    blamed.
    """

    def __init__(self, client: Client, say: Callable[[str], None], memory: str = "") -> None:
        self._client = client
        self._say = say
        self._memory = memory
        self._admission = Admission(client, say)
        self._sent_files = SentFiles()
        self._ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self._waiting: dict[Future[Any], _Attempt] = {}
        self._again: list[_Attempt] = []
        self._group = f"hdagen-{uuid.uuid4().hex[:8]}"
        self._group_holder: Future[Any] | None = None
        self._count = 0
        self._lonely_since = 0.0

    def run_tasks(self, tasks: Iterable[Task]) -> TaskEnds:
        """Run tasks on the cluster.

        Args:
            tasks: The tasks, taken as workers become free.

        Yields:
            Each task with its outcome, as it ends.

        Raises:
            PlantError: The scheduler is lost, or no worker can take tasks.

        """
        coming = (_Attempt(task) for task in tasks)
        is_exhausted = False
        with self._explain_errors():
            self._admission.look_for_workers()  # all that are there take part from the beginning
            self._hold_group()
        while self._waiting or self._again or not is_exhausted:
            self._check_cluster()
            while idle := self._admission.admitted - {attempt.worker for attempt in self._waiting.values()}:
                attempt = self._again.pop() if self._again else next(coming, None)
                if attempt is None:
                    is_exhausted = True
                    break
                if not attempt.builds or attempt.worker not in idle:  # a build goes to the worker that asked for it
                    attempt.worker = min(idle)
                if (unsent := self._submit(attempt)) is not None:
                    yield attempt.task, unsent
            for attempt, outcome in (*self._take_back_lost(), *self._stop_overdue(), *self._collect_ended()):
                yield attempt.task, outcome

    def _hold_group(self) -> None:
        """Keep one result, so that the group of all tasks never ends: the scheduler remembers groups that ended."""
        if self._group_holder is None:
            self._group_holder = self._client.submit(int, key=(self._group, 0), pure=False)

    def _check_cluster(self) -> None:
        """Look for workers. Raises PlantError where none can take tasks."""
        if self._client.status != "running":  # a scheduler that comes back has forgotten the tasks
            raise self._explain_loss()
        with self._explain_errors():
            self._admission.look_if_due()
        if self._admission.admitted:
            self._lonely_since = 0.0
            return
        if self._admission.refused:
            address, why = next(iter(self._admission.refused.items()))
            raise PlantError(f"no worker of the cluster can take tasks; {address}: {why}.")
        now = time.monotonic()
        if not self._lonely_since:
            self._lonely_since = now
            self._say("the cluster has no worker at the moment; waiting for one.")
        if now - self._lonely_since > _LONGEST_WAIT_FOR_WORKERS:
            raise PlantError(f"the cluster had no worker for {_LONGEST_WAIT_FOR_WORKERS:g} s; start some.")

    @contextmanager
    def _explain_errors(self) -> Iterator[None]:
        """Turn whatever a call of the client raises once the scheduler is lost into PlantError."""
        try:
            yield
        except Exception as error:
            if isinstance(error, OSError) or self._client.status != "running":
                raise self._explain_loss() from error
            raise

    def _explain_loss(self) -> PlantError:
        return PlantError(
            "the cluster's scheduler is gone; what is finished is kept: start the scheduler, and give the same command "
            "again."
        )

    def _submit(self, attempt: _Attempt) -> Outcome | None:
        """Send a task to its worker; return its outcome where its files cannot be read."""
        payload = _make_payload(attempt.task, attempt.builds)
        if isinstance(payload, Outcome):
            return payload
        payload["files"] = self._sent_files.leave_out_kept(payload["files"], attempt.worker)
        self._count += 1
        attempt.deadline = time.monotonic() + attempt.task.longest_seconds
        key = (self._group, self._count)
        with self._explain_errors():
            future = self._client.submit(execute_on_worker, payload, key=key, workers=[attempt.worker], pure=False)
        self._waiting[future] = attempt
        future.add_done_callback(self._ended.put)
        return None

    def _take_back_lost(self) -> Iterator[tuple[_Attempt, Outcome]]:
        """Send the tasks of lost workers again; refuse those that ended too many."""
        for future, attempt in list(self._waiting.items()):
            if not self._admission.is_lost(attempt.worker):
                continue
            del self._waiting[future]
            self._sent_files.forget_worker(attempt.worker)
            with self._explain_errors():
                future.cancel(force=True)
            attempt.kills += 1
            if attempt.kills < MOST_KILLED_WORKERS:
                self._again.append(attempt)
            else:
                yield attempt, self._refuse_killer(attempt.kills)

    def _collect_ended(self) -> Iterator[tuple[_Attempt, Outcome]]:
        """Outcomes of tasks that ended, after waiting a moment for the first."""
        patience = _TIME_CHECK_INTERVAL if self._waiting else _LONELY_CHECK_INTERVAL
        with suppress(queue.Empty):
            while True:
                future = self._ended.get(timeout=patience)
                patience = 0.0
                attempt = self._waiting.get(future)
                if attempt is None:  # it was taken back
                    continue
                outcome = self._judge_future(future, attempt)
                del self._waiting[future]
                if outcome is not None:
                    yield attempt, outcome

    def _judge_future(self, future: Future[Any], attempt: _Attempt) -> Outcome | None:
        """The outcome of a task; None where it is sent again. Raises PlantError where the scheduler is lost."""
        from distributed import CancelledError, KilledWorker

        try:
            reply = future.result(timeout=_REPLY_SECONDS)
        except TimeoutError:  # the worker was lost with the result
            self._again.append(attempt)
            return None
        except KilledWorker as error:
            return self._refuse_killer(error.allowed_failures + 1)
        except CancelledError:
            raise self._explain_loss() from None
        except Exception as error:
            if self._client.status != "running":
                raise self._explain_loss() from error
            if "deserialization" in str(error):
                raise PlantError(
                    "the scheduler cannot read tasks; install the same hdagen beside it, as on the workers."
                ) from None
            return Outcome(Status.FAILED, messages=(f"{type(error).__name__}: {error}",))
        if reply["kind"] == ENDED:
            return _read_reply(reply)
        if reply["kind"] == NEEDS_BUILD:
            return self._send_build(attempt, reply)
        if reply["kind"] == NEEDS_FILES:  # it was started again under its address
            self._sent_files.forget_contents(attempt.worker, reply["lacking"])
            self._again.append(attempt)
            return None
        self._admission.dismiss(attempt.worker, reply["messages"][0])
        self._again.append(attempt)
        return None

    def _refuse_killer(self, count: int) -> Outcome:
        limit = ""
        if self._memory:
            limit = f", or needed more than {self._memory} of memory"
        said = (
            f"it ended its worker process {count} times (the process crashed or was killed{limit}) and is not tried "
            "again; run it alone to see why, or change its files."
        )
        return Outcome(Status.REFUSED, messages=(said,))

    def _send_build(self, attempt: _Attempt, reply: Mapping[str, Any]) -> Outcome | None:
        """Make the build that a worker without a compiler asks for, and send the task with it."""
        if len(attempt.builds) >= MOST_BUILDS_OF_TASK:
            return Outcome(Status.FAILED, messages=tuple(reply["messages"]))
        try:
            built = pack_build(reply["wanted"])
        except PlantError as error:
            return Outcome(Status.FAILED, messages=tuple(str(error).splitlines()))
        self._say(f"worker {attempt.worker} has no compiler; it gets the build {built['folder']}.")
        attempt.builds = (*attempt.builds, built)
        self._again.append(attempt)
        return None

    def _stop_overdue(self) -> Iterator[tuple[_Attempt, Outcome]]:
        """Stop the tasks that took too long, with their workers."""
        now = time.monotonic()
        for future, attempt in list(self._waiting.items()):
            if now < attempt.deadline:
                continue
            del self._waiting[future]
            with self._explain_errors():
                future.cancel(force=True)
                self._client.run(end_process, workers=[attempt.worker], wait=False)
            self._sent_files.forget_worker(attempt.worker)
            said = f"it was stopped after {attempt.task.longest_seconds:g} s."
            yield attempt, Outcome(Status.FAILED, messages=(said,), seconds=attempt.task.longest_seconds)

    def cancel_all(self) -> None:
        """Take back what was sent and has not ended."""
        from distributed.client import ClosedClientError

        for future in self._waiting:
            with suppress(OSError, RuntimeError, ClosedClientError):  # the scheduler is lost
                future.cancel(force=True)
        self._waiting.clear()


def _make_payload(task: Task, builds: tuple[Mapping[str, Any], ...] = ()) -> dict[str, Any] | Outcome:
    """The payload of a task, or its outcome where a file cannot be read."""
    try:
        return task.make_payload(builds)
    except OSError as error:
        return Outcome(Status.FAILED, messages=(f"{error.filename}: {error.strerror}.",))


def _read_reply(reply: Mapping[str, Any]) -> Outcome:
    return Outcome(
        Status(reply["status"]),
        reply["row"],
        tuple(reply["messages"]),
        reply["files"],
        reply["seconds"],
        reply["processor_seconds"],
    )
