"""Labels closed before a check and opened after it: a hash of them and of a nonce, both from the seed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


class SealError(Exception):
    """Labels that are not those that were sealed."""


@dataclass(frozen=True)
class Seal:
    """``digest``: SHA-256, hexadecimal, of the nonce and the canonical JSON of the labels; ``count`` of them."""

    digest: str
    count: int


def close(labels: Mapping[str, Any], seed: str) -> Seal:
    """The seal of ``labels``; the same labels and seed give the same, so that an interrupted check can go on."""
    nonce = hashlib.sha256(f"nonce\0{seed}".encode()).hexdigest()
    text = json.dumps(labels, sort_keys=True, separators=(",", ":"))
    return Seal(hashlib.sha256(f"{nonce}\n{text}".encode()).hexdigest(), len(labels))


def open_(labels: Mapping[str, Any], seed: str, seal: Seal) -> None:
    """Nothing where ``labels`` are what ``seal`` closed; raises SealError."""
    found = close(labels, seed)
    if found != seal:
        raise SealError(
            f"the labels are not those that were sealed: their hash is {found.digest}, sealed was {seal.digest}; "
            "the check counts for nothing, run it again."
        )


def seed_hash(seed: str) -> str:
    """SHA-256 by which a seed can be recognised without being told."""
    return hashlib.sha256(f"seed\0{seed}".encode()).hexdigest()
