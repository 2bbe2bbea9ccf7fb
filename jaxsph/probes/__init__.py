"""Probes of a run: gauges, sensors, devices, energies, noise."""
