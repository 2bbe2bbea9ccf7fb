"""Runs against exact solutions and theory."""
