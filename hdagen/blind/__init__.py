"""Blind checks of `hdagen diagnose`: realities by another simulator, sealed labels, scores.

``cases`` draws cases of two families: ``arms`` with springs (``sizes`` states their effects and typical sizes,
``drivetrain`` and ``reality`` simulate them, ``motion`` draws their motion) and rigid ``joints`` (``joint_reality``
simulates them, ``travel`` draws their motion). ``seal`` seals and verifies the labels, ``run`` diagnoses the cases,
``score`` scores the verdicts, ``blind_page`` shows the scores, ``calibrate`` fits and freezes a calibration.
Nothing here reads the generated model or its equations; docs/method/blind_check.md describes the checks.
"""

KINDS = ("single", "background", "none", "unknown", "unknown+one", "pair", "task", "joint")
LOG_SECONDS = {**dict.fromkeys(KINDS, 10.0), "joint": 24.0}  # usual length of a log
