"""C text of the model's functions: statements, vector lanes, closed loops and headers."""
