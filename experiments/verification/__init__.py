"""Comparisons with exact solutions and theory."""
