"""The schema of diagnosis.json, and documents of its first schema with the keys of the present one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SCHEMA = 2  # of the documents that this version writes
FIRST_SCHEMA = 1  # of those that earlier versions wrote, which are still read
RENAMED_KEYS = {  # key of a document of the first schema -> its key here
    "alone": "direct_evidence",
    "doubted": "doubts",
    "tolerated": "nuisance_effects",
    "unseen": "undetectable",
    "ladder": "ranking",
}
RENAMED_METHOD_KEYS = {  # the same of the table `method`
    "uncalibrated": "uncalibrated_probability",
    "present_from": "present_size",
    "sure_below": "most_doubt",
    "tolerated_share": "nuisance_width",
}


def upgrade_content(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Give a document of the first schema the keys of the present one.

    Args:
        content: Of a diagnosis.json of any schema, or of a file that is none.

    Returns:
        The document of the present schema; any other document unchanged.

    """
    schema = content.get("schema")
    if type(schema) is not int or schema != FIRST_SCHEMA:
        return content
    upgraded = _rename_keys(content, RENAMED_KEYS) | {"schema": SCHEMA}
    if isinstance(method := content.get("method"), Mapping):
        upgraded["method"] = _rename_keys(method, RENAMED_METHOD_KEYS)
    return upgraded


def _rename_keys(table: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """A table with other names for some of its keys, in the same order."""
    return {names.get(key, key): value for key, value in table.items()}
