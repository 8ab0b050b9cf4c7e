"""The text that decides what a compiler makes of a source, found without a compiler.

It is the source with every header beside it that it includes. Sizes and numbers of a robot are macros of their own
headers; of these only those count that the text names, so that robots of the same structure share objects.
"""

from __future__ import annotations

import re
from pathlib import Path

MACRO_HEADERS = ("hda_sizes.h", "hda_mpc_sizes.h")  # a macro a line, and no name of one is joined by ##
INCLUDED = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([^"]+)"', re.MULTILINE)
MACRO = re.compile(rb"^#define (HDA_\w+).*\n", re.MULTILINE)
NAME = re.compile(rb"HDA_\w+")


def collect_deciding_text(folder: Path, source: str) -> bytes:
    """Collect a source, the headers beside it that it includes, and the macros of the robot that these name.

    Args:
        folder: Where the source and the headers of the build lie.
        source: File name of the source.

    Returns:
        The text: the source, every header once, and the lines of the macros.

    """
    texts, names = list[bytes](), [source]
    macros = dict[bytes, bytes]()
    for name in names:  # which grows meanwhile
        text = (folder / name).read_bytes()
        found = [included.decode() for included in INCLUDED.findall(text)]
        names += [one for one in dict.fromkeys(found) if one not in names and (folder / one).is_file()]
        if name in MACRO_HEADERS:
            macros |= {line.group(1): line.group(0) for line in MACRO.finditer(text)}
            text = MACRO.sub(b"", text)
        texts.append(text)
    for text in texts:  # which grows by macros, for these name others
        named = {*NAME.findall(text)} & macros.keys()
        texts += [macros.pop(name) for name in sorted(named)]
    return b"".join(texts)
