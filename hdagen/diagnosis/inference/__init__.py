"""The linear model of all windows, its evidence for every set of effects, and the fit of one set."""
