"""Rows to fit and rows to hold out, windows of them, and the gap over them."""
