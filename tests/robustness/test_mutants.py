"""Thousands of damaged files, none of which may end in anything but a reading or a sentence."""

from __future__ import annotations

import resource
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mutants
import pyarrow.parquet as pq
import pytest
from mutants import MOST_MEMORY, campaign, drawn, fate, kinds, mutant, tried, try_batch

from hdagen.campaign.task import TaskFolder


def test_two_thousand_damaged_files_are_read_or_refused_in_sentences(tmp_path: Path) -> None:
    every = kinds(tmp_path)
    before = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    counts, wrong = tried(every, 2000, tmp_path)
    assert wrong == []
    assert sum(counts.values()) == 2000
    outcomes = {
        outcome: sum(n for name, n in counts.items() if name.endswith(outcome)) for outcome in ("read", "refused")
    }
    assert outcomes["read"] > 100 and outcomes["refused"] > 1000  # the damage is neither none nor total
    assert {name.split()[0] for name in counts} == {kind.name for kind in every if kind.share}
    assert 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss <= max(before, MOST_MEMORY)


def test_what_is_not_damaged_is_read(tmp_path: Path) -> None:
    for kind in kinds(tmp_path):
        for seed in kind.seeds.values():
            assert fate(kind, seed, tmp_path) == "read", kind.name


def test_a_mutant_can_be_made_again(tmp_path: Path) -> None:
    kind, number = list(drawn(kinds(tmp_path), 100))[-1]
    assert mutant(kind, number) == mutant(kind, number) != mutant(kind, number + 1)


def test_a_campaign_goes_on_where_it_was_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Batches of two controller files; the second call tries the second batch alone."""
    monkeypatch.setattr(mutants, "BATCH", 2)
    tried_before: list[int] = []

    def interrupt_second(folder: TaskFolder, parameters: Mapping[str, Any]) -> dict[str, Any]:
        tried_before.append(parameters["first"])
        if len(tried_before) == 2:
            raise KeyboardInterrupt
        return try_batch(folder, parameters)

    monkeypatch.setattr(mutants, "try_batch", interrupt_second)
    counts, wrong, interrupted = campaign(["controller.toml"], 4, tmp_path)
    assert (counts.total(), wrong, interrupted) == (2, [], True)
    counts, wrong, interrupted = campaign(["controller.toml"], 4, tmp_path)
    assert (counts.total(), wrong, interrupted) == (4, [], False) and tried_before == [0, 2, 2]
    assert "1 of 2 were finished before and are kept, 1 are left." in capsys.readouterr().err
    rows = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert [(row["task"], row["status"], row["wrong"]) for row in rows] == [
        ("from 0 on", "done", "[]"),
        ("from 2 on", "done", "[]"),
    ]


@pytest.mark.campaign
@pytest.mark.parametrize(("names", "count"), [([], 100_000), (["log.mat"], 1000)])
def test_a_campaign_finds_no_death_no_hang_and_no_traceback(names: list[str], count: int, tmp_path: Path) -> None:
    counts, wrong, _ = campaign(names, count, tmp_path)
    print(counts)
    assert wrong == []


def test_an_encoder_that_stands_exactly_still_divides_by_nothing(tmp_path: Path) -> None:
    kind = next(kind for kind in kinds(tmp_path) if kind.name == "columns.toml")
    assert fate(kind, mutant(kind, 3822), tmp_path) in ("read", "refused")
