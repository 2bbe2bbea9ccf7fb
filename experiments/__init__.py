"""Runs that show what the solver does: each prints its numbers (`python -m experiments.<name>`)."""
