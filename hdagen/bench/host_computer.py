"""Where and when a figure was measured."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import time
from pathlib import Path

from hdagen.support.version import __version__


def describe_machine() -> dict[str, str]:
    """Describe the machine that takes a measurement: processor, load, versions and date, by name."""
    return {
        "processor": _read_processor_name(),
        "processors": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.1f}",  # programs that wanted to run, on average over the last minute
        "python": platform.python_version(),
        "numpy": importlib.metadata.version("numpy"),
        "casadi": importlib.metadata.version("casadi"),
        "hdagen": __version__,
        "date": time.strftime("%Y-%m-%d"),
    }


def _read_processor_name() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        text = ""
    lines = (line.split(":", 1)[1].strip() for line in text.splitlines() if line.startswith("model name"))
    return next(lines, platform.machine())
