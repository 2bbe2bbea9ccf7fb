"""Neighbour searches: the interface, the search by cells, the search by jax-md, and the tables."""
