"""A robot with the verdict of a diagnosis, as a model of other simulators, and the proof that it holds there."""
