"""A run: tasks that an earlier run finished are kept, the others are run, everything is written as it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace

from hdagen.campaign.campaign_progress import CampaignProgress
from hdagen.campaign.result_store import TABLE_FILE, ResultStore
from hdagen.campaign.task import Outcome, Status, Task
from hdagen.campaign.task_runner import TaskRunner


def run_campaign(
    tasks: Sequence[Task], store: ResultStore, runner: TaskRunner, say: Callable[[str], None]
) -> tuple[Mapping[str, Outcome], bool]:
    """Run the tasks that no earlier run finished, and write the table of all.

    Args:
        tasks: The tasks, each with a name of its own.
        store: Where results are kept.
        runner: What runs tasks.
        say: Hears how far the run is.

    Returns:
        Outcomes by the tasks' names in their order, without content of files, and whether an interrupt ended the run.

    Raises:
        PlantError: No further task can be run; what is finished is kept.
        OSError: A result cannot be written; what is finished is kept.

    """
    outcomes = {task.name: Outcome(Status.NOT_RUN) for task in tasks}
    todo = _keep_finished(tasks, store, outcomes, say)
    interrupted = False
    try:
        for task, outcome in run_arriving_tasks(todo, len(todo), store, runner, say):
            outcomes[task.name] = outcome
    except KeyboardInterrupt:
        interrupted = True
    finally:
        store.write_table(outcomes)
    return outcomes, interrupted


def run_arriving_tasks(
    tasks: Iterable[Task], count: int, store: ResultStore, runner: TaskRunner, say: Callable[[str], None]
) -> Iterator[tuple[Task, Outcome]]:
    """Run tasks, each of which may be made only when its turn has come, and keep what comes of them.

    Args:
        tasks: The tasks.
        count: How many they are at most.
        store: Where results are kept.
        runner: What runs tasks.
        say: Hears how far the run is.

    Yields:
        Each task with its outcome, without content of files, as it ends.

    Raises:
        PlantError: No further task can be run; what is finished is kept.
        OSError: A result cannot be written; what is finished is kept.

    """
    progress = CampaignProgress(count, say)
    inputs: dict[str, str] = {}

    def send() -> Iterator[Task]:
        for task in tasks:
            try:
                inputs[task.name] = task.hash_inputs()
            except OSError:
                inputs[task.name] = ""  # the runner says which file cannot be read
            yield task

    with closing(runner.run_tasks(send())) as ended:
        for task, outcome in ended:
            store.keep_outcome(task, inputs.pop(task.name), outcome)
            progress.note_end(task.name, outcome)
            yield task, replace(outcome, files={})


def _keep_finished(
    tasks: Sequence[Task], store: ResultStore, outcomes: dict[str, Outcome], say: Callable[[str], None]
) -> list[Task]:
    """Enter the outcomes of earlier runs; return the tasks that are left."""
    if store.is_table_broken():
        say(f"{store.folder / TABLE_FILE}: is broken; it is made again from the results of the tasks, which are kept.")
    todo = []
    for task in tasks:
        kept = store.find_finished(task)
        if kept is None:
            todo.append(task)
        else:
            outcomes[task.name] = kept
    if len(todo) < len(tasks):
        say(f"{len(tasks) - len(todo)} of {len(tasks)} were finished before and are kept, {len(todo)} are left.")
    return todo
