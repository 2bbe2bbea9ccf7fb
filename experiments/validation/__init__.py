"""Comparisons with measurements and published numbers."""
