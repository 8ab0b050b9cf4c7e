"""Checks for mistakes in a log by its own numbers, one kind a file; `hdagen.triage` runs them."""
