"""From the null model to the sets of effects that lead: starts, screening, races, sets of two and three."""
