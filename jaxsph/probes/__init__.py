"""Probes of a run: gauges, sensors, readings of parts, energies, noise."""
