"""A picture of a part of a page, by a headless Chromium.

    python docs/images/take_picture.py PAGE.html OUT.png TOP HEIGHT

TOP and HEIGHT are in pixels of the page, which is 960 wide. Pillow (the `paper` extra brings it) cuts the picture and
reduces it to 64 colours.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

WIDTH = 960


def take_picture(page: Path, out: Path, top: int, height: int) -> None:
    """Write the part of a page from ``top`` on as a PNG.

    Args:
        page: The page.
        out: The picture.
        top: First row, in pixels.
        height: Number of rows.

    """
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "page.png"
        size = f"--window-size={WIDTH},{top + height}"
        command = ["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", f"--screenshot={whole}", size]
        subprocess.run([*command, page.resolve().as_uri()], check=True, capture_output=True)
        with Image.open(whole) as picture:
            part = picture.convert("RGB").crop((0, top, WIDTH, top + height))
    part.quantize(64).save(out, optimize=True)


if __name__ == "__main__":
    take_picture(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
