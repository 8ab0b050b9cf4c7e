"""Blind checks of `hdagen diagnose`: realities by another simulator, sealed labels, scores.

`realities` draws cases of three families and makes their logs; `label_seal` seals and verifies the labels,
`sealed_check` has the cases diagnosed, `scores` and `score_summary` score the verdicts, `blind_page` shows the scores,
`rates` pools checks, `family_table` compares families, and `calibrate` fits and freezes a calibration.
Nothing here reads the generated model or its equations; docs/method/blind_check.md describes the checks.
"""
