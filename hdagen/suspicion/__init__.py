"""Mistakes in a log that its own numbers give away, one kind a file; see triage."""
