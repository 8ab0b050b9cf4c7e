"""The searches of a diagnosis in a file, from which the diagnosis can be decided again without any fit.

The file holds numbers, names and the tree that they stand in. It is an NPZ archive whose entry `tree` is JSON, and
whose other entries are the arrays of that tree. Models and logs are not in it: whoever reads it has the robot file and
the logs.
"""

from __future__ import annotations

import io
import json
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.arrays import Array
from hdagen.arm.effect_catalogue import EffectCatalogue, EffectTraits
from hdagen.diagnosis.inference.candidate_priors import Candidate, CandidateSet, Column
from hdagen.diagnosis.inference.linear_gaussian import TotalNormalEquations
from hdagen.diagnosis.inference.local_fit import Fit
from hdagen.diagnosis.inference.marginal_likelihood import Posterior, ScoredHypothesis
from hdagen.diagnosis.inference.multiple_shooting import MultipleShooting
from hdagen.diagnosis.inference.sensitivities import OperatingPoint, Sensitivities
from hdagen.diagnosis.search.hypothesis_search import SearchResult
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_bytes

SEARCHES_FILE = "searches.npz"
LARGEST_SEARCHES_BYTES = 400_000_000
SPRINGS, RIGID = "springs", "rigid"  # the model with springs in rigid joints, and the one without
_REMEDY = "`hdagen diagnose --keep-searches` writes such a file"
DAMAGE_ERRORS = (  # that a damaged archive or a damaged tree raises
    *(ArithmeticError, AttributeError, EOFError, LookupError, MemoryError, RuntimeError, TypeError, ValueError),
    *(zipfile.BadZipFile, zlib.error, SyntaxError, tokenize.TokenError),  # the last two from the header of an array
)
_DTYPES = {np.dtype(one) for one in ("f8", "i8", "bool")}


@dataclass(frozen=True, eq=False)
class Searches:
    """All that the fits of a diagnosis found.

    Attributes:
        null: the fit without any effect, which has no columns.
        as_stated: the search that takes the robot file as right; None where the diagnosis needed none.
        with_numbers: the search with the file's numbers among the causes; None where the diagnosis needed none.
        begins_with_numbers: whether the latter was first.

    """

    null: Fit
    as_stated: SearchResult | None
    with_numbers: SearchResult | None = None
    begins_with_numbers: bool = False


STORED_CLASSES = {
    one.__name__: one
    for one in (
        Candidate,
        CandidateSet,
        Column,
        Fit,
        OperatingPoint,
        Posterior,
        ScoredHypothesis,
        Searches,
        SearchResult,
        Sensitivities,
        TotalNormalEquations,
    )
}


def write_searches(found: Searches, path: Path) -> None:
    """Write the searches of a diagnosis.

    Args:
        found: the searches.
        path: of the file.

    Raises:
        OSError: the file cannot be written.

    """
    writer = _TreeWriter()
    root = writer.encode(found)
    tree = json.dumps({"objects": writer.objects, "root": root}, separators=(",", ":"))
    file = io.BytesIO()
    arrays = {f"array_{k}": array for k, array in enumerate(writer.arrays)}
    np.savez(file, tree=np.frombuffer(tree.encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    write_atomically(path, file.getvalue())


def read_searches(path: Path, effects: EffectCatalogue, simulators: Mapping[str, MultipleShooting]) -> Searches:
    """Read the searches of a diagnosis.

    Args:
        path: of the file.
        effects: the catalogue of the model.
        simulators: the record on the model with springs, and on the one without; the former may be missing.

    Returns:
        The searches.

    Raises:
        InputFileError: the file cannot be read, or does not belong to these models.

    """
    content = read_bytes(path, LARGEST_SEARCHES_BYTES, _REMEDY)
    try:
        arrays = _read_arrays(content)
        tree = json.loads(arrays.pop("tree").tobytes())
        reader = _TreeReader(effects, simulators, [arrays[f"array_{k}"] for k in range(len(arrays))])
        for class_name, values in tree["objects"]:
            reader.restore_object(class_name, values)
        found = reader.decode(tree["root"])
    except DAMAGE_ERRORS as error:
        raise InputFileError(
            f"{path}: holds no searches of this robot and log ({type(error).__name__}: {str(error)[:200]}); {_REMEDY}."
        ) from None
    if not isinstance(found, Searches):
        raise InputFileError(f"{path}: holds no searches; {_REMEDY}.")
    return found


def needs_springs(path: Path) -> bool:
    """Tell whether a file of searches has fits of the model with springs.

    Args:
        path: of the file.

    Returns:
        Whether it has some.

    Raises:
        InputFileError: the file cannot be read.

    """
    content = read_bytes(path, LARGEST_SEARCHES_BYTES, _REMEDY)
    try:
        return f'{{"simulator":"{SPRINGS}"}}'.encode() in _read_arrays(content)["tree"].tobytes()
    except DAMAGE_ERRORS as error:
        raise InputFileError(f"{path}: holds no searches ({type(error).__name__}); {_REMEDY}.") from None


def _read_arrays(content: bytes) -> dict[str, Array]:
    """The arrays of an archive; ValueError where it would grow beyond the largest file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(one.file_size for one in archive.infolist()) > LARGEST_SEARCHES_BYTES:
            raise ValueError("its entries are too large")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive_of_arrays:
        return dict(archive_of_arrays)


@dataclass(eq=False)
class _TreeWriter:
    """Turns objects into JSON and arrays; each object and each array is written once."""

    objects: list[Any] = field(default_factory=list)
    arrays: list[Array] = field(default_factory=list)
    places: dict[int, dict[str, int]] = field(default_factory=dict)
    kept: list[Any] = field(default_factory=list)  # so that no other object takes the identity of one of them

    def encode(self, value: Any) -> Any:
        """The JSON of a value."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, tuple | list | frozenset | Mapping):
            return self._encode_collection(value)
        if isinstance(value, EffectTraits):
            return {"effect": value.name}
        if isinstance(value, MultipleShooting):
            return {"simulator": SPRINGS if _has_springs(value) else RIGID}
        if id(value) not in self.places:
            self.kept.append(value)
            self.places[id(value)] = self._store(value)
        return self.places[id(value)]

    def _encode_collection(self, value: Any) -> Any:
        if isinstance(value, Mapping):
            return {"mapping": [[self.encode(key), self.encode(one)] for key, one in value.items()]}
        if isinstance(value, frozenset):
            return {"set": sorted(value)}
        return {"list" if isinstance(value, list) else "tuple": [self.encode(one) for one in value]}

    def _store(self, value: Any) -> dict[str, int]:
        """Store an object or an array; return where it is."""
        if isinstance(value, np.ndarray | np.generic):
            self.arrays.append(np.asarray(value))
            return {"array" if isinstance(value, np.ndarray) else "number": len(self.arrays) - 1}
        if isinstance(value, Fit):
            value = value.without_columns()
        if STORED_CLASSES.get(type(value).__name__) is not type(value):
            raise TypeError(f"{type(value).__name__}: no file of searches has such an object.")
        values = [self.encode(getattr(value, one.name)) for one in fields(value)]
        self.objects.append([type(value).__name__, values])
        return {"object": len(self.objects) - 1}


@dataclass(eq=False)
class _TreeReader:
    """Makes the objects again, each after those that it holds."""

    effects: EffectCatalogue
    simulators: Mapping[str, MultipleShooting]
    arrays: list[Array]
    objects: list[Any] = field(default_factory=list)

    def restore_object(self, class_name: str, values: list[Any]) -> None:
        """Make the next object."""
        made_class = STORED_CLASSES[class_name]
        made = object.__new__(made_class)
        for one, value in zip(fields(made_class), values, strict=True):
            object.__setattr__(made, one.name, self.decode(value))
        if isinstance(made, Sensitivities):
            _check_point(made)
        self.objects.append(made)

    def decode(self, value: Any) -> Any:
        """The value of a piece of JSON."""
        if not isinstance(value, dict):
            return value
        ((kind, content),) = value.items()
        if kind in ("tuple", "list"):
            members = [self.decode(one) for one in content]
            return tuple(members) if kind == "tuple" else members
        if kind == "set":
            return frozenset(content)
        if kind == "mapping":
            return {self.decode(key): self.decode(one) for key, one in content}
        if kind == "effect":
            return self.effects[content]
        if kind == "simulator":
            return self.simulators[content]
        if kind == "object":
            return self.objects[content]
        if kind not in ("array", "number") or self.arrays[content].dtype not in _DTYPES:
            raise ValueError(f"found {kind} of an unknown type")
        return self.arrays[content] if kind == "array" else self.arrays[content][()]


def _has_springs(shooting: MultipleShooting) -> bool:
    """Whether a simulator's model has springs in joints that the robot file calls rigid."""
    return any(effect["name"] in shooting.arm.effects.series_springs for effect in shooting.arm.manifest["effects"])


def _check_point(at: Sensitivities) -> None:
    """Raise ValueError where a point does not belong to its model: compiled code relies on the lengths."""
    shooting, point = at.shooting, at.point
    if point.p.shape != shooting.arm.p.shape:
        raise ValueError(f"found {point.p.shape} parameters, the model has {shooting.arm.p.shape}")
    states = (len(shooting.record.starts), shooting.m)
    if point.initial_states.shape != states or any(one.dtype != float for one in (point.p, point.initial_states)):
        raise ValueError(f"found initial states of {point.initial_states.shape}, the record has {states}")
    if point.memory is not None and point.memory.shape != shooting.zero_memory.shape:
        raise ValueError(f"found a memory of {point.memory.shape}, the model has {shooting.zero_memory.shape}")
