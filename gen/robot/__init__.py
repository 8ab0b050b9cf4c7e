"""The robot file: its keys, how it is read and checked, and the numbers that follow from it."""
