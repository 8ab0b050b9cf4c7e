"""What every room stands on: files written whole, files read with care, processes, threads and messages."""
