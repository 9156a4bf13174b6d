"""Many logs: each worked on once, whoever does it, and put together."""
