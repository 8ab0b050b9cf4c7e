"""The functions at the top of `hdagen`: robots, logs and diagnoses as callers have them, in and out."""
