"""The report of a diagnosis: sentences, maps, plots and the page."""
