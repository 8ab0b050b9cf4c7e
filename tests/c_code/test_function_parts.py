"""Long functions in parts: the interpreter's bits, wherever the results go."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest
from graphs import assembled, bits

from gen.c_code import function_parts


def test_a_function_in_parts_has_the_interpreters_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of 50 statements, whose inputs lie where the results go; runs of zeros are filled by loops."""
    f = next(one.graph for one in assembled("paper").functions if one.name == "rhs_jacobian")
    monkeypatch.setattr(function_parts, "LONGEST_FUNCTION", 100)
    monkeypatch.setattr(function_parts, "LONGEST_PART", 50)
    monkeypatch.setattr(function_parts, "LONG_RUN", 4)
    whole, parts = function_parts.emit_function(f, "every")
    assert len(parts) > 5
    assert any("for (int i" in part for part in parts)
    (tmp_path / "text.c").write_text("#include <math.h>\n" + whole + "\n".join(parts))
    command = ["cc", "-O2", "-ffp-contract=off", "-shared", "-fPIC", "text.c", "-o", "text.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "text.so"))
    pointer, rng = ctypes.POINTER(ctypes.c_double), np.random.default_rng(9)
    sizes = [f.numel_in(k) for k in range(f.n_in())], [f.numel_out(k) for k in range(f.n_out())]
    for _ in range(20):
        given = [rng.uniform(0.1, 1.0, size) for size in sizes[0]]
        expected = [np.array(part).ravel(order="F") for part in f(*given)]
        places = [np.resize(value, max(value.size, size)) for value, size in zip(given, sizes[1], strict=True)]
        shared = [place.ctypes.data_as(pointer) for place in places]
        library.hda_every(*shared, *shared)
        for place, part in zip(places, expected, strict=True):
            assert np.array_equal(bits(place[: part.size]), bits(part))
