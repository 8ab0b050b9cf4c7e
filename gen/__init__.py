"""Robot arms as equations: symbols in, C out. The only package that imports casadi and sympy."""

import sys

if sys.platform == "win32":
    raise ImportError("hdagen does not run on Windows; use Linux, there or in the Windows Subsystem for Linux.")
