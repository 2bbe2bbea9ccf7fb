"""Studies with many runs: sweeps, slopes with respect to a parameter, and searches for the best values."""
