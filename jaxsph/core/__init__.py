"""Core: arrays, kernels, pair sums, the time loop and the neighbour search."""
