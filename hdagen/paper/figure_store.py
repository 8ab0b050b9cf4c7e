"""The files of a figure: drawn, written atomically, and left alone while none of their inputs has changed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from hdagen.arm.build_loader import PlantError
from hdagen.log.measured_log import write as write_log
from hdagen.paper.drawing import draw_result
from hdagen.paper.paper_page import make_section
from hdagen.paper.prototype.figure_result import Result
from hdagen.support.atomic_write import write_atomically
from hdagen.support.input_file import InputFileError, read_json

FIGURE_SCHEMA = 1
LARGEST_JSON = 10_000_000  # bytes of a figure's JSON
SECTIONS_FOLDER = "sections"  # folder of the page's sections


@cache
def hash_inputs(builds: tuple[str, ...]) -> str:
    """Hash the inputs of all figures: this package's own code, and the builds of the arms.

    Args:
        builds: names of the builds' folders, which hold a hash of their content.

    Returns:
        The hash, hexadecimal.

    """
    digest = hashlib.sha256()
    for path in sorted(Path(str(resources.files("hdagen"))).rglob("*.py")):
        digest.update(path.read_bytes())
    digest.update("\n".join(builds).encode())
    return digest.hexdigest()[:16]


def read_finished(folder: Path, name: str, came_from: str) -> dict[str, Any] | None:
    """Read the JSON of a finished figure.

    Args:
        folder: of the results.
        name: of the figure.
        came_from: hash of the inputs, as `hash_inputs` gives it.

    Returns:
        The JSON of a figure whose files are complete and come from these inputs; None where it has to be made.

    """
    try:
        content = read_json(folder / f"{name}.json", LARGEST_JSON, "make it again")
        same = content["schema"] == FIGURE_SCHEMA and content["inputs"] == came_from
        kept = same and all(digest_file(folder / file) == digest for file, digest in content["files"].items())
    except (InputFileError, OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    if not kept:
        return None
    return dict(content)


def store_figure(folder: Path, result: Result, came_from: str, seconds: float) -> dict[str, Any]:
    """Write a figure's files. Its JSON is the last, and tells that the others are complete.

    Args:
        folder: of the results.
        result: the figure or table.
        came_from: hash of the inputs, as `hash_inputs` gives it.
        seconds: that it took to make.

    Returns:
        The content of the JSON.

    Raises:
        PlantError: matplotlib is missing, or a file cannot be written.

    """
    svg, png = draw_result(result)
    part = json.dumps(make_section(result), ensure_ascii=False, indent=1).encode()
    files = {f"{result.name}.svg": svg, f"{result.name}.png": png, f"{SECTIONS_FOLDER}/{result.name}.json": part}
    try:
        (folder / SECTIONS_FOLDER).mkdir(parents=True, exist_ok=True)
        (folder / f"{result.name}.json").unlink(missing_ok=True)
        for file, written in files.items():
            write_atomically(folder / file, written)
        logs, robots = {}, dict[bytes, str]()
        for end, log in result.logs.items():
            file = f"{result.name}_{end}.parquet"
            write_log(log, folder / file)
            robot = result.robots.get(end, "paper_prototype")
            if not isinstance(robot, str):
                robot = robots.setdefault(robot, f"{result.name}_{end}.toml")
            logs[file] = robot
        for text, file in robots.items():  # one for all logs of the same arm
            files[file] = text
            write_atomically(folder / file, text)
        content = {
            "schema": FIGURE_SCHEMA, "name": result.name, "title": result.title, "text": result.text,
            "claims": [as_json_value(asdict(claim)) for claim in result.claims],
            "choices": [asdict(choice) for choice in result.choices],
            "numbers": as_json_value(result.numbers), "logs": logs, "inputs": came_from, "seconds": round(seconds, 2),
            "files": {file: digest_file(folder / file) for file in [*files, *logs]},
        }  # fmt: skip
        whole = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
        write_atomically(folder / f"{result.name}.json", whole.encode())
    except OSError as error:
        raise PlantError(f"{folder}: {error.strerror}; choose another place with --out.") from None
    return content


def keep_figure(folder: Path, name: str, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Keep the files of a figure that another process made; its JSON is the last.

    Args:
        folder: of the results.
        name: of the figure.
        files: content of files by name, of this figure and others.

    Returns:
        The content of the figure's JSON.

    Raises:
        PlantError: a file cannot be written.

    """
    said = files[f"{name}.json"]
    content: dict[str, Any] = json.loads(said)
    try:
        (folder / SECTIONS_FOLDER).mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.json").unlink(missing_ok=True)
        for file in content["files"]:
            write_atomically(folder / file, files[file])
        write_atomically(folder / f"{name}.json", said)
    except OSError as error:
        raise PlantError(f"{folder}: {error.strerror}; choose another place with --out.") from None
    return content


def read_sections(folder: Path, names: Sequence[str]) -> list[dict[str, Any]]:
    """Read the page's sections of finished figures.

    Args:
        folder: of the results.
        names: of the figures.

    Returns:
        Their sections, as `hdagen.paper.paper_page.make_section` made them.

    """
    return [json.loads((folder / SECTIONS_FOLDER / f"{name}.json").read_text(encoding="utf-8")) for name in names]


def as_json_value(value: Any) -> Any:
    """Convert a value to one that JSON takes: numbers to nine digits, None in place of NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): as_json_value(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [as_json_value(entry) for entry in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.9g}") if math.isfinite(value) else None
    return value


def digest_file(path: Path) -> str:
    """Hash a file, so that a change of it is noticed."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]
