"""OSQP's generated code for the sparse form of the problem, and the tables that fill its matrices."""

from __future__ import annotations

from gen.mpc.stage import Stage


def osqp_files(made: Stage) -> dict[str, str]:
    """File name -> text."""
    return {}
