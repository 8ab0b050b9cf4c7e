"""What is measured of this project: times and sizes against their bars, and the figures of README and docs."""
