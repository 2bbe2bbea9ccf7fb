"""Runs: the pure `simulate`, the host's `run`, `resume` and `march` around it, chunks, results."""
