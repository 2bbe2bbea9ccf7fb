"""Runs against measurements and published numbers."""
