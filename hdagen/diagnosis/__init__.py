"""Diagnosis: where model and reality part, which missing structure causes it, and how far the gap shrinks with it."""
