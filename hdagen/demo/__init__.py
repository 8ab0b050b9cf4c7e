"""What `hdagen demo` simulates, replays and shows."""
