"""Schemes that advance the water: weakly compressible and incompressible SPH, integrators and solvers."""
