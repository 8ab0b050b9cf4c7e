"""Labels sealed before a check and verified after it, by a hash of them and of a nonce that the seed decides."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


class SealError(Exception):
    """The labels differ from the sealed ones."""


@dataclass(frozen=True)
class Seal:
    """``digest``: SHA-256, hexadecimal, of the nonce and the canonical JSON of the labels; ``count`` of them."""

    digest: str
    count: int


def seal_labels(labels: Mapping[str, Any], seed: str) -> Seal:
    """Seal labels; equal labels and seeds give equal seals, so that an interrupted check can go on.

    Args:
        labels: the label of each case, by the case's name; JSON values.
        seed: the seed of the check, which decides the nonce.

    Returns:
        The hash of nonce and labels, and how many labels there are.

    """
    nonce = hashlib.sha256(f"nonce\0{seed}".encode()).hexdigest()
    text = json.dumps(labels, sort_keys=True, separators=(",", ":"))
    return Seal(hashlib.sha256(f"{nonce}\n{text}".encode()).hexdigest(), len(labels))


def verify_seal(labels: Mapping[str, Any], seed: str, seal: Seal) -> None:
    """Verify that labels are the sealed ones.

    Args:
        labels: the label of each case, by the case's name.
        seed: the seed of the check.
        seal: the seal that `seal_labels` made before the check.

    Raises:
        SealError: the labels or the seed differ from the sealed ones.

    """
    found = seal_labels(labels, seed)
    if found != seal:
        raise SealError(
            f"the labels are not those that were sealed: their hash is {found.digest}, sealed was {seal.digest}; "
            "the check counts for nothing, run it again."
        )


def hash_seed(seed: str) -> str:
    """Hash a seed, so that it can be recognised without being revealed.

    Args:
        seed: the seed of a check.

    Returns:
        SHA-256, hexadecimal.

    """
    return hashlib.sha256(f"seed\0{seed}".encode()).hexdigest()
