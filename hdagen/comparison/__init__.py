"""Two diagnoses side by side: verdicts, probabilities, gaps and parameters, and where they agree."""
