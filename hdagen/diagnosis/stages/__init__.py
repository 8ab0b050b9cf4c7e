"""The stages of a diagnosis by name, and optional ones that may fail."""
