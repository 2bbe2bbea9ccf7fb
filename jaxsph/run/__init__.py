"""Runs: the pure function `simulate`, the host functions around it, chunks and results."""
