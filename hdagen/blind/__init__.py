"""Blind checks of `hdagen diagnose`: realities by another simulator, sealed labels, scores.

``cases`` draws, of two families: ``arms`` with springs (``sizes`` states their effects and typical sizes,
``drivetrain`` and ``reality`` simulate, ``motion`` moves) and rigid ``joints`` (``joint_reality``, ``travel``).
``seal`` closes and opens the labels, ``run`` diagnoses, ``score`` counts, ``blind_page`` shows, ``calibrate`` freezes.
Nothing here reads the generated model or its equations; docs/blind.md says what is what.
"""

KINDS = ("single", "background", "none", "unknown", "unknown+one", "pair", "task", "joint")
SECONDS = {kind: 24.0 if kind == "joint" else 10.0 for kind in KINDS}  # of a log, where nothing else is asked for
