"""The predictive controller's numeric half: what controller.toml says, the controller, closed loops, tables, its
page."""
