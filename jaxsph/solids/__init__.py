"""Solids: shapes, walls and their ghosts, contact."""
