"""`python -m gen.builder.compiler_check`: whether the C compiler makes libraries, and which one it is."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from gen.builder.compiler import CompileError, compile_library, find_compiler
from gen.robot.value_reader import escape_control_characters

PROBE = "#include <math.h>\n\ndouble hda_probe(double x);\n\ndouble hda_probe(double x)\n{\n    return sin(x);\n}\n"


def main() -> int:
    """Compile a small library as a build does, and print the compiler's version.

    Returns:
        Exit code: 0 where the library was made, 2 where it was not; then standard error says why.

    """
    try:
        with TemporaryDirectory() as place:
            (Path(place) / "probe.c").write_text(PROBE)
            compile_library(Path(place), ["probe.c"], "portable", "probe.so", None)
        print(find_compiler().version)
    except (CompileError, OSError) as error:
        print("\n".join(map(escape_control_characters, str(error).split("\n"))), file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
