"""Robot arms as equations: symbols in, C out. The only package that imports casadi and sympy."""
