"""Many logs of many machines, diagnosed one process each, and the page of what they have in common."""
