"""The logger of a library: silent until its user asks for records."""

from __future__ import annotations

import logging


def make_quiet_logger(name: str) -> logging.Logger:
    """Get a logger that prints nothing by itself.

    Args:
        name: Its name; loggers below it are silent as well.

    Returns:
        The logger, with a handler that drops every record.

    """
    logger = logging.getLogger(name)
    if not any(isinstance(handler, logging.NullHandler) for handler in logger.handlers):
        logger.addHandler(logging.NullHandler())
    return logger
