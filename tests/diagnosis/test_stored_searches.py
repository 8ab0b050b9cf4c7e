"""A diagnosis decided again from its stored searches says the same to the bit; hostile files are refused."""

from __future__ import annotations

import io
import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wrist

from hdagen import diagnose
from hdagen.diagnosis.diagnosis import Diagnosis
from hdagen.diagnosis.judged_search import JudgedSearch
from hdagen.diagnosis.search import stored_searches
from hdagen.diagnosis.search.stored_searches import SEARCHES_FILE
from hdagen.diagnosis.stored_diagnosis import StoredDiagnosis, read_diagnosis
from hdagen.log.measured_log import Log
from hdagen.support.input_file import InputFileError


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("stored") / "robot.toml"
    file.write_text(wrist.ROBOT)
    return file


@pytest.fixture(scope="module")
def machine_log(robot: Path) -> Log:
    """A log of a machine with three times the file's Coulomb friction."""
    return wrist.move_wrist(robot, {"coulomb_friction_1": 3.0}, 5.0)


@pytest.fixture(scope="module")
def found(robot: Path, machine_log: Log) -> Diagnosis:
    """A diagnosis with its second search, and with springs in its rigid joint, saved beside the robot file."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(JudgedSearch, "is_file_in_doubt", True)
        made = diagnose(robot, [machine_log])
    made.save_searches(robot.parent)
    return made


@pytest.fixture(scope="module")
def stored(robot: Path, machine_log: Log, found: Diagnosis) -> StoredDiagnosis:
    return read_diagnosis(robot, [machine_log], robot.parent / SEARCHES_FILE)


def test_the_stored_searches_decide_the_same_to_the_bit(
    found: Diagnosis, stored: StoredDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(JudgedSearch, "is_file_in_doubt", True)
    again = stored.decide_again()
    assert not again["lacks_search"]
    expected = found.content
    for key in ("verdict", "sure", "hypotheses", "method"):
        assert json.dumps(again[key]) == json.dumps(expected[key]), key
    for key in ("effect", "joint", "probability", "parameters"):
        assert json.dumps([one[key] for one in again["causes"]]) == json.dumps([one[key] for one in expected["causes"]])
    for key in ("before", "after", "achievable", "interval"):
        assert json.dumps(again["gap"][key]) == json.dumps(expected["gap"][key]), key
    assert again["verdict"] == ["coulomb_friction@1"]


def test_both_searches_come_back_whole(found: Diagnosis, stored: StoredDiagnosis) -> None:
    searches = found.result.searches
    assert searches.with_numbers is not None and stored.searches.with_numbers is not None
    assert searches.as_stated is not None and stored.searches.as_stated is not None
    for made, read in (
        (searches.as_stated, stored.searches.as_stated),
        (searches.with_numbers, stored.searches.with_numbers),
    ):
        assert [one.names for one in made.fits] == [one.names for one in read.fits]
        assert [one.evidence_here for one in made.fits] == [one.evidence_here for one in read.fits]
        for one, other in zip(made.fits, read.fits, strict=True):
            assert np.array_equal(one.posterior[1], other.posterior[1])
            assert [one.tempered_evidence(2.0, some) for some in one.subsets] == [
                other.tempered_evidence(2.0, some) for some in other.subsets
            ]
        assert [one.presence_probability for one in made.screened] == [
            one.presence_probability for one in read.screened
        ]


def test_a_decision_that_asks_for_a_search_which_was_not_needed_says_so(
    stored: StoredDiagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(JudgedSearch, "is_file_in_doubt", True)
    lacking = StoredDiagnosis(stored.judge, type(stored.searches)(stored.searches.null, stored.searches.as_stated))
    assert lacking.decide_again()["lacks_search"]


def _damage_tree(change: Callable[[dict[str, Any]], Any]) -> Callable[[bytes], bytes]:
    """Damage that changes the tree of a file."""

    def damage(content: bytes) -> bytes:
        arrays = dict(np.load(io.BytesIO(content)))
        tree = json.loads(arrays["tree"].tobytes())
        change(tree)
        arrays["tree"] = np.frombuffer(json.dumps(tree).encode(), np.uint8)
        file = io.BytesIO()
        np.savez(file, **arrays)
        return file.getvalue()

    return damage


def _damage_text(seed: int) -> Callable[[bytes], bytes]:
    """Damage that cuts a piece out of the tree's text, or overwrites one."""

    def damage(content: bytes) -> bytes:
        chance = random.Random(seed)
        arrays = dict(np.load(io.BytesIO(content)))
        text = bytearray(arrays["tree"].tobytes())
        at = chance.randrange(len(text))
        text[at : at + chance.choice([1, 5, 300])] = chance.choice([b"", b"0", b"{}", b"null", b"[[", b"-1", b"9" * 30])
        file = io.BytesIO()
        np.savez(file, **(arrays | {"tree": np.frombuffer(bytes(text), np.uint8)}))
        return file.getvalue()

    return damage


def _flip_bit(seed: int) -> Callable[[bytes], bytes]:
    """Damage of one bit of the archive."""

    def damage(content: bytes) -> bytes:
        chance = random.Random(seed)
        flipped = bytearray(content)
        flipped[chance.randrange(len(flipped))] ^= 1 << chance.randrange(8)
        return bytes(flipped)

    return damage


@pytest.mark.parametrize("make_damage", [_damage_text, _flip_bit])
def test_random_damage_is_read_or_refused(
    robot: Path, stored: StoredDiagnosis, tmp_path: Path, make_damage: Callable[[int], Callable[[bytes], bytes]]
) -> None:
    content, path = (robot.parent / SEARCHES_FILE).read_bytes(), tmp_path / SEARCHES_FILE
    simulators = {stored_searches.RIGID: stored.searches.null.sensitivities.shooting}
    refused = 0
    for seed in range(40):
        path.write_bytes(make_damage(seed)(content))
        try:
            stored_searches.read_searches(path, stored.judge.models.full.effects, simulators)
        except InputFileError:
            refused += 1
    assert refused > 20


@pytest.mark.parametrize("beginning", [b",'descr'", b"('descr'", b"{\n'descr"])
def test_a_damaged_header_of_an_array_is_refused(
    robot: Path, stored: StoredDiagnosis, tmp_path: Path, beginning: bytes
) -> None:
    content, path = (robot.parent / SEARCHES_FILE).read_bytes(), tmp_path / SEARCHES_FILE
    simulators = {stored_searches.RIGID: stored.searches.null.sensitivities.shooting}
    path.write_bytes(content.replace(b"{'descr'", beginning, 1))
    with pytest.raises(InputFileError, match="holds no searches"):
        stored_searches.read_searches(path, stored.judge.models.full.effects, simulators)


def _shorten_parameters(content: bytes) -> bytes:
    """A file whose arrays of floats have one entry less."""
    arrays = {
        name: one[:-1] if one.ndim == 1 and one.dtype == float else one
        for name, one in np.load(io.BytesIO(content)).items()
    }
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def _add_objects(content: bytes) -> bytes:
    """A file with an array of Python objects, which only an unpickler could read."""
    file = io.BytesIO()
    np.savez(file, tree=np.array([{"a": 1}], object), allow_pickle=True)
    return file.getvalue()


def _pack_too_much(content: bytes) -> bytes:
    """A small file that unpacks to more than is possible."""
    file = io.BytesIO()
    np.savez_compressed(file, tree=np.zeros(2 * len(content), np.uint8))
    return file.getvalue()


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[: len(content) // 2],
        lambda content: b"\x80\x04\x95not a pickle",
        _damage_tree(lambda tree: tree.update(root={"tuple": []})),
        _damage_tree(lambda tree: tree["objects"].insert(0, ["Path", ["/"]])),
        _damage_tree(lambda tree: tree["objects"].reverse()),
        _damage_tree(lambda tree: tree.update(root={"effect": "no_such_effect"})),
        _damage_tree(lambda tree: tree.update(root={"array": 0, "set": []})),
        _shorten_parameters,
        _add_objects,
        _pack_too_much,
    ],
)
def test_a_damaged_file_is_refused_in_a_sentence(
    robot: Path,
    stored: StoredDiagnosis,
    tmp_path: Path,
    damage: Callable[[bytes], bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = (robot.parent / SEARCHES_FILE).read_bytes()
    monkeypatch.setattr(stored_searches, "LARGEST_SEARCHES_BYTES", len(content) + 1000)
    path = tmp_path / SEARCHES_FILE
    path.write_bytes(damage(content))
    simulators = {stored_searches.RIGID: stored.searches.null.sensitivities.shooting}
    with pytest.raises(InputFileError, match="--keep-searches` writes"):
        stored_searches.read_searches(path, stored.judge.models.full.effects, simulators)
