"""Neighbour searches: the interface, the search by cells and the one by jax-md."""
