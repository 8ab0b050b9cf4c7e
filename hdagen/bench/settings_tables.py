"""The settings of a diagnosis as tables of the docs, printed from the classes that declare them."""

from __future__ import annotations

from typing import Any

from hdagen.diagnosis.settings import STAGE_SETTINGS
from hdagen.support.setting_declaration import list_settings

COLUMNS = ("setting", "value", "unit", "reason", "chosen on")
PURE_NUMBER = "1"


def build_settings_table(stage: str) -> str:
    """Tabulate the settings of one stage, a line for each.

    Args:
        stage: Name of the stage, as `settings` of diagnosis.json has it.

    Returns:
        Markdown.

    """
    lines = [_format_row(COLUMNS), "|---" * len(COLUMNS) + "|"]
    for one in list_settings(STAGE_SETTINGS[stage]):
        unit = "" if one.unit == PURE_NUMBER else one.unit
        lines.append(_format_row((f"`{one.name}`", _format_value(one.value), unit, one.reason, one.chosen_on)))
    return "\n".join(lines) + "\n"


def _format_row(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


def _format_value(value: Any) -> str:
    if isinstance(value, tuple):
        together = "; " if isinstance(value[0], tuple) else ", "
        return together.join(_format_value(one) for one in value)
    return f"{value:g}" if isinstance(value, float) else f"{value:,}"
