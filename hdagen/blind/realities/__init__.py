"""Cases drawn from a seed, and the other simulator that makes their logs."""
