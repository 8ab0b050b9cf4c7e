"""The model predictive controller's generated half: structure, stage function, sizes, OSQP's code, the whole problem
as truth."""
