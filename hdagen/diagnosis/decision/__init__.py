"""Calibrated probabilities of the sets, what the motion cannot tell, and what diagnosis.json says of them."""
