"""The predictive controller measured: against other laws, other solvers and the converged problem."""
