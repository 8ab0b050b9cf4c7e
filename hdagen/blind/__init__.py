"""Blind checks of `hdagen diagnose`: realities by another simulator, sealed labels, scores.

``sizes`` states the effects and their typical sizes, ``drivetrain`` and ``reality`` simulate, ``motion`` moves,
``cases`` draws, ``seal`` closes and opens the labels, ``run`` diagnoses, ``score`` counts, ``blind_page`` shows,
``calibrate`` freezes. Nothing here reads the generated model or its equations; docs/blind.md says what is what.
"""

KINDS = ("single", "background", "none", "unknown", "pair", "task")
